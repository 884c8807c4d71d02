# SPDX-License-Identifier: Apache-2.0
"""Rows about requests that a user or program repeats, or makes at the wrong time."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from screw_module_msgs.srv import SetControlMode
from std_srvs.srv import Trigger

from .acts import both, refused
from .creep import creep_until
from .intruder_row import intruder_row as _row
from .limits import COMMAND, DYING, LOST, STALE
from .row import GOES_ON, MISSED, Act, Alarm, Failed, Row

_MISSED = LOST + 2 * 20 + 20 + DYING
"""Samples until the supervisor counts a deactivated node as lost."""
_SPECTATOR = "endpoint_state"
_FOUND_S, _ASKED_S, _DONE_S = 5.0, 1.0, 6.0  # wall clock, wall clock, simulated
_STUTTERS, _STUTTER_S = 10, 0.017


def rows() -> Iterator[Row]:
    """Return the rows of services, parameters and transitions in motion, and a slow subscriber."""
    yield _row("clear-fault-storm", "clear_fault while enabled, again and again",
               _storm([("amplifier/clear_fault", Trigger, {}), ("manus/clear_fault", Trigger, {})]),
               "amplifier, manus: nothing changes", None, "none is needed",
               safe=GOES_ON)  # fmt: skip
    yield _row("mode-storm", "set_mode through all modes, again and again",
               _storm([("impedance_controller/set_mode", SetControlMode, {"mode": mode})
                       for mode in (0, 1, 2, 3, 4, 1)]),
               "impedance_controller fades", None, "none is needed", safe=GOES_ON)  # fmt: skip
    yield _row("parameter-storm", "stiffness changed 500 times a second between its limits",
               _parameter_storm, "impedance_controller fades", None, "none is needed",
               safe=GOES_ON, watch=0.3)  # fmt: skip
    yield _row("encoder-deactivated", "lifecycle deactivate of the encoder in motion",
               _transition("encoder", Transition.TRANSITION_DEACTIVATE), "impedance_controller",
               Alarm("impedance_controller", "encoder", "encoder"),
               f"lifecycle activate; encoder/home, {MISSED}, reset, enable",
               _transition("encoder", Transition.TRANSITION_ACTIVATE),
               within=STALE + 10 + DYING)  # fmt: skip
    yield _row("amplifier-deactivated", "lifecycle deactivate of the amplifier in motion",
               _transition("amplifier", Transition.TRANSITION_DEACTIVATE), "amplifier",
               Alarm("supervisor", "amplifier", "amplifier"),
               "lifecycle activate; clear_fault, reset, enable",
               _transition("amplifier", Transition.TRANSITION_ACTIVATE),
               within=COMMAND + 20 + DYING)._replace(plane_within=_MISSED)  # fmt: skip
    yield _row("tare-in-motion", "force_sensor/tare and untare in motion",
               both(refused("force_sensor/tare", said="enabled"),
                    refused("force_sensor/untare", said="enabled")),
               "force_sensor refuses while a drive is enabled", None, "none is needed",
               safe=GOES_ON)  # fmt: skip
    yield _row("spectator-stutters", "a program that subscribes to every sample is stopped and "
               "continued repeatedly", _stutter, "no node: a subscriber cannot delay a publisher",
               None, "none is needed", _flowing, safe=GOES_ON, watch=1.0)  # fmt: skip


def _storm(calls: list[tuple]) -> Act:
    def act(testbed) -> None:
        for service, kind, fields in calls * 3:
            testbed.robot.call(kind, service, kind.Request(**fields))

    return act


def _parameter_storm(testbed) -> None:
    """Set the stiffness to and fro without waiting for the answers."""
    service = "impedance_controller/set_parameters"
    client = testbed.robot.client(SetParameters, service)
    for number in range(200):
        value = 0.0 if number % 2 else 1000.0
        parameter = Parameter("stiffness", value=value).to_parameter_msg()
        client.call_async(SetParameters.Request(parameters=[parameter]))
        testbed.robot.pause(0.002)
    testbed.configure()


def _transition(node: str, number: int) -> Act:
    def act(testbed) -> float:
        robot = testbed.robot
        client = robot.client(ChangeState, f"{node}/change_state")
        ready = creep_until(robot.clock, lambda: robot.is_offered(client), _FOUND_S)
        begin = testbed.listener.time
        future = client.call_async(ChangeState.Request(transition=Transition(id=number)))
        # The request travels by wall clock; the transition takes simulated time.
        creep_until(robot.clock, future.done, _ASKED_S)
        if not (ready and robot.met(future.done, _DONE_S) and future.result().success):
            raise Failed(f"{node} refused the transition")
        return begin

    return act


def _stutter(testbed) -> None:
    acts = itertools.cycle((testbed.freeze, testbed.thaw))
    for _ in range(_STUTTERS):
        next(acts)(_SPECTATOR)
        testbed.robot.pause(_STUTTER_S)


def _flowing(testbed) -> None:
    testbed.thaw(_SPECTATOR)
