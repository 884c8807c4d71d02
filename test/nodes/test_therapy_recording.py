# SPDX-License-Identifier: Apache-2.0
"""A recorder that hangs, dies or whose disk is full holds up no session, and none goes on unaware.

The recorder is played: only the session's side runs, mostly without ROS's graph.
"""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from screw_module_msgs.srv import StartRecording
from std_srvs.srv import Trigger

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes.session_recorder import SessionRecorder
from screw_module_ros.nodes.therapy_recording import (
    BEGUN,
    LOST,
    RECORDER,
    REFUSED,
    RecorderSettings,
    SessionRecording,
)
from screw_module_ros.nodes.therapy_session import TherapySessionNode
from screw_module_ros.recording.recorder import Status

S = 1_000_000_000
DONE = Trigger.Response(success=True, message="bag")


class PlayedRecorder:
    """The services of a recorder, which answer when the test says so; also node and inbox."""

    def __init__(self):
        self.asked: dict[str, list[Future]] = {}
        self.names: list[str] = []
        self.told: list[DiagnosticStatus] = []
        log = SimpleNamespace(info=lambda text: None, warning=lambda text: None)
        self.get_logger = lambda: log
        self.get_namespace = lambda: "/"
        self.left_out: set[str] = set()

    def create_client(self, kind, name):
        calls = self.asked[name.rpartition("/")[2]] = []

        def call_async(request):
            self.names += [request.name] if isinstance(request, StartRecording.Request) else []
            calls.append(Future())
            return calls[-1]

        return SimpleNamespace(service_is_ready=lambda: True, call_async=call_async)

    def get_subscriptions_info_by_topic(self, name):
        other = SimpleNamespace(node_name="web_bridge", node_namespace="/")
        own = SimpleNamespace(node_name="session_recorder", node_namespace="/")
        return [other] if name in self.left_out else [other, own]

    def subscribe(self, kind, name, profile):
        return lambda: self.told.pop(0) if self.told else None

    def answer(self, service, response):
        """Answer the oldest call."""
        self.asked[service].pop(0).set_result(response)

    def report(self, recording, bag="", message=""):
        values = [KeyValue(key="recording", value=str(recording)), KeyValue(key="bag", value=bag)]
        self.told.append(DiagnosticStatus(values=values, message=message))


@pytest.fixture
def recorder():
    return PlayedRecorder()


@pytest.fixture
def recording(recorder):
    clock = ManualClock(S)
    made = SessionRecording(recorder, clock)
    made.connect(recorder)
    made.begin(RecorderSettings(timeout=5.0))
    made.clock = clock
    return made


def follow(recording, second, in_session=True):
    recording.clock.time_ns = round(second * S)
    return recording.follow(in_session, recording.clock.time_ns)


def begun(recording, recorder, at=1):
    recording.ask("P-22222_clock")
    assert follow(recording, at) == ""
    recorder.answer("record", DONE)
    assert follow(recording, at + 1) == BEGUN and recording.runs


def test_a_recorder_that_never_answers_is_given_up(recording, recorder):
    recording.ask("P-22222_clock")
    assert [follow(recording, second) for second in (1, 5, 10)] == [""] * 3
    assert follow(recording, 12) == REFUSED
    assert "does not answer" in recording.message
    assert not recording.waits and recording.hindrance("P-22222", True, 12 * S) == ""


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


def test_a_recording_that_begins_after_it_was_given_up_is_ended(recording, recorder):
    recording.ask("P-22222_clock")
    follow(recording, 1)
    assert follow(recording, 12) == REFUSED
    recorder.answer("record", DONE)
    assert len(recorder.asked["stop"]) == 1
    assert follow(recording, 30) == "" and not recording.runs


def test_its_name_comes_with_the_request(recording, recorder):
    begun(recording, recorder)
    assert recorder.names == ["P-22222_clock"]


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
    assert "is being closed" in recording.hindrance("P-22222", True, 4 * S)
    late = recording.hindrance("P-22222", True, 14 * S)
    assert late == "", "a mute recorder is waited for no more"
    recorder.answer("stop", DONE)
    assert recording.hindrance("P-22222", True, 4 * S) == ""
    assert recording.message == "recorded to bag"


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
    recording.listen(S)
    assert recording.of_another("P-33333", 2 * S) == owner
    assert recording.of_another("P-33333", 9 * S) == "", "the recorder has gone as well"
    recorder.report(False, bag)
    recording.listen(2 * S)
    assert recording.of_another("P-33333", 2 * S) == ""


@pytest.mark.parametrize("answered", [True, False])
def test_a_recording_ends_with_the_sessions_node(recording, recorder, answered):
    """Else it would hold the next patient's movements in a bag of this one's name."""
    if answered:
        begun(recording, recorder)
    else:
        recording.ask("P-22222_clock")
    node = SimpleNamespace(
        _lock=threading.Lock(), _session=None, _recording=recording, clock=recording.clock,
        _relay_wishes=lambda now_ns, ends: None,
    )  # fmt: skip
    TherapySessionNode.end(node)
    assert len(recorder.asked["stop"]) == 1 and not recording.runs
    TherapySessionNode.end(node)
    assert len(recorder.asked["stop"]) == 1


def test_a_recording_that_failed_is_reported_as_none():
    """A full disk closes the bag, but the recorder's session lasts until it is stopped."""
    status = Status("only 3 MiB left on the disk", 7, 0, 5, 100, {})
    recording = SimpleNamespace(status=lambda: status)
    taps = SimpleNamespace(refused={}, recording=recording)
    node = SimpleNamespace(_taps=taps, _last=None, _folder="bag", _refusal="")
    assert SessionRecorder.health(node).values["recording"] is False
    recording.status = lambda: status._replace(error="")
    assert SessionRecorder.health(node).values["recording"] is True


@pytest.fixture
def served(ros_domain_id):
    """Return a maker of nodes that are served until the end of the test."""
    context = Context()
    context.init()
    executor, ending, nodes = SingleThreadedExecutor(context=context), threading.Event(), []

    def serve() -> None:
        while not ending.is_set():
            executor.spin_once(timeout_sec=0.05)

    def make(name: str) -> Node:
        nodes.append(Node(name, context=context))
        executor.add_node(nodes[-1])
        return nodes[-1]

    thread = threading.Thread(target=serve)
    thread.start()
    yield make
    ending.set()
    thread.join()
    executor.shutdown(timeout_sec=1.0)
    for node in nodes:
        node.destroy_node()
    context.try_shutdown()


def asked(node):
    """Return a recording that a node has asked for."""
    made = SessionRecording(node, ManualClock(S))
    made.connect(SimpleNamespace(subscribe=lambda *request: lambda: None))
    made.ask("P-22222")
    return made


def test_a_recorder_that_appears_records(served, wait_until):
    made = asked(served("session"))
    assert made.follow(True, 2 * S) == ""

    def record(request, response):
        response.success, response.message = True, request.name
        return response

    served(RECORDER).create_service(StartRecording, "~/record", record)
    wait_until(lambda: made.follow(True, 2 * S) or made.message == "recording to P-22222")


def test_without_a_recorder_it_is_refused_after_a_while(served):
    made = asked(served("session"))
    assert made.follow(True, 6 * S - 1) == ""
    assert made.follow(True, 6 * S) == REFUSED
    assert "no session_recorder answers" in made.message
