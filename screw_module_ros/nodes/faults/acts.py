# SPDX-License-Identifier: Apache-2.0
"""What rows are put together from: acts on a stand, and what they check of the answers."""

from __future__ import annotations

import time
from functools import reduce
from typing import Any

from std_srvs.srv import SetBool, Trigger

from ..support.robot import RobotError
from .row import Act, Failed
from .ticks import PERIOD

_PERIOD_NS = round(PERIOD * 1e9)


def fault(device: str, name: str, value: float = 0.0) -> Act:
    """Make something go wrong in the simulated rig, until `cured`."""
    return lambda stand: stand.robot.inject(device, name, value) and None


def cured(device: str) -> Act:
    """End every fault of a device of the rig."""
    return lambda stand: stand.robot.inject(device, "clear")


def rehomed(stand) -> None:
    """Carry the handle to the reference mark and home the encoder there."""
    stand.place()
    stand.robot.wait_until(
        lambda: stand.robot.call(Trigger, "encoder/home").success, 5.0, "encoder/home is refused"
    )


def both(*acts: Act) -> Act:
    """Do one after the other."""

    def act(stand) -> None:
        for one in acts:
            one(stand)

    return act


def called(service: str, kind: type = Trigger, **fields: Any) -> Act:
    """Call a service, whatever it answers."""
    return lambda stand: stand.robot.call(kind, service, kind.Request(**fields)) and None


def switched(service: str, on: bool) -> Act:
    """Call a SetBool service, whatever it answers."""
    return called(service, SetBool, data=on)


def refused(service: str, kind: type = Trigger, said: str = "", **fields: Any) -> Act:
    """Call a service that must refuse, in a sentence with `said` in it."""

    def act(stand) -> None:
        answer = stand.robot.call(kind, service, kind.Request(**fields))
        if answer.success or said not in answer.message:
            raise Failed(f"{service} was not refused as it should: {answer.message!r}")

    return act


def parameter_refused(node: str, name: str, value: Any) -> Act:
    """Set a parameter that must be refused in a sentence naming it."""

    def act(stand) -> None:
        try:
            stand.robot.set_parameter(node, name, value)
        except RobotError as error:
            if "refused" not in str(error) or name not in str(error):
                raise Failed(f"not refused with its name: {error}") from error
        else:
            raise Failed(f"{node} took {name} = {value!r}")

    return act


def published(
    kind: type, topic: str, count: int = 0, period: float = 0.002, late: int = 0, **fields: Any
) -> Act:
    """Publish a message with these fields on a topic, `count` times or until dismissed.

    Numbered messages look like the next true one: tick number, acquisition of now, `late` ns added.
    """

    def make() -> Any:
        message = kind()
        if hasattr(message, "monotonic_ns"):
            now = time.monotonic_ns() + late
            message.monotonic_ns = now
            message.sequence = (now // _PERIOD_NS + 1) & 0xFFFFFFFF
        for name, value in fields.items():
            *owners, last = name.split("__")
            setattr(reduce(getattr, owners, message), last, value)
        return message

    def act(stand) -> float:
        stand.intrude(kind, topic, make, count, period)
        return 0.0

    return act


def game(*setpoint: float) -> Act:
    """Let the game publish x, y, z, vx, vy, vz."""

    def act(stand) -> None:
        stand.heard.setpoint = setpoint

    return act


def repeated(act: Act, times: int) -> Act:
    """Do an act so many times."""

    def acts(stand) -> None:
        for _ in range(times):
            act(stand)

    return acts
