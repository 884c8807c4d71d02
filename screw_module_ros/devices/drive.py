# SPDX-License-Identifier: Apache-2.0
"""CiA 402 drive in torque mode: one command per tick, enabled only on request.

The driver writes zero torque unless the drive shows operation enabled on request and no fault is
latched. `drive_logic` decides what to send; this module sends it.
"""

from __future__ import annotations

import math
from contextlib import suppress

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..profiles import ANY_DRIVE, DRIVE_HEARTBEAT, GUARDS, MASTER_HEARTBEAT, Profile
from ..settings import validated
from ..units import PER_MILLE, to_per_mille
from . import cia402
from . import drive_setup as setup
from .canopen import NMT_START, NMT_STOP, Heartbeat
from .cia402 import State
from .drive_guards import MissingGuard
from .drive_logic import ExcessTorque
from .drive_reports import DriveReports
from .drive_settings import DriveSettings, adapted, cross_checked, waived_guards
from .errors import BusError, DeviceError, NotNow
from .life import Phase, Remedy

_MODE_EVERY = 16
"""Writes between two looks at how old the drive's mode is."""
_UNHEARD_NS = 200_000_000
"""Without a statusword for this long a drive may have booted; its boot-up may have been lost."""


class Drive(DriveReports):
    """Driver of one drive; `heartbeat`, `sync` and `write` belong to the realtime loop.

    counters: those of `DriveReports`, writes (commands sent), bad_torque (commands that were not
    finite), saturated (commands beyond max_torque), bus_errors, foreign (commands of another
    master), foreign_heartbeats (in our name).
    warnings: for the user, such as missing guards. unguarded: guards that the drive refused and
    nothing replaces.
    drive_limit: the `max_torque` that the drive has been told [Nm], None if unknown.
    beat: our heartbeat, shared by the drives of one bus; the driver creates it if none is given.
    per_turn: change of position per turn: the screw's lead [m], or 2 pi for a joint [rad].
    remedy: of a drive that may have lost its configuration: another SDO client talked to it, or it
    was silent for long enough to restart unheard.
    """

    profile_number = setup.PROFILE

    def __init__(
        self,
        port: Port,
        settings: DriveSettings,
        label: str = "drive",
        beat: Heartbeat | None = None,
        per_turn: float = 2.0 * math.pi,
        profile: Profile = ANY_DRIVE,
    ):
        settings = adapted(cross_checked(validated(settings)), profile.drive)
        super().__init__(port, settings, label, per_turn, profile)
        self.warnings: list[str] = []
        self.unguarded: tuple[MissingGuard, ...] = ()
        self.beat = beat or Heartbeat(port, settings.master_id, settings.heartbeat_period)
        self._excess = ExcessTorque(
            settings.excess_torque * settings.rated_torque,
            settings.lasting_torque * settings.rated_torque,
            round(1e9 / settings.rate),
        )
        self._waived = waived_guards(settings)
        self._largest = settings.max_torque
        self.drive_limit: float | None = None
        self._configured = self._setup
        self._open_ids: set[int] = set()
        self._asked = 0.0
        self._was_armed = False
        self._expects_heartbeat = True
        self._started_ns = 0
        self._command_id = setup.command_pdo(settings, profile.drive).cob_id
        self._pack_command = setup.command_layout(profile.drive).pack
        self._enable_word = cia402.ENABLE_OPERATION | profile.drive.mode_bits
        port.subscribe(self._command_id, self._on_foreign_command)
        port.subscribe(self.beat.can_id, self._on_foreign_heartbeat)

    # -- configuration: blocking -----------------------------------------------------------------

    @property
    def traffic(self) -> list[Traffic]:
        """Frames for the bus load."""
        return setup.drive_traffic(
            self.settings, self._port.sync_producer, self.profile.drive, self._setup
        )

    def refuse_others(self) -> None:
        """Raise Occupied when another master commands this drive, or sends our heartbeat."""
        master = f"heartbeat of master {self.settings.master_id}"
        self.listen_for({self.beat.can_id: master, self._command_id: self._command_text})

    def make_safe(self) -> None:
        """Take the torque away: an earlier program may have left the drive enabled."""
        setup.without_torque(self.sdo, self.profile.drive)

    def set_up(self) -> setup.DriveSetup:
        """Write settings and guards; a drive that refuses a guard cannot be enabled."""
        return setup.set_up(self._port, self.sdo, self.settings, self.profile.drive)

    def adopt(self, found: setup.DriveSetup) -> None:
        """Take over mode, rating and missing guards."""
        self.expect(found)
        self._configured = found
        self._limited(found)
        for can_id in set(found.open_ids) - self._open_ids:  # nobody else may command it there
            self._open_ids.add(can_id)
            self._port.subscribe(can_id, self._on_foreign_command)
        self.warnings = [
            f"UNGUARDED: the {self.label} will not hold its torque back by itself: no {guard}"
            for guard in found.unguarded
        ] + [*found.warnings, *map(str, found.replaced)]

    def _limited(self, found: setup.DriveSetup) -> None:
        taken = self.profile.drive.largest_target / PER_MILLE * found.thousand
        self.drive_limit = self.settings.max_torque
        self._largest = min(self.settings.max_torque, taken)
        self.unguarded = found.unguarded

    def limit(self, max_torque: float) -> None:
        """Take another `max_torque` [Nm], and tell the drive, which must be off; blocking.

        A drive that refuses it lacks that guard, and is not enabled. Raises NotAnswering, BusError.
        """
        self.drive_limit = None  # until it has answered
        self.settings = self.settings._replace(max_torque=max_torque)
        self._limited(
            setup.limit_again(self.sdo, self.settings, self.profile.drive, self._configured)
        )

    def prepare_start(self) -> None:
        """Drop the states shown before; from the start on the loop must call `write` every tick."""
        self._was_armed = False
        self.forget_reports()

    # -- cyclic: realtime loop -------------------------------------------------------------------

    @property
    def _armed(self) -> bool:
        """Whether the drive monitors our commands and our heartbeat."""
        return self.phase is Phase.RUNNING and self._was_armed

    def sync(self, now_ns: int) -> None:
        """Send SYNC where this process produces it. now_ns: CLOCK_MONOTONIC. Raises BusError."""
        if self._port.sync_producer:
            self._port.send_sync(now_ns)

    def heartbeat(self, now_ns: int) -> None:
        """Send our heartbeat when due. now_ns: CLOCK_MONOTONIC [ns]. Raises BusError."""
        if self.phase is Phase.RUNNING and self._was_armed:  # as `_armed`, without its call
            self.beat.beat(now_ns)

    def is_on(self, now_ns: int) -> bool:
        """Return whether it is in operation enabled, by a fresh statusword, and in torque mode."""
        return self.state(now_ns) is State.OPERATION_ENABLED and self.mode_confirmed

    def is_enabled(self, now_ns: int) -> bool:
        """Return whether it is in operation enabled, by a fresh statusword, in whatever mode."""
        return self.state(now_ns) is State.OPERATION_ENABLED

    def write(self, torque_nm: float, now_ns: int) -> float:
        """Send one command; return its torque [Nm], zero unless enabled on request.

        torque_nm: on the motor shaft, with the robot's sign. now_ns: CLOCK_MONOTONIC [ns]. The
        first command after `start` carries no torque: it arms the guards. Raises BusError.
        """
        if self.phase is not Phase.RUNNING:
            return 0.0
        if not self._was_armed:
            return self._arm(now_ns)
        logic = self.logic
        if not math.isfinite(torque_nm):
            self.counters["bad_torque"] += 1
            logic.latch(f"the torque command was {torque_nm}")
        state = self.state(now_ns)
        if state is State.UNKNOWN:
            with suppress(BusError):  # it cannot be read, and must be switched off all the same
                self._port.pump()  # answers may wait in our socket
            state = self.state(now_ns)
            self._check_silence(now_ns)
        self._check_torque(state, now_ns)
        if not self.counters["writes"] % _MODE_EVERY:  # another mode is latched as it is heard
            self.check_mode(now_ns)
            if not self.mode_confirmed:
                self.confirm_mode(now_ns)
        beat_ns = self._started_ns if self.heartbeat_ns is None else self.heartbeat_ns
        controlword = logic.step(
            state, self.shown, beat_ns if self._expects_heartbeat else None, self.nmt, now_ns
        )
        if logic.recovery.active and logic.recovery.nmt_start_due(state, now_ns):
            self.command_nmt(NMT_START)
        per_mille = 0
        if controlword == cia402.ENABLE_OPERATION:
            controlword = self._enable_word
            if state is State.OPERATION_ENABLED and self.mode_confirmed:
                per_mille = self._per_mille(torque_nm)
        self._send(controlword, per_mille)
        if logic.nmt_stop_due(now_ns):
            # After the zero command: with 6007 altered, a stopped drive may keep its torque.
            self.command_nmt(NMT_STOP)
        self._asked = per_mille * self.torque_of
        return self._asked

    def _arm(self, now_ns: int) -> float:
        """Send the heartbeat, then one command without torque: the drive now monitors both."""
        self.beat.rest()
        self.beat.beat(now_ns)
        self._send(cia402.DISABLE_VOLTAGE, 0)
        self._expects_heartbeat = all(
            missing.guard != DRIVE_HEARTBEAT for missing in self.unguarded
        )
        replaced = any(each.guard == DRIVE_HEARTBEAT for each in self._configured.replaced)
        if self._expects_heartbeat and not replaced:  # it beats as it was told
            self._beats.period_ns = round(self.settings.drive_heartbeat * 1e9)
        self._started_ns = now_ns
        self.logic.start(now_ns)
        self._was_armed = True
        return 0.0

    def _check_silence(self, now_ns: int) -> None:
        """Count the configuration as lost when the drive may have restarted unheard.

        Where another node sends SYNC, tell first that none has come for a drive to answer.
        """
        given = self.reading
        last_ns = max(self._started_ns, given.monotonic_ns if given else 0)
        unheard = now_ns - last_ns > _UNHEARD_NS
        unasked = not self._port.sync_producer and self.synced_ns <= last_ns
        if unasked and (unheard or self.logic.enabling):
            self.logic.latch(
                f"no SYNC comes on {self._port.name}, so the {self.label} says nothing: start the "
                "node that sends it (can.sync_producer), then clear the fault"
            )
        if not unheard:
            return
        self.need(Remedy.RESET)
        self.logic.explain(self.emergency)
        self.logic.latch(
            f"the {self.label} was silent and may have restarted" if given else
            f"the {self.label} is silent: no statusword since it was started; clear the fault, "
            "which resets its communication, else switch its supply off and on"
        )  # fmt: skip

    def _check_torque(self, state: State, now_ns: int) -> None:
        given, brakes = self.reading, self.logic.leaving and self.brakes  # 2 s at most, or a fault
        if state is not State.OPERATION_ENABLED or given is None or brakes:
            self._excess.restart()
        elif self._excess.check(self._asked, given.torque, now_ns):
            self.logic.latch(
                f"the {self.label} gives {given.torque:.3f} Nm of torque, {self._asked:.3f} Nm "
                "was asked for"
            )

    def _per_mille(self, torque_nm: float) -> int:
        limit = self._largest
        if not -limit <= torque_nm <= limit:
            self.counters["saturated"] += 1
            torque_nm = max(-limit, min(limit, torque_nm))
        return to_per_mille(self.settings.direction * torque_nm, self._setup.thousand)

    def _send(self, controlword: int, per_mille: int) -> None:
        try:
            self._port.send(self._command_id, self._pack_command(controlword, per_mille))
        except BusError as error:
            self.counters["bus_errors"] += 1
            self.logic.latch(str(error))
            raise
        self.counters["writes"] += 1

    # -- requests, from any thread ---------------------------------------------------------------

    @property
    def fault(self) -> str:
        """Why the drive is off, latched until `clear_fault`; empty while healthy."""
        return self.logic.fault

    @property
    def recovering(self) -> bool:
        """Whether a `clear_fault` is in progress; the loop's writes continue it."""
        return self.logic.recovery.active

    @property
    def unsound(self) -> bool:
        """Whether it has to be configured again: also when it answers and beats no more."""
        return self.logic.lost or super().unsound

    @property
    def leaving(self) -> bool:
        """Whether a disabling is under way; the loop's writes continue it."""
        return self.logic.leaving

    def request_enable(self) -> None:
        """Request operation enabled; the loop's writes carry it out.

        Raises NotNow with the `refusal`.
        """
        if refused := self.refusal():
            raise NotNow(refused)
        self.logic.enable()

    def refusal(self) -> str:
        """Return why it cannot be enabled now, empty if it can.

        A fault is latched, a recovery or a disabling is in progress, the loop does not write, the
        mode is not the configured one, or a guard is missing.
        """
        if self.fault:
            return f"{self.fault}; clear the fault first"
        if self.recovering:
            return f"the {self.label} is still recovering: wait until it has"
        if self.leaving:
            return f"the {self.label} is still being disabled: try again in a moment"
        if not self._armed:
            return f"the {self.label} is not being commanded: activate it first"
        return self.mode_refusal(self._port.clock.now_ns()) or self.guards_refusal()

    def guards_refusal(self) -> str:
        """Return the guards that are missing and not waived, with the way out; empty if none."""
        lacking = [each for each in self.unguarded if each.guard not in self._waived]
        if not lacking:
            return ""
        return (
            f"the {self.label} would not hold its torque back by itself, it has no "
            f"{'; no '.join(map(str, lacking))}; {self._way_out(lacking)}"
        )

    def _way_out(self, lacking: list[MissingGuard]) -> str:
        """Return what to do; where the drive has an object and refuses a value, first that."""
        names = [each.guard for each in lacking if each.guard != MASTER_HEARTBEAT]
        cures = list(dict.fromkeys(each.cure for each in lacking if each.cure))
        ways = [", ".join(cures)] if cures else []
        if not all(each.cure for each in lacking):
            ways.append("choose the `profile` of its make")
        if names:
            ways.append(f"waive what you can do without, `waived` with {', '.join(names)}")
        if any(each.guard == MASTER_HEARTBEAT and not each.cure for each in lacking):
            ways.append("only `allow_no_heartbeat` lets a drive run that does not watch us")
        return ", or ".join(ways)

    @property
    def danger(self) -> str:
        """Return what to say at each enabling, empty if the drive holds its torque back by itself.

        It does not where it does not watch our heartbeat, and where only a word of its profile
        stands in for a guard.
        """
        told = [
            f"DANGER: the {self.label} is enabled without {GUARDS[each.guard]}: its torque "
            "goes on when this program hangs or the cable breaks; keep a hand on the emergency stop"
            for each in self.unguarded
            if each.guard == MASTER_HEARTBEAT
        ]
        told += [
            f"DANGER: the {self.label} is enabled without {GUARDS[each.guard]}; in its place only: "
            f"{each.text}"
            for each in self._configured.replaced
            if each.by_word
        ]
        return "; ".join(told)

    def request_disable(self) -> None:
        """Request torque off; the drive goes down to switched on."""
        self.logic.disable()

    def clear_fault(self) -> None:
        """Begin to recover; `recovering` is True until the drive is back, at most switched on.

        After a boot-up, and if it needs a `remedy`, this configures the drive again, which blocks
        and raises as `configure`. A bus that has failed is opened anew.
        """
        self._port.restore()
        logic = self.logic
        if logic.lost:
            self.need(Remedy.RESET)
        if self.unsound:
            self.forget_errors()  # what it reports from here on explains a fault that follows
            try:
                self.configure()
                self.start()
            except DeviceError:
                self.need(Remedy.CONFIGURE)
                raise
            logic.forget()
            logic.explain(self.emergency)
            logic.recover()
        elif self.phase is Phase.RUNNING:
            self.forget_errors()
            logic.recover()
        else:
            logic.forget()
        if self.unsound:  # what came meanwhile is no fault of before
            logic.latch(
                f"the {self.label} restarted, was silent, or another SDO client talked to it, "
                "while its fault was being cleared: clear it again"
            )

    # -- what others do, from the thread that pumps the port -------------------------------------

    @property
    def _command_text(self) -> str:
        return f"frames 0x{self._command_id:X} on {self._port.name}"

    def _on_foreign_command(self, _data: bytes, _arrival_ns: int) -> None:
        """Stop at the first command of another master; our own frames do not arrive here."""
        self.counters["foreign"] += 1
        if self._armed:
            self.logic.intruded(
                f"somebody else commands the {self.label}: {self._command_text}"
            )

    def _on_foreign_heartbeat(self, _data: bytes, _arrival_ns: int) -> None:
        """Stop: with the heartbeat of somebody else the drive would not notice that we hang."""
        self.counters["foreign_heartbeats"] += 1
        if self._armed:
            self.logic.latch(
                f"somebody else sends the heartbeat of master {self.settings.master_id}, which is "
                f"ours, on {self._port.name}: the {self.label} would not notice when we hang; end "
                "it, or choose another master_id here"
            )

    def altered_by(self, client: str) -> None:
        """Stop: another client may have changed the configuration, also guards and limits."""
        self.need(Remedy.CONFIGURE)
        self.logic.intruded(
            f"{client} talks to the {self.label} and may have changed what it was told: stop it, "
            "then clear the fault, which configures the drive anew"
        )

    def restarted(self) -> None:
        """Latch a boot-up, which explains the faults before it."""
        self.logic.forget()
        self.logic.latch(
            f"the {self.label} restarted (boot-up): its configuration is gone; clear the "
            "fault to configure it again"
        )

