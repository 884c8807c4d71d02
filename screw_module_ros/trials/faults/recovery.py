# SPDX-License-Identifier: Apache-2.0
"""The documented recovery, with these services only: home, tare, clear_fault, reset, enable."""

from __future__ import annotations

from typing import Any

from screw_module_msgs.msg import AmplifierState, ImpedanceState, PlanarState, SafetyState
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.operator.robot import Robot, RobotError

from .listener import Listener
from .patient import Patient

_READY_S, _STEP_S, _SETTLE_S = 30.0, 0.02, 0.6
_TARE_AGAIN_S = 1.5
AGAIN = "against the last homing"
"""Part of the answer to a homing request that must be repeated to confirm it."""
SECOND_WORD_S = 1.5


class Recovery:
    """Calls the services that an operator would call, until the robot works.

    steps: services called since the set was cleared. enabled_at: simulated time of the first enable
    request [s].
    """

    def __init__(self, robot: Robot, listener: Listener, patient: Patient):
        self.steps: set[str] = set()
        self.enabled_at = 0.0
        self._robot, self._listener, self._patient = robot, listener, patient
        self._one_enabled = False
        self._tared = -_TARE_AGAIN_S

    def go(self, mode: int) -> None:
        """Bring the robot to operation in `mode`. Raises RobotError after 30 s."""
        end = self._listener.time + _READY_S
        self._one_enabled = False
        while missing := self._improve(mode):
            if self._listener.time > end:
                raise RobotError(f"no recovery to operation: {missing}")
            self._robot.pause(_STEP_S)

    def _improve(self, mode: int) -> str:
        """Do the operator's next step; return what is missing, empty if nothing is."""
        for step in (self._sensors, self._drives, self._permission):
            missing = step()
            if missing:
                return missing
        return self._operate(mode)

    def _sensors(self) -> str:
        robot, listener = self._robot, self._listener
        if not listener.homed:
            self._patient.place()
            return self._home("encoder/home")
        ill = any(
            complaint.startswith("force_sensor:") and "samples/s" not in complaint
            for complaint in robot.complaints()
        )
        if not listener.fresh("force_sensor") or ill:
            return self._tare() or "force_sensor: tared"
        return ""

    def _tare(self) -> str:
        """Let the handle go and tare; the diagnostics show the result a moment later."""
        listener = self._listener
        if listener.time - self._tared < _TARE_AGAIN_S and listener.fresh("force_sensor"):
            return "force_sensor: its diagnostics are not OK yet"
        self._robot.set_fixture("free")
        refused = self._try(Trigger, "force_sensor/tare")
        self._patient.place()
        if not refused:
            self._tared = self._listener.time
        return refused

    def _drives(self) -> str:
        vertical, plane = self._robot.state(AmplifierState), self._robot.state(PlanarState)
        if vertical is None or plane is None:
            return f"{'amplifier' if vertical is None else 'manus'} is silent"
        if vertical.faulted:
            return self._try(Trigger, "amplifier/clear_fault") or vertical.reason
        if plane.faulted:
            return self._try(Trigger, "manus/clear_fault") or plane.reason
        if not plane.homed:
            self._patient.place_plane()
            return self._home("manus/home") or "manus: homed"
        return ""

    def _home(self, service: str) -> str:
        """Home; repeat the request if the count contradicts the last homing, to confirm it."""
        refused = self._try(Trigger, service)
        if AGAIN not in refused:
            return refused
        self._robot.pause(SECOND_WORD_S)
        return self._try(Trigger, service)

    def _permission(self) -> str:
        state = self._robot.state(SafetyState)
        if state is None or state.level == SafetyState.OK:
            return "" if state else "the supervisor is silent"
        reasons = ", ".join(state.reasons)
        if state.level == SafetyState.STOPPED:
            return self._try(Trigger, "supervisor/reset") or reasons
        return reasons or "waiting"

    def _operate(self, mode: int) -> str:
        listener, controller = self._listener, self._robot.state(ImpedanceState)
        if controller is None:
            return "impedance_controller is silent"
        if controller.mode != mode:
            self._robot.set_mode(mode)
        silent = [node for node in ("amplifier", "manus") if not listener.fresh(node)]
        if silent:
            return f"{silent[0]} is silent"
        off = [node for node in ("amplifier", "manus") if not listener.enabled(node)]
        if off:
            return self._enable(off)
        settled = listener.time - self.enabled_at > _SETTLE_S
        return "" if settled and controller.mode == mode else "settling"

    def _enable(self, nodes: list[str]) -> str:
        if not self._patient.at_rest:
            return "the hand moves"
        if not self._one_enabled:
            self.enabled_at = self._listener.time
        for node in nodes:
            if refused := self._try(SetBool, f"{node}/enable", data=True):
                return refused
            self._one_enabled = True
        return "just enabled"

    def _try(self, kind: type, service: str, **fields: Any) -> str:
        """Call a service; return its message if it refused, else an empty text."""
        try:
            answer = self._robot.call(kind, service, kind.Request(**fields), 6.0)
        except RobotError as error:
            self._robot.watch()
            return str(error)
        if answer.success:
            self.steps.add(service)
            return ""
        return answer.message or "refused"
