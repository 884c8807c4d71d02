# SPDX-License-Identifier: Apache-2.0
"""A Python client for operators: each call does what an operator at the bench does.

    with Robot() as robot:
        robot.wait_until_ready(["encoder", "amplifier"])
        robot.home()
        robot.set_mode(ForceCommand.IMPEDANCE)

Every call either succeeds or raises RobotError, which names the node and quotes its message.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Point, Vector3
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from screw_module_msgs.msg import (
    AmplifierState,
    EndpointSetpoint,
    ImpedanceState,
    PlanarState,
    SafetyState,
)
from screw_module_msgs.srv import InjectFault, SetArm, SetControlMode, SetFixture, SetImpedance
from std_srvs.srv import SetBool, Trigger

from screw_module_ros import graph

from ..nodes.support.inbox import Outlet, fill_stamp
from ..nodes.support.topics import offered
from .client import ANSWER_S, Client, RobotError

__all__ = ["Robot", "RobotError", "arm"]

_NAN = math.nan
_AFTER_CLEARING_S = 0.2
_HEARD_S = 1.0
_SILENT_S = 0.5
_LEAVE = (_NAN, _NAN, _NAN)


def arm(
    target: tuple[float, float, float] = _LEAVE,
    duration: float = 0.0,
    amplitude: tuple[float, float, float] = _LEAVE,
    omega: tuple[float, float, float] = _LEAVE,
    kind: str = "",
    mass: float = _NAN,
    stiffness: float = _NAN,
    damping: float = _NAN,
    traits: Mapping[str, float] | None = None,
    patient: str = "",
) -> SetArm.Request:
    """Return a change of the simulated patient, in the units of SetArm.srv.

    traits: by name, such as {"weight": 20.0, "carried": 0.0}; others stay as they are. patient: a
    name for all of an arm, such as healthy; beside it only traits count.
    NaN and '' keep the present value. An axis with NaN as target, amplitude and omega continues its
    present path.
    """
    return SetArm.Request(
        kind=kind,
        mass=mass,
        stiffness=stiffness,
        damping=damping,
        target=Point(**dict(zip("xyz", target, strict=True))),
        duration=duration,
        amplitude=Vector3(**dict(zip("xyz", amplitude, strict=True))),
        omega=Vector3(**dict(zip("xyz", omega, strict=True))),
        traits=list(traits or ()),
        values=list(map(float, (traits or {}).values())),
        patient=patient,
    )


class Robot(Client):
    """The operator's actions on the robot."""

    def __init__(self, *args: Any, **kwargs: Any):
        super().__init__(*args, **kwargs)
        self._setpoint = EndpointSetpoint()
        self._setpoint.header.frame_id = "manus_base"
        self._setpoints: Outlet | None = None  # from the first on: one node alone may have it

    def close(self) -> None:
        """Leave the graph."""
        if self._setpoints is not None:
            self._setpoints.close()
        super().close()

    # Requests ------------------------------------------------------------------------------

    def ask(
        self, kind: type[Any], service: str, request: Any = None, deadline_s: float = ANSWER_S
    ) -> str:
        """Like `call`; return the response's message, raise RobotError with it when refused."""
        response = self.call(kind, service, request, deadline_s)
        if not response.success:
            raise RobotError(f"{service} was refused: {response.message}")
        return response.message

    def trigger(self, service: str, deadline_s: float = ANSWER_S) -> str:
        """Call a Trigger service, like `ask`."""
        return self.ask(Trigger, service, deadline_s=deadline_s)

    def set_parameter(self, node: str, name: str, value: Any) -> None:
        """Set one parameter; raises RobotError as `set_parameters`."""
        self.set_parameters(node, {name: value})

    def set_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        """Set parameters in one request, all or none: some are allowed only together.

        Raises RobotError with the node's reason.
        """
        if not values:
            return
        changes = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        request = SetParametersAtomically.Request(parameters=changes)
        service = f"{node}/set_parameters_atomically"
        result = self.call(SetParametersAtomically, service, request).result
        if not result.successful:
            listed = ", ".join(f"{name} = {value!r}" for name, value in values.items())
            raise RobotError(f"{node} refused {listed}: {result.reason}")

    # Actions -------------------------------------------------------------------------------

    def home(self) -> None:
        """Home encoder and plane: nut and arm stand at their reference marks, at rest."""
        self.trigger("encoder/home")
        self.trigger("manus/home")

    def tare(self) -> str:
        """Tare: set zero force at the resting, unloaded handle."""
        return self.trigger("force_sensor/tare")

    def clear_faults(self) -> None:
        """Clear latched faults of the drives until both answer without a fault."""
        self.clear_amplifier()
        self._clear("manus", PlanarState, lambda state: state.drive_state)

    def clear_amplifier(self) -> None:
        """Clear latched faults of the vertical drive alone, like `clear_faults`."""
        self._clear("amplifier", AmplifierState, lambda state: (state.state,))

    def _clear(self, node: str, kind: type, drives: Callable[[Any], Any]) -> None:
        refusal = ""

        def healthy() -> bool:
            nonlocal refusal
            state = self.state(kind)
            if state is None:
                return False
            if not state.faulted:
                return AmplifierState.UNKNOWN not in drives(state)
            answer = self.call(Trigger, f"{node}/clear_fault")
            refusal = "" if answer.success else answer.message
            self.pause(_AFTER_CLEARING_S)
            return False

        if not self.met(healthy, ANSWER_S):
            raise RobotError(f"the fault of {node} cannot be cleared: {refusal or self.said(node)}")

    def permit(self) -> None:
        """Wait for the supervisor's permission; reset an earlier stop.

        The cause of the stop may last for a while; a reset is possible only after it has ended.
        """
        refusal = ""

        def permitted() -> bool:
            nonlocal refusal
            state = self.state(SafetyState)
            if state is None or state.level != SafetyState.STOPPED:
                return state is not None and state.level == SafetyState.OK
            answer = self.call(Trigger, "supervisor/reset")
            refusal = "" if answer.success else answer.message
            self.pause(_AFTER_CLEARING_S)
            return False

        if not self.met(permitted, ANSWER_S):
            state = self.state(SafetyState)
            why = ", ".join(state.reasons) if state else self.said("supervisor")
            raise RobotError(f"the supervisor gives no permission to move: {refusal or why}")

    def enable(self, on: bool = True) -> None:
        """Switch the torque of the vertical axis on or off."""
        self._enable("amplifier", AmplifierState, on)

    def enable_plane(self, on: bool = True) -> None:
        """Switch the torque of the plane on or off."""
        self._enable("manus", PlanarState, on)

    def _enable(self, node: str, kind: type, on: bool) -> None:
        self._ask_to_enable(node, on)
        state = None

        def switched() -> bool:
            nonlocal state
            state = self.state(kind)
            return state is not None and state.enabled == on

        if not self.met(switched, ANSWER_S):
            reason = state.reason if state else self.said(node)
            raise RobotError(f"{node} did not switch {'on' if on else 'off'}: {reason}")

    def _ask_to_enable(self, node: str, on: bool) -> None:
        """Request it, and repeat while the supervisor's permission has not reached the drive."""
        refusal = ""

        def answered() -> bool:
            nonlocal refusal
            answer = self.call(SetBool, f"{node}/enable", SetBool.Request(data=on))
            refusal = "" if answer.success else answer.message
            safety = self.state(SafetyState)
            return not refusal or safety is None or safety.level != SafetyState.OK

        self.met(answered, _HEARD_S)
        if refusal:
            raise RobotError(f"{node}/enable was refused: {refusal}")

    def set_mode(self, mode: int) -> None:
        """Choose the vertical law, a constant of ForceCommand."""
        self.ask(SetControlMode, "impedance_controller/set_mode", SetControlMode.Request(mode=mode))

    def set_impedance(
        self, stiffness: float, damping: float, node: str = "impedance_controller"
    ) -> None:
        """Set spring [N/m] and damper [Ns/m] of the vertical axis, or of the plane (`manus`)."""
        request = SetImpedance.Request(stiffness=stiffness, damping=damping)
        self.ask(SetImpedance, f"{node}/set_impedance", request)

    def set_setpoint(
        self,
        x: float = _NAN,
        y: float = _NAN,
        z: float = _NAN,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Publish where the spring pulls [m]; NaN leaves an axis alone.

        With the first call this client becomes the sender of `setpoint`.
        """
        if self._setpoints is None:
            self._setpoints = outlet = Outlet(self.node, self.clock, *offered(graph.SETPOINT))
            self.met_at_once(lambda: outlet.heard)
        message = self._setpoint
        fill_stamp(message.header, self.clock.stamp_ns())
        message.position.x, message.position.y, message.position.z = x, y, z
        message.velocity.x, message.velocity.y, message.velocity.z = velocity
        self._setpoints.publish(message)

    def start_recording(self) -> Path:
        """Start the session recorder; return the bag's folder."""
        return Path(self.trigger("session_recorder/start"))

    def stop_recording(self) -> str:
        """Stop the session recorder; return its summary."""
        return self.trigger("session_recorder/stop", deadline_s=30.0)

    def check_enabled(self) -> None:
        """Raise RobotError with the known reason when a torque is off."""
        for name, kind in (("amplifier", AmplifierState), ("manus", PlanarState)):
            if not self.met(partial(self.state, kind), _SILENT_S):
                raise RobotError(f"{name} is silent{self.complaints_text()}")
            state = self.state(kind)
            if not state.enabled:
                controller = self.state(ImpedanceState)
                cause = controller.reason if controller and controller.faulted else ""
                cause = f"; impedance_controller: {cause}" if cause else self.complaints_text()
                raise RobotError(f"{name} took the torque off: {state.reason}{cause}")

    # The simulated rig ---------------------------------------------------------------------

    def set_arm(self, request: SetArm.Request) -> None:
        """Change the simulated patient."""
        self.ask(SetArm, "sim_rig/set_arm", request)

    def send_arm(self, request: SetArm.Request) -> None:
        """Change the simulated patient without waiting for the answer."""
        self.client(SetArm, "sim_rig/set_arm").call_async(request)

    def set_fixture(self, name: str) -> None:
        """Change the fixture of the handle: human_arm, free, stage or locked_rotor."""
        request = SetFixture.Request(fixture=name, position=_NAN)
        self.ask(SetFixture, "sim_rig/set_fixture", request)

    def inject(self, device: str, fault: str, value: float = 0.0, duration: float = 0.0) -> str:
        """Inject a fault into a simulated device or bus; return the rig's description of it."""
        request = InjectFault.Request(device=device, fault=fault, value=value, duration=duration)
        return self.ask(InjectFault, "sim_rig/inject_fault", request)
