# SPDX-License-Identifier: Apache-2.0
"""What rows are put together from: acts on a testbed, and what they check of the answers."""

from __future__ import annotations

from functools import reduce
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from .limits import PERIOD_NS
from .recovery import AGAIN, SECOND_WORD_S
from .row import Act, Failed


def fault(device: str, name: str, value: float = 0.0) -> Act:
    """Make something go wrong in the simulated rig, until `cured`."""

    def act(testbed) -> float:
        begin = testbed.just_now()
        testbed.robot.inject(device, name, value)
        return begin

    return act


def cured(device: str) -> Act:
    """End every fault of a device of the rig."""
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
    """Do one after the other; the harm begins with the first that does any."""

    def act(testbed) -> float | None:
        return next(filter(None, [one(testbed) for one in acts]), None)

    return act


def called(service: str, kind: type = Trigger, **fields: Any) -> Act:
    """Call a service, whatever it answers."""

    def act(testbed) -> float:
        begin = testbed.just_now()
        testbed.robot.call(kind, service, kind.Request(**fields))
        return begin

    return act


def switched(service: str, on: bool) -> Act:
    """Call a SetBool service, whatever it answers."""
    return called(service, SetBool, data=on)


def refused(service: str, service_type: type = Trigger, said: str = "", **fields: Any) -> Act:
    """Call a service that must refuse, in a sentence with `said` in it."""

    def act(testbed) -> None:
        answer = testbed.robot.call(service_type, service, service_type.Request(**fields))
        if answer.success or said not in answer.message:
            raise Failed(f"{service} was not refused as it should: {answer.message!r}")

    return act


def parameter_refused(node: str, name: str, value: Any, said: str) -> Act:
    """Set a parameter that must be refused, in a sentence with `said` in it."""
    given = Parameter(name, value=value).to_parameter_msg()

    def act(testbed) -> None:
        request = SetParameters.Request(parameters=[given])
        (result,) = testbed.robot.call(SetParameters, f"{node}/set_parameters", request).results
        if result.successful:
            raise Failed(f"{node} took {name} = {value!r}")
        if said not in result.reason:
            raise Failed(f"{node} refused {name} = {value!r} without {said!r}: {result.reason}")

    return act


def published(
    kind: type, topic: str, count: int = 0, period: float = 0.002, late: int = 0, **fields: Any
) -> Act:
    """Publish a message with these fields on a topic each `period` [s], `count` times or for good.

    Numbered messages look like the next true one: tick number, acquisition of now, `late` ns added.
    A field may be a function of the testbed, for what is known only then.
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
    """Let the game publish x, y, z, vx, vy, vz."""

    def act(testbed) -> None:
        testbed.heard.setpoint = setpoint

    return act


def repeated(act: Act, times: int) -> Act:
    """Do an act so many times."""
    return both(*[act] * times)
