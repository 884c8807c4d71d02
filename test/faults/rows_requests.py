# SPDX-License-Identifier: Apache-2.0
"""Rows about requests that a user or program repeats, or makes at the wrong time."""

from __future__ import annotations

from functools import partial

from acts import both, called, refused, repeated, transition
from lifecycle_msgs.msg import Transition
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from row import (
    CLEAR,
    COMMAND,
    DYING,
    HOME,
    LOST,
    MISSED,
    PLANE_CLEAR,
    SILENT,
    STOPPED,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
    goes_on,
)

from screw_module_ros.control.laws import names
from screw_module_ros.control.modes import IMPEDANCE
from screw_module_ros.graph import MODULE

GROUP = "intruders"
_MISSED = LOST + 2 * 20 + 20 + DYING
"""Samples until the supervisor counts a deactivated node as lost."""
_ANEW = 60
"""Samples in which the controller is activated again and its first command is refused."""
_SPECTATOR = "endpoint_state"
_STUTTERS, _STUTTER_S = 5, 0.017
_goes_on = partial(goes_on, group=GROUP, watch=0.3)


def _parameter_storm(robot) -> None:
    """Set the stiffness to and fro without waiting for the answers."""
    client = robot.client(SetParameters, "impedance_controller/set_parameters")
    for number in range(200):
        value = 0.0 if number % 2 else 1000.0
        parameter = Parameter("stiffness", value=value).to_parameter_msg()
        client.call_async(SetParameters.Request(parameters=[parameter]))
        robot.pause(0.002)
    robot.configure()


def _deactivated(node: str, who: str, report: str, services, within: int, plane: int) -> Row:
    return Row(
        f"{node}-deactivated", GROUP, f"lifecycle deactivate of the {node} in motion",
        transition(node, Transition.TRANSITION_DEACTIVATE), Report(report, node, node),
        services, who, within, plane,
        mend=transition(node, Transition.TRANSITION_ACTIVATE), watch=0.3,
    )  # fmt: skip


def _stutter(robot) -> None:
    for act in (robot.freeze, robot.thaw) * _STUTTERS:
        act(_SPECTATOR)
        robot.pause(_STUTTER_S)


def _storm(*acts: Act) -> Act:
    """Do the acts three times; what follows is observed from their end on."""

    def act(robot) -> None:
        repeated(both(*acts), 3)(robot)

    return act


def _every_mode(robot) -> None:
    for mode in (*names(), IMPEDANCE):
        robot.set_mode(mode)


def _activated_anew(**more) -> Row:
    """Less than five periods pass in simulated time, so no command is too old."""
    node = "impedance_controller"
    return Row(
        fault="impedance_controller deactivated and activated at once, in motion",
        inject=both(transition(node, Transition.TRANSITION_DEACTIVATE),
                    transition(node, Transition.TRANSITION_ACTIVATE)),
        report=Report("amplifier", "activated anew|no fresh command", "amplifier"),
        services=(CLEAR, *STOPPED), noticed_by="amplifier", within=_ANEW,
        plane_within=_ANEW + VIA_SUPERVISOR, group=GROUP, watch=0.6, **more,
    )  # fmt: skip


ROWS = [
    _activated_anew(name="controller-activated-anew"),
    _activated_anew(name="controller-activated-anew-apart", shared=None),
    _goes_on("clear-fault-storm", fault="clear_fault while enabled, again and again",
             act=_storm(called(CLEAR), called(PLANE_CLEAR)),
             who="amplifier, manus: nothing changes"),
    _goes_on("mode-storm", fault="set_mode through all modes, again and again",
             act=_storm(_every_mode), who="impedance_controller fades"),
    _goes_on("parameter-storm", fault="stiffness changed 500 times a second between its limits",
             act=_parameter_storm, who="impedance_controller fades"),
    _deactivated("encoder", "impedance_controller", "impedance_controller", (HOME, *MISSED),
                 SILENT + 8, SILENT + 8 + VIA_SUPERVISOR),
    _deactivated("amplifier", "amplifier", "supervisor", (CLEAR, *STOPPED), COMMAND + 20 + DYING,
                 _MISSED),
    _goes_on("tare-in-motion", fault="force_sensor/tare and untare in motion",
             act=both(refused("force_sensor/tare", said="enabled"),
                      refused("force_sensor/untare", said="enabled")),
             who="force_sensor refuses while a drive is enabled"),
    _goes_on("spectator-stutters", fault="a program that subscribes to every sample is stopped and "
             "continued repeatedly", act=_stutter,
             who="no node: a subscriber cannot delay a publisher",
             mend=lambda robot: robot.thaw(_SPECTATOR), watch=1.0, shared=MODULE),
]  # fmt: skip
