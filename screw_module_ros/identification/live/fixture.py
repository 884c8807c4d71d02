# SPDX-License-Identifier: Apache-2.0
"""What holds handle or rotor during a trial: the simulated rig's services, or an operator.

The user does the mounting (stage, locked rotor, hand): a wrong fixture is refused, with the way
out. The trial controls a mounted stage or hand.

The zero of the transducer is measured with the handle untouched and the pin in, so that the nut
does not move. A rotor locked on the transducer is unloaded as soon as the torque is off.

The operator's confirmation is left out only for a rig that was detected on the bus. A node with the
name `sim_rig` proves nothing: it can also run beside a real robot.
"""

from __future__ import annotations

import math
import statistics
import threading
from collections.abc import Callable
from typing import Annotated, NamedTuple

from screw_module_msgs.msg import EncoderSample, SimTruth
from screw_module_msgs.srv import SetFixture

from screw_module_ros import graph
from screw_module_ros.can_io.bus import SIMULATED_INTERFACES, BusSettings, open_bus, within
from screw_module_ros.clock import WallClock
from screw_module_ros.devices.errors import BusError
from screw_module_ros.identification.trials import WAY_S, Arm, MotionTrial, NotPossible
from screw_module_ros.nodes.support.inbox import Inbox
from screw_module_ros.nodes.support.topics import offered
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot, arm
from screw_module_ros.settings import Setting

_CONFIRM_S = 1800.0
_RETURN_S = 1.0
_NEAR = 2e-4  # [m]
_FIXTURES = {
    "stage": "the handle is not on the positioning stage",
    "locked_rotor": "the rotor is not locked on the transducer",
    "human_arm": "no hand holds the handle",
}
_HEARD_S = 5.0
_FRESH_NS = 1_000_000_000
_PLACING_S = 20.0
_SETTLE_S = 0.3
_PLACING_SPEED = 0.1  # speed of the rig as it carries the handle [m/s]
_THERE = 1e-4  # [m]
_CREEP = 2e-3  # [m/s]; the stand waits for rest after the law has started
_SAG = 0.05  # largest sag of the handle in a hand [m]
_STILL = 1e-4  # [m/s]
_TRAVEL = 0.36  # [m]
_ACCELERATION = 2.0  # acceleration of the rig's stage [m/s^2]
_LONGEST_WAY = 1000  # stored positions, from which the stage's start is computed
_NAN = math.nan
_TPDO1 = 0x180  # CiA 301: its COB-ID is this and the node id
_LOOK_NS = 500_000_000
_ENOUGH = 20
_RECEIVE_S = 0.05


class OperatorFixture:
    """Requests actions of an operator, who confirms each with `~/confirm`.

    Every method of a fixture may raise RobotError. simulated: without an operator.
    """

    simulated = False

    def __init__(self, robot: Robot, confirmed: threading.Event, say: Callable[[str], None]):
        self._robot, self._confirmed, self._say = robot, confirmed, say
        self._mounted = ""
        self._speed = 0.0

    def _ask(self, what: str) -> None:
        self._confirmed.clear()
        service = topic_of(self._robot, "characterize/confirm")
        self._say(f"PLEASE: {what}; then ros2 service call {service} std_srvs/srv/Trigger")
        if not self._robot.met(self._confirmed.is_set, _CONFIRM_S):
            raise RobotError(f"nobody confirmed within {_CONFIRM_S / 60:.0f} minutes: {what}")

    def require(self, fixture: str) -> None:
        """Request the mounting and its confirmation, once."""
        if self._mounted != fixture:
            self._ask({
                "stage": "mount the positioning stage, lock pin out",
                "locked_rotor": "take the motor off the screw and lock its rotor to the transducer",
                "human_arm": "let a healthy person hold the handle, lock pin out",
            }[fixture])  # fmt: skip
            self._mounted = fixture

    def unload(self) -> None:
        """Request the release of the handle."""
        self._ask("let go of the handle, or take it off the stage, and leave it at rest")

    def stage_at(self, height: float, upside_down: bool) -> None:
        """Request the handle on the stage at a height [m]."""
        over = ", the module upside down" if upside_down else ", the module upright"
        self._ask(f"put the handle on the stage at {1e3 * height:.0f} mm{over}, at rest")

    def stage_hold(self) -> None:
        """Request the connection of the handle to the stage at its present height."""
        self._ask("fix the handle to the stage as it hangs")

    def stage_go(self, speed: float, end: float) -> None:
        """Tell the operator to start the stage."""
        self._speed = speed
        self._say(f"PLEASE: run the stage to {1e3 * end:.0f} mm at {1e3 * speed:g} mm/s")

    def stage_passed(self, end: float) -> bool:
        """Return whether the nut has passed `end` [m]."""
        sample = self._robot.state(EncoderSample)
        direction = math.copysign(1.0, self._speed)
        return sample is not None and direction * (sample.position - end) > -_NEAR

    def stage_began_ns(self) -> float | None:
        """Return None: only the position of the nut is known."""
        return None

    def stage_halt(self) -> None:
        """Tell the operator to stop the stage."""
        self._say("PLEASE: stop the stage")

    def hand_at(self, hand: Arm, centre: float) -> None:
        """Request that the person holds the handle at a height [m]."""
        self._ask(f"hold the handle at rest at {1e3 * centre:.0f} mm")

    def hand_moves(self, trial: MotionTrial) -> None:
        """Let the hand move up and down as the trial says."""
        self._say(
            f"PLEASE: move the handle up and down by {1e3 * trial.amplitude:.0f} mm about "
            f"{1e3 * trial.centre:.0f} mm, once in {2.0 * math.pi / trial.omega:.1f} s"
        )

    def hand_lets_go(self) -> None:
        """Have the hand let the handle go where it is."""
        self._say("PLEASE: let the handle go")

    def hand_rests(self, centre: float) -> None:
        """Let the hand come back and rest at a height [m]."""
        self._say("PLEASE: hold the handle at rest")
        self._robot.pause(_RETURN_S)

    def mounted(self) -> str:
        """Return what the operator confirmed."""
        return self._mounted

    def reload(self) -> None:
        """Do nothing: the next trial requests its fixture."""

    def put_back(self) -> None:
        """Leave the mounting to the operator."""

    def close(self) -> None:
        """There is nothing to close."""


class RigFixture:
    """The simulated rig: stage and hand, operated through its services."""

    simulated = True

    def __init__(self, robot: Robot):
        self._robot = robot
        self._truth: SimTruth | None = None
        self._heard_ns = 0
        self._found: SimTruth | None = None
        self._upside_down = False
        self._speed, self._begin = 0.0, 0.0
        self._way: list[tuple[int, float]] = []  # times [ns since the epoch] and heights [m]
        self._inbox = Inbox(robot.node, robot.clock)
        self._take = self._inbox.subscribe(*offered(graph.TRUTH))

    def close(self) -> None:
        """Remove the subscription."""
        self._inbox.close()

    def truth(self) -> SimTruth:
        """Return the newest sim/truth. Raises RobotError when the rig is silent."""
        self._robot.wait_until(self._is_heard, _HEARD_S, "sim_rig is silent")
        return self._truth

    def _is_heard(self) -> bool:
        now_ns = self._robot.clock.now_ns()
        while (truth := self._take()) is not None:
            self._truth, self._heard_ns = truth, now_ns
            if len(self._way) < _LONGEST_WAY:
                stamp = truth.header.stamp
                self._way.append((stamp.sec * 10**9 + stamp.nanosec, truth.handle_position))
        return self._truth is not None and now_ns - self._heard_ns < _FRESH_NS

    def require(self, fixture: str) -> None:
        """Raise NotPossible, with the way out, unless the rig has this fixture."""
        truth = self.truth()
        service = topic_of(self._robot, "sim_rig/set_fixture")
        call = f"ros2 service call {service} screw_module_msgs/srv/SetFixture"
        if truth.fixture != fixture:
            raise NotPossible(
                f"{_FIXTURES[fixture]} but on {truth.fixture!r}: "
                f'{call} "{{fixture: {fixture}, position: .nan}}"'
            )
        if truth.locked:
            raise NotPossible(f'the lock pin is in: {call} "{{position: .nan, locked: false}}"')
        if self._found is None:
            self._found, self._upside_down = truth, truth.upside_down

    def mounted(self) -> str:
        """Return what holds the handle."""
        return self.truth().fixture

    def _fix(
        self, fixture: str, speed: float = 0.0, position: float = _NAN, locked: bool = False,
        settle_s: float = 0.0,
    ) -> None:  # fmt: skip
        request = SetFixture.Request(
            fixture=fixture, speed=speed, position=position, upside_down=self._upside_down,
            locked=locked,
        )  # fmt: skip
        self._robot.ask(SetFixture, "sim_rig/set_fixture", request)
        self._robot.pause(settle_s)

    def unload(self) -> None:
        """Put the pin in and let the handle go."""
        self._fix("free", locked=True, settle_s=_SETTLE_S)

    def stage_at(self, height: float, upside_down: bool) -> None:
        """Carry the handle to a height [m] and hold it there."""
        self._upside_down = upside_down
        self._fix("stage", position=height)
        self._wait_until_at(height)

    def _wait_until_at(
        self, height: float, within: float = _THERE, slower: float = _STILL
    ) -> None:
        def there() -> bool:
            truth = self.truth()
            off, speed = abs(truth.handle_position - height), abs(truth.handle_velocity)
            return off < within and speed < slower

        self._robot.wait_until(there, _PLACING_S, f"the handle did not come to {height:g} m")
        self._robot.pause(_SETTLE_S)

    def stage_hold(self) -> None:
        """Take the handle as it hangs, pin out."""
        self._fix("stage", settle_s=_SETTLE_S)

    def stage_go(self, speed: float, end: float) -> None:
        """Start the stage, which itself moves on to the end of the travel."""
        self._speed, self._begin = speed, self.truth().handle_position
        self._way = []
        self._fix("stage", speed=speed)

    def stage_passed(self, end: float) -> bool:
        """Return whether the stage has passed `end` [m]."""
        beyond = self.truth().handle_position - end
        return math.copysign(1.0, self._speed) * beyond > -0.1 * _THERE

    def stage_began_ns(self) -> float | None:
        """Return the time at which it began to move [ns], extrapolated from its positions."""
        speed = abs(self._speed)
        begun = [
            at - 1e9 * (abs(height - self._begin) / speed + 0.5 * speed / _ACCELERATION)
            for at, height in self._way
            if abs(height - self._begin) > max(1e-5, speed**2 / _ACCELERATION)
        ]
        ahead_ns = self._robot.clock.stamp_ns() - self._robot.clock.now_ns()  # the stamps are
        return statistics.median(begun) - ahead_ns if begun else None

    def stage_halt(self) -> None:
        """Stop where it is."""
        self._fix("stage", settle_s=_SETTLE_S)

    def hand_at(self, hand: Arm, centre: float) -> None:
        """Carry the handle to the centre [m], where the hand holds it at rest."""
        way = abs(self.truth().handle_position - centre)
        self._fix("human_arm", position=centre)
        self._robot.set_arm(arm(kind="active", **hand._asdict()))
        self._robot.pause(way / _PLACING_SPEED + _SETTLE_S)
        self._wait_until_at(centre, _SAG, _CREEP)

    def hand_moves(self, trial: MotionTrial) -> None:
        """Go to the middle of the sine and begin it there, on the vertical axis only."""
        self._robot.set_arm(
            arm(
                target=(_NAN, _NAN, trial.centre + trial.way),
                duration=WAY_S if trial.way else 0.0,
                amplitude=(_NAN, _NAN, trial.amplitude),
                omega=(_NAN, _NAN, trial.omega),
            )
        )

    def hand_lets_go(self) -> None:
        """Let the handle go where it is."""
        self._fix("free")

    def hand_rests(self, centre: float) -> None:
        """End the sine at the centre [m]."""
        still = (_NAN, _NAN, 0.0)
        self._robot.set_arm(arm((_NAN, _NAN, centre), _RETURN_S, amplitude=still, omega=still))
        self._robot.pause(_RETURN_S + _SETTLE_S)

    def reload(self) -> None:
        """Remove the pin and restore the former fixture."""
        assert self._found is not None, "nothing was mounted by a trial"
        height = _NAN
        if self._found.fixture == "human_arm":  # the virtual hand is taken there as well
            height = min(max(self.truth().handle_position, 0.0), _TRAVEL)
        self._fix(self._found.fixture, position=height, settle_s=_SETTLE_S)

    def put_back(self) -> None:
        """Restore the former mounting, at rest at the present height."""
        if self._found is not None:
            self._upside_down = self._found.upside_down
            self.reload()
            self._found = None


Fixture = RigFixture | OperatorFixture


def topic_of(robot: Robot, name: str) -> str:
    """Return the full name of a relative one, with the namespace, for a command line."""
    return f"{robot.node.get_namespace().rstrip('/')}/{name}"


class RigBusSettings(NamedTuple):
    """Which device on the bus `can` shows that the rig is simulated."""

    encoder_node_id: Annotated[int, Setting("CANopen node id of the encoder", "", 1, 127)] = 2


def sees_rig(robot: Robot, bus: BusSettings, device: RigBusSettings) -> bool:
    """Return whether the simulated encoder answers.

    In simulated time: the rig's process on this machine has answered on a bus; a driver on real
    hardware refuses simulated time. By wall clock: positions arrive on `bus`, which must be the bus
    of the node `encoder`, and a simulated one: no hardware and no other machine has that.
    """
    if not isinstance(robot.clock, WallClock):
        page = robot.clock.page
        return any(pid == page.conductor and sent > 0 for pid, sent in page.buses())
    if bus.interface not in SIMULATED_INTERFACES:
        return False
    wanted = {
        "can.interface": bus.interface,
        "can.channel": bus.channel,
        "node_id": device.encoder_node_id,
    }
    try:
        answer = robot.parameters("encoder", wanted)
    except RobotError:  # the experiment says what is missing
        return False
    return answer == wanted and _hears(
        within(bus, robot.node.get_namespace()), _TPDO1 + device.encoder_node_id
    )


def _hears(settings: BusSettings, identifier: int) -> bool:
    """Return whether frames of an identifier arrive repeatedly."""
    try:
        bus = open_bus(settings._replace(sync_producer=False))
    except BusError:
        return False
    clock, count = WallClock(), 0
    end_ns = clock.now_ns() + _LOOK_NS
    try:
        while count < _ENOUGH and clock.now_ns() < end_ns:
            frame = bus.recv(_RECEIVE_S)
            count += frame is not None and frame.arbitration_id == identifier
    finally:
        bus.shutdown()
    return count >= _ENOUGH
