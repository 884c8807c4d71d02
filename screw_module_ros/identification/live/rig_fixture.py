# SPDX-License-Identifier: Apache-2.0
"""Stage and hand of the simulated rig, operated through its services (see `fixture.Fixture`)."""

from __future__ import annotations

import math
import statistics

from screw_module_msgs.msg import SimTruth
from screw_module_msgs.srv import SetFixture

from screw_module_ros import graph
from screw_module_ros.identification.trials import WAY_S, Arm, MotionTrial, NotPossible
from screw_module_ros.nodes.support.inbox import Inbox
from screw_module_ros.nodes.support.topics import offered
from screw_module_ros.operator.robot import Robot, arm

from .graph import topic_of

FIXTURES = {
    "stage": "the handle is not on the positioning stage",
    "locked_rotor": "the rotor is not locked on the transducer",
    "human_arm": "no hand holds the handle",
}
_HEARD_S = 5.0
_FRESH_NS = 1_000_000_000
_PLACING_S = 20.0
_SETTLE_S = 0.3
_RETURN_S = 1.0
_PLACING_SPEED = 0.1  # of the rig, carrying the handle [m/s]
_THERE = 1e-4  # [m]
_CREEP = 2e-3  # [m/s]; the bench waits for rest after the law has started
_SAG = 0.05  # largest sag of the handle in a hand [m]
_STILL = 1e-4  # [m/s]
_TRAVEL = 0.36  # [m]
_ACCELERATION = 2.0  # of the rig's stage [m/s^2]
_LONGEST_WAY = 1000  # stored positions, from which the stage's start is computed
_NAN = math.nan


class RigFixture:
    """The simulated rig."""

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
                f"{FIXTURES[fixture]} but on {truth.fixture!r}: "
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
        self, fixture: str, speed: float = 0.0, position: float = _NAN, locked: bool = False
    ) -> None:
        request = SetFixture.Request(
            fixture=fixture,
            speed=speed,
            position=position,
            upside_down=self._upside_down,
            locked=locked,
        )
        self._robot.ask(SetFixture, "sim_rig/set_fixture", request)

    def unload(self) -> None:
        """Put the pin in and let the handle go."""
        self._fix("free", locked=True)
        self._robot.pause(_SETTLE_S)

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
            near = abs(truth.handle_position - height) < within
            return near and abs(truth.handle_velocity) < slower

        self._robot.wait_until(there, _PLACING_S, f"the handle did not come to {height:g} m")
        self._robot.pause(_SETTLE_S)

    def stage_hold(self) -> None:
        """Take the handle as it hangs, pin out."""
        self._fix("stage")
        self._robot.pause(_SETTLE_S)

    def stage_go(self, speed: float, end: float) -> None:
        """Start the stage, which itself moves on to the end of the travel."""
        self._speed, self._begin = speed, self.truth().handle_position
        self._way = []
        self._fix("stage", speed=speed)

    def stage_passed(self, end: float) -> bool:
        """Return whether the stage has passed `end` [m]."""
        direction = math.copysign(1.0, self._speed)
        return direction * (self.truth().handle_position - end) > -0.1 * _THERE

    def stage_began_ns(self) -> float | None:
        """Return the time at which it began to move [ns], extrapolated from its positions."""
        speed = abs(self._speed)
        begun = [
            at - 1e9 * (abs(height - self._begin) / speed + 0.5 * speed / _ACCELERATION)
            for at, height in self._way
            if abs(height - self._begin) > max(1e-5, speed**2 / _ACCELERATION)
        ]
        clock = self._robot.clock
        stamps_ahead_ns = clock.stamp_ns() - clock.now_ns()
        return statistics.median(begun) - stamps_ahead_ns if begun else None

    def stage_halt(self) -> None:
        """Stop where it is."""
        self._fix("stage")
        self._robot.pause(_SETTLE_S)

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
        if self._found.fixture == "human_arm":
            height = min(max(self.truth().handle_position, 0.0), _TRAVEL)
            self._fix("human_arm", position=height)  # takes the virtual hand there as well
        else:
            self._fix(self._found.fixture)
        self._robot.pause(_SETTLE_S)

    def put_back(self) -> None:
        """Restore the former mounting, at rest at the present height."""
        if self._found is not None:
            self._upside_down = self._found.upside_down
            self.reload()
            self._found = None
