# SPDX-License-Identifier: Apache-2.0
"""Two of a kind, and what an attacker or a clumsy user would do: faults of our own invention."""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from screw_module_msgs.msg import EndpointSetpoint, ForceCommand, SafetyState
from screw_module_msgs.srv import SetControlMode
from std_srvs.srv import SetBool, Trigger

from screw_module_ros import graph

from .acts import both, called, published, refused, switched
from .limits import AT_ONCE, BY_SERVICE, COMMAND, DYING, LOST, PERIOD_NS, STALE, TOLD
from .patient import SPRING
from .row import GOES_ON, MISSED, OFF, Act, Alarm, Failed, Row, nothing

GROUP = "intruders"
_FUTURE = 1_000_000
_FOREIGN_TORQUE = 300  # per mille of the rated torque; any torque would act, for up to a period
_NO_LIMIT = 10_000  # per mille
_TWO_COMMAND = Alarm("amplifier", "force command|nodes publish", "amplifier")
_FAST = AT_ONCE + 12
"""Samples: ten more than one sender's make a second one."""
_COUNTED = 100 + AT_ONCE + 4
"""Samples: who publishes commands is counted each 0.1 s."""
_MISSED = LOST + 2 * 20 + 20 + DYING
"""Samples in which the supervisor misses a node that left in order."""


def rows() -> Iterator[Row]:
    """Two controllers, amplifiers, encoders, supervisors, games; foreign frames; storms."""
    yield from _twins()
    yield from _topics()
    yield from _frames()
    yield from _storms()
    yield _row("spectator-stutters", "a program that hears every sample is stopped and continued "
               "again and again", _stutter, "nobody: who listens cannot hold up who speaks", None,
               "none is needed", _flowing, safe=GOES_ON, watch=1.0)  # fmt: skip


def _row(
    name: str, text: str, act: Act, who: str, alarm: Alarm | None, recovery: str,
    back: Act = nothing, safe: str = OFF, within: int = AT_ONCE, watch: float = 0.3,
    apart: bool = False,
) -> Row:  # fmt: skip
    stops = safe != GOES_ON
    return Row(
        name=name, group=GROUP, fault=text, inject=act, back=back, alarm=alarm, recovery=recovery,
        noticed_by=who, within=within if stops else 0,
        plane_within=within + TOLD if stops else 0, safe=safe, watch=watch,
        apart=apart,
    )  # fmt: skip


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
               both(_permits, called("supervisor/estop"), _enable_in_vain),
               "amplifier, manus: two nodes publish safety_state",
               Alarm("supervisor", "emergency stop", "emergency stop"),
               "stop it; clear_fault, reset, enable", within=BY_SERVICE)  # fmt: skip
    yield _row("two-games", "two games with contradictory set points, 1000 a second",
               _second_game, "controller and manus: speed and acceleration are limited", None,
               "none is needed", safe=GOES_ON, watch=1.0)  # fmt: skip


def _guest(node: str) -> Act:
    return lambda testbed: testbed.start_guest(node, "-r", f"__node:={node}_2")


def _second_controller(testbed) -> float:
    """Start it; the harm begins with its first command, the second for the same sample."""
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

    if not testbed.until(doubled, 15.0):
        raise Failed("the second controller commands nothing")
    return testbed.just_now()


def _permits(testbed) -> None:
    published(
        SafetyState, graph.SAFETY_STATE, 0, 0.001, level=SafetyState.OK, motion_permitted=True,
        vertical_permitted=True, planar_permitted=True,
    )(testbed)  # fmt: skip


def _enable_in_vain(testbed) -> None:
    """No drive may be enabled while two senders contradict each other."""
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
               _future_commands, "amplifier", Alarm("amplifier", "force command", "amplifier"),
               "stop the sender; amplifier/clear_fault, reset, enable", within=AT_ONCE + 6,
               apart=True)  # fmt: skip
    yield _row("command-absurd", "one force command of 149 N, from a foreign sender",
               published(ForceCommand, graph.FORCE_COMMAND, 1, 0.01, force=149.0),
               "amplifier: two nodes publish it; it is followed by 4 N at most", _TWO_COMMAND,
               "stop the sender; amplifier/clear_fault, reset, enable", within=_COUNTED,
               apart=True)  # fmt: skip
    yield _row("command-4-khz", "30 N, 4000 times a second, each newer than the true one before it",
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


def _frames() -> Iterator[Row]:
    torque = struct.pack("<BHBi", 0x2B, 0x6071, 0, _FOREIGN_TORQUE)
    limit = struct.pack("<BHBi", 0x2B, 0x6072, 0, _NO_LIMIT)
    for name, text, data in (
        ("torque", "writes 6071 by SDO, 100 a second", torque),
        ("limit", "takes the drive's torque limit 6072 away by SDO", limit),
    ):
        yield _row(f"foreign-sdo-{name}", f"a foreign master {text}",
                   _frames_on("amplifier", 0x601, data, 0.01),
                   "amplifier: another SDO client; it stops the node",
                   Alarm("amplifier", "another SDO client", "amplifier"),
                   "stop it; amplifier/clear_fault, which configures the drive anew, reset, "
                   "enable", within=AT_ONCE + 11)  # fmt: skip
    turned = struct.pack("<BHBi", 0x2B, 0x6000, 0, 5)
    yield _row("foreign-sdo-encoder", "a foreign master turns the encoder's direction by SDO",
               _frames_on("encoder", 0x602, turned, 0.01), "encoder: another SDO client",
               Alarm("encoder", "another SDO client", "encoder"),
               f"stop it; encoder/home, {MISSED}, reset, enable",
               within=STALE + 10 + DYING, apart=True)  # fmt: skip
    wrong = struct.pack(">Hh", 0x000F, 0)
    yield _row("foreign-controlword-wrong-endian", "a foreign master sends controlwords with bytes "
               "swapped", _frames_on("amplifier", 0x201, wrong, 0.01), "amplifier: the drive left",
               Alarm("amplifier", "drive", "amplifier"),
               "stop it; amplifier/clear_fault, reset, enable", within=AT_ONCE + 11)  # fmt: skip
    yield _row("foreign-walk-up", "a foreign master walks the drive up, which nobody has enabled",
               _walk_up,
               "amplifier: somebody else commands the drive; it stops the node",
               Alarm("amplifier", "somebody else commands the vertical drive", "amplifier"),
               "stop it; amplifier/clear_fault, reset, enable")  # fmt: skip
    nmt = struct.pack("<BB", 0x80, 0)
    yield _row("foreign-nmt-preoperational", "a foreign master sends all devices of the drive's "
               "bus to PRE-OPERATIONAL", _frames_on("amplifier", 0x000, nmt, 0.05), "amplifier",
               Alarm("amplifier", "drive", "amplifier"),
               "stop it; amplifier/clear_fault, reset, enable",
               within=51 + COMMAND + 4 + DYING)  # fmt: skip
    yield _row("foreign-sync", "a foreign master sends SYNC on the encoder's bus",
               _frames_on("encoder", 0x080, b"", 0.005), "encoder",
               Alarm("encoder", "somebody else sends SYNC", "encoder"),
               f"stop it; encoder/home, {MISSED}, reset, enable",
               within=STALE + 10 + DYING, apart=True)  # fmt: skip


def _frames_on(node: str, can_id: int, data: bytes, period: float) -> Act:
    def act(testbed) -> None:
        port = testbed.intruders.port(node)
        testbed.intruders.repeat(lambda: port.send(can_id, data), period)

    return act


def _walk_up(testbed) -> float:
    """Send it to operation enabled with torque, between our commands, a thousand times a second."""
    for node in ("amplifier", "manus"):
        switched(f"{node}/enable", False)(testbed)
    port = testbed.intruders.port("amplifier")
    words = [struct.pack("<Hh", word, _FOREIGN_TORQUE) for word in (0x06, 0x07, 0x0F)]

    def walk() -> None:
        for word in words:
            port.send(0x201, word)

    testbed.robot.pause(0.1)
    begin = testbed.just_now()
    testbed.intruders.repeat(walk, 0.001)
    return begin


def _storms() -> Iterator[Row]:
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


def _storm(calls: list[tuple]) -> Act:
    def act(testbed) -> None:
        for service, kind, fields in calls * 3:
            testbed.robot.call(kind, service, kind.Request(**fields))

    return act


def _parameter_storm(testbed) -> None:
    """Without waiting for answers."""
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
        begin = testbed.just_now()
        request = ChangeState.Request(transition=Transition(id=number))
        answer = testbed.robot.call(ChangeState, f"{node}/change_state", request)
        if not answer.success:
            raise Failed(f"{node} refused the transition")
        return begin

    return act


_SPECTATOR = "endpoint_state"
_STUTTERS, _STUTTER_S = 10, 0.017


def _stutter(testbed) -> None:
    acts = itertools.cycle((testbed.freeze, testbed.thaw))
    for _ in range(_STUTTERS):
        next(acts)(_SPECTATOR)
        testbed.robot.pause(_STUTTER_S)


def _flowing(testbed) -> None:
    testbed.thaw(_SPECTATOR)
