# SPDX-License-Identifier: Apache-2.0
"""Acts on a testbed, of which rows consist, with the checks of the answers."""

from __future__ import annotations

from functools import reduce
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from .limits import PERIOD_NS
from .recovery import AGAIN, SECOND_WORD_S
from .row import Act, Failed

_FAR = 0.01
"""Two positions that differ by this much disagree at any speed of the hand [m]."""


def fault(device: str, name: str, value: float = 0.0) -> Act:
    """Inject a fault into a device of the simulated rig; `cured` ends it."""

    def act(testbed) -> float:
        begin = testbed.listener.time
        testbed.robot.inject(device, name, value)
        return begin

    return act


def frozen(device: str, name: str) -> Act:
    """Freeze a position. It counts from where the hand has moved on, or the robot has stopped."""

    def act(testbed) -> float:
        testbed.robot.inject(device, name)
        begin = testbed.listener.now.height

        testbed.robot.wait_until(
            lambda: (
                testbed.listener.disabled_at() or abs(testbed.listener.now.height - begin) > _FAR
            ),
            6.0,
            "the hand does not move on",
        )
        return testbed.listener.time

    return act


def cured(device: str) -> Act:
    """End all faults of a device of the rig."""
    return lambda testbed: testbed.robot.inject(device, "clear")


def rehomed(testbed) -> None:
    """Carry the handle to the reference mark and home the encoder there."""
    testbed.patient.place()

    def home() -> bool:
        answer = testbed.robot.call(Trigger, "encoder/home")
        if AGAIN in answer.message:
            testbed.robot.pause(SECOND_WORD_S)
            answer = testbed.robot.call(Trigger, "encoder/home")
        return answer.success

    testbed.robot.wait_until(home, 8.0, "encoder/home is refused")


def both(*acts: Act) -> Act:
    """Do the acts in order; the fault begins at the first time that an act returns."""

    def act(testbed) -> float | None:
        return next(filter(None, [one(testbed) for one in acts]), None)

    return act


def called(service: str, kind: type = Trigger, **fields: Any) -> Act:
    """Call a service; any answer is accepted."""

    def act(testbed) -> float:
        begin = testbed.listener.time
        testbed.robot.call(kind, service, kind.Request(**fields))
        return begin

    return act


def switched(service: str, on: bool) -> Act:
    """Call a SetBool service; any answer is accepted."""
    return called(service, SetBool, data=on)


def refused(service: str, service_type: type = Trigger, said: str = "", **fields: Any) -> Act:
    """Call a service that must refuse with a message that contains `said`."""

    def act(testbed) -> None:
        answer = testbed.robot.call(service_type, service, service_type.Request(**fields))
        if answer.success or said not in answer.message:
            raise Failed(f"{service} was not refused with {said!r}: {answer.message!r}")

    return act


def parameter_refused(node: str, name: str, value: Any, said: str) -> Act:
    """Set a parameter that the node must refuse with a reason that contains `said`."""
    change = Parameter(name, value=value).to_parameter_msg()

    def act(testbed) -> None:
        request = SetParameters.Request(parameters=[change])
        (result,) = testbed.robot.call(SetParameters, f"{node}/set_parameters", request).results
        if result.successful:
            raise Failed(f"{node} accepted {name} = {value!r}")
        if said not in result.reason:
            raise Failed(f"{node} refused {name} = {value!r} without {said!r}: {result.reason}")

    return act


def published(
    kind: type, topic: str, count: int = 0, period: float = 0.002, late: int = 0, **fields: Any
) -> Act:
    """Publish a message on a topic each `period` [s], `count` times; 0 = until the row's end.

    A message with a tick number gets the number of the next genuine one and the present time plus
    `late` [ns]. fields: values of the message's fields, `__` for nested ones; a function of the
    testbed gives a value that is known only at run time.
    """

    def make(testbed) -> Any:
        message = kind()
        if hasattr(message, "monotonic_ns"):
            now_ns = testbed.robot.clock.now_ns() + late
            message.monotonic_ns = now_ns
            message.sequence = (now_ns // PERIOD_NS + 1) & 0xFFFFFFFF
        for name, value in fields.items():
            *owners, last = name.split("__")
            content = value(testbed) if callable(value) else value
            setattr(reduce(getattr, owners, message), last, content)
        return message

    return lambda testbed: testbed.intruders.publish(
        kind, topic, lambda: make(testbed), count, period
    )


def game(*setpoint: float) -> Act:
    """Set the game's set point: x, y, z [m], vx, vy, vz [m/s]."""

    def act(testbed) -> None:
        testbed.listener.setpoint = setpoint

    return act


def held_by(fixture: str) -> Act:
    """Let something else hold the handle: a fixture of the rig."""
    return lambda testbed: testbed.robot.set_fixture(fixture)


def repeated(act: Act, times: int) -> Act:
    """Do an act `times` times."""
    return both(*[act] * times)
