# SPDX-License-Identifier: Apache-2.0
"""Controller and amplifier with a module's calibration: taken, shown, recorded, or refused."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from screw_module_msgs.msg import AmplifierState, ImpedanceState

from screw_module_ros.calibration.module import (
    ModuleCalibration,
    SensorBias,
    thesis_friction,
    write_calibration,
)
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.vertical_settings import KNOWN_SHARE
from screw_module_ros.nodes.support.answering import Done
from screw_module_ros.operator.robot import Robot
from screw_module_ros.recording.decoded import calibrations, columns
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

NODES = ("impedance_controller", "amplifier")
SERIAL = "SIM-0001"  # that of params/sim.yaml
GRAVITY = 9.25


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    """Return the path of a calibration and its identity."""
    path = tmp_path_factory.mktemp("calibration") / "sim_module.yaml"
    friction = thesis_friction()
    written = write_calibration(
        path,
        ModuleCalibration(
            serial=SERIAL,
            date="2001-05-11T09:30:00Z",
            software="0.1.0",
            friction=friction._replace(phase_rad=0.4),
            linearization=default_linearization(0.02),
            gravity_N=GRAVITY,
            mass_kg=5.5,
            sensor_bias=SensorBias((0.0,) * 3, (0.0,) * 3),
            residuals={"friction_rms_N": 0.8},
        ),
    )
    return SimpleNamespace(path=path, written=written, identity=written.identity(path))


def given(path, serial=SERIAL, **others) -> list[str]:
    """Return --ros-args that name a calibration."""
    named = {"calibration_file": path, "module_serial": serial, **others}
    return [word for key, value in named.items() for word in ("-p", f"{key}:={value}")]


def refusal(node) -> str:
    """Configure a node that must refuse; return the sentence in its diagnostics."""
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    heard = []
    node._diagnostics = SimpleNamespace(publish=heard.append)
    node.publish_health()
    (status,) = heard[0].status
    assert status.level == DiagnosticStatus.ERROR
    return status.message


@pytest.mark.parametrize("name", NODES)
def test_a_foreign_calibration_is_refused(make_node, calibration, name):
    told = refusal(make_node(name, *given(calibration.path, "SIM-0002")))
    assert told.startswith(str(calibration.path))
    assert "'SIM-0001'" in told and "'SIM-0002'" in told


@pytest.mark.parametrize("name", NODES)
def test_a_calibration_for_an_unknown_module_is_refused(make_node, calibration, name):
    told = refusal(make_node(name, "-p", f"calibration_file:={calibration.path}"))
    assert "set module_serial" in told


@pytest.mark.parametrize("name", NODES)
def test_a_changed_calibration_is_refused(make_node, calibration, tmp_path, name):
    path = tmp_path / "changed.yaml"
    path.write_text(calibration.path.read_text().replace("phase_rad: 0.4", "phase_rad: 0.5"))
    told = refusal(make_node(name, *given(path)))
    assert str(path) in told and "was changed after it was written" in told
    assert "identify the module anew" in told


@pytest.mark.parametrize(
    ("name", "other"),
    [("impedance_controller", "friction_file"), ("amplifier", "linearization_file")],
)
def test_a_file_for_a_part_beside_it_is_refused(make_node, calibration, name, other):
    told = refusal(make_node(name, *given(calibration.path, **{other: "own.yaml"})))
    assert other in told and "own.yaml" in told and "calibration_file" in told


def test_an_unused_calibration_is_checked_too(make_node, calibration):
    told = refusal(make_node("amplifier", *given(calibration.path, "other", linearize=False)))
    assert "this is module 'other'" in told


def test_refused_and_put_right_the_controller_takes_it(make_node, calibration):
    node = make_node("impedance_controller", *given(calibration.path, "SIM-0002", gravity=12.5))
    refusal(node)
    assert node.get_parameter("gravity").value == 12.5
    node.set_parameters([Parameter("module_serial", value=SERIAL)])
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node._friction.model == calibration.written.friction
    assert node._state_message.calibration == calibration.identity
    assert node.get_parameter("gravity").value == GRAVITY
    node.trigger_activate()
    assert node.part.settings.gravity == GRAVITY
    assert node.part.settings.observer_inertia == KNOWN_SHARE
    node.close()


def test_gravity_set_by_hand_is_told_with_the_identity(make_node, calibration):
    """What a bag says of the calibration must be what was in force."""
    node = make_node("impedance_controller", *given(calibration.path))
    node.trigger_configure()
    assert not node.parameters.write(gravity=8.0)
    assert node._state_message.calibration == f"{calibration.identity}, gravity 8 N by hand"
    node.trigger_activate()
    assert node.part.settings.gravity == 8.0
    assert not node.parameters.write(gravity=GRAVITY)
    assert node._state_message.calibration == calibration.identity
    node.close()


def test_a_mass_set_by_hand_is_told_and_not_carried(make_node, calibration):
    """OBSERVER carried 0.7 of any mass that somebody set, and with 9 kg left less than none."""
    node = make_node("impedance_controller", *given(calibration.path))
    node.trigger_configure()
    node.trigger_activate()
    assert not node.parameters.write(mass=9.0)
    law = node.part.settings
    assert law.mass == 9.0
    assert law.observer_inertia * law.mass == pytest.approx(KNOWN_SHARE * 5.5)
    assert node._state_message.calibration == f"{calibration.identity}, mass 9 kg by hand"
    node.trigger_deactivate()
    node.trigger_activate()
    assert node.part.settings == law
    assert not node.parameters.write(mass=5.5)
    assert node.part.settings.observer_inertia == KNOWN_SHARE
    assert node._state_message.calibration == calibration.identity
    node.close()


@pytest.mark.parametrize("by_hand", [False, True])
def test_the_next_module_does_not_inherit_it(make_node, calibration, by_hand):
    """Cleaned up and configured without a file: weight, mass and carried share are the old ones.

    A mass is carried only where it was measured. What the operator set since then stays.
    """
    names = ("gravity", "mass", "observer_inertia")
    node = make_node("impedance_controller", *given(calibration.path, gravity=12.5, mass=4.0))
    node.trigger_configure()
    assert [node.get_parameter(name).value for name in names] == [GRAVITY, 5.5, KNOWN_SHARE]
    if by_hand:
        assert not node.parameters.write(gravity=8.0)
    node.trigger_cleanup()
    node.set_parameters([Parameter("calibration_file", value="")])
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    wanted = [8.0 if by_hand else 12.5, 4.0, 0.0]
    assert [node.get_parameter(name).value for name in names] == wanted
    node.close()


# The graph -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def graph(tmp_path_factory, calibration):
    """Return the running rig, controller, amplifier and recorder, with the calibration."""
    extra = ["-p", f"session_recorder:folder:={tmp_path_factory.mktemp('bags')}"]
    for name in NODES:
        extra += ["-p", f"{name}:calibration_file:={calibration.path}"]
    with GraphRun(only=["sim_rig", *NODES, "session_recorder"], extra=extra) as run:
        yield run
        codes = run.stop()
    assert set(codes.values()) == {0}


@pytest.fixture(scope="module")
def robot(graph):
    with Robot("tester", watch=graph.watch, simulated=True) as operator:
        graph.wait_until_ready(operator)
        yield operator


@pytest.fixture(scope="module")
def shown(robot):
    """Return the newest diagnostics of each node: its values by key."""
    heard = {}

    def hear(array: DiagnosticArray) -> None:
        for status in array.status:
            heard[status.name] = {value.key: value.value for value in status.values}

    robot.node.create_subscription(DiagnosticArray, "/diagnostics", hear, 50)
    return heard


def test_both_nodes_show_it(robot, shown, calibration):
    """In their states and in their diagnostics."""
    for kind in (ImpedanceState, AmplifierState):
        robot.wait_until(lambda kind=kind: robot.state(kind) is not None, 20.0, "no state")
        assert robot.newest(kind).calibration == calibration.identity
    robot.wait_until(
        lambda: all(shown.get(n, {}).get("calibration") == calibration.identity for n in NODES),
        20.0,
        "not in the diagnostics",
    )


def test_every_bag_holds_it(robot, shown, calibration):
    """In each message; `session info` shows the last one."""
    topics = {"/screw/controller_state", "/screw/amplifier_state"}

    def recorded(topic: str) -> int:
        counts = shown.get("session_recorder", {}).get(topic, "{}")
        return json.loads(counts).get("messages", 0)

    bag = robot.start_recording()
    robot.wait_until(lambda: all(map(recorded, topics)), 20.0, "not recorded")
    robot.stop_recording()
    assert calibrations(bag) == dict.fromkeys(topics, calibration.identity)
    for topic in topics:
        assert set(columns(bag, topic)["calibration"]) == {calibration.identity}


def test_a_bag_of_less_than_a_second_holds_it_too(make_node, tmp_path, wait_until, calibration):
    """No timer runs here: the topic is found when it is heard."""
    given = {"folder": tmp_path, "topics": "[/told_once/state]"}
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    node = make_node("session_recorder", *words)
    publisher = node.create_publisher(AmplifierState, "/told_once/state", 1)
    node.trigger_configure()
    node.trigger_activate()
    assert isinstance(node._on_start("bag"), Done)

    def recorded() -> int:
        publisher.publish(AmplifierState(calibration=calibration.identity))
        node._taps.look()
        node.step()
        status = node._taps.recording.status()
        return status.messages + status.waiting

    wait_until(recorded, what="a message in the recorder")
    node.close()
    assert calibrations(tmp_path / "bag") == {"/told_once/state": calibration.identity}
