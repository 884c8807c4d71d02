# SPDX-License-Identifier: Apache-2.0
"""The node `session_recorder` as a process of its own, against real publishers.

What it answers when it cannot begin is in test_recorder_start.py.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial

import pytest
import rclpy
import screw_module_msgs.msg as messages
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import Trigger

from screw_module_ros.recording.bag_files import information
from screw_module_ros.recording.decoded import calibrations, columns, topics
from screw_module_ros.recording.recorder import NO_ANSWER
from screw_module_ros.recording.records import notes
from screw_module_ros.recording.recover import recover
from screw_module_ros.recording.verify import verify

pytestmark = [pytest.mark.graph, pytest.mark.long]

BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
# Whoever comes late still gets everything: tests do not depend on who found whom first.
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RUN = "from screw_module_ros.nodes.session_recorder import main; raise SystemExit(main())"


class Graph:
    """A node of the test beside the recorder: publishes, calls services, hears `~/status`."""

    def __init__(self, wait_until):
        self.wait_until = wait_until
        self.processes: list[subprocess.Popen] = []
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("recorder_test", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.status = DiagnosticStatus()
        self.node.create_subscription(DiagnosticStatus, "/session_recorder/status", self._heard, 10)
        publisher = self.node.create_publisher
        self.encoder = publisher(messages.EncoderSample, "/screw/encoder", LATCHED)
        self.state = publisher(messages.AmplifierState, "/screw/amplifier_state", LATCHED)
        self.latched = publisher(String, "/latched", LATCHED)
        self.plain = publisher(String, "/plain", BEST_EFFORT)
        self.unnamed = publisher(String, "/unnamed", LATCHED)

    def _heard(self, status):
        self.status = status

    def until(self, predicate, what):
        def turn():
            ended = [process.args for process in self.processes if process.poll() is not None]
            assert not ended, f"the recorder ended while the test waited for {what}"
            self.executor.spin_once(timeout_sec=0.01)
            return predicate()

        self.wait_until(turn, 60.0, what)

    def values(self):
        return {value.key: value.value for value in self.status.values}

    def counts(self, topic) -> dict:
        """Return a topic's counts in the last status."""
        return json.loads(self.values().get(topic, "{}"))

    def until_recorded(self, topic, number):
        self.until(
            lambda: self.counts(topic).get("messages", 0) >= number,
            f"{number} of {topic} in status",
        )

    def call(self, name) -> Trigger.Response:
        """Call a service; a node that is not active yet is asked again."""
        client = self.node.create_client(Trigger, f"/session_recorder/{name}")
        self.until(client.service_is_ready, f"the service {name}")
        answers = []

        def answered():
            if not answers or (answers[-1].done() and "not active" in answers[-1].result().message):
                answers.append(client.call_async(Trigger.Request()))
            return answers[-1].done() and "not active" not in answers[-1].result().message

        self.until(answered, f"the answer of {name}")
        return answers[-1].result()

    def connected(self):
        self.until(
            lambda: all(
                p.get_subscription_count() for p in (self.encoder, self.state, self.latched)
            ),
            "the recorder's subscriptions",
        )

    def publish(self, sequences):
        for number in sequences:
            self.encoder.publish(messages.EncoderSample(sequence=number, count=2 * number))

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def graph(wait_until) -> Iterator[Graph]:
    graph = Graph(wait_until)
    yield graph
    graph.close()


@pytest.fixture
def recorder(tmp_path, graph):
    """Start the recorder with parameters; ended with SIGTERM, which it must answer with 0."""
    processes = graph.processes

    def start(**parameters) -> subprocess.Popen:
        named = "[plain, /latched]"
        given = {"folder": tmp_path, "name": "bag", "topics": named, **parameters}
        options = [text for key, value in given.items() for text in ("-p", f"{key}:={value}")]
        processes.append(subprocess.Popen([sys.executable, "-c", RUN, "--ros-args", *options]))
        return processes[-1]

    yield start
    for process in processes:
        if process.poll() is None:
            process.terminate()
            assert process.wait(60) == 0


def state(bag):
    return information(bag)["custom_data"]["screw_module_ros/state"]


def sequences(bag):
    return list(columns(bag, "/screw/encoder")["sequence"])


def test_start_record_stop(graph, recorder, tmp_path):
    (tmp_path / "params.yaml").write_text("x: 1")
    recorder(configuration=f"['{tmp_path}/params.yaml']")
    graph.latched.publish(String(data="before the recorder came"))
    answer = graph.call("start")
    assert (answer.success, answer.message) == (True, str(tmp_path / "bag"))
    graph.connected()
    graph.publish([*range(10), *range(12, 20)])
    graph.state.publish(messages.AmplifierState(calibration="line-cubic-line 1"))
    graph.until_recorded("/screw/encoder", 18)
    assert graph.counts("/screw/encoder")["lost"] == 2
    assert graph.status.level == DiagnosticStatus.OK
    assert not graph.call("start").success
    answer = graph.call("stop")
    assert answer.success
    assert "2 ticks lost, 0 not received, 0 not written" in answer.message

    bag = tmp_path / "bag"
    assert (sequences(bag), state(bag)) == ([*range(10), *range(12, 20)], "closed")
    assert list(columns(bag, "/latched")["data"]) == ["before the recorder came"]
    assert calibrations(bag) == {"/screw/amplifier_state": "line-cubic-line 1"}
    assert notes(bag)["configuration"][f"{tmp_path}/params.yaml"].startswith("sha256:")
    assert verify(bag).topics["/screw/encoder"].lost == 2
    assert {"/rosout", "/parameter_events"} <= set(topics(bag))
    assert "/unnamed" not in topics(bag)
    offer = (bag / "metadata.yaml").read_text().split("name: /plain")[1].split("message_count")[0]
    assert "reliability: best_effort" in offer
    assert "durability: volatile" in offer


def test_what_a_killed_recorder_flushed_is_recovered(graph, recorder, tmp_path, kill_9):
    process = recorder(record_on_start=True)
    graph.connected()
    graph.publish(range(40))
    graph.until(lambda: int(graph.values().get("messages", 0)) > 40, "40 samples on the disk")
    graph.until(
        lambda: "/recorder_test" in notes(tmp_path / "bag").get("parameters", {}),
        "the parameters on the disk",
    )
    kill_9(process.pid)
    process.wait()
    found = recover(tmp_path / "bag")
    assert (sequences(found.folder), state(found.folder)) == (list(range(40)), "recovered")
    assert "/recorder_test" in notes(found.folder)["parameters"]


def test_neither_log_nor_diagnostics_name_a_bag(graph, recorder, tmp_path):
    """Its name may be a patient's; `~/status` tells it to the session."""
    said = []
    for kind, topic in ((DiagnosticArray, "/diagnostics"), (Log, "/rosout")):
        graph.node.create_subscription(kind, topic, lambda each: said.append(str(each)), 100)
    (tmp_path / "P-7K3QX_old").mkdir()
    (tmp_path / "P-7K3QX_old" / "P-7K3QX_old_0.mcap").write_bytes(b"")
    recorder(name="P-7K3QX_clock")
    assert graph.call("start").success
    assert not graph.call("start").success
    graph.until(lambda: graph.values().get("bag", "").endswith("P-7K3QX_clock"), "its name")
    assert graph.call("stop").success
    assert not graph.call("start").success
    graph.until(lambda: any("diagn" in e and "never over" in e for e in said), "the refusal")
    graph.until(lambda: any("msg='recording'" in e for e in said), "a line of the log")
    assert not any("P-7K3QX" in each for each in said)


ODD = {
    # rclcpp, where one of the parameters has no value yet
    "/other": ([], '{"a": null, "b": null}'),
    "/odd": ([ParameterValue(type=77), ParameterValue()], NO_ANSWER),
}
"""Nodes that answer oddly: the values that they give, and what the bag holds of it."""


def test_parameters_of_every_node_are_noted(graph, recorder, tmp_path):
    """The recorder's own and those of the test's node, asked of each; `verify` finds them whole.

    SIGINT closes the bag. The recording ended as soon as a node that answers oddly was asked.
    """

    def names(request, response):
        response.result.names = ["a", "b"]
        return response

    def tell(values, request, response):
        response.values = values
        return response

    for name, (values, _) in ODD.items():
        graph.node.create_service(ListParameters, f"{name}/list_parameters", names)
        asked = partial(tell, values)
        graph.node.create_service(GetParameters, f"{name}/get_parameters", asked)
    bag, process = tmp_path / "bag", recorder(record_on_start=True)
    graph.connected()
    graph.publish(range(5))
    graph.until_recorded("/screw/encoder", 5)

    def noted():
        found = notes(bag).get("parameters", {})
        odd = all(found.get(name) == text for name, (_, text) in ODD.items())
        plain = (found.get(name, "") for name in ("/recorder_test", "/session_recorder"))
        return odd and all(text.startswith("{") for text in plain)

    graph.until(noted, "the parameters in the bag")
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 0
    assert (sequences(bag), state(bag)) == (list(range(5)), "closed")
    report = verify(bag)
    # How long the samples end before the recording is the machine's affair here.
    assert [each for each in report.problems if not each.startswith("/screw/encoder: begins")] == [
        "/odd: the node did not report its parameters"
    ]
    own = json.loads(report.notes["parameters"]["/session_recorder"])
    assert (own["name"], own["storage.flush_period"]) == ("bag", 0.8)
    assert json.loads(report.notes["parameters"]["/recorder_test"])["use_sim_time"] is False
