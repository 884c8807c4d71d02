# SPDX-License-Identifier: Apache-2.0
"""CiA 402 drive in torque mode: one command per tick, enabled only on request.

The driver writes zero torque unless the drive shows operation enabled on request and no fault is
latched. `drive_logic` decides what to send; this module sends it.
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace

from ..can_io.bus_load import Traffic
from ..can_io.port import SYNC_ID, Port
from ..samples import DriveReading
from ..settings import validated
from ..units import from_per_mille, to_per_mille
from . import cia402, drive_exit
from . import drive_setup as setup
from .cia402 import Goal, State
from .drive_logic import DriveLogic
from .drive_reports import DriveCounters, DriveReports
from .drive_settings import BRAKE, DriveSettings, cross_checked, drive_traffic
from .drive_torque import ExcessTorque
from .errors import BusError, DeviceError, NotConfigured, NotEnabled, Occupied
from .heartbeat import Heartbeat
from .node import CanopenNode

#: RPDO1: controlword, target torque [per mille of the rated torque].
_COMMAND = struct.Struct("<Hh")
_HEARTBEATS_MISSED = 3


class Drive:
    """Driver of one drive; `heartbeat`, `sync` and `write` belong to the realtime loop.

    warnings: for the user, such as missing guards. unguarded: the guards that the drive refused.
    reports: decoded answers of the drive. beat: our heartbeat, shared by the drives of one bus;
    the driver creates it if none is given. per_turn: change of position per turn: the screw's lead
    [m], or 2 pi for a joint [rad].
    """

    def __init__(
        self,
        port: Port,
        settings: DriveSettings,
        label: str = "drive",
        beat: Heartbeat | None = None,
        per_turn: float = 2.0 * math.pi,
    ):
        self.settings = cross_checked(validated(settings))
        self.label = label
        self.counters = DriveCounters()
        self.warnings: list[str] = []
        self.unguarded: tuple[setup.MissingGuard, ...] = ()
        self.beat = beat or Heartbeat(port, settings.master_id, settings.heartbeat_period)
        self._port = port
        silence = _HEARTBEATS_MISSED * settings.drive_heartbeat
        brake = settings.stop_reaction == BRAKE
        self._logic = DriveLogic(label, brake, settings.enable_timeout, silence)
        position_of = settings.direction * per_turn / settings.counts_per_turn
        self.reports = DriveReports(
            port, settings, label, self._logic, self.counters, position_of
        )
        self.node = CanopenNode(
            port, settings.node_id, label, settings.sdo_timeout, self._boot_up,
            self.reports.on_emergency, self._on_foreign_sdo,
        )  # fmt: skip
        self._command_id = 0x200 + settings.node_id
        self._setup = setup.DriveSetup(0, settings.rated_torque)
        self._torque_of = self._asked = 0.0
        self._excess = ExcessTorque(
            settings.excess_torque * settings.rated_torque,
            settings.lasting_torque * settings.rated_torque,
            round(1e9 / settings.rate),
        )
        self._running = self._armed = self._altered = False
        self._hears = True
        self._started_ns = 0
        port.subscribe(self._command_id, self._on_foreign_command)

    # -- configuration: blocking -----------------------------------------------------------------

    @property
    def identity(self) -> str:
        """Identity that the device reports, for hardware_id."""
        return self.node.identity.text

    @property
    def traffic(self) -> list[Traffic]:
        """Frames for the bus load."""
        return drive_traffic(self.settings, self._port.sync_producer)

    @property
    def mode(self) -> int:
        """Mode of operation in use: 10 cyclic synchronous torque, 4 profile torque."""
        return self._setup.mode

    @property
    def reading(self) -> DriveReading | None:
        """The newest cyclic answer, None before the first."""
        return self.reports.reading

    @property
    def error_code(self) -> int:
        """Object 603F, the newest known."""
        return self.reports.error_code

    @property
    def running(self) -> bool:
        """Whether commands are being sent."""
        return self._running

    @property
    def altered(self) -> bool:
        """Whether another SDO client may have changed it since it was configured."""
        return self._altered

    @property
    def configured(self) -> bool:
        """Whether `start` may follow: configured just now, and neither restarted nor left since."""
        return self.node.may_start(watched=self._running)

    def configure(self) -> None:
        """Find the drive, configure it and set its guards; blocking.

        A drive that refuses a guard is configured but cannot be enabled, unless `allow_unguarded`
        is set. Raises Occupied, NotAnswering, WrongDevice, Refused, NotConfigured, BusError.
        """
        self._running = self.node.configured = self._armed = False
        settings = self.settings
        heard = self._port.heard({self.beat.can_id: bool, self._command_id: bool}, settings.listen)
        if heard is not None:
            raise Occupied(self._occupied(heard))
        self._setup = found = setup.configure(self.node, settings)
        self._torque_of = settings.direction * from_per_mille(1, found.rated_torque)
        self.reports.configured(found.mode, self._torque_of, found.inputs)
        self.unguarded = found.unguarded
        self.warnings = [
            f"UNGUARDED: the {self.label} will not hold its torque back by itself: no {guard}"
            for guard in found.unguarded
        ] + list(found.warnings)

    def _occupied(self, heard: int) -> str:
        """Return the message about another master's frame; heard: its identifier."""
        if heard == SYNC_ID:
            return (
                f"somebody already sends SYNC on {self._port.name}: a second copy of this node, "
                "or can.sync_producer should be false here"
            )
        text = f"heartbeat of master {self.settings.master_id}"
        return (
            f"somebody already commands the {self.label} on {self._port.name} "
            f"({text if heard == self.beat.can_id else self._command_text}): is a second copy of "
            "this node running?"
        )

    def start(self) -> None:
        """NMT start; from now on the loop must call `write` every tick.

        Raises NotConfigured before `configure` and after `stop`, BusError.
        """
        if not self.node.configured:
            raise NotConfigured(f"the {self.label} is not configured")
        self._armed = False
        self.reports.restart()
        self.node.start()
        self._running = True
        if not self.node.configured:  # it has restarted at just that
            self._running = False

    def stop(self) -> None:
        """Send nothing more and leave the drive to its guards; `shutdown` is the clean exit.

        The configuration counts as gone: an exit disarms the guards, and nobody watches any more.
        """
        self.node.configured = self._running = self._armed = False

    def shutdown(self) -> str:
        """Shut down cleanly: disable, disarm the guards, stop the heartbeat. Blocking, up to 2 s.

        Call it after the loop has ended. Returns the errors, empty without any.
        """
        return drive_exit.leave([self], self._port)

    # -- cyclic: realtime loop -------------------------------------------------------------------

    def sync(self, now_ns: int) -> None:
        """Send SYNC where this process produces it. now_ns: CLOCK_MONOTONIC. Raises BusError."""
        if self._port.sync_producer:
            self._port.send_sync(now_ns)

    def heartbeat(self, now_ns: int) -> None:
        """Send our heartbeat when due. now_ns: CLOCK_MONOTONIC [ns]. Raises BusError."""
        if self._armed:
            self.beat.beat(now_ns)

    def state(self, now_ns: int) -> State:
        """Return the drive's state, UNKNOWN when its statusword is older than ten periods."""
        return self.reports.state(now_ns)

    def is_on(self, now_ns: int) -> bool:
        """Return whether it is in operation enabled, by a fresh statusword."""
        return self.reports.state(now_ns) is State.OPERATION_ENABLED

    def write(self, torque_nm: float, now_ns: int) -> float:
        """Send one command; return its torque [Nm], zero unless enabled on request.

        torque_nm: on the motor shaft, with the robot's sign. now_ns: CLOCK_MONOTONIC [ns]. The
        first command after `start` carries no torque: it arms the guards. Raises BusError.
        """
        if not self._running:
            return 0.0
        if not self._armed:
            return self._arm(now_ns)
        logic, node = self._logic, self.node
        if not math.isfinite(torque_nm):
            self.counters.bad_torque += 1
            logic.latch(f"the torque command was {torque_nm}")
        state = self.reports.state(now_ns)
        if state is State.UNKNOWN:
            self._port.pump()  # answers may wait in our socket
            state = self.reports.state(now_ns)
        self._look_at_torque(state, now_ns)
        heard_ns = self._started_ns if node.heartbeat_ns is None else node.heartbeat_ns
        recovering = logic.recovery.active
        controlword = logic.step(
            state, self.reports.shown, heard_ns if self._hears else None, node.state, now_ns
        )
        if logic.recovery.active and logic.recovery.nmt_start_due(state, now_ns):
            node.start()
        per_mille = 0
        if controlword == cia402.ENABLE_OPERATION and state is State.OPERATION_ENABLED:
            per_mille = self._per_mille(torque_nm)
        self._send(controlword, per_mille)
        if logic.nmt_stop_due(now_ns):
            # After the zero command: with 6007 altered, a stopped drive may keep its torque.
            node.stop()
        if recovering and not logic.recovery.active and state is State.UNKNOWN:
            # Silent for a whole recovery: it may have restarted while its boot-up could not come.
            self.stop()
        self._asked = per_mille * self._torque_of
        return self._asked

    def _look_at_torque(self, state: State, now_ns: int) -> None:
        given = self.reports.reading
        if state is not State.OPERATION_ENABLED or given is None:
            self._excess.restart()
        elif self._excess.check(self._asked, given.torque, now_ns):
            self._logic.latch(
                f"the {self.label} gives {given.torque:.3f} Nm of torque, {self._asked:.3f} Nm "
                "was asked for"
            )

    def _arm(self, now_ns: int) -> float:
        """Send the heartbeat, then one command without torque: the drive now monitors both."""
        self.beat.rest()
        self.beat.beat(now_ns)
        self._send(cia402.DISABLE_VOLTAGE, 0)
        self._hears = all(missing.guard != setup.DRIVE_HEARTBEAT for missing in self.unguarded)
        self._started_ns = now_ns
        self._logic.start(now_ns)
        self._armed = True
        return 0.0

    def _per_mille(self, torque_nm: float) -> int:
        limit = self.settings.max_torque
        if not -limit <= torque_nm <= limit:
            self.counters.saturated += 1
            torque_nm = max(-limit, min(limit, torque_nm))
        return to_per_mille(self.settings.direction * torque_nm, self._setup.rated_torque)

    def _send(self, controlword: int, per_mille: int) -> None:
        try:
            self._port.send(self._command_id, _COMMAND.pack(controlword, per_mille))
        except BusError as error:
            self.counters.bus_errors += 1
            self._logic.latch(str(error))
            raise
        self.counters.writes += 1

    # -- requests, from any thread ---------------------------------------------------------------

    @property
    def fault(self) -> str:
        """Why the drive is off, latched until `clear_fault`; empty while healthy."""
        return self._logic.fault

    @property
    def recovering(self) -> bool:
        """Whether a `clear_fault` is in progress; the loop's writes continue it."""
        return self._logic.recovery.active

    @property
    def enabling(self) -> bool:
        """Whether operation enabled is requested."""
        return self._logic.goal is Goal.OPERATION_ENABLED

    def request_enable(self) -> None:
        """Request operation enabled; the loop's writes carry it out.

        Raises NotEnabled with the `refusal`.
        """
        if refused := self.refusal():
            raise NotEnabled(refused)
        self._logic.enable()

    def refusal(self) -> str:
        """Return why it cannot be enabled now, empty if it can.

        A fault is latched, a recovery is in progress, the loop does not write, the mode is not the
        configured one, or a guard is missing.
        """
        if self.fault:
            return f"{self.fault}; clear the fault first"
        if self.recovering:
            return f"the {self.label} is still recovering: wait until it has"
        if not self._armed:
            return f"the {self.label} is not being commanded: activate it first"
        if self.reports.mode_display != self.mode:
            shown = self.reports.mode_display
            return f"the {self.label} is not in mode {self.mode}, 6061 is {shown}"
        if self.unguarded and not self.settings.allow_unguarded:
            return (
                f"the {self.label} would not hold its torque back by itself, it has no "
                f"{'; no '.join(map(str, self.unguarded))}; allow_unguarded overrides this"
            )
        return ""

    def request_disable(self) -> None:
        """Request torque off; the drive goes down to switched on."""
        self._logic.disable()

    def clear_fault(self) -> None:
        """Begin to recover; `recovering` is True until the drive is back, at most switched on.

        After a boot-up, after a recovery without an answer, or if another SDO client may have
        changed an object, this configures the drive again, which blocks and raises as `configure`.
        """
        if not self.node.configured or self._altered:
            self._altered = False  # a client that continues meanwhile sets it again
            try:
                self.configure()
                self.start()
            except DeviceError:
                self._altered = True
                raise
            self.reports.forget_errors()
            self._logic.forget()
            self._logic.recover()
        elif self._running:
            self.reports.forget_errors()
            self._logic.recover()
        else:
            self._logic.forget()
        if self._altered or not self.node.configured:  # what came meanwhile is no fault of before
            self._logic.latch(
                f"the {self.label} restarted, or another SDO client talked to it, while its fault "
                "was being cleared: clear it again"
            )

    def snapshot(self) -> DriveCounters:
        """Return a copy of the counters."""
        return replace(self.counters)

    @property
    def _command_text(self) -> str:
        return f"frames 0x{self._command_id:X} on {self._port.name}"

    def _on_foreign_command(self, _data: bytes, _arrival_ns: int) -> None:
        """Stop at the first command of another master; our own frames do not arrive here."""
        self.counters.foreign += 1
        if self._armed:
            self._logic.intruded(
                f"somebody else commands the {self.label}: {self._command_text}"
            )

    def _on_foreign_sdo(self) -> None:
        """Stop: another client may have changed the configuration, also guards and limits."""
        self.counters.foreign_sdo += 1
        if self.node.configured:
            self._altered = True
            self._logic.intruded(
                f"{self.node.sdo.foreign_client} talks to the {self.label} and may have changed "
                "what it was told: stop it, then clear the fault, which configures the drive anew"
            )

    def _boot_up(self) -> None:
        self.counters.boot_ups += 1
        if self.node.configured:
            self.node.configured = self._running = self._armed = False
            self._logic.forget()  # the restart explains the faults before it
            self._logic.latch(
                f"the {self.label} restarted (boot-up): its configuration is gone; clear the "
                "fault to configure it again"
            )
