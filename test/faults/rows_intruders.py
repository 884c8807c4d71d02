# SPDX-License-Identifier: Apache-2.0
"""Rows about a second node of a kind and about a foreign sender on a topic."""

from __future__ import annotations

import itertools
import math

from acts import both, called, paused, published, refused, repeated
from fault_robot import SPRING
from row import (
    AT_ONCE,
    BY_SERVICE,
    CLEAR,
    ENABLE,
    MODE,
    PERIOD_NS,
    PLANE_BACK,
    PLANE_CLEAR,
    STOPPED,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
    goes_on,
)
from screw_module_msgs.msg import (
    EndpointSetpoint,
    ForceCommand,
    ImpedanceState,
    PlanarState,
    SafetyState,
)
from std_srvs.srv import SetBool

from screw_module_ros import graph
from screw_module_ros.graph import MODULE, Entry

GROUP = "intruders"
_FUTURE = 1_000_000
_TWO_COMMAND = Report("amplifier", "force command|nodes publish", "amplifier")
_FAST = AT_ONCE + 12
"""Samples: ten more messages than expected indicate a second sender."""
_FOUND_S = 4.0
"""Wall clock in which every process has found a publisher that one has found: the middleware
repeats its announcements each 3 s, should the first ones be lost."""
_COUNTED = 100 + AT_ONCE + 4
"""Samples: the amplifier counts the publishers of commands each 0.1 s."""
_COUNTED_STATE = 100 + 2 * 20 + VIA_SUPERVISOR
"""Samples: the supervisor counts each 0.1 s, and reads and decides at 50 Hz each."""
_AMPLIFIER_BACK = (CLEAR, *STOPPED)


def _stops(
    name: str, text: str, act: Act, who: str, within: int, report: Report = _TWO_COMMAND,
    services=_AMPLIFIER_BACK, shared: Entry | None = None,
) -> Row:  # fmt: skip
    return Row(name, GROUP, text, act, report, services, who, within, within + VIA_SUPERVISOR,
               watch=0.3, shared=shared)  # fmt: skip


def _goes_on(name: str, text: str, act: Act, who: str) -> Row:
    return goes_on(name, GROUP, text, act, who, watch=1.0)


def _twin(node: str) -> Row:
    def act(robot) -> None:
        robot.start_guest(node, "-r", f"__node:={node}_2")

    row = _goes_on(f"two-of-{node}", f"a second {node} on the same device, under another name",
                   act, f"the second {node}: it does not start")  # fmt: skip
    return row._replace(report=Report(f"{node}_2", "already driven by another process"))


def _second_controller(robot) -> float:
    """Start it; the fault begins with its first command, the second one for the same sample."""
    take = robot.intruders.listen(ForceCommand, graph.FORCE_COMMAND)
    robot.start_guest("impedance_controller", "-r", "__node:=impedance_controller_2")
    newest = -1

    def doubled() -> bool:
        nonlocal newest
        while (command := take()) is not None:
            if command.sequence <= newest:
                return True
            newest = command.sequence
        return False

    robot.wait_until(doubled, 15.0, "the second controller sends no command")
    begin = robot.time
    # It is heard here; by wall clock the amplifier's middleware may find it a moment later.
    robot.creep_until(lambda: False, _FOUND_S)
    return begin


def _fast_commands(robot) -> float:
    """Publish commands of 30 N whose numbers follow each other, from two ticks ahead on."""
    clock = robot.clock
    numbers = itertools.count(clock.now_ns() // PERIOD_NS + 2)

    def make() -> ForceCommand:
        number = next(numbers) & 0xFFFFFFFF
        return ForceCommand(force=30.0, monotonic_ns=clock.now_ns(), sequence=number)

    return robot.intruders.publish(ForceCommand, graph.FORCE_COMMAND, make, 0, 0.00025)


def _future_number(robot) -> int:
    return (robot.clock.now_ns() // PERIOD_NS + _FUTURE) & 0xFFFFFFFF


def _permits(robot) -> None:
    published(
        SafetyState, graph.SAFETY_STATE, 0, 0.001, level=SafetyState.OK, motion_permitted=True,
        vertical_permitted=True, planar_permitted=True,
    )(robot)  # fmt: skip


_CONTRADICTS = published(
    EndpointSetpoint, graph.SETPOINT, 0, 0.001, position__x=-0.1, position__y=-0.1,
    position__z=0.05,
)  # fmt: skip
_PLANE_NAN = published(
    EndpointSetpoint, graph.SETPOINT, 0, 0.005, position__x=math.nan, position__y=math.nan,
    position__z=SPRING[2], velocity__x=math.nan,
)  # fmt: skip
_STATES = {  # as a recording that is played in the robot's domain repeats them
    graph.MANUS_STATE: (PlanarState, {"homed": True, "enabled": True}),
    graph.CONTROLLER_STATE: (ImpedanceState, {}),
}


def _repeated_state(node: str, topic: str, services) -> Row:
    """The node dies, and somebody goes on to send its last state: it is not alive."""
    kind, fields = _STATES[topic]
    row = _stops(
        f"{node}-dead-state-repeated",
        f"{node} killed, its state is repeated by another",
        both(published(kind, topic, 0, 0.005, **fields), lambda robot: robot.kill(node)),
        "supervisor: two nodes publish it", _COUNTED_STATE,
        Report("supervisor", f"{topic}: one is allowed", node), services,
    )  # fmt: skip
    return row._replace(mend=lambda robot: robot.restart(node))


ROWS = [
    _repeated_state("manus", graph.MANUS_STATE, PLANE_BACK),
    _repeated_state("impedance_controller", graph.CONTROLLER_STATE, (MODE, CLEAR, *STOPPED)),
    _stops("two-controllers", "a second impedance_controller under another name",
           _second_controller, "amplifier", _COUNTED),
    _twin("amplifier"),
    _twin("force_sensor"),
    _stops("two-supervisors", "emergency stop, while a second supervisor permits motion",
           # No drive can be enabled while two senders contradict each other.
           both(_permits, called("supervisor/estop"), paused(0.3),
                *[repeated(refused(enable, SetBool, data=True), 10) for enable in ENABLE]),
           "amplifier, manus: two nodes publish safety_state", BY_SERVICE,
           Report("supervisor", "emergency stop", "emergency stop"),
           (CLEAR, PLANE_CLEAR, *STOPPED), shared=MODULE),
    _goes_on("two-games", "two games with contradictory set points, 1000 a second", _CONTRADICTS,
             "controller and manus warn; speed and acceleration are limited",
             )._replace(report=Report("impedance_controller", "nodes publish setpoint")),
    _stops("command-from-the-future", "force commands with tick numbers far ahead",
           published(ForceCommand, graph.FORCE_COMMAND, 20, 0.005, force=10.0,
                     sequence=_future_number), "amplifier", _COUNTED),
    _stops("command-absurd", "one force command of 149 N, from a foreign sender",
           published(ForceCommand, graph.FORCE_COMMAND, 1, 0.01, force=149.0),
           "amplifier: two nodes publish it; it changes the force by 4 N at most", _COUNTED),
    _stops("command-4-khz", "30 N, 4000 times a second, each newer than the genuine command",
           _fast_commands, "amplifier", _FAST),
    _goes_on("setpoint-plane-only-nan", "set points with NaN in the plane only", _PLANE_NAN,
             "manus leaves its axes alone"),
]  # fmt: skip
