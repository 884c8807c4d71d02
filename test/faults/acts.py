# SPDX-License-Identifier: Apache-2.0
"""Acts on the robot, of which rows consist, with the checks of the answers."""

from __future__ import annotations

from functools import reduce
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from row import HOME, PERIOD_NS, Act
from std_srvs.srv import SetBool, Trigger

_FAR = 0.01
"""Two positions that differ by this much disagree at any speed of the hand [m]."""
_FOUND_S, _ASKED_S, _DONE_S = 5.0, 1.0, 6.0  # wall clock, wall clock, simulated
_OLD_S = 0.4  # after this time nobody takes a state for that of a node that has ended
_AGAIN_S = 1.1  # a homing that contradicts the last one counts the second time, after 1 s


def fault(device: str, name: str, value: float = 0.0) -> Act:
    """Inject a fault into a device of the simulated rig; `cured` ends it."""

    def act(robot) -> float:
        begin = robot.time
        robot.inject(device, name, value)
        return begin

    return act


def frozen(device: str, name: str) -> Act:
    """Freeze a position. It counts from where the hand has moved on, or the robot has stopped."""

    def act(robot) -> float:
        robot.inject(device, name)
        record, begin = robot.record, robot.record.now.height
        robot.wait_until(
            lambda: record.disabled_at or abs(record.now.height - begin) > _FAR,
            6.0,
            "the hand does not move on",
        )
        return robot.time

    return act


def cured(device: str) -> Act:
    """End all faults of a device of the rig."""
    return lambda robot: robot.inject(device, "clear")


def rehomed(robot) -> None:
    """Carry the handle to the reference mark and home the encoder there."""
    robot.hand.to_mark()
    while not robot.call(Trigger, HOME).success:  # until the row's deadline
        robot.pause(_AGAIN_S)


def both(*acts: Act) -> Act:
    """Do the acts in order; the fault begins at the first time that an act returns."""

    def act(robot) -> float | None:
        return next(filter(None, [one(robot) for one in acts]), None)

    return act


def repeated(act: Act, times: int) -> Act:
    """Do an act `times` times."""
    return both(*[act] * times)


def called(service: str, kind: type = Trigger, **fields: Any) -> Act:
    """Call a service; any answer is accepted."""

    def act(robot) -> float:
        begin = robot.time
        robot.call(kind, service, kind.Request(**fields))
        return begin

    return act


def switched(service: str, on: bool) -> Act:
    """Call a SetBool service; any answer is accepted."""
    return called(service, SetBool, data=on)


def refused(service: str, kind: type = Trigger, said: str = "", **fields: Any) -> Act:
    """Call a service that must refuse with a message that contains `said`."""

    def act(robot) -> None:
        answer = robot.call(kind, service, kind.Request(**fields))
        assert not answer.success, f"{service} was granted: {answer.message}"
        assert said in answer.message, service

    return act


def parameter_refused(node: str, name: str, value: Any) -> Act:
    """Set a parameter that the node must refuse with a reason that contains its name."""
    change = Parameter(name, value=value).to_parameter_msg()

    def act(robot) -> None:
        request = SetParameters.Request(parameters=[change])
        (result,) = robot.call(SetParameters, f"{node}/set_parameters", request).results
        assert not result.successful
        assert name in result.reason

    return act


def published(
    kind: type, topic: str, count: int = 0, period: float = 0.002, late: int = 0, **fields: Any
) -> Act:
    """Publish a message on a topic each `period` [s], `count` times; 0 = until the row's end.

    A message with a tick number gets the number of the next genuine one and the present time plus
    `late` [ns]. fields: values of the message's fields, `__` for nested ones; a function of the
    robot gives a value that is known only at run time.
    """

    def make(robot) -> Any:
        message = kind()
        if hasattr(message, "monotonic_ns"):
            now_ns = robot.clock.now_ns() + late
            message.monotonic_ns = now_ns
            message.sequence = (now_ns // PERIOD_NS + 1) & 0xFFFFFFFF
        for name, value in fields.items():
            *owners, last = name.split("__")
            content = value(robot) if callable(value) else value
            setattr(reduce(getattr, owners, message), last, content)
        return message

    return lambda robot: robot.intruders.publish(kind, topic, lambda: make(robot), count, period)


def game(*setpoint: float) -> Act:
    """Set the game's set point: x, y, z [m], vx, vy, vz [m/s]; nothing = no game."""

    def act(robot) -> None:
        robot.setpoint = setpoint or None

    return act


def transition(node: str, number: int) -> Act:
    """Ask for a transition of a node's life cycle, by its number; it must be done."""

    def act(robot) -> float:
        client = robot.client(ChangeState, f"{node}/change_state")
        ready = robot.creep_until(lambda: robot.is_offered(client), _FOUND_S)
        begin = robot.time
        future = client.call_async(ChangeState.Request(transition=Transition(id=number)))
        # The request travels by wall clock; the transition takes simulated time.
        robot.creep_until(future.done, _ASKED_S)
        assert ready and robot.met(future.done, _DONE_S) and future.result().success
        return begin

    return act


def reconfigured(node: str, name: str, value: Any) -> Act:
    """Give a node another value of a parameter that it reads when it is configured."""
    down = (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)
    up = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)

    def act(robot) -> None:
        both(*[transition(node, number) for number in down], paused(_OLD_S))(robot)
        robot.set_parameter(node, name, value)
        both(*[transition(node, number) for number in up])(robot)

    return act


def held_by(fixture: str) -> Act:
    """Let something else hold the handle: a fixture of the rig."""
    return lambda robot: robot.set_fixture(fixture)


def paused(seconds: float) -> Act:
    """Let simulated time pass."""
    return lambda robot: robot.pause(seconds)
