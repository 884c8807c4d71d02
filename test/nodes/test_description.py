# SPDX-License-Identifier: Apache-2.0
"""The URDF's kinematics are those of the laws, and what is shown names only what there is."""

from __future__ import annotations

import importlib.util
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

from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import MANUS, PlanarArm, Screw, forward, jacobian
from screw_module_ros.nodes.endpoint_state import carried, planar_joints, vertical_joint
from screw_module_ros.nodes.robot_description import robot_description

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


class Model:
    """Forward kinematics by the URDF's own words (wiki.ros.org/urdf/XML)."""

    def __init__(self, text: str):
        root = ElementTree.fromstring(text)
        self.links = {link.get("name") for link in root.iter("link")}
        self.joints = {joint.get("name"): joint for joint in root.iter("joint")}
        self._above = {joint.find("child").get("link"): joint for joint in self.joints.values()}

    def pose(self, link: str, values: dict[str, float]) -> np.ndarray:
        """Return the 4 x 4 pose of a link in the root's frame for joint values."""
        pose = np.eye(4)
        while link in self._above:
            joint = self._above[link]
            pose = _origin(joint) @ _moved(joint, _value(joint, values)) @ pose
            link = joint.find("parent").get("link")
        assert link == "manus_base"
        return pose


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def _origin(joint) -> np.ndarray:
    pose, origin = np.eye(4), joint.find("origin")
    if origin is not None:
        assert origin.get("rpy") is None
        pose[:3, 3] = _numbers(origin.get("xyz"))
    return pose


def _value(joint, values: dict[str, float]) -> float:
    mimic = joint.find("mimic")
    if mimic is None:
        return values.get(joint.get("name"), 0.0)
    return float(mimic.get("multiplier", 1)) * values[mimic.get("joint")]


def _moved(joint, value: float) -> np.ndarray:
    pose = np.eye(4)
    if joint.get("type") == "fixed":
        return pose
    axis = np.array(_numbers(joint.find("axis").get("xyz")))
    assert list(axis) == [0, 0, 1]
    if joint.get("type") == "prismatic":
        pose[:3, 3] = value * axis
        return pose
    cosine, sine = math.cos(value), math.sin(value)
    pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return pose


@pytest.fixture(scope="module", params=[MANUS, OTHER], ids=["MANUS", "another arm"])
def arm_and_model(request):
    return request.param, Model(robot_description(request.param))


@settings(max_examples=50)
@given(shoulder=angles, elbow=angles, height=st.floats(0.0, 0.36))
def test_the_handle_is_where_the_laws_have_it(arm_and_model, shoulder, elbow, height):
    """For the joint_states that absolute angles become; the handle keeps its directions."""
    arm, model = arm_and_model
    plane = PlanarState(homed=True, joint_position=[shoulder, elbow])
    values = {name: joint[0] for name, joint in planar_joints(carried(plane, 0)).items()}
    pose = model.pose("handle", {**values, "vertical": height})
    assert pose[:3, 3] == pytest.approx([*forward(shoulder, elbow, arm), height], abs=1e-12)
    assert pose[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)


def test_frames_joints_and_limits():
    model = Model(robot_description())
    assert {"manus_base", "upper_arm", "forearm", "module", "handle"} <= model.links
    free = {name for name, joint in model.joints.items()
            if joint.get("type") != "fixed" and joint.find("mimic") is None}  # fmt: skip
    assert free == {"shoulder", "elbow", "vertical"}
    plane, vertical = PlanarSettings(), VerticalSettings()
    for name, low, high in (("shoulder", plane.shoulder_low, plane.shoulder_high),
                            ("elbow", plane.between_low, plane.between_high),
                            ("vertical", vertical.travel_low, vertical.travel_high)):  # fmt: skip
        limit = model.joints[name].find("limit")
        assert (float(limit.get("lower")), float(limit.get("upper"))) == (low, high)


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
