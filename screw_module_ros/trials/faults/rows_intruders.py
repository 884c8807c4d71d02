# SPDX-License-Identifier: Apache-2.0
"""Rows about a second node of a kind and about a foreign sender on a topic."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from screw_module_msgs.msg import EndpointSetpoint, ForceCommand, SafetyState
from std_srvs.srv import SetBool

from screw_module_ros import graph

from .acts import both, called, published
from .creep import creep
from .intruder_row import intruder_row as _row
from .limits import AT_ONCE, BY_SERVICE, PERIOD_NS
from .patient import SPRING
from .row import GOES_ON, Act, Alarm, Failed, Row

_FUTURE = 1_000_000
_TWO_COMMAND = Alarm("amplifier", "force command|nodes publish", "amplifier")
_FAST = AT_ONCE + 12
"""Samples: ten more messages than expected indicate a second sender."""
_FOUND_S = 4.0
"""Wall clock in which every process has found a publisher that one has found: the middleware
repeats its announcements each 3 s, should the first ones be lost."""
_COUNTED = 100 + AT_ONCE + 4
"""Samples: the amplifier counts the publishers of commands each 0.1 s."""


def rows() -> Iterator[Row]:
    """Return the rows of two controllers, amplifiers, supervisors, games, and foreign commands."""
    yield from _twins()
    yield from _topics()


def _twins() -> Iterator[Row]:
    yield _row("two-controllers", "a second impedance_controller under another name",
        _second_controller, "amplifier", _TWO_COMMAND,
        "stop it; amplifier/clear_fault, reset, enable", within=_COUNTED, apart=True)  # fmt: skip
    for node in ("amplifier", "force_sensor"):
        yield _row(f"two-of-{node}", f"a second {node} on the same device, under another name",
                   _guest(node), f"the second {node}: it does not start",
                   Alarm(f"{node}_2", "already driven by another process"), "stop it",
                   safe=GOES_ON, watch=1.0)  # fmt: skip
    yield _row("two-supervisors", "emergency stop, while a second supervisor permits motion",
               both(_permits, called("supervisor/estop"), _enable_refused),
               "amplifier, manus: two nodes publish safety_state",
               Alarm("supervisor", "emergency stop", "emergency stop"),
               "stop it; clear_fault, reset, enable", within=BY_SERVICE)  # fmt: skip
    yield _row("two-games", "two games with contradictory set points, 1000 a second",
               _second_game, "controller and manus: speed and acceleration are limited", None,
               "none is needed", safe=GOES_ON, watch=1.0)  # fmt: skip


def _guest(node: str) -> Act:
    return lambda testbed: testbed.start_guest(node, "-r", f"__node:={node}_2")


def _second_controller(testbed) -> float:
    """Start it; the fault begins with its first command, the second one for the same sample."""
    take = testbed.intruders.listen(ForceCommand, graph.FORCE_COMMAND)
    testbed.start_guest("impedance_controller", "-r", "__node:=impedance_controller_2")
    newest = -1

    def doubled() -> bool:
        nonlocal newest
        while (command := take()) is not None:
            if command.sequence <= newest:
                return True
            newest = command.sequence
        return False

    testbed.robot.wait_until(doubled, 15.0, "the second controller sends no command")
    begin = testbed.listener.time
    # It is heard here; by wall clock the amplifier's middleware may find it a moment later.
    creep(testbed.robot.clock, _FOUND_S)
    return begin


def _permits(testbed) -> None:
    published(
        SafetyState, graph.SAFETY_STATE, 0, 0.001, level=SafetyState.OK, motion_permitted=True,
        vertical_permitted=True, planar_permitted=True,
    )(testbed)  # fmt: skip


def _enable_refused(testbed) -> None:
    """Check that no drive can be enabled while two senders contradict each other."""
    testbed.robot.pause(0.3)
    for node in ("amplifier", "manus"):
        for _ in range(10):
            answer = testbed.robot.call(SetBool, f"{node}/enable", SetBool.Request(data=True))
            if answer.success:
                raise Failed(f"{node}/enable was granted after an emergency stop")


def _second_game(testbed) -> None:
    published(
        EndpointSetpoint, graph.SETPOINT, 0, 0.001, position__x=-0.1, position__y=-0.1,
        position__z=0.05,
    )(testbed)  # fmt: skip


def _topics() -> Iterator[Row]:
    yield _row("command-from-the-future", "force commands with tick numbers far ahead",
               _future_commands, "amplifier", _TWO_COMMAND,
               "stop the sender; amplifier/clear_fault, reset, enable", within=_COUNTED,
               apart=True)  # fmt: skip
    yield _row("command-absurd", "one force command of 149 N, from a foreign sender",
               published(ForceCommand, graph.FORCE_COMMAND, 1, 0.01, force=149.0),
               "amplifier: two nodes publish it; it changes the force by 4 N at most", _TWO_COMMAND,
               "stop the sender; amplifier/clear_fault, reset, enable", within=_COUNTED,
               apart=True)  # fmt: skip
    yield _row("command-4-khz", "30 N, 4000 times a second, each newer than the genuine command",
               _fast_commands, "amplifier", _TWO_COMMAND,
               "stop the sender; amplifier/clear_fault, reset, enable", within=_FAST,
               apart=True)  # fmt: skip
    x, y, z, *_ = SPRING
    yield _row("setpoint-plane-only-nan", "set points with NaN in the plane only",
               published(EndpointSetpoint, graph.SETPOINT, 0, 0.005, position__x=math.nan,
                         position__y=math.nan, position__z=z, velocity__x=math.nan),
               "manus leaves its axes alone", None, "none is needed", safe=GOES_ON,
               watch=1.0)  # fmt: skip


def _fast_commands(testbed) -> float:
    clock = testbed.robot.clock
    numbers = itertools.count(clock.now_ns() // PERIOD_NS + 2)

    def make() -> ForceCommand:
        number = next(numbers) & 0xFFFFFFFF
        return ForceCommand(force=30.0, monotonic_ns=clock.now_ns(), sequence=number)

    return testbed.intruders.publish(ForceCommand, graph.FORCE_COMMAND, make, 0, 0.00025)


def _future_commands(testbed) -> float:
    clock = testbed.robot.clock

    def make() -> ForceCommand:
        return ForceCommand(
            force=10.0, monotonic_ns=clock.now_ns(),
            sequence=(clock.now_ns() // PERIOD_NS + _FUTURE) & 0xFFFFFFFF,
        )  # fmt: skip

    return testbed.intruders.publish(ForceCommand, graph.FORCE_COMMAND, make, 20, 0.005)
