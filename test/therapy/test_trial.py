# SPDX-License-Identifier: Apache-2.0
"""Phases and results of one trial over constructed samples."""

import math

import pytest

from screw_module_ros.control.minimum_jerk import pace, way
from screw_module_ros.control.slot import length_of
from screw_module_ros.therapy.adaptation import Assistance
from screw_module_ros.therapy.columns import Trial
from screw_module_ros.therapy.hand import PLANE, HandSample
from screw_module_ros.therapy.line import Line
from screw_module_ros.therapy.measures import computed
from screw_module_ros.therapy.protocol import STRENGTH, TrialPlan
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.trial import Phase, PrepareError, TrialCourse

CLOCK = load_protocol("clock_adaptive")
EVALUATION = load_protocol("evaluation")
CENTRE, FAR = (0.0, 0.0, 0.18), (0.0, 0.14, 0.18)
ASSISTED = TrialPlan(1, 2, 1, CENTRE, FAR)
FREE = TrialPlan(1, 1, 1, CENTRE, FAR)
TICK_NS = 5_000_000


class Hand:
    """Makes samples 5 ms apart; `y` moves, all else rests."""

    def __init__(self, trial):
        self.trial, self.count = trial, 0
        self.y = self.x = 0.0

    def stay(self, seconds, vy=0.0, fy=0.0, fz=0.0):
        for _ in range(round(seconds / 5e-3)):
            self.take(vy, fy, fz)
        return self.trial.phase

    def take(self, vy=0.0, fy=0.0, fz=0.0):
        self.trial.take(
            HandSample(
                5 * self.count, self.count * TICK_NS, self.x, self.y, 0.18, 0.0, vy, 0.0,
                0.0, fy, fz,
            )
        )  # fmt: skip
        self.count += 1

    def reach(self, duration, length=0.14):
        """Move along y on a minimum-jerk way, until the trial is not moving any more."""
        begin = self.y
        steps = round(duration / 5e-3)
        for k in range(1, steps + 1):
            self.y = begin + length * way(k / steps)
            self.take(length / duration * pace(k / steps))


def trial(plan=ASSISTED, protocol=CLOCK, duration=1.4):
    return TrialCourse(protocol, plan, Assistance(duration, 100.0))


def test_an_assisted_reach_from_beginning_to_end():
    hand = Hand(trial())
    assert hand.stay(0.3) == Phase.PREPARE
    assert hand.trial.wish.plane is not None, "the robot brings the hand"
    assert hand.stay(0.3) == Phase.WAIT
    assert hand.trial.wish.start_ns is None, "the slot is open"
    assert hand.trial.wish.vertical is None
    hand.reach(1.0)
    assert hand.trial.phase == Phase.REACHED
    assert hand.trial.wish.start_ns is not None
    hand.stay(0.6)
    assert hand.trial.phase == Phase.NONE
    result = hand.trial.result
    assert result["initiated"] and result["reached"] and result["moved"]
    assert result["pm2b"] > 0.01, "quicker than the wall of 1.4 s"
    assert result["pm2a"] == 0.0
    assert result["pm3"] == pytest.approx(0.0, abs=1e-30)
    assert 0.13 <= result["pm4"] <= 0.14
    assert result["rate"] == pytest.approx(200.0)
    assert result["missing"] == 0
    assert result["speed_ratio"] == pytest.approx(0.6, abs=0.05)
    assert result["path_error"] == pytest.approx(0.0, abs=1e-12)
    assert result["reach_error"] <= 0.001


def test_start_by_speed_is_at_the_published_share():
    hand = Hand(trial())
    hand.stay(0.5)
    assert hand.trial.phase == Phase.WAIT
    least = 0.4 * 1.875 * 0.14 / 1.4
    hand.take(vy=0.99 * least)
    assert hand.trial.phase == Phase.WAIT
    hand.take(vy=1.01 * least)
    assert hand.trial.phase == Phase.MOVING
    assert hand.trial.wish.start_ns == (hand.count - 1) * TICK_NS


def test_a_slow_hand_starts_by_its_way():
    hand = Hand(trial())
    hand.stay(0.5)
    hand.y = 0.021
    hand.take(vy=0.01)
    assert hand.trial.phase == Phase.MOVING


def test_who_does_not_start_is_helped_after_the_wait_and_given_up_in_the_end():
    hand = Hand(trial())
    hand.stay(0.5)
    assert hand.stay(1.8) == Phase.WAIT
    assert hand.stay(0.3) == Phase.MOVING
    assert hand.stay(1.5) == Phase.OVER_TIME
    hand.stay(10.0)
    assert hand.trial.phase == Phase.OVER_TIME
    hand.stay(1.0)
    result = hand.trial.result
    assert not result["initiated"] and not result["reached"] and not result["moved"]
    lag = (0.07 * 1.4 + 0.14 * 10.6) / 12.0  # behind the wall on its way, and at the target
    assert result["pm2b"] == pytest.approx(-lag, abs=1e-3)
    assert math.isnan(result["sparc"])


def test_moved_by_the_robot_shows_in_pm2a():
    hand = Hand(trial())
    hand.stay(2.6)
    assert hand.trial.phase == Phase.MOVING
    for k in range(280):
        hand.y = 0.9 * 0.14 * way(k / 280)
        hand.take(vy=0.1, fy=-5.0)
    assert hand.trial.phase == Phase.OVER_TIME
    hand.y = 0.14
    hand.stay(0.6)
    # -0.5 W while it moves; at rest before that it is behind the wall too, and adds nothing.
    assert -0.5 < hand.trial.result["pm2a"] < -0.4
    assert hand.trial.result["robot_share"] == pytest.approx(1.0)


def test_a_hand_that_does_not_come_to_the_start_is_said_so():
    hand = Hand(trial())
    hand.y = 0.05
    with pytest.raises(PrepareError, match="50 mm from the start of trial 1 after 20 s"):
        hand.stay(21.0)


def test_a_hand_that_is_pulled_from_the_start_is_drawn_there_ever_stiffer():
    """From the walls along the line alone 5 N kept a hand 11 mm off, and no session began."""
    hand = Hand(trial())
    hand.x, hand.y = 0.0, -0.012
    hand.stay(1.9)
    assert hand.trial.wish.plane.growth == 0.0 and length_of(hand.trial.wish.plane) > 0.01
    hand.stay(0.2)
    tube, begun = hand.trial.wish.plane, hand.trial.wish.start_ns
    assert tube[:4] == (0.0, 0.0, 0.0, 0.0)
    assert (tube.growth, tube.side_stiffness) == (60.0, 200.0)
    assert (tube.half_width, tube.end_half_width) == (0.0, 0.0)
    hand.stay(5.0)
    assert (hand.trial.wish.plane, hand.trial.wish.start_ns) == (tube, begun), "it goes on growing"
    hand.y = -0.009
    assert hand.stay(0.5) == Phase.WAIT
    stuck = Hand(trial())
    stuck.y = -0.012
    with pytest.raises(PrepareError, match="12 mm from the start"):
        stuck.stay(20.1)


@pytest.mark.parametrize("kind", ["hold", "resisted", "strength"])
def test_what_holds_a_hand_in_a_trial_does_not_stiffen(kind):
    growing = EVALUATION.guidance._replace(growth=100.0)
    held = trial(block(kind), EVALUATION._replace(guidance=growing))
    Hand(held).stay(0.5)
    assert held.phase == Phase.MOVING and held.wish.plane.growth == 0.0


def test_unassisted_slot_only_damps():
    hand = Hand(trial(FREE))
    hand.stay(0.5)
    slot = hand.trial.wish.plane
    assert (slot.back_stiffness, slot.side_stiffness, slot.growth) == (0.0, 0.0, 0.0)
    assert slot.damping == 5.0


def block(kind):
    number = next(n for n, b in enumerate(EVALUATION.blocks, 1) if b.kind == kind)
    points = {"circle": (CENTRE, (0.0, 0.1, 0.18)), "hold": (CENTRE, CENTRE)}
    return TrialPlan(1, number, 1, *points.get(kind, (CENTRE, FAR)))


def test_a_circle_ends_when_it_is_round():
    hand = Hand(trial(block("circle"), EVALUATION))
    hand.y = 0.1
    assert hand.stay(0.5) == Phase.WAIT
    steps = 600
    for k in range(steps + 30):
        angle = 2.0 * math.pi * k / steps
        hand.x, hand.y = 0.1 * math.sin(angle), 0.1 * math.cos(angle)
        hand.take(vy=0.2)
        if hand.trial.phase == Phase.NONE:
            break
    assert hand.trial.phase == Phase.NONE
    assert abs(k - steps) <= 3
    figures = hand.trial.result
    assert figures["independence"] == pytest.approx(1.0, abs=0.02)
    assert figures["size"] == pytest.approx(math.pi * 0.01, rel=0.02)


def test_holding_still():
    hand = Hand(trial(block("hold"), EVALUATION))
    hand.stay(0.5)
    assert hand.trial.phase == Phase.MOVING
    hand.x = 0.003
    hand.stay(10.1)
    assert hand.trial.result["hold_deviation"] == pytest.approx(0.003, rel=0.02)


def test_strength_is_the_largest_force_along_the_direction():
    hand = Hand(trial(block("strength"), EVALUATION))
    hand.stay(0.5)
    slot = hand.trial.wish.plane
    assert (slot.side_stiffness, slot.half_width) == (800.0, 0.0)
    assert slot.start_y == slot.target_y, "held to the centre, not led to the target"
    hand.stay(1.0, fy=12.0, fz=-3.0)
    hand.stay(1.0, fy=25.0)
    hand.stay(4.0, fy=-40.0)
    figures = hand.trial.result
    assert (figures["largest_force"], figures["largest_vertical_force"]) == (25.0, 3.0)


def test_the_largest_force_is_that_of_the_samples_with_a_force():
    """A first sample without a valid force must not hide the others: max() of NaN is NaN."""
    samples = [
        HandSample(n, n * 5_000_000, *(0.0,) * 6, force, force, force)
        for n, force in enumerate((math.nan, 7.0, 9.0, math.nan, 3.0))
    ]
    line = Line((0.0, 0.0, 0.0), (0.0, 0.05, 0.0), PLANE)
    found = computed(Trial(STRENGTH, line, 1.4, 0, samples[-1].time_ns, samples))
    assert (found["largest_force"], found["largest_vertical_force"]) == (9.0, 9.0)
    found = computed(Trial(STRENGTH, line, 1.4, 0, 0, samples))
    assert math.isnan(found["largest_force"]) and math.isnan(found["largest_vertical_force"])
