# SPDX-License-Identifier: Apache-2.0
"""The dialogue that weighs an arm in `therapy_session`, without a graph."""

from __future__ import annotations

import math

import pytest
from geometry_msgs.msg import Point, Vector3
from screw_module_msgs.msg import EndpointState, SafetyState, TherapyState
from screw_module_msgs.srv import StartTherapy
from services import asked
from wired import Topics

from screw_module_ros.clock import ManualClock
from screw_module_ros.therapy.arm_weights import LASTS_S, ArmWeight, arms_of, keep

S = 1_000_000_000
TODAY_S = 1_796_000_000


class Room:
    """The node, both ends of its topics, and a hand that follows its slot at 200 Hz."""

    def __init__(self, node, file):
        self.node, self.file = node, file
        self.ends = Topics(node)
        node.trigger_configure()
        node.trigger_activate()
        node.requests.ask = lambda act: act()
        self.place, self.count = (0.0, -0.1, 0.05), 0

    def feed(self, seconds, fz=0.0, enabled=(True, True)):
        for _ in range(round(seconds * 200)):
            self.node.clock.time_ns += S // 200
            self.count += 1
            x, y, z = self.place
            self.ends.heard["endpoint_state"].append(EndpointState(
                sequence=self.count, monotonic_ns=self.node.clock.time_ns,
                position=Point(x=x, y=y, z=z), force=Vector3(z=fz), valid=[True] * 3,
                force_valid=True, enabled=list(enabled), safety=SafetyState.OK,
            ))  # fmt: skip
            self.node.step()
            slots = self.ends.told["therapy/slot"]
            if slots and slots[-1].planar:
                to = slots[-1].target
                self.place = to.x, to.y, to.z
        return self.state

    @property
    def state(self):
        return self.ends.told["therapy/state"][-1]

    def weigh(self, patient="P-7K3QX", side="left", **more):
        return asked(self.node, "~/weigh", StartTherapy.Request(patient=patient, side=side, **more))

    def start(self, side="left", patient="P-7K3QX"):
        request = StartTherapy.Request(protocol="evaluation", patient=patient, side=side)
        return asked(self.node, "~/start", request)


@pytest.fixture
def room(make_node, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    node = make_node("therapy_session")
    node.clock = ManualClock(S)
    monkeypatch.setattr(node.clock, "stamp_ns", lambda: TODAY_S * S, raising=False)
    yield Room(node, tmp_path / "screw_module_ros" / "therapy_session" / "arm_weights.json")
    node.close()


def hung(room, fz=-18.0):
    """Weigh an arm; return the last state."""
    room.feed(0.1)
    assert room.weigh().success
    assert (room.feed(0.5).kind, room.state.phase) == ("weigh", TherapyState.NONE)
    assert "strap the arm in" in room.feed(1.0).arm
    assert (room.state.kind, room.state.phase) == ("weigh", TherapyState.WAIT)
    assert room.weigh().success
    assert (room.feed(1.0, fz).kind, room.state.phase) == ("weigh", TherapyState.MOVING)
    state = room.feed(39.0, fz)
    assert (state.kind, state.phase) == ("", TherapyState.NONE)
    return state


def test_an_arm_is_weighed_and_kept_for_patient_and_side(room):
    state = hung(room)
    assert state.arm == "the arm weighs 18.0 N"
    assert (state.arm_weight, state.arm_spread) == pytest.approx((18.0, 0.0), abs=1e-6)
    kept = arms_of(room.file, "P-7K3QX")
    assert kept.right is None and kept.left.weight == pytest.approx(18.0)
    assert kept.left.weighed_s == TODAY_S
    assert room.place == pytest.approx((0.0, -0.1, 0.05)), "it lies again"
    assert not room.ends.told["therapy/slot"][-1].planar


def test_from_the_first_place_on_the_arm_is_supported(room):
    hung(room)
    support = [slot.support for slot in room.ends.told["therapy/slot"]]
    assert 0.0 in support and max(s for s in support if s == s) == pytest.approx(18.0)
    assert support[-1] == pytest.approx(18.0), "it stays carried, until it is lowered"


def test_the_spring_waits_at_the_hand_while_slots_change(room):
    hung(room)
    last = room.ends.told["setpoint"][-1].position
    assert (last.x, last.y, last.z) == pytest.approx((0.0, -0.1, 0.05))


def test_an_arm_that_was_not_weighed_is_not_carried_afterwards(room):
    """What was found of it at some place may be less than it weighs, or more."""
    room.feed(0.1)
    room.weigh()
    room.feed(1.5)
    room.weigh()
    room.feed(8.0, -18.0)
    assert room.state.arm.startswith("let it hang: far")
    room.weigh()
    state = room.feed(12.0, -18.0)
    support = [slot.support for slot in room.ends.told["therapy/slot"]]
    assert max(support) == pytest.approx(18.0) and support[-1] == 0.0
    assert state.arm == "not weighed: the therapist ended it" and state.support == 0.0


@pytest.mark.parametrize(("given", "wrong"), [
    ({"side": ""}, "left or right"), ({"side": "up"}, "'up': left or right"),
    ({"patient": "Maria"}, "not a pseudonym"),
])  # fmt: skip
def test_it_must_be_known_whose_arm_is_weighed(room, given, wrong):
    room.feed(0.1)
    answer = room.weigh(**given)
    assert not answer.success and wrong in answer.message


def test_weighing_and_session_wait_for_each_other(room):
    room.feed(0.1)
    room.weigh()
    assert "an arm is being weighed" in room.start().message
    assert "left arm of P-7K3QX" in room.weigh(side="right").message
    room.feed(1.5)
    assert room.weigh().success
    room.feed(1.0, -18.0)
    assert room.weigh().success, "pressed again, it ends"
    assert room.feed(10.0, -18.0).arm == "not weighed: the therapist ended it"
    assert room.start().success
    assert "a session is under way" in room.weigh().message


def test_a_silent_page_lets_the_arm_be_brought_back(room):
    room.feed(0.1)
    room.weigh(attended=True)
    assert "the therapist's page has been silent" in room.feed(3.0).arm
    room.weigh()
    room.feed(1.5)
    room.weigh()
    room.node.course.attendance.begin(True, room.node.clock.now_ns())
    state = room.feed(2.5, -18.0)
    assert "silent" in state.arm and state.arm.endswith("the arm is brought back")
    room.node.clock.time_ns += S
    room.node.step()
    assert "endpoint_state is silent" in room.state.arm
    assert not room.ends.told["therapy/slot"][-1].planar


@pytest.mark.parametrize(("age_s", "weight", "told"), [
    (LASTS_S, 17.0, ""), (LASTS_S + 86_400, math.nan, "weighed 15 days ago, 17.0 N then"),
])  # fmt: skip
def test_a_session_knows_the_arm_for_two_weeks(room, age_s, weight, told):
    keep(room.file, "P-7K3QX", "left", ArmWeight(17.0, 1.0, TODAY_S - age_s))
    room.feed(0.1)
    assert room.start().success
    state = room.feed(0.1)
    assert state.side == "left" and state.arm.startswith(told)
    assert state.arm_weight == pytest.approx(weight, nan_ok=True)


@pytest.mark.parametrize(("patient", "side"), [
    ("P-7K3QX", "right"), ("P-7K3QX", ""), ("P-22222", "left"),
])  # fmt: skip
def test_another_arm_is_another_weight(room, patient, side):
    keep(room.file, "P-7K3QX", "left", ArmWeight(17.0, 1.0, TODAY_S))
    room.feed(0.1)
    assert room.start(side, patient).success
    assert math.isnan(room.feed(0.1).arm_weight)


def test_a_side_is_left_or_right(room):
    room.feed(0.1)
    answer = room.start(side="both")
    assert not answer.success and "left or right" in answer.message


def test_a_file_that_cannot_be_read_is_told_and_the_weight_counts_all_the_same(room):
    room.file.parent.mkdir(parents=True)
    room.file.write_text("{")
    state = hung(room)
    assert state.arm.startswith("the arm weighs 18.0 N; ") and str(room.file) in state.arm
    assert room.start().success
    assert room.feed(0.1).arm_weight == pytest.approx(18.0)
    assert room.file.read_text() == "{"


def test_a_node_that_was_deactivated_forgets_the_arm(room):
    hung(room)
    room.node.trigger_deactivate()
    room.node.trigger_activate()
    state = room.feed(0.1)
    assert state.arm == "" and math.isnan(state.arm_weight)
