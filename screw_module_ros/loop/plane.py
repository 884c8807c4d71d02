# SPDX-License-Identifier: Apache-2.0
"""The plane, MIT-MANUS: one tick of both drives, which also measure the positions, and the law.

::

    tick -> SYNC -> both positions -> controller -> both torques -> publish
                 handle force ----------^
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ..can_io.port import Port
from ..control.arms import FIVE_BAR, Arm
from ..control.laws.plane_impedance import PLANE_IMPEDANCE
from ..control.planar_settings import PlanarSettings
from ..control.plane_law import PlaneLaw
from ..control.slot import SlotLimits
from ..devices.drive import Drive
from ..devices.errors import DeviceError
from ..safety.checks import FreezeSettings
from ..safety.permit import PermitSettings
from ..safety.timing import DeadlineMeter
from . import gate
from .plane_controller import NO_TORQUES, JointSettings, PlaneController, PlaneLimits
from .plane_drives import PlaneDrives
from .requests import Requests
from .ticker import Tick, Ticker

_FREEZE = FreezeSettings()
_SLOT_LIMITS = SlotLimits()


class PlaneWires(NamedTuple):
    """The connections to other processes.

    read_inputs: reads set point, handle force and permission at a time [ns], while the drives
    answer. publish_state: called with each tick; it publishes when due.
    """

    read_inputs: Callable[[int], None] = lambda now_ns: None
    publish_state: Callable[[Tick], None] = lambda tick: None


class Plane:
    """The plane's loop; `step` is one tick.

    controller: checks, home and law; drives: both, behind their gate. meter: latency from the tick
    to the torques. skipped: ticks that an overrun skipped.
    """

    def __init__(
        self,
        drives: tuple[Drive, Drive],
        port: Port,
        period_ns: int,
        settings: PlanarSettings,
        joints: JointSettings,
        permit: PermitSettings,
        freeze: FreezeSettings = _FREEZE,
        slot_limits: SlotLimits = _SLOT_LIMITS,
        limits: PlaneLimits | None = None,
        wires: PlaneWires | None = None,
        law: PlaneLaw = PLANE_IMPEDANCE,
        arm: Arm = FIVE_BAR,
        own: Any = None,
        work_ns: Callable[[], int] | None = None,
    ):
        """law, arm, own, work_ns: see `PlaneController`."""
        self._limits, self._wires = limits or PlaneLimits(), wires or PlaneWires()
        self._clock, self._period_ns = port.clock, period_ns
        # A command is as old as the positions behind it.
        oldest = max(permit.command_periods, joints.silence)
        self.drives = PlaneDrives(
            drives, port, period_ns, permit._replace(command_periods=oldest), joints.time_constant
        )
        self.controller = PlaneController(
            settings, joints, period_ns, self.drives.permit.fault,
            (drives[0].label, drives[1].label), freeze, slot_limits,
            self._limits.handle_force_limit, law, arm, own, work_ns,
        )  # fmt: skip
        self.restart()

    def restart(self) -> None:
        """Forget what was asked for, forces and positions, the home too: for a start of the loop.

        Nobody listened before it.
        """
        self.controller.restart()
        self.drives.restart()
        self.meter = DeadlineMeter(self._period_ns)
        self.skipped = 0
        self._ticker = Ticker(self._clock, self._period_ns)

    # One tick ----------------------------------------------------------------------------------

    def step(self) -> None:
        """Do one tick; whatever goes wrong in it, both drives get a last zero."""
        try:
            self._step()
        except BaseException:
            self.drives.release()
            raise

    def _step(self) -> None:
        """Do one tick.

        The driver latches errors of the bus; state and diagnostics show them. Permit and writes run
        whatever else fails.
        """
        tick = self._ticker.sleep()
        self.skipped += tick.skipped
        now_ns = tick.monotonic_ns
        try:
            self.drives.request(now_ns)
        except DeviceError:
            pass
        self._wires.read_inputs(now_ns)
        self.check(now_ns)
        answered = False
        try:
            answered = self.drives.await_answers(now_ns, self._ticker.due_ns())
        except DeviceError:
            pass
        try:
            if answered:
                self.act(now_ns)
                self.meter.tick(tick.sequence, now_ns, self._clock.now_ns())
            else:
                self.zero_without_answers(now_ns)
        except DeviceError:
            pass
        self._wires.publish_state(tick)

    def check(self, now_ns: int) -> None:
        """Stop on missed deadlines, and on a force sensor that has gone silent."""
        permit = self.drives.permit
        permit.missed(self.meter.missed_in_a_row(now_ns), self._limits.missed_limit)
        self.controller.check_force(permit.enabled, now_ns)

    def act(self, now_ns: int) -> None:
        """Turn both positions into torques. Raises BusError, after both writes."""
        controller, drives = self.controller, self.drives
        shoulder, elbow = drives.pair
        assert shoulder.reading and elbow.reading, "the caller waits for both answers"
        positions = shoulder.reading.position, elbow.reading.position
        torques = controller.on_positions(
            positions, drives.written, drives.permit.enabled, now_ns
        )
        drives.write(torques, controller.measured.stamp_ns, now_ns)

    def zero_without_answers(self, now_ns: int) -> None:
        """Write zero in a tick without both answers. Raises BusError, after both writes."""
        controller, drives = self.controller, self.drives
        controller.stop_when_silent(drives.permit.enabled, now_ns)
        drives.write(NO_TORQUES, controller.measured.stamp_ns, now_ns)

    # Between two ticks -------------------------------------------------------------------------

    def take_home(self, now_ns: int) -> str:
        """Home at the reference mark, at now_ns [ns]; return why not, empty if done."""
        if not self.drives.permit.at_rest(now_ns):
            return "the plane is enabled: disable it first"
        return self.controller.home(now_ns)

    # For services, which ask the loop ------------------------------------------------------------

    def enable(self, requests: Requests) -> str:
        """Enable both drives; return why not, empty if done. See `gate.enable`."""
        if not self.controller.homed:
            return "not homed: call ~/home first"
        if self._limits.force_required and not self.controller.force_seen:
            return "force sensor: no sample yet"
        return gate.enable(self.drives.permit, requests)

    def clear_fault(self, requests: Requests) -> str:
        """Recover both drives; home again if one counts from elsewhere now. See `gate`.

        The homes are lost before it: none outlives a drive's new count, whatever fails after that.
        """
        elsewhere = self.drives.count_anew
        if elsewhere:
            requests.ask(self.controller.lose_homes)
        fault = gate.clear_fault(self.drives.permit, requests)
        if elsewhere:
            requests.ask(self.controller.lose_homes)  # the positions begin anew
        return fault
