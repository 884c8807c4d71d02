# SPDX-License-Identifier: Apache-2.0
"""Where the simulated patient moves his hand: trials of a session, a game's wish, set points."""

from __future__ import annotations

import math

import pytest
from geometry_msgs.msg import Point
from screw_module_msgs.msg import EndpointSetpoint, TherapyState

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes.simulated_patient import SimulatedPatient
from screw_module_ros.plant.settings import patients
from screw_module_ros.therapy.wishes import SILENT_NS

START, TARGET = (0.0, 0.0, 0.18), (0.1, -0.05, 0.18)


class Screen:
    """Plays what a patient hears, in the place of his node; sent: where his hand went."""

    def __init__(self, patient):
        self.clock, self.sent, self.seen = ManualClock(10_000_000_000), [], {}
        self.arm = patients()[patient]
        self.patient = SimulatedPatient(
            self, lambda: self.arm, lambda change: self.sent.append(change)
        )

    def create_subscription(self, kind, name, heard, profile):
        self.seen[name] = heard
        return name

    def destroy_subscription(self, name):
        del self.seen[name]

    def show(self, name, *point, **state):
        if point:
            x, y, z = point
            self.seen[name](EndpointSetpoint(position=Point(x=x, y=y, z=z)))
        else:
            self.seen[name](TherapyState(**state))

    @property
    def targets(self):
        return [change.target for change in self.sent]


def reach(phase, **more):
    start, target = (Point(**dict(zip("xyz", each, strict=True))) for each in (START, TARGET))
    return {"state": TherapyState.RUNNING, "kind": "reach", "trial": 1, "start": start,
            "target": target, "phase": phase, **more}  # fmt: skip


PHASES = TherapyState.PREPARE, TherapyState.MOVING, TherapyState.OVER_TIME


@pytest.mark.parametrize(
    ("patient", "reached"), [("healthy", TARGET), ("weak", (0.08, -0.04, 0.18))]
)
def test_a_weak_patient_comes_four_fifths_of_the_way(patient, reached):
    screen = Screen(patient)
    for phase in PHASES:
        screen.show("therapy/state", **reach(phase))
    assert screen.targets == [pytest.approx(START), pytest.approx(reached)]
    assert {change.duration for change in screen.sent} == {patients()[patient].reach_time}


def test_a_flaccid_patient_never_moves_his_hand():
    screen = Screen("flaccid")
    for phase in PHASES:
        screen.show("therapy/state", **reach(phase))
    screen.show("therapy/wish", *TARGET)
    screen.show("setpoint", *TARGET)
    assert screen.sent == []


def test_an_arm_hangs_while_it_is_weighed_and_is_as_before_afterwards():
    screen = Screen("severe")
    for phase in (TherapyState.NONE, TherapyState.WAIT, *[TherapyState.MOVING] * 2):
        screen.show("therapy/state", kind="weigh", phase=phase)
    (hangs,) = screen.sent
    assert dict(zip(hangs.traits, hangs.values, strict=True)) == {"tension": 0.0, "carried": 0.0}
    for _ in range(2):
        screen.show("therapy/state")
    _, again = screen.sent
    assert again.traits == hangs.traits
    assert again.values == (screen.arm.tension, screen.arm.carried)


def test_a_circle_is_walked_from_its_target():
    screen, since = Screen("healthy"), (0.0, 0.6, 1.2)
    target = Point(x=0.1, y=0.0, z=0.18)
    screen.show("therapy/state", **reach(TherapyState.PREPARE, kind="circle", target=target))
    for passed in since:
        screen.show("therapy/state", **reach(TherapyState.MOVING, kind="circle", target=target,
                                             since=passed))  # fmt: skip
    angles = [math.atan2(y, x) for x, y, _ in screen.targets]
    assert angles == pytest.approx([-k * math.tau / 12 for k in range(4)])


def test_a_game_s_wish_is_followed_as_far_as_the_robot_goes():
    """A hand that went for a point five metres away pulled with 152 N once nobody wished it."""
    screen = Screen("healthy")
    screen.show("therapy/wish", 5.0, -5.0, 5.0)
    assert screen.targets == [pytest.approx((0.15, -0.15, 0.33))]


def test_a_game_in_the_plane_is_followed_in_the_plane():
    """The game of the browser leaves the height alone; its patient never moved."""
    screen = Screen("healthy")
    for x in (0.1, 0.1, 0.1 + 1e-4, -0.1):
        screen.show("therapy/wish", x, 0.05, math.nan)
    assert [point[:2] for point in screen.targets] == [(0.1, 0.05), (-0.1, 0.05)]
    assert all(math.isnan(point[2]) for point in screen.targets)


def test_set_points_that_a_session_node_makes_of_a_wish_do_not_count():
    """They lag behind the wish, and the last one lets the hand go where it is."""
    screen = Screen("healthy")
    for step in range(20):
        screen.show("therapy/wish", 0.1, 0.0, 0.2)
        screen.show("setpoint", 0.005 * step, 0.0, 0.2)
    assert screen.targets == [(0.1, 0.0, 0.2)]
    screen.clock.time_ns += SILENT_NS
    screen.show("setpoint", 0.06, 0.0, 0.2)
    assert screen.targets[1:] == [(0.06, 0.0, 0.2)]


def test_a_set_point_that_moves_is_followed_to_where_it_comes_to_rest():
    screen = Screen("healthy")
    for step in range(21):
        screen.show("setpoint", 0.004 * step, 0.0, 0.2)
    for _ in range(3):
        screen.show("setpoint", 0.08, 0.0, 0.2)
    assert [point[0] for point in screen.targets] == pytest.approx([0.0, 0.032, 0.064, 0.08])


def test_a_set_point_nowhere_moves_no_hand():
    screen = Screen("healthy")
    screen.show("setpoint", math.nan, math.nan, math.nan)
    assert screen.sent == []


def test_in_a_session_the_hand_follows_the_session_alone_and_afterwards_the_game_again():
    screen = Screen("healthy")
    screen.show("therapy/wish", 0.1, 0.0, 0.2)
    screen.show("therapy/state", **reach(TherapyState.MOVING))
    screen.show("therapy/wish", -0.1, 0.0, 0.2)
    screen.show("setpoint", -0.1, 0.0, 0.2)
    assert screen.targets == [(0.1, 0.0, 0.2), pytest.approx(TARGET)]
    screen.clock.time_ns += SILENT_NS
    screen.show("therapy/state", **reach(TherapyState.NONE, state=TherapyState.FINISHED))
    screen.show("therapy/wish", 0.1, 0.0, 0.2)
    assert screen.targets[2:] == [(0.1, 0.0, 0.2)]


def test_a_patient_who_leaves_sees_nothing():
    screen = Screen("healthy")
    screen.patient.close()
    assert screen.seen == {}
