# SPDX-License-Identifier: Apache-2.0
"""`therapy_session` without a graph: its messages, its game, its recorder.

A recorder that hangs, dies or whose disk is full holds up no session, and none goes on unaware.
"""

from __future__ import annotations

import math
import time
from datetime import datetime, timezone
from types import SimpleNamespace

import pytest
import yaml
from geometry_msgs.msg import Point
from played_recorder import PlayedRecorder
from rclpy.parameter import Parameter
from screw_module_msgs.msg import (
    EndpointSetpoint,
    EndpointState,
    ImpedanceState,
    SafetyState,
    TherapyState,
)
from screw_module_msgs.srv import StartTherapy
from services import asked
from std_msgs.msg import Float64, UInt8
from std_srvs.srv import Trigger
from wired import Topics

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes import therapy_recording, therapy_session
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.law_inputs import slot_of
from screw_module_ros.nodes.therapy_recording import RecorderSettings, SessionRecording
from screw_module_ros.nodes.therapy_session import Course
from screw_module_ros.nodes.wish_relay import WishRelay
from screw_module_ros.therapy.arm import Arm
from screw_module_ros.therapy.asked import GoesOn, Question
from screw_module_ros.therapy.attendance import Attendance
from screw_module_ros.therapy.hand import PLANE, SAFETY_OK, hand_sample
from screw_module_ros.therapy.protocol_file import protocol_text, sha256
from screw_module_ros.therapy.scores import scores_in
from screw_module_ros.therapy.session import State
from screw_module_ros.therapy.trial import Phase
from screw_module_ros.therapy.wishes import WishLimits

S = 1_000_000_000
DONE = Trigger.Response(success=True, message="bag")


@pytest.fixture
def recorder():
    return PlayedRecorder()


@pytest.fixture
def recording(recorder, monkeypatch):
    monkeypatch.setattr(therapy_recording, "is_served", lambda node, client: recorder.is_there)
    clock = ManualClock(S)
    made = SessionRecording(recorder, clock)
    made.connect(recorder)
    made.begin(RecorderSettings(timeout=5.0))
    made.clock = clock
    return made


BEGUN, REFUSED, LOST = "begun", "refused", "lost"


def follow(recording, second, in_session=True):
    """Return what the recording does to a session, nothing if it leaves it alone."""
    recording.clock.time_ns = round(second * S)
    done = []
    session = SimpleNamespace(
        state=State.RUNNING if in_session else State.FINISHED,
        begin=lambda: done.append((BEGUN, recording.message)),
        abort=lambda reason: done.append((REFUSED, reason)),
        pause=lambda reason: done.append((LOST, reason)),
    )
    recording.follow(session, recording.clock.time_ns)
    assert all(reason == recording.message for _, reason in done)
    return "".join(what for what, _ in done)


def begun(recording, recorder, at=1):
    if not recording.waits:
        recording.ask("P-22222_clock")
    assert follow(recording, at) == ""
    recorder.answer("record", DONE)
    assert follow(recording, at + 1) == BEGUN and recording.runs
    assert recorder.names[-1] == "P-22222_clock"


def test_a_recorder_that_never_answers_is_given_up(recording, recorder):
    recording.ask("P-22222_clock")
    assert [follow(recording, second) for second in (1, 5, 10)] == [""] * 3
    assert follow(recording, 12) == REFUSED
    assert "does not answer" in recording.message
    assert not recording.waits and recording.start_refusal("P-22222", True, 12 * S) == ""


def test_a_recorder_that_appears_in_time_records(recording, recorder):
    recorder.is_there = False
    recording.ask("P-22222_clock")
    assert follow(recording, 5.9) == "" and not recorder.names
    recorder.is_there = True
    begun(recording, recorder, 5.9)


def test_without_a_recorder_it_is_refused_after_a_while(recording, recorder):
    recorder.is_there = False
    recording.ask("P-22222_clock")
    assert follow(recording, 5.999) == ""
    assert follow(recording, 6) == REFUSED
    assert "no session_recorder answers" in recording.message


def test_a_recorder_that_leaves_a_sessions_topics_out_records_none(recording, recorder):
    """A subscription may have failed; the session was said to be recorded."""
    recorder.left_out = {"therapy/trial"}
    recording.ask("P-22222_clock")
    assert follow(recording, 1) == ""
    recorder.answer("record", DONE)
    assert [follow(recording, second) for second in (2, 4)] == ["", ""]
    assert follow(recording, 6) == REFUSED and not recording.runs
    assert (
        recording.message
        == "not recorded: the session_recorder does not subscribe to therapy/trial"
    )
    assert len(recorder.asked["stop"]) == 1


def test_a_session_begins_only_once_the_recorder_hears_it(recording, recorder):
    """On a busy machine that takes longer; only a session's first state has the protocol."""
    recorder.left_out = {"therapy/state"}
    recording.ask("P-22222_clock")
    assert follow(recording, 1) == ""
    recorder.answer("record", DONE)
    assert follow(recording, 3) == ""
    recorder.left_out = set()
    assert follow(recording, 4) == BEGUN


def test_a_recorder_in_the_publisher_s_process_has_a_topic_without_a_subscription(
    recording, recorder
):
    recorder.left_out = {"endpoint_state"}
    recording.ask("P-22222_clock")
    assert follow(recording, 1) == ""
    recorder.answer("record", DONE)
    assert follow(recording, 2) == ""
    recorder.report(True, "P-22222_clock", **{"/endpoint_state": "{}"})
    assert follow(recording, 3) == BEGUN


def test_a_late_answer_is_not_that_of_the_next_session(recording, recorder):
    recording.ask("P-22222_clock")
    follow(recording, 1)
    assert follow(recording, 12) == REFUSED
    recording.ask("P-33333_clock")
    follow(recording, 13)
    recorder.answer("record", DONE)  # to the first
    assert len(recorder.asked["stop"]) == 1
    assert follow(recording, 15) == "" and not recording.runs
    recorder.answer("record", DONE)
    assert follow(recording, 16) == BEGUN


def test_a_silent_recorder_is_told_to_stop(recording, recorder):
    """It may go on later: the session is no longer said to be recorded, nor is the next one."""
    begun(recording, recorder)
    assert follow(recording, 8) == LOST and not recording.runs
    assert len(recorder.asked["stop"]) == 1


def test_a_recording_that_has_ended_is_not_ended_again(recording, recorder):
    begun(recording, recorder)
    recorder.report(recording=False, message="the disk is full")
    assert follow(recording, 3) == LOST
    assert recording.message == "the recording has ended: the disk is full"
    assert recorder.asked["stop"] == []
    recorder.report(recording=True)  # another recording
    assert follow(recording, 4) == "" and not recording.runs


def test_a_recording_lasts_as_long_as_the_recorder_reports_it(recording, recorder):
    recorder.report(recording=False)  # what was before does not count
    begun(recording, recorder)
    for second in range(3, 60):
        recorder.report(recording=True)
        assert follow(recording, second) == "" and recording.runs
    assert follow(recording, 64) == ""
    assert follow(recording, 64.001) == LOST
    assert recording.message == "the session recorder has been silent for 5 s"


def test_a_recording_ends_a_second_after_its_session(recording, recorder):
    begun(recording, recorder)
    assert follow(recording, 3, in_session=False) == "" and recording.runs
    assert follow(recording, 3.9, in_session=False) == "" and recording.runs
    assert follow(recording, 4, in_session=False) == "" and not recording.runs
    assert "is being closed" in recording.start_refusal("P-22222", True, 4 * S)
    late = recording.start_refusal("P-22222", True, 14 * S)
    assert late == "", "a mute recorder is waited for no more"
    recorder.answer("stop", DONE)
    assert recording.start_refusal("P-22222", True, 4 * S) == ""
    assert recording.message == "the recording is closed", "it goes to /diagnostics: no bag's name"


def test_a_recording_that_begins_after_the_end_is_ended(recording, recorder):
    recording.ask("P-22222_clock")
    follow(recording, 1)
    recording.close()
    recorder.answer("record", DONE)
    assert len(recorder.asked["stop"]) == 2, "one at the end, one for what began after it"


@pytest.mark.parametrize(("bag", "owner"), [
    ("/bags/P-22222_clock_2026_01_05-12_00_00", "P-22222"),
    ("/bags/P-33333_clock_2026_01_05-12_00_00", ""),
    ("/bags/session_2026_01_05-12_00_00", ""),  # somebody records the whole day
])  # fmt: skip
def test_a_recording_that_a_killed_node_left_is_noticed(recording, recorder, bag, owner):
    recorder.report(True, bag)
    recording.follow(None, S)
    assert recording.of_another("P-33333", 2 * S) == owner
    assert recording.of_another("P-33333", 9 * S) == "", "the recorder has gone as well"
    recorder.report(False, bag)
    recording.follow(None, 2 * S)
    assert recording.of_another("P-33333", 2 * S) == ""


@pytest.mark.parametrize("answered", [True, False])
def test_a_recording_ends_with_the_sessions_node(
    recording, recorder, answered, make_node, monkeypatch
):
    """Else it would hold the next patient's movements in a bag of this one's name."""
    monkeypatch.setattr(therapy_session, "SessionRecording", lambda node, clock: recording)
    node = make_node("therapy_session")
    Topics(node)
    node.trigger_configure()
    node.trigger_activate()
    recording.connect(recorder)
    if answered:
        begun(recording, recorder)
    else:
        recording.ask("P-22222_clock")
    node.trigger_deactivate()
    assert len(recorder.asked["stop"]) == 1 and not recording.runs
    node.end()
    assert len(recorder.asked["stop"]) == 1


S = 1_000_000_000
HAND = (0.05, 0.0, 0.2)


@pytest.fixture
def relay():
    wishes, asked = [], []

    def publish(message):
        asked.append((message.position.x, message.position.y, message.position.z))

    node = SimpleNamespace(outlet=lambda *offer: publish, stamp=lambda header: None)
    inbox = SimpleNamespace(
        subscribe=lambda *request: lambda: wishes.pop(0) if wishes else None
    )
    made = WishRelay(node, inbox, WishLimits())
    made.wishes, made.asked = wishes, asked
    return made


def wish(x):
    message = EndpointSetpoint()
    message.position.x, message.position.z = x, 0.2
    return message


def test_a_game_that_is_cut_off_lets_the_hand_go_at_once(relay):
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    assert len(relay.asked) == 1 and relay.asked[0] != HAND
    relay.wishes.append(wish(0.1))
    relay.relay(False, HAND, 10 * S + 50_000_000)  # the therapist allows no wishes any more
    assert relay.asked[1:] == [HAND]
    relay.wishes.append(wish(0.1))
    relay.relay(False, HAND, 20 * S)
    assert len(relay.asked) == 2, "once: others may ask for set points as well"
    relay.wishes.append(wish(0.14))
    relay.relay(True, HAND, 21 * S)
    assert relay.asked[2][0] == pytest.approx(0.05 + 0.2 * 0.3), "from the hand on, at its speed"


@pytest.mark.parametrize("allowed", [True, False])
def test_a_hand_of_unknown_position_is_let_go_as_soon_as_it_is_known(relay, allowed):
    """endpoint_state fails together with the game: no set point at all would leave the spring."""
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    relay.relay(allowed, None, 12 * S)
    relay.relay(allowed, (math.nan, math.nan, 0.2), 13 * S)
    assert len(relay.asked) == 1, "nowhere is no place to let it go at"
    relay.relay(allowed, HAND, 14 * S)
    relay.relay(allowed, HAND, 15 * S)
    assert relay.asked[1:] == [HAND]


@pytest.mark.parametrize(("age_s", "expected"), [(0.1, HAND), (0.5, None)])
def test_where_the_hand_was_before_a_silence_is_no_set_point(age_s, expected, tmp_path):
    """Else the first wish, or the release, would pull from a place that the hand has left."""
    course = Course(Attendance(), Arm(tmp_path, lambda: 0))
    assert course.hand(10 * S) is None, "nothing was heard yet"
    course.sample, course.sampled_ns = hand_sample(at_hand(5), PLANE), 10 * S
    assert course.hand(10 * S + round(age_s * S)) == expected


def at_hand(sequence) -> EndpointState:
    x, y, z = HAND
    return EndpointState(sequence=sequence, position=Point(x=x, y=y, z=z))


@pytest.fixture
def recordings(monkeypatch):
    """Return what the nodes made here record with."""
    made = []

    def make(*given):
        made.append(SessionRecording(*given))
        return made[-1]

    monkeypatch.setattr(therapy_session, "SessionRecording", make)
    return made


@pytest.fixture
def session(make_node, recordings):
    """A session's node that is active, and both ends of its topics."""
    node = make_node("therapy_session")
    ends = Topics(node)
    node.trigger_configure()
    node.trigger_activate()
    node.requests.ask = lambda act: act()  # its loop is the test
    yield node, ends
    node.close()


def test_a_session_begins_without_the_games_set_point(relay):
    """NaN alone leaves the spring where it is, and it pulled until the recording had begun."""
    relay.wishes.append(wish(0.1))
    relay.relay(True, HAND, 10 * S)
    relay.begin(WishLimits(), HAND, 11 * S)
    assert relay.asked[-1] == HAND
    for tenth in range(9):
        relay.relay(False, HAND, 11 * S + tenth * S // 10)
    assert relay.asked[2:] == [HAND]
    for second in (12, 13):
        relay.relay(False, HAND, second * S)
    assert len(relay.asked) == 4, "and then nowhere: a pause must not pull back there"
    assert all(math.isnan(value) for value in relay.asked[3])


def test_a_session_begins_without_the_set_point_of_anybody(relay):
    """That of the homing pulled up all through sessions in the plane."""
    relay.begin(WishLimits(), HAND, 11 * S)
    relay.relay(False, HAND, 11 * S)
    assert relay.asked == [HAND]


def test_the_sessions_node_takes_a_games_pull_with_it(session):
    """Nobody would ever let the hand go: the controllers keep the newest set point."""
    node, ends = session
    ends.heard["endpoint_state"].append(at_hand(5))
    ends.heard["therapy/wish"].append(wish(0.1))
    node.step()
    (asked,) = ends.told["setpoint"]
    node.trigger_deactivate()
    let_go = ends.told["setpoint"][1].position
    assert asked.position.x > HAND[0] and (let_go.x, let_go.y, let_go.z) == HAND


def test_a_node_that_was_deactivated_forgets_the_patient(session):
    node, ends = session
    ends.heard["endpoint_state"].append(at_hand(5))
    node.step()
    started = asked(node, "~/start", StartTherapy.Request(protocol="evaluation", patient="P-7K3QX"))
    assert started.success
    node.step()
    assert ends.told["therapy/state"][-1].patient == "P-7K3QX"
    node.trigger_deactivate()
    node.trigger_activate()
    node.step()
    state = ends.told["therapy/state"][-1]
    state.header.stamp.sec = state.header.stamp.nanosec = state.monotonic_ns = 0
    for name in ("arm_weight", "pain", "tired", "rest"):
        assert math.isnan(getattr(state, name))
        setattr(state, name, 0.0)
    idle = TherapyState(state=TherapyState.IDLE)
    idle.header.frame_id = "manus_base"
    assert state == idle


def test_an_unrecorded_session_does_not_begin_in_the_bag_of_another(session, monkeypatch):
    """After a kill of this node the recorder goes on, with the name of the patient before."""
    node, ends = session
    ends.heard["endpoint_state"].append(at_hand(5))
    node.step()
    request = StartTherapy.Request(protocol="evaluation", patient="P-22222")
    with monkeypatch.context() as patch:
        patch.setattr(SessionRecording, "of_another", lambda *_: "P-33333")
        answer = asked(node, "~/start", request).message
    assert "still records a session of P-33333" in answer and "session_recorder/stop" in answer
    assert asked(node, "~/start", request).success


def ready_hand(sequence, z=0.2) -> EndpointState:
    """A hand at rest, on a robot that may move it."""
    message = at_hand(sequence)
    message.position.x, message.position.z, message.monotonic_ns = 0.0, z, sequence * 5_000_000
    message.valid, message.enabled, message.safety = [True] * 3, [True] * 2, SafetyState.OK
    return message


def test_the_height_of_a_session_in_the_plane_is_held_as_one_slot(session):
    """Each trial has its own slot; one that holds must not fade out and in with each."""
    node, ends = session
    ends.heard["endpoint_state"].append(ready_hand(5))
    node.step()
    request = StartTherapy.Request(protocol="evaluation", patient="P-7K3QX")
    assert asked(node, "~/start", request).success
    for sequence in range(6, 1000):
        ends.heard["endpoint_state"].append(ready_hand(sequence, z=0.2 if sequence < 100 else 0.19))
        node.step()
    slots = ends.told["therapy/slot"]
    assert len({(each.planar, each.start_ns) for each in slots}) > 2
    moments = [slot_of(each, vertical=True) for each in slots]
    rested = next(n for n, (slot, _) in enumerate(moments) if slot is not None)
    assert slots[rested].start_ns == 0 and slots[0].start_ns > 0, "not yet while it is prepared"
    ((slot, start_ns),) = set(moments[rested:])
    assert slot[:4] == (0.2, 0.0, 0.2, 0.0) and start_ns == 0
    assert (slot.side_stiffness, slot.half_width, slot.growth) == (800.0, 0.0, 0.0)
    assert asked(node, "~/pause", Trigger.Request()).success
    node.step()
    assert slot_of(ends.told["therapy/slot"][-1], vertical=True) == (None, 0)


class Room:
    """A session's node, with a controller and a hand that the test moves.

    limit, in_use: what the controller tells [N]; hand: the newest sample; count: of them.
    """

    def __init__(self, node, ends, recording):
        self.node, self.ends, self.recording = node, ends, recording
        self.limit, self.in_use, self.count = 25.0, 0.0, 5
        self.force, self.z = 0.0, 0.2

    def go_on(self, seconds):
        """Move on, sample by sample, on the node's own clock."""
        for _ in range(round(seconds * 200)):
            self.count += 1
            hand = ready_hand(self.count, self.z)
            hand.force.z = self.force
            hand.monotonic_ns = self.node.clock.now_ns()
            told = ImpedanceState(support=self.in_use, support_limit=self.limit)
            self.ends.heard["endpoint_state"].append(hand)
            self.ends.heard["screw/controller_state"].append(told)
            self.node.step()
            self.node.clock.time_ns += 5_000_000

    def ask(self, force):
        """Ask for support by hand [N]; return why not."""
        changes = [Parameter("support.force", value=force)]
        refused = self.node.set_parameters_atomically(changes).reason
        self.go_on(0.005)
        return refused

    def call(self, name, request=None):
        answer = asked(self.node, name, request)
        self.go_on(0.005)
        return answer.message if not answer.success else ""

    def keeps(self, folder):
        """Let the session's bag lie in a folder."""
        self.recording.folder = folder

    @property
    def slots(self):
        return self.ends.told["therapy/slot"]

    @property
    def state(self):
        return self.ends.told["therapy/state"][-1]


@pytest.fixture
def room(session, recordings):
    node, ends = session
    node.clock = ManualClock(100 * S)
    node.requests.put = lambda act: act()
    made = Room(node, ends, *recordings)
    made.go_on(0.5)
    return made


START = StartTherapy.Request(protocol="evaluation", patient="P-7K3QX")


def test_a_support_beyond_its_bounds_is_refused_with_a_sentence(room):
    assert "was not weighed: at most 15 N" in room.ask(16.0)
    assert room.ask(15.0) == "" and room.state.support == 15.0
    room.limit = 0.0
    room.go_on(0.01)
    assert "choose mode 3 to 5" in room.ask(10.0)
    assert room.ask(0.0) == ""
    room.limit = 8.0
    room.go_on(0.01)
    assert "stop_reaction to brake" in room.ask(10.0)
    assert room.state.support == 0.0


def test_an_arm_is_carried_without_a_session_while_one_starts_runs_and_waits(room):
    assert not room.slots, "who asks for nothing holds no lease"
    assert room.ask(12.0) == ""
    room.go_on(1.0)
    assert len(room.slots) >= 20
    assert not any(slot.planar or slot.vertical or any(slot.held) for slot in room.slots)
    assert room.call("~/start", START) == ""
    room.go_on(1.0)
    assert room.slots[-1].planar
    assert room.call("~/pause") == ""
    count = len(room.slots)
    room.go_on(1.0)
    assert len(room.slots) >= count + 20 and not room.slots[-1].planar
    assert room.call("~/abort") == ""
    room.go_on(1.0)
    assert {slot.support for slot in room.slots} == {12.0}, "the end leaves the arm carried"
    assert room.state.state == TherapyState.ABORTED
    assert room.ask(0.0) == "" and room.slots[-1].support == 0.0


def test_the_patient_pauses_and_no_more(room):
    """His stop takes what a pause takes, no torque; only the therapist goes on."""
    assert "no session" in room.call("~/pause_by_patient")
    assert room.ask(12.0) == "" and room.call("~/start", START) == ""
    room.go_on(1.0)
    assert room.slots[-1].planar
    assert room.call("~/pause_by_patient") == ""
    assert (room.state.state, room.state.reason) == (TherapyState.PAUSED, "the patient asked")
    assert not room.slots[-1].planar and room.slots[-1].support == 12.0
    assert "is paused" in room.call("~/pause_by_patient")
    assert room.call("~/resume") == "" and room.state.state == TherapyState.RUNNING
    assert room.call("~/abort") == "" and "is aborted" in room.call("~/pause_by_patient")


ASKING = StartTherapy.Request(
    protocol="evaluation", patient="P-7K3QX", checks=StartTherapy.Request.ASK
)
PAIN, TIREDNESS = 16 * TherapyState.PAIN, 16 * TherapyState.TIREDNESS


def answer(room, *data):
    """Touch numbers on the patient's screen, one after the other."""
    for each in data:
        room.ends.heard["therapy/answer"].append(UInt8(data=each))
        room.go_on(0.01)


def kept(folder):
    (file,) = folder.glob("*_scores.json")
    return [(score.scale, score.value) for score in scores_in(file)]


def test_a_session_begins_once_the_patient_has_told_his_pain_and_tiredness(room, tmp_path):
    assert room.call("~/start", ASKING) == ""
    room.keeps(tmp_path)
    room.go_on(1.0)
    assert (room.state.state, room.state.asks) == (TherapyState.STARTING, TherapyState.PAIN)
    assert "asked for pain and tiredness" in room.state.reason
    assert not any(slot.planar for slot in room.slots)
    answer(room, TIREDNESS + 4, PAIN + 11, PAIN + 2)
    assert (room.state.asks, room.state.pain) == (TherapyState.TIREDNESS, 2.0), "one by one"
    answer(room, PAIN + 9)  # touched twice
    assert room.state.state == TherapyState.STARTING and math.isnan(room.state.tired)
    answer(room, TIREDNESS + 4)
    assert (room.state.state, room.state.asks) == (TherapyState.RUNNING, TherapyState.NOTHING)
    assert (room.state.pain, room.state.tired) == (2.0, 4.0)
    assert kept(tmp_path) == [("pain_before", 2.0), ("tired_before", 4.0)]


def test_what_is_told_before_the_recorder_has_answered_is_kept_then(room, tmp_path, monkeypatch):
    assert room.call("~/start", ASKING) == ""
    monkeypatch.setattr(SessionRecording, "waits", True)
    answer(room, PAIN + 2, TIREDNESS + 4)
    monkeypatch.setattr(SessionRecording, "waits", False)
    room.keeps(tmp_path)
    room.go_on(0.01)
    assert kept(tmp_path) == [("pain_before", 2.0), ("tired_before", 4.0)]


def test_who_cannot_answer_is_not_waited_for(room):
    assert room.call("~/start", ASKING) == ""
    assert room.call("~/resume") == ""
    assert room.state.state == TherapyState.RUNNING
    assert math.isnan(room.state.pain) and room.state.goes_on == TherapyState.NOT_ASKED


@pytest.mark.parametrize(("way", "value", "word", "state"), [
    ("resume", 1.0, TherapyState.YES, TherapyState.RUNNING),
    ("abort", 0.0, TherapyState.NO, TherapyState.ABORTED),
])  # fmt: skip
def test_much_pain_begins_no_session_without_the_therapists_word(room, tmp_path, way, value, word,
                                                                 state):  # fmt: skip
    assert room.call("~/start", ASKING) == ""
    room.keeps(tmp_path)
    answer(room, PAIN + 6, TIREDNESS + 0)
    room.go_on(1.0)
    assert (room.state.state, room.state.goes_on) == (TherapyState.STARTING, TherapyState.ASKED)
    assert room.call(f"~/{way}") == ""
    assert (room.state.state, room.state.goes_on) == (state, word)
    assert ("went_on", value) in kept(tmp_path)


@pytest.mark.parametrize(("pain", "asked_on"), [(3, False), (4, True)])
def test_after_a_pause_of_the_patient_pain_that_rose_is_asked_about(room, pain, asked_on):
    """3 more than at first; a pause of the therapist asks nobody."""
    assert room.call("~/start", ASKING) == ""
    answer(room, PAIN + 1, TIREDNESS + 1)
    room.go_on(0.5)
    assert room.call("~/pause") == "" and room.state.asks == TherapyState.NOTHING
    assert room.call("~/resume") == "" and room.call("~/pause_by_patient") == ""
    assert room.state.asks == TherapyState.PAIN
    answer(room, PAIN + pain, TIREDNESS + 1)
    assert (room.state.goes_on == TherapyState.ASKED) is asked_on
    room.go_on(1.0)
    assert room.state.state == TherapyState.PAUSED
    assert room.call("~/resume") == "" and room.state.state == TherapyState.RUNNING
    assert (room.state.goes_on == TherapyState.YES) is asked_on


def test_after_a_spasm_and_after_the_session_he_is_asked_again(room, tmp_path):
    assert room.call("~/start", ASKING) == ""
    room.keeps(tmp_path)
    answer(room, PAIN + 1, TIREDNESS + 1)
    room.go_on(14.0)
    assert room.ends.told["therapy/trial"]
    room.force = -70.0
    room.go_on(0.4)
    room.force = 0.0
    assert (room.state.reason, room.state.asks) == ("the arm pulls hard", TherapyState.PAIN)
    assert room.call("~/abort") == "" and room.state.asks == TherapyState.PAIN
    answer(room, PAIN + 8)
    assert room.state.goes_on == TherapyState.NOT_ASKED, "there is nothing to go on with"
    assert kept(tmp_path)[-1] == ("pain_after", 8.0)
    room.node.clock.time_ns += 301 * S
    room.go_on(0.01)
    assert room.state.asks == TherapyState.NOTHING, "the next patient must not answer for him"
    answer(room, TIREDNESS + 3)
    assert len(kept(tmp_path)) == 3


@pytest.mark.parametrize("protocol", ["evaluation", "elevator"])
def test_a_rest_ends_by_itself_and_drops_no_arm(room, protocol):
    """In the plane the height stays held; where trials bring the arm up again it is lowered."""
    assert room.ask(12.0) == ""
    request = StartTherapy.Request(protocol=protocol, patient="P-7K3QX")
    assert room.call("~/start", request) == ""
    room.go_on(10.0)
    assert room.call("~/rest") == ""
    assert (room.state.state, room.state.reason) == (TherapyState.PAUSED, "a rest")
    assert 59.0 < room.state.rest <= 60.0
    slot, _ = slot_of(room.slots[-1], vertical=True)
    assert slot.target_x == (0.2 if protocol == "evaluation" else 0.05)
    assert not room.slots[-1].planar and room.slots[-1].support == 12.0
    assert "is paused" in room.call("~/rest")
    room.go_on(59.9)
    assert room.state.state == TherapyState.PAUSED and room.state.rest < 0.2
    room.go_on(0.2)
    assert room.state.state == TherapyState.RUNNING and math.isnan(room.state.rest)
    assert room.slots[-1].support == 12.0, "it is carried again"


def test_a_rest_that_the_patient_stops_does_not_end_by_itself(room):
    assert room.call("~/start", START) == ""
    room.go_on(10.0)
    assert room.call("~/rest") == "" and room.call("~/pause_by_patient") == ""
    assert (room.state.reason, slot_of(room.slots[-1], vertical=True)[0]) == (
        "the patient asked", None
    )  # fmt: skip
    room.go_on(61.0)
    assert room.state.state == TherapyState.PAUSED
    assert room.call("~/resume") == "" and room.call("~/rest") == "" and room.call("~/resume") == ""
    assert room.state.state == TherapyState.RUNNING, "the therapist ends a rest before its time"


def test_the_therapist_switches_the_sound_of_the_patients_screen(room):
    assert not room.state.sound
    changes = [Parameter("patient_sound", value=True)]
    assert room.node.set_parameters_atomically(changes).successful
    room.go_on(0.1)
    assert room.state.sound


@pytest.mark.parametrize(("asked", "begins"), [
    ((1.2, 140.0), (1.2, 140.0)), ((0.1, 9000.0), (0.7, 300.0)), ((0.0, 0.0), (1.4, 100.0)),
    ((math.nan, 140.0), (1.4, 100.0)), ((1.2, math.nan), (1.4, 100.0)),
])  # fmt: skip
def test_a_session_begins_with_the_assistance_of_last_time_within_what_it_adapts(
    room, asked, begins
):  # fmt: skip
    """The protocol stays what it is, so that sessions of one hash compare."""
    request = StartTherapy.Request(
        protocol="clock_adaptive", patient="P-7K3QX", duration=asked[0], side_stiffness=asked[1]
    )
    assert room.call("~/start", request) == ""
    assert (room.state.duration, room.state.side_stiffness) == begins
    assert room.state.definition_sha256 == sha256(protocol_text("clock_adaptive"))


def test_a_game_pulls_and_scores_in_its_minutes_and_not_in_a_pause(room):
    """Its minutes are a session's trials: another session lets no game pull."""
    game = StartTherapy.Request(protocol="fruit", patient="P-7K3QX", level="far", minutes=2)
    assert room.call("~/start", game) == ""
    state = room.state
    assert (state.kind, state.block, state.trials, state.trial) == ("game", "far", 2, 1)

    def pulled():
        room.ends.told["setpoint"].clear()
        room.ends.heard["therapy/wish"].append(wish(0.14))
        room.ends.heard["therapy/score"].append(Float64(data=0.75))
        room.go_on(0.01)
        return any(each.position.x > 0.0 for each in room.ends.told["setpoint"])

    room.go_on(0.5)
    assert pulled() and not any(slot.planar or slot.vertical for slot in room.slots)
    assert room.call("~/pause_by_patient") == "" and not pulled()
    assert room.call("~/resume") == "" and pulled()
    room.go_on(60.0)
    (result,) = room.ends.told["therapy/trial"]
    assert (result.kind, result.score) == ("game", 0.75)
    assert room.call("~/abort") == ""
    assert room.call("~/start", START) == "" and not pulled()
    refused = StartTherapy.Request(protocol="fruit", patient="P-7K3QX", level="hard")
    assert "level = 'hard': one of near, middle, far" in room.call("~/start", refused)


def test_a_bag_is_named_by_utc_wherever_the_clinic_is(room, monkeypatch):
    """A local time without its zone is two moments in one night of autumn."""
    names = []
    monkeypatch.setattr(SessionRecording, "ask", lambda self, name: names.append(name))
    before = datetime.now(timezone.utc).replace(microsecond=0)
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    time.tzset()
    request = StartTherapy.Request(protocol="evaluation", patient="P-7K3QX", record=True)
    assert room.call("~/start", request) == ""
    monkeypatch.undo()
    time.tzset()
    (name,) = names
    named = datetime.strptime(name, "P-7K3QX_evaluation_%Y_%m_%d-%H_%M_%S%z")
    assert before <= named <= datetime.now(timezone.utc) and name.endswith("Z")


def test_the_patient_ends_a_weighing_and_the_arm_is_brought_back(room):
    arm = StartTherapy.Request(patient="P-7K3QX", side="left")
    assert room.call("~/weigh", arm) == ""
    room.go_on(4.0)
    assert "strap the arm in" in room.state.arm
    assert room.call("~/weigh", arm) == ""
    room.go_on(2.0)
    assert "let it hang" in room.state.arm and room.slots[-1].vertical
    assert room.call("~/pause_by_patient") == ""
    room.go_on(0.1)
    assert "the patient asked; the arm is brought back" in room.state.arm


def test_the_arm_is_lowered_and_let_go(room):
    assert room.ask(12.0) == ""
    room.in_use = 12.0
    assert room.call("~/start", START) == ""
    room.go_on(1.0)
    assert "the session is running: pause it first" in room.call("~/lower")
    assert room.call("~/pause") == ""
    assert room.call("~/lower") == ""
    slot, _ = slot_of(room.slots[-1], vertical=True)
    assert (slot.start_x, slot.target_x, room.slots[-1].support) == (0.2, 0.05, 12.0)
    room.go_on(5.1)
    assert "is being lowered" in room.state.arm
    assert room.slots[-1].vertical and room.slots[-1].support == 0.0
    room.in_use = 0.0
    room.go_on(0.1)
    assert not room.slots[-1].vertical
    assert room.call("~/resume") == "" and room.slots[-1].support == 12.0, "it is carried again"


def test_what_was_lowered_of_one_is_not_carried_again_of_another(room):
    assert room.ask(12.0) == ""
    assert room.call("~/lower") == ""
    assert "is being lowered" in room.call("~/start", START)
    room.go_on(6.0)
    assert room.call("~/start", START) == ""
    assert room.call("~/pause") == "" and room.call("~/resume") == ""
    assert room.state.support == 0.0


@pytest.mark.parametrize(("patient", "side", "support"), [
    ("P-7K3QX", "left", 12.0), ("P-7K3QX", "right", 0.0), ("P-22222", "left", 0.0),
])  # fmt: skip
def test_what_one_was_carried_with_is_not_asked_for_another(room, patient, side, support):
    """The next patient's arm would be pressed up by what the last one needed."""
    first = StartTherapy.Request(protocol="evaluation", patient="P-7K3QX", side="left")
    assert room.call("~/start", first) == "" and room.ask(12.0) == ""
    assert room.call("~/abort") == "" and room.state.support == 12.0
    then = StartTherapy.Request(protocol="evaluation", patient=patient, side=side)
    assert room.call("~/start", then) == ""
    assert room.state.support == room.slots[-1].support == support


def test_what_is_asked_for_before_a_patients_first_session_is_his(room):
    assert room.call("~/start", START) == "" and room.ask(12.0) == ""
    assert room.call("~/abort") == "" and room.ask(9.0) == ""
    then = StartTherapy.Request(protocol="evaluation", patient="P-22222")
    assert room.call("~/start", then) == ""
    room.go_on(0.5)
    assert room.state.support == 9.0


def test_nothing_is_lowered_without_torque(room):
    room.ends.heard["endpoint_state"].append(EndpointState(valid=[True] * 3))
    room.node.step()
    assert asked(room.node, "~/lower").message == "the vertical torque is off"


@pytest.mark.parametrize("kind", ["reach", "strength"])
def test_an_arm_that_pulls_hard_pauses_all_but_a_trial_of_strength(room, kind):
    assert room.ask(12.0) == "" and room.call("~/start", START) == ""
    room.go_on(1.0)
    room.node.course.session.trial.kind = kind
    room.force = -70.0
    room.go_on(0.29)
    assert room.state.state == TherapyState.RUNNING
    room.go_on(0.1)
    if kind == "strength":
        assert room.state.state == TherapyState.RUNNING
        return
    assert (room.state.state, room.state.reason) == (TherapyState.PAUSED, "the arm pulls hard")
    assert not room.slots[-1].planar and room.slots[-1].support == 12.0


def test_a_lowering_ends_where_the_arm_pulls_hard(room):
    assert room.ask(12.0) == "" and room.call("~/lower") == ""
    room.force = -70.0
    room.go_on(0.5)
    assert not room.slots[-1].vertical and room.slots[-1].support == 12.0


def test_a_result_has_the_support_that_was_in_use(room):
    assert room.call("~/start", START) == ""
    room.go_on(1.0)
    room.in_use = 7.0
    room.go_on(12.0)
    (result,) = room.ends.told["therapy/trial"]
    assert 6.0 < result.support < 7.0


@pytest.fixture
def carrying(monkeypatch):
    """Give the first block of `evaluation` a support."""
    content = yaml.safe_load(protocol_text("evaluation"))

    def carry(support):
        content["blocks"][0]["support"] = support
        monkeypatch.setattr(therapy_session, "protocol_text", lambda _: yaml.safe_dump(content))

    return carry


@pytest.mark.parametrize(("force", "support", "let_go"), [
    (-5.4, 0.0, True), (-20.0, 0.0, False), (-20.0, 15.0, True), (-20.0, math.nan, False),
])  # fmt: skip
def test_a_set_point_on_which_an_arm_hangs_is_not_let_go(room, force, support, let_go):
    """20 N of an arm on a spring of 100 N/m would fall by 20 cm."""
    room.force, room.in_use = force, support
    room.go_on(0.1)
    assert room.call("~/start", START) == ""
    room.go_on(2.0)
    asked = [message.position.z for message in room.ends.told["setpoint"]]
    assert (0.2 in asked) is let_go


def test_a_share_of_an_arm_that_was_not_weighed_starts_no_session(room, carrying):
    carrying({"share": 0.5})
    assert "weigh the arm first" in room.call("~/start", START)
    assert room.state.state == TherapyState.IDLE


def test_a_block_asks_for_its_support_until_somebody_does_by_hand(room, carrying):
    carrying({"force": 6.0})
    assert room.call("~/start", START) == ""
    room.go_on(0.5)
    assert (room.state.support, room.state.support_since) == (6.0, 0)
    assert room.ask(9.0) == ""
    room.go_on(0.5)
    since = room.state.support_since
    assert room.state.support == 9.0 and 0 < since < room.count
    assert room.call("~/pause") == "" and room.call("~/resume") == ""
    room.go_on(0.5)
    assert (room.state.support, room.state.support_since) == (9.0, since)


MESSAGES = 150  # three quarters of a second


def test_samples_of_a_pause_are_all_taken(make_node, wait_until, monkeypatch):
    """The queue held ten, 50 ms: trials counted samples as missing that the bag had."""
    node = make_node("therapy_session")
    node.connect()
    node.begin()
    taken = []
    monkeypatch.setattr(
        therapy_session, "hand_sample",
        lambda message, space: taken.append(message.sequence) or hand_sample(message, space),
    )  # fmt: skip
    publisher = node.create_publisher(EndpointState, "endpoint_state", topics.EACH_STATE)
    wait_until(lambda: publisher.get_subscription_count() == 1, what="discovery")
    for number in range(MESSAGES):
        publisher.publish(EndpointState(sequence=number))
    node.step()
    wait_until(lambda: node.step() or len(taken) >= MESSAGES, what="all samples")
    assert taken == list(range(MESSAGES))
    node.disconnect()
    node.close_topics()


def test_states_and_phases_are_those_of_the_message():
    for constant in (*State, *Phase, *Question, *GoesOn):
        assert getattr(TherapyState, constant.name) == constant


def test_the_safety_level_that_permits_is_that_of_the_message():
    assert SafetyState.OK == SAFETY_OK
