# SPDX-License-Identifier: Apache-2.0
"""The URDF's kinematics are those of the laws, and what is shown names only what there is."""

from __future__ import annotations

import importlib.util
import itertools
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from screw_module_msgs.msg import AmplifierState, PlanarState
from urdf_model import Model, mimicked, numbers, tensor, turned

from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import MANUS, PlanarArm, Screw, forward, inverse, jacobian
from screw_module_ros.nodes import robot_description as robot_description_module
from screw_module_ros.nodes.endpoint_state import (
    all_joints,
    carried,
    planar_joints,
    vertical_joint,
)
from screw_module_ros.nodes.robot_description import robot_description
from screw_module_ros.plant.planar import tip
from screw_module_ros.plant.settings import load_world
from screw_module_ros.resources import resource_path
from screw_module_ros.thesis import figure

ROOT = Path(__file__).resolve().parents[2]


def _topics() -> dict[str, tuple]:
    """Return the design's table of topics, which the test of the graph holds."""
    file = Path(__file__).with_name("test_graph.py")
    spec = importlib.util.spec_from_file_location("test_of_the_graph", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.TOPICS


TOPICS = _topics()
OTHER = PlanarArm(upper_arm=0.3, forearm=0.45, base_x=0.02, base_y=0.5, elbow="left")
angles = st.floats(-math.pi, math.pi)


@pytest.fixture(scope="module", params=[MANUS, OTHER], ids=["MANUS", "another arm"])
def arm_and_model(request):
    return request.param, Model(robot_description(request.param))


def joint_values(shoulder: float, elbow: float, height: float) -> dict[str, float]:
    """Return what joint_states has of absolute angles [rad] and a height [m]."""
    plane = PlanarState(homed=True, joint_position=[shoulder, elbow])
    driven = {**planar_joints(carried(plane, 0)), "vertical": (height, 0.0, 0.0)}
    return {name: joint[0] for name, joint in all_joints(driven, Screw()).items()}


@settings(max_examples=50)
@given(shoulder=angles, elbow=angles, height=st.floats(0.0, 0.36))
def test_the_handle_is_where_the_laws_have_it(arm_and_model, shoulder, elbow, height):
    """For the joint_states that absolute angles become; the handle keeps its directions."""
    arm, model = arm_and_model
    pose = model.pose("handle", joint_values(shoulder, elbow, height))
    assert pose[:3, 3] == pytest.approx([*forward(shoulder, elbow, arm), height], abs=1e-12)
    assert pose[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)


def test_over_the_workspace_urdf_laws_and_plant_have_one_handle():
    """From its corners to its centre; the loop of the five-bar is closed everywhere."""
    model, world = Model(robot_description()), load_world()
    width, depth = figure("workspace_width") / 2, figure("workspace_depth") / 2
    crank = -numbers(model.joints["coupler"].find("origin").get("xyz"))[0]
    assert crank > 0.05
    for x, y, z in itertools.product(
        np.linspace(-width, width, 7), np.linspace(-depth, depth, 7), (0.0, 0.13, 0.36)
    ):
        shoulder, elbow = inverse(x, y)
        values = joint_values(shoulder, elbow, z)
        handle = model.place("handle", values)
        assert handle == pytest.approx([x, y, z], abs=1e-12)
        assert handle[:2] == pytest.approx(tip(world.planar, shoulder, elbow), abs=1e-12)
        assert model.place("coupler", values, MANUS.upper_arm, 0.0, 0.0) == pytest.approx(
            model.place("forearm", values, -crank, 0.0, 0.0), abs=1e-12
        )
        screw, grip = model.place("screw", values), model.place("grip", values)
        assert grip == pytest.approx(handle, abs=1e-12)
        assert math.dist(screw[:2], handle[:2]) == pytest.approx(world.vertical.handle_offset)


def test_the_elbow_is_beyond_the_table_on_its_side_and_both_motors_stand():
    model = Model(robot_description())
    values = joint_values(*inverse(0.0, 0.0), 0.1)
    assert model.place("forearm", values)[0] > 0.3  # to the patient's right
    cylinders = [visual for visual in model.links["manus_base"].iter("visual")
                 if visual.find("material").get("name") == "motor"]  # fmt: skip
    places = [numbers(visual.find("origin").get("xyz"))[:2] for visual in cylinders]
    assert places == [[MANUS.base_x, MANUS.base_y]] * 2


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2])
def test_the_grip_is_locked_at_an_angle_and_the_handle_stays(angle):
    """It turns about the line from the screw to it (3.1.10)."""
    model = Model(robot_description(handle_angle=angle))
    values = joint_values(*inverse(0.05, 0.1), 0.2)
    grip, carriage = model.pose("grip", values), model.pose("carriage", values)
    assert grip[:3, 3] == pytest.approx([0.05, 0.1, 0.2], abs=1e-12)
    assert carriage[:3, :3].T @ grip[:3, :3] == pytest.approx(turned([1, 0, 0], angle), abs=1e-12)


def test_the_nut_rises_by_the_lead_when_the_screw_turns_once():
    """Clockwise, seen from the motor on top of it."""
    model = Model(robot_description())
    before, after = (joint_values(0.0, -1.0, z) for z in (0.1, 0.1 + Screw().lead / 4))
    moved = model.pose("screw", before)[:3, :3].T @ model.pose("screw", after)[:3, :3]
    assert moved == pytest.approx(turned([0, 0, -1], math.pi / 2), abs=1e-9)


CHANGED = {"module_mass": 6.5, "moving_mass": 1.3, "screw_mass": 0.5, "turning_mass": 3.9,
           "inertia": "inmotion2"}  # fmt: skip


@pytest.mark.parametrize("changed", [{}, CHANGED], ids=["as shipped", "another plant"])
def test_masses_and_inertias_are_the_plants(changed, tmp_path, monkeypatch):
    """Of arm, module and screw, over the workspace: the URDF owns none of them."""
    text = resource_path(robot_description_module.MASSES).read_text("utf-8")
    for key, value in changed.items():
        text, count = re.subn(rf"^(  {key}: +)\S+", rf"\g<1>{value}", text, flags=re.MULTILINE)
        assert count == 1
    file = tmp_path / "plant.yaml"
    file.write_text(text, encoding="utf-8")
    monkeypatch.setattr(robot_description_module, "MASSES", str(file))
    model, world = Model(robot_description()), load_world(file)
    planar, own = world.planar, world.planar.joint_inertia
    for x, y in itertools.product((-0.19, 0.0, 0.15), (-0.2, 0.0, 0.2)):
        shoulder, elbow = inverse(x, y)
        found = model.inertia(["shoulder", "elbow", "vertical"], joint_values(shoulder, elbow, 0.2))
        absolute = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        ways = np.reshape(jacobian(shoulder, elbow), (2, 2))
        wanted = np.zeros((3, 3))
        coupling = own.coupling * math.cos(elbow - shoulder)
        wanted[:2, :2] = [[own.shoulder, coupling], [coupling, own.elbow]]
        wanted[:2, :2] += planar.module_mass * ways.T @ ways
        wanted[2, 2] = world.vertical.moving_mass + world.vertical.turning_mass
        found = absolute.T @ found @ absolute
        assert found[2, :2] == pytest.approx(0.0, abs=0.02)  # the spinning screw's own moment
        found[:2, 2] = found[2, :2] = 0.0
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_each_inertia_is_one_that_a_body_can_have():
    """Positive, and no principal moment larger than the sum of the others."""
    model = Model(robot_description())
    masses = {}
    for name, link in model.links.items():
        if (inertial := link.find("inertial")) is not None:
            masses[name] = float(inertial.find("mass").get("value"))
            moments = sorted(np.linalg.eigvalsh(tensor(inertial)))
            assert masses[name] > 0.0 and moments[0] > 0.0
            assert moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9), name
    planar = load_world().planar
    of_module = ("module", "screw", "carriage", "handle_turn", "handle")
    assert sum(masses[name] for name in of_module) == pytest.approx(planar.module_mass)
    assert masses.keys() == model.links.keys() - {"manus_base", "grip"}  # these are fixed


def test_each_part_that_is_seen_collides_where_it_is_seen():
    model = Model(robot_description())

    def shapes(link, kind):
        return [(part.find("origin").attrib, [(shape.tag, shape.attrib)
                                              for shape in part.find("geometry")])
                for part in link.iter(kind)]  # fmt: skip

    for name, link in model.links.items():
        assert shapes(link, "visual") == shapes(link, "collision")
        assert (name == "handle_turn") == (not shapes(link, "visual")), name


def test_frames_joints_and_limits():
    model = Model(robot_description())
    assert {"manus_base", "upper_arm", "forearm", "module", "handle"} <= model.links.keys()
    free = {name for name, joint in model.joints.items()
            if joint.get("type") != "fixed" and joint.find("mimic") is None}  # fmt: skip
    assert free == {"shoulder", "elbow", "vertical"}
    plane, vertical = PlanarSettings(), VerticalSettings()
    for name, low, high in (("shoulder", plane.shoulder_low, plane.shoulder_high),
                            ("elbow", plane.between_low, plane.between_high),
                            ("vertical", vertical.travel_low, vertical.travel_high)):  # fmt: skip
        limit = model.joints[name].find("limit")
        assert (float(limit.get("lower")), float(limit.get("upper"))) == (low, high)


def test_joint_states_has_each_joint_of_the_urdf_with_what_it_mimics():
    model = Model(robot_description())
    moving = {name: joint for name, joint in model.joints.items() if joint.get("type") != "fixed"}
    driven = {"shoulder": (0.1, 1.0, 2.0), "elbow": (0.2, 3.0, 4.0), "vertical": (0.3, 5.0, 6.0)}
    shown = all_joints(driven, Screw())
    assert shown.keys() == moving.keys()
    for name, (angle, speed, effort) in shown.items():
        of, times = mimicked(moving[name])
        assert (angle, speed) == pytest.approx((times * driven[of][0], times * driven[of][1]))
        assert effort == (driven[of][2] if of == name else 0.0)
    assert all_joints({"vertical": driven["vertical"]}, Screw()).keys() == {"vertical", "screw"}
    assert all_joints({}, Screw()) == {}


def test_for_mujoco_it_has_the_parts_of_the_urdf_and_the_plant_s_masses():
    """What its motion is: test/plant/test_mujoco_model.py, where MuJoCo is installed."""
    text = robot_description(shape=robot_description_module.SHAPE_MUJOCO)
    bodies = {body.get("name"): body for body in ElementTree.fromstring(text).iter("body")}
    urdf = Model(robot_description())
    assert bodies.keys() == urdf.links.keys() - {"manus_base", "handle_turn", "handle"}
    for name, body in bodies.items():
        if name == "grip":
            continue  # its mass is the carriage's
        parts = (name, "handle_turn", "handle") if name == "carriage" else (name,)
        mass = sum(float(urdf.links[each].find("inertial/mass").get("value")) for each in parts)
        assert float(body.find("inertial").get("mass")) == pytest.approx(mass)
        assert len(body.findall("geom")) == len(urdf.links[name].findall("visual"))


def test_two_robots_share_a_tf_by_a_prefix_of_their_links():
    plain, left = Model(robot_description()), Model(robot_description(prefix="left_"))
    assert left.links.keys() == {f"left_{name}" for name in plain.links}
    assert left.joints.keys() == plain.joints.keys()
    values = joint_values(-0.5, -2.0, 0.1)
    assert left.pose("left_handle", values) == pytest.approx(plain.pose("handle", values))


@settings(max_examples=50)
@given(angles, angles, st.floats(-20, 20), st.floats(-20, 20), st.floats(-5, 5), st.floats(-5, 5))
def test_effort_times_speed_is_the_motors_power(shoulder, elbow, first, second, fast, slow):
    """In the URDF's joints as in the motors' own."""
    plane = PlanarState(homed=True, joint_position=[shoulder, elbow],
                        joint_velocity=[fast, slow], measured_torque=[first, second])  # fmt: skip
    power = sum(speed * effort for _, speed, effort in planar_joints(carried(plane, 0)).values())
    assert power == pytest.approx(first * fast + second * slow, abs=1e-9)


def test_the_force_of_a_joint_torque_is_the_laws():
    """J^T F in absolute angles, seen through the URDF's joints, still presses with F."""
    xs, xe, ys, ye = jacobian(0.4, 1.9)
    fx, fy = 12.0, -7.0
    plane = PlanarState(homed=True, joint_position=[0.4, 1.9],
                        measured_torque=[xs * fx + ys * fy, xe * fx + ye * fy])  # fmt: skip
    joints = planar_joints(carried(plane, 0))
    # With the elbow held, the shoulder's torque is the force's moment about the base.
    x, y = forward(0.4, 1.9)
    moment = (x - MANUS.base_x) * fy - (y - MANUS.base_y) * fx
    assert joints["shoulder"][2] == pytest.approx(moment)


def test_the_vertical_effort_is_a_force():
    encoder = SimpleNamespace(homed=True, position=0.2, velocity=0.01)
    drive = AmplifierState(measured_torque=0.42)
    (joint,) = vertical_joint(encoder, drive, Screw()).values()
    assert joint == pytest.approx((0.2, 0.01, 138.5), abs=0.05)  # thesis 3.1.6


def test_what_is_not_homed_is_left_out():
    assert planar_joints(carried(None, 0)) == planar_joints(carried(PlanarState(), 0)) == {}
    assert vertical_joint(None, None, Screw()) == {}
    encoder = SimpleNamespace(homed=False, position=0.2, velocity=0.0)
    assert vertical_joint(encoder, AmplifierState(), Screw()) == {}


def message_field(topic: str, path: str) -> None:
    """Look a field up; raise AttributeError or KeyError where there is none."""
    package, _, name = TOPICS[topic][0].split("/")
    value = getattr(importlib.import_module(f"{package}.msg"), name)()
    for part in re.split(r"[./]", re.sub(r"\[\d+\]", "", path)):
        value = getattr(value, part)


def test_the_foxglove_layout_names_what_there_is():
    layout = json.loads((ROOT / "docs/foxglove_layout.json").read_text())
    paths = [path["value"] for panel in layout["configById"].values()
             for path in panel.get("paths", ())]  # fmt: skip
    assert len(paths) > 8
    for path in paths:
        topic, _, field = path.partition(".")
        message_field(topic, field)
    shown = re.findall(r'"([A-Za-z0-9]+![a-z]+)"', json.dumps(layout["layout"]))
    assert sorted(shown) == sorted(layout["configById"])


def test_the_plotjuggler_layout_names_what_there_is():
    root = ElementTree.parse(ROOT / "docs/plotjuggler_layout.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert len(curves) > 8
    for curve in curves:
        topic = next(topic for topic in TOPICS if curve.startswith(f"{topic}/"))
        message_field(topic, curve.removeprefix(f"{topic}/"))


def test_the_rviz_configuration_names_what_there_is():
    content = yaml.safe_load((ROOT / "rviz/therapy_robot.rviz").read_text())
    manager = content["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "manus_base"
    topics = {display["Topic"]["Value"] for display in manager["Displays"] if "Topic" in display}
    assert topics and all(f"/{topic}" in TOPICS for topic in topics)


def test_the_rviz_configuration_of_two_robots_has_the_frames_of_their_prefixes():
    content = yaml.safe_load((ROOT / "rviz/two_robots.rviz").read_text())["Visualization Manager"]
    models = [display["Description Topic"]["Value"] for display in content["Displays"]]
    assert models == ["/left/robot_description", "/right/robot_description"]
    fixed = content["Global Options"]["Fixed Frame"]
    assert fixed in Model(robot_description(prefix="left_")).links
