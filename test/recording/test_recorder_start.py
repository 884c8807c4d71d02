# SPDX-License-Identifier: Apache-2.0
"""The parts of `session_recorder` without a graph: its folder, answers, topics and parameters."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Infinite
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_hash import TypeHash
from screw_module_msgs.srv import CountSessions, StartRecording
from std_srvs.srv import Trigger

from screw_module_ros.nodes import session_recorder
from screw_module_ros.nodes.recording_parameters import NodeParameters
from screw_module_ros.nodes.recording_topics import Taps, offered_by, satisfying
from screw_module_ros.nodes.session_recorder import SessionRecorder
from screw_module_ros.recording.bag_files import information
from screw_module_ros.recording.definitions import UNKNOWN
from screw_module_ros.recording.recorder import NO_ANSWER


@pytest.fixture
def recorder(tmp_path, monkeypatch, request):
    """Return the recorder, active; its folder is `bags` below the test's.

    The parameter of the fixture: further ROS arguments.
    """
    words = ["-p", f"folder:={tmp_path / 'bags'}", *getattr(request, "param", [])]
    monkeypatch.setattr("sys.argv", ["session_recorder", "--ros-args", *words])
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = SessionRecorder()
    node.parameters.finish()
    node.trigger_configure()
    node.trigger_activate()
    yield node
    node.close()
    node.destroy_node()
    rclpy.shutdown()


def called(node: SessionRecorder, service_name: str, kind: type = Trigger, **fields: str) -> str:
    """Call a service of the node; return its answer: of ~/start the folder, or what is wrong."""
    (service,) = (each for each in node.services if each.srv_name.endswith(f"/{service_name}"))
    return service.callback(kind.Request(**fields), kind.Response()).message


def give(node: SessionRecorder, **parameters: object) -> None:
    for key, value in parameters.items():
        (result,) = node.set_parameters([Parameter(key.replace("__", "."), value=value)])
        assert result.successful, result.reason


def test_two_in_one_second_get_two_folders(recorder, tmp_path, monkeypatch):
    monkeypatch.setattr(session_recorder, "date_in_name", lambda: "2001_01_31-12_00_00Z")
    folders = []
    for _ in range(3):
        folders.append(Path(called(recorder, "start")))
        called(recorder, "stop")
    stem = "session_2001_01_31-12_00_00Z"
    assert [f.name for f in folders] == [stem, f"{stem}_2", f"{stem}_3"]
    assert all((folder / "metadata.yaml").is_file() for folder in folders)


def test_a_request_names_its_own_bag_and_no_later_one(recorder, tmp_path):
    """A name that stayed would be a patient's on somebody else's recording."""
    give(recorder, name="by_hand")
    give(recorder, allow_dirty=True)
    folders = [Path(called(recorder, "record", StartRecording, name="P-7K3QX_clock"))]
    refused = called(recorder, "record", StartRecording, name="other")
    assert "already recording" in refused and "P-7K3QX" not in refused, "who asks may log it"
    called(recorder, "stop")
    folders.append(Path(called(recorder, "start")))
    called(recorder, "stop")
    assert [folder.name for folder in folders] == ["P-7K3QX_clock", "by_hand"]
    folder = Path(called(recorder, "record", StartRecording))
    assert folder.name.startswith("session_2")


def test_no_patient_is_recorded_with_changed_software_unless_allowed(recorder, monkeypatch):
    monkeypatch.setattr(session_recorder, "commit", lambda: "0a1b2c3d4e5f, dirty")
    refused = called(recorder, "record", StartRecording, name="P-7K3QX_clock")
    assert "differs from its commit (0a1b2c3d4e5f, dirty)" in refused and "allow_dirty" in refused
    give(recorder, name="P-7K3QX_by_hand")
    assert called(recorder, "start") == refused
    assert Path(called(recorder, "record", StartRecording, name="bench")).name == "bench"
    called(recorder, "stop")
    give(recorder, allow_dirty=True)
    assert Path(called(recorder, "start")).name == "P-7K3QX_by_hand"
    called(recorder, "stop")
    give(recorder, allow_dirty=False)
    for told in ("0a1b2c3d4e5f", "unknown"):
        monkeypatch.setattr(session_recorder, "commit", lambda told=told: told)
        name = f"P-7K3QX_{told}"
        assert Path(called(recorder, "record", StartRecording, name=name)).name == name
        called(recorder, "stop")


def test_the_sessions_of_a_patient_are_counted(recorder, tmp_path):
    """Each of his bags once, whatever became of it; a recovered copy is none of its own."""
    (service,) = (each for each in recorder.services if each.srv_name.endswith("/count"))

    def answer(patient):
        return service.callback(CountSessions.Request(patient=patient), CountSessions.Response())

    assert (answer("P-7K3QX").success, answer("P-7K3QX").sessions) == (True, 0), "no folder yet"
    own = [f"P-7K3QX_clock_{end}" for end in ("1", "2", "2_recovered", "3_recovered")]
    for name in (*own, "P-7K3QY_clock_1", "P-7K3QX", "session_1"):
        (tmp_path / "bags" / name).mkdir(parents=True)
    (tmp_path / "bags" / "P-7K3QX_notes").write_text("no bag")
    assert (answer("P-7K3QX").sessions, answer("P-7K3QX").message) == (3, "3 recorded")
    assert (answer("P-7K3QY").sessions, answer("P-7K3QZ").sessions) == (1, 0)
    refused = answer("Erika")
    assert not refused.success and "not a pseudonym" in refused.message
    assert "Erika" not in refused.message and refused.sessions == 0


@pytest.mark.parametrize("text", ["../x", "/tmp/x", "..", "a/b"])
def test_a_name_leads_nowhere_else(recorder, tmp_path, text):
    give(recorder, name=text)
    assert "no plain name" in recorder.health().message  # before anybody starts
    assert "no plain name" in called(recorder, "start")
    assert "no plain name" in called(recorder, "record", StartRecording, name=text)
    assert not (tmp_path / "x").exists() and not (tmp_path / "bags").exists()


def test_who_can_send_messages_does_not_choose_the_folder(recorder, tmp_path):
    (result,) = recorder.set_parameters([Parameter("folder", value=str(tmp_path / "else"))])
    assert not result.successful and "fixed once the node has started" in result.reason


def test_a_recorder_that_cannot_record_is_not_well(recorder, tmp_path):
    assert recorder.health().level == DiagnosticStatus.OK
    (tmp_path / "bags").write_text("")
    assert recorder.health().level == DiagnosticStatus.ERROR
    assert f"{tmp_path / 'bags'} is no folder" in recorder.health().message
    (tmp_path / "bags").unlink()
    assert recorder.health().level == DiagnosticStatus.OK


@pytest.mark.parametrize("pattern", ["*", "/screw/*"])
def test_a_pattern_names_no_topic(recorder, tmp_path, pattern):
    """Nothing is left of a recording that could not start."""
    give(recorder, name="bag")
    give(recorder, topics=[pattern])
    assert called(recorder, "start").startswith(f"topics: {pattern!r} is no topic name")
    assert not (tmp_path / "bags" / "bag").exists()


@pytest.mark.parametrize("recorder", [["-p", "record_on_start:=true"]], indirect=True, ids=["once"])
def test_nor_does_it_when_the_recording_begins_with_the_node(recorder):
    """The error of rclpy escaped there: the node did not become active."""
    recorder.trigger_deactivate()
    give(recorder, topics=["/screw/*"])
    recorder.trigger_activate()
    assert recorder.active and "'/screw/*' is no topic name" in recorder.health().message


@pytest.mark.parametrize(
    "recorder", [["-p", "record_on_start:=true", "-p", "name:=bag"]], indirect=True, ids=["at once"]
)
@pytest.mark.parametrize(
    ("obstacle", "sentence"), [("bag", "never overwritten"), ("file", "cannot make the bag")]
)
def test_what_hinders_the_recording_at_the_start_is_told(recorder, tmp_path, obstacle, sentence):
    assert recorder.health().level == DiagnosticStatus.OK
    recorder.trigger_deactivate()
    assert (tmp_path / "bags" / "bag" / "metadata.yaml").is_file()
    if obstacle == "file":
        shutil.rmtree(tmp_path / "bags")
        (tmp_path / "bags").write_text("")
    recorder.trigger_activate()
    assert recorder.health().level == DiagnosticStatus.ERROR
    assert sentence in recorder.health().message
    assert sentence in called(recorder, "start")
    assert called(recorder, "stop") == "not recording"


def test_full_disk_is_told_and_the_recorder_lives_on(recorder, wait_until):
    give(recorder, name="bag")
    give(recorder, storage__min_free_space=2**40)  # more than any disk has
    bag = Path(called(recorder, "start"))

    def is_told() -> bool:
        recorder.step()
        return recorder.health().level == DiagnosticStatus.ERROR

    wait_until(is_told, what="an error in the health")
    assert "left on the disk" in recorder.health().message
    assert recorder.health().values["recording"] is False, "though it lasts until it is stopped"
    assert information(bag)["custom_data"]["screw_module_ros/state"] == "closed"
    assert "never overwritten" in called(recorder, "start"), "the name is taken"


# How a topic that was named is taken, and which nodes have not told their parameters.

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE


def offer(reliability, durability):
    profile = QoSProfile(depth=1, reliability=reliability, durability=durability)
    return TopicEndpointInfo(qos_profile=profile)


@pytest.mark.parametrize(
    ("offers", "reliability", "durability"),
    [
        ([(RELIABLE, VOLATILE)], RELIABLE, VOLATILE),
        ([(RELIABLE, LATCHED), (RELIABLE, LATCHED)], RELIABLE, LATCHED),
        ([(RELIABLE, LATCHED), (RELIABLE, VOLATILE)], RELIABLE, VOLATILE),
        ([(RELIABLE, VOLATILE), (BEST_EFFORT, VOLATILE)], BEST_EFFORT, VOLATILE),
    ],
)
def test_request_is_as_strict_as_all_offers_allow(offers, reliability, durability):
    assert satisfying("/scan", [offer(*each) for each in offers]) == (reliability, durability)


def test_log_lines_of_the_last_session_are_left_out():
    """They name its bag, and so its patient."""
    assert satisfying("/rosout", [offer(RELIABLE, LATCHED)]) == (RELIABLE, VOLATILE)


def test_offer_in_rosbag2s_words():
    told = offer(BEST_EFFORT, LATCHED)
    told.qos_profile.deadline = told.qos_profile.lifespan = Infinite
    told.qos_profile.liveliness_lease_duration = Infinite
    found = offered_by(told)
    assert (found["reliability"], found["durability"]) == ("best_effort", "transient_local")
    assert found["deadline"] == found["lifespan"] == {"sec": 9223372036, "nsec": 854775807}


def test_messages_of_another_version_are_recorded_without_a_definition():
    """With the one that is installed here they would be decoded to garbage."""
    said = []
    log = SimpleNamespace(error=said.append)
    taps = SimpleNamespace(_node=SimpleNamespace(get_logger=lambda: log))
    tap = SimpleNamespace(name="/x", type="screw_module_msgs/msg/EncoderSample")
    told = offer(RELIABLE, VOLATILE)
    told.topic_type_hash = TypeHash(version=1, value=b"\1" * 32)
    topic = Taps._topic(taps, tap, [told])
    assert topic.definition == UNKNOWN and topic.type_hash == "RIHS01_" + "01" * 32
    assert "/x is recorded without a definition" in said[0] and "rebuild both" in said[0]


class Silent:
    """A graph in which no node answers; names: the nodes that are there."""

    get_namespace = Mock(return_value="/")
    get_fully_qualified_name = Mock(return_value="/session_recorder")
    create_client = destroy_client = Mock()

    def __init__(self, *names: str):
        self.names = names

    def get_service_names_and_types(self):
        types = ["rcl_interfaces/srv/GetParameters"]
        return [(f"{name}/get_parameters", types) for name in self.names]


@pytest.mark.parametrize(
    ("name", "noted"),
    [("/manus", {"/manus": NO_ANSWER}), ("/left/manus", {})],
    ids=["it stays and keeps silent", "of another robot"],
)
def test_a_node_that_does_not_answer(name, noted):
    parameters = NodeParameters(Silent(name))
    for _ in range(6):
        parameters.ask()
    assert parameters.values == noted


def test_a_script_that_is_run_again_and_again_is_not_noted():
    """Each run ends before it could answer; `verify` would call the bag incomplete."""
    parameters = NodeParameters(silent := Silent())
    for names in ([], *[["/my_script"], ["/my_script"], []] * 6):
        silent.names = names
        parameters.ask()
    assert parameters.values == {}
