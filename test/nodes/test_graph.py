# SPDX-License-Identifier: Apache-2.0
"""The whole graph against the rig, as separate processes and in one.

Topics, services, enabling, the module's calibration: nobody outside may see a difference between
the two. What only one arrangement has, `module` among them, stands at the end. How they stop: the
rows in test/faults.
"""

from __future__ import annotations

import importlib
import json
import os
import random
import subprocess
import threading

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from policy_profiles import CLOCK, NODES, all_seen, policy
from rclpy.qos import ReliabilityPolicy
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    ForceCommand,
    ImpedanceState,
    PlanarState,
    SafetyState,
)

import harass
from screw_module_ros.graph import (
    BESIDE,
    ENCODER_DECIMATED,
    FORCE_DECIMATED,
    GRAPH,
    MODULE,
    WHOLE,
    table,
)
from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.nodes.support import topics
from screw_module_ros.operator.robot import Robot, RobotError, arm
from screw_module_ros.recording.decoded import calibrations
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
HOME = 0.25
HARASSED_S = 2.0
SEPARATE = pytest.mark.parametrize("run", [None], ids=["separate"], indirect=True)
COMPOSED = pytest.mark.parametrize("run", [MODULE], ids=["composed"], indirect=True)

# Topic -> type, publisher, reliability, written out again.
TOPICS = {
    "/screw/encoder": ("screw_module_msgs/msg/EncoderSample", "encoder", BEST_EFFORT),
    "/handle/force": ("screw_module_msgs/msg/ForceSample", "force_sensor", BEST_EFFORT),
    "/screw/encoder/decimated": ("screw_module_msgs/msg/EncoderSample", "encoder", RELIABLE),
    "/handle/force/decimated": ("screw_module_msgs/msg/ForceSample", "force_sensor", RELIABLE),
    "/handle/wrench": ("geometry_msgs/msg/WrenchStamped", "force_sensor", RELIABLE),
    "/screw/force_command": (
        "screw_module_msgs/msg/ForceCommand", "impedance_controller", RELIABLE),
    "/screw/controller_state": (
        "screw_module_msgs/msg/ImpedanceState", "impedance_controller", RELIABLE),
    "/screw/amplifier_state": ("screw_module_msgs/msg/AmplifierState", "amplifier", RELIABLE),
    "/manus/state": ("screw_module_msgs/msg/PlanarState", "manus", RELIABLE),
    "/endpoint_state": ("screw_module_msgs/msg/EndpointState", "endpoint_state", RELIABLE),
    "/joint_states": ("sensor_msgs/msg/JointState", "endpoint_state", RELIABLE),
    "/safety_state": ("screw_module_msgs/msg/SafetyState", "supervisor", RELIABLE),
    "/sim/truth": ("screw_module_msgs/msg/SimTruth", "sim_rig", RELIABLE),
    "/session_recorder/status": (
        "diagnostic_msgs/msg/DiagnosticStatus", "session_recorder", RELIABLE),
}  # fmt: skip

SERVICES = {
    "/encoder/home": "std_srvs/srv/Trigger",
    "/force_sensor/tare": "std_srvs/srv/Trigger",
    "/force_sensor/untare": "std_srvs/srv/Trigger",
    "/impedance_controller/set_impedance": "screw_module_msgs/srv/SetImpedance",
    "/impedance_controller/set_mode": "screw_module_msgs/srv/SetControlMode",
    "/amplifier/enable": "std_srvs/srv/SetBool",
    "/amplifier/clear_fault": "std_srvs/srv/Trigger",
    "/manus/enable": "std_srvs/srv/SetBool",
    "/manus/clear_fault": "std_srvs/srv/Trigger",
    "/manus/home": "std_srvs/srv/Trigger",
    "/manus/set_impedance": "screw_module_msgs/srv/SetImpedance",
    "/supervisor/estop": "std_srvs/srv/Trigger",
    "/supervisor/reset": "std_srvs/srv/Trigger",
    "/supervisor/lock_vertical": "std_srvs/srv/SetBool",
    "/session_recorder/count": "screw_module_msgs/srv/CountSessions",
    "/session_recorder/record": "screw_module_msgs/srv/StartRecording",
    "/session_recorder/start": "std_srvs/srv/Trigger",
    "/session_recorder/stop": "std_srvs/srv/Trigger",
    "/sim_rig/set_arm": "screw_module_msgs/srv/SetArm",
    "/sim_rig/inject_fault": "screw_module_msgs/srv/InjectFault",
    "/sim_rig/set_fixture": "screw_module_msgs/srv/SetFixture",
}


@pytest.fixture(scope="module", params=[None, WHOLE], ids=["separate", "one"])
def run(request, tmp_path_factory, calibration):
    """Return the running graph; it must end in order, also while both torques are on."""
    folder = tmp_path_factory.mktemp("bags")
    extra = ["-p", f"session_recorder:folder:={folder}"]
    for name in ("impedance_controller", "amplifier"):
        extra += ["-p", f"{name}:calibration_file:={calibration.path}"]
    with GraphRun(extra=extra, shared=request.param) as graph:
        yield graph
        codes = graph.stop()
    started = [entry.executable for entry in table(request.param)]
    assert codes == dict.fromkeys(reversed(started), 0)


@pytest.fixture(scope="module")
def robot(run):
    """Return an operator of the graph whose nodes are all active."""
    with Robot("tester", watch=run.watch, simulated=True) as operator:
        run.wait_until_ready(operator)
        operator.clear_faults()
        operator.home()
        yield operator
        operator.clear_faults()
        operator.permit()
        operator.enable()
        operator.enable_plane()


@pytest.fixture
def ready(robot):
    """Return the operator with the robot unloaded, permitted and not enabled."""
    robot.set_arm(arm(kind="active", target=(0.0, 0.0, HOME), duration=0.3))
    robot.set_setpoint(0.0, 0.0, HOME)
    for enable in (robot.enable, robot.enable_plane):
        enable(False)
    robot.clear_faults()
    robot.permit()
    return robot


def message_class(kind: str) -> type:
    """Return the class of a type like `std_msgs/msg/Header`."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


class Collector:
    """Counts what arrives on every topic of the table."""

    def __init__(self, robot: Robot):
        self.counts = dict.fromkeys([*TOPICS, "/diagnostics"], 0)
        self.alarmed: set[str] = set()
        self._lock = threading.Lock()
        for topic, (kind, _, reliability) in TOPICS.items():
            quality = 10 if reliability is RELIABLE else topics.SAMPLE
            robot.node.create_subscription(
                message_class(kind), topic, lambda _, t=topic: self._note(t), quality
            )
        robot.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnose, 50)

    def _note(self, topic: str) -> None:
        with self._lock:
            self.counts[topic] += 1

    def _diagnose(self, array: DiagnosticArray) -> None:
        self._note("/diagnostics")
        self.alarmed |= {status.name for status in array.status}


def test_every_topic_is_alive(robot):
    """Each topic of the design: one publisher, the right node, type and reliability, messages."""
    collector = Collector(robot)
    robot.wait_until(
        lambda: all(count >= 2 for count in collector.counts.values()),
        30.0,
        "some topics are silent",
    )
    for topic, (kind, node, reliability) in TOPICS.items():
        (publisher,) = robot.node.get_publishers_info_by_topic(topic)
        assert (publisher.node_name, publisher.topic_type) == (node, kind)
        assert publisher.qos_profile.reliability == reliability, topic
    names = {entry.executable for entry in GRAPH}
    robot.wait_until(lambda: names <= collector.alarmed, 20.0, "a node gives no diagnostics")


def test_every_service_is_there(robot):
    """Each service of the design, with its type."""
    robot.wait_until(
        lambda: set(SERVICES) <= {name for name, _ in robot.node.get_service_names_and_types()},
        20.0,
        "services are missing",
    )
    offered = dict(robot.node.get_service_names_and_types())
    for name, kind in SERVICES.items():
        assert offered[name] == [kind], name


def test_enable_move_and_disable(ready):
    """After homing, taring and enabling the robot pulls the hand towards the set point."""
    ready.tare()
    ready.set_mode(ForceCommand.IMPEDANCE)
    ready.set_impedance(400.0, 0.0)
    ready.set_arm(arm(kind="relaxed"))
    ready.enable()
    ready.enable_plane()
    for change in ("tare", "untare"):
        with pytest.raises(RobotError, match="enabled and would jump"):
            ready.trigger(f"force_sensor/{change}")
    ready.set_setpoint(0.05, 0.0, HOME + 0.06)
    ready.wait_until(
        lambda: abs(ready.newest(PlanarState).position[0] - 0.05) < 0.03,
        20.0,
        "no way in the plane",
    )
    ready.wait_until(
        lambda: ready.newest(ImpedanceState).position > HOME + 0.02,
        20.0,
        "the handle did not rise",
    )
    assert ready.newest(AmplifierState).lost == 0
    ready.enable(False)
    assert ready.newest(AmplifierState).commanded_torque == 0.0


def test_the_calibration_is_shown_and_in_every_bag(robot, calibration):
    """What a bag says of the module must be what was in force."""
    shown: dict[str, dict[str, str]] = {}

    def hear(array: DiagnosticArray) -> None:
        for status in array.status:
            shown[status.name] = {value.key: value.value for value in status.values}

    robot.node.create_subscription(DiagnosticArray, "/diagnostics", hear, 50)
    bag = robot.start_recording()
    states = ("screw/controller_state", "screw/amplifier_state")
    loaded_by = ("impedance_controller", "amplifier")

    def is_recorded_and_shown() -> bool:
        counts = shown.get("session_recorder", {})
        recorded = all(json.loads(counts.get(f"/{t}", "{}")).get("messages", 0) for t in states)
        return recorded and shown.keys() >= {*loaded_by}

    robot.wait_until(is_recorded_and_shown, 20.0, "not recorded, or not shown")
    robot.stop_recording()
    assert calibrations(bag) == {f"/{topic}": calibration.identity for topic in states}
    for node in loaded_by:
        assert shown[node]["calibration"] == calibration.identity


def profiles_seen(robot, found) -> dict:
    """Return the profiles of the running nodes, and of those beside them."""
    simulated = ["--ros-args", "-p", "use_sim_time:=true"]
    of_any_port = {"web_bridge": ["-p", "port:=0"]}
    ours = [bringup.Process(name, [*simulated, *of_any_port.get(name, [])]) for name in BESIDE]
    seen: dict = {}
    try:
        robot.wait_until_ready(BESIDE)
        robot.met(lambda: all_seen(robot.node, found, seen), 20.0)
    finally:
        bringup.stop(ours)
    return seen


@SEPARATE
def test_the_policy_is_the_running_graph(robot):
    """What each node publishes, hears, offers and runs, name by name.

    What the recorder hears and asks is what there is.
    """
    found = policy()
    seen = profiles_seen(robot, found)
    for name in (*NODES, "therapy_session", "web_bridge"):
        allowed, has = found[name][name], seen[name]
        assert allowed.publish == has.publish, name
        assert allowed.reply == has.reply, name
        if name != "session_recorder":
            assert allowed.subscribe - {CLOCK} == has.subscribe - {CLOCK}, name
            assert allowed.request == has.request, name
    idle, allowed = seen["characterize"], found["characterize"]["characterize"]
    assert (allowed.publish, allowed.subscribe - {CLOCK}, allowed.reply, allowed.execute) == (
        idle.publish, idle.subscribe - {CLOCK}, idle.reply, idle.execute
    )  # fmt: skip
    published = frozenset().union(*(profile.publish for profile in seen.values()), {"/setpoint"})
    slow = {f"/{name}" for name in (ENCODER_DECIMATED, FORCE_DECIMATED)}  # never recorded
    recorder = found["session_recorder"]["session_recorder"]
    states = {name for name in published if name.endswith("/transition_event")}
    assert recorder.subscribe == published - slow - states
    asked = {f"/{name}/{service}" for name in (*NODES, *BESIDE) if name != "session_recorder"
             for service in ("get_parameters", "list_parameters")}  # fmt: skip
    assert recorder.request == asked


def test_a_second_copy_is_refused(run):
    """Two encoder nodes in one domain: the second ends with a sentence."""
    done = subprocess.run(
        [executable_path("encoder")], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert "already runs in ROS domain" in done.stderr


@SEPARATE
def test_every_tick_is_answered_beside_busy_loops_and_stopped_processes(ready):
    """Two busy loops beside the graph, and processes stopped at random: slower, never wrong."""
    ready.set_mode(ForceCommand.FORCE_FEEDBACK)
    ready.enable()
    ready.enable_plane()
    before, lost = ready.newest(AmplifierState), ready.newest(PlanarState).lost
    with harass.harassing(os.getpid(), 2, 0.25, random.Random(1)) as stops:
        ready.pause(HARASSED_S)
        after = ready.newest(AmplifierState)
        assert stops, "nobody was stopped"
    ready.check_enabled()
    assert after.commands - before.commands == pytest.approx(1000 * HARASSED_S, abs=20)
    assert (after.late, after.lost) == (before.late, before.lost)
    assert ready.newest(PlanarState).lost == lost


@COMPOSED
def test_a_rate_of_its_own_is_refused(robot):
    """One loop drives the parts: a rate cannot be changed for one of them."""
    with pytest.raises(RobotError, match="common to the nodes"):
        robot.set_parameter("encoder", "rate", 100.0)


@COMPOSED
def test_somebody_else_may_command_while_the_controller_is_off(ready):
    """As `characterize` does: without a controller here the amplifier listens to the topic."""
    samples: list[EncoderSample] = []
    ready.node.create_subscription(EncoderSample, "screw/encoder", samples.append, topics.SAMPLE)
    change(ready, Transition.TRANSITION_DEACTIVATE)
    change(ready, Transition.TRANSITION_CLEANUP)
    publisher = ready.node.create_publisher(ForceCommand, "screw/force_command", topics.COMMAND)
    try:
        ready.wait_until(lambda: hears(ready, "amplifier"), 10.0, "the amplifier does not hear it")
        before = ready.newest(AmplifierState).commands

        def heard() -> bool:
            sample = samples[-1]
            publisher.publish(
                ForceCommand(
                    sequence=sample.sequence, monotonic_ns=sample.monotonic_ns, force=12.5
                )
            )
            state = ready.newest(AmplifierState)
            return state.commands >= before + 20 and state.commanded_force == 12.5

        ready.wait_until(heard, 20.0, "the amplifier does not act upon the topic")
    finally:
        ready.node.destroy_publisher(publisher)
        change(ready, Transition.TRANSITION_CONFIGURE)
        change(ready, Transition.TRANSITION_ACTIVATE)
    wait_until_heard_again(ready)
    ready.clear_faults()
    ready.permit()
    ready.enable()


def hears(robot: Robot, name: str) -> bool:
    """Return whether a node subscribes to the commands."""
    found = robot.node.get_subscriptions_info_by_topic("/screw/force_command")
    return name in {subscriber.node_name for subscriber in found}


def wait_until_heard_again(robot: Robot) -> None:
    """Wait for a state of the controller, and then for a permission given after it."""
    newest = {ImpedanceState: 0, SafetyState: 0}

    def newer(kind: type, than: int) -> bool:
        state = robot.state(kind)
        if state is not None:
            newest[kind] = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
        return newest[kind] > than

    begun = robot.clock.stamp_ns()
    robot.wait_until(lambda: newer(ImpedanceState, begun), 10.0, "the controller is silent")
    heard = newest[ImpedanceState] + 100_000_000
    robot.wait_until(lambda: newer(SafetyState, heard), 10.0, "the supervisor is silent")


def change(robot: Robot, transition: int) -> None:
    """Take the controller one lifecycle step."""
    request = ChangeState.Request(transition=Transition(id=transition))
    robot.wait_until(
        lambda: robot.call(ChangeState, "impedance_controller/change_state", request).success,
        10.0,
        "the controller stays as it is",
    )
