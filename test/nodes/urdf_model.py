# SPDX-License-Identifier: Apache-2.0
"""A URDF, read by its own words: kinematics and masses (wiki.ros.org/urdf/XML)."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np


class Model:
    """Kinematics and masses by the URDF's own words (wiki.ros.org/urdf/XML)."""

    def __init__(self, text: str):
        self.root = ElementTree.fromstring(text)
        self.links = {link.get("name"): link for link in self.root.iter("link")}
        self.joints = {joint.get("name"): joint for joint in self.root.iter("joint")}
        self._above = {joint.find("child").get("link"): joint for joint in self.joints.values()}

    def pose(self, link: str, values: dict[str, float]) -> np.ndarray:
        """Return the 4 x 4 pose of a link in the root's frame for joint values."""
        pose = np.eye(4)
        for joint in self._chain(link):
            pose = _origin(joint) @ _moved(joint, self._value(joint, values)) @ pose
        return pose

    def place(self, link: str, values: dict[str, float], *at: float) -> np.ndarray:
        """Return where a point of a link's frame, its origin by default, is in the root's frame."""
        return (self.pose(link, values) @ [*(at or (0.0,) * 3), 1.0])[:3]

    def inertia(self, driven: list[str], values: dict[str, float]) -> np.ndarray:
        """Return the mass matrix of the driven joints, all links with their inertias summed."""
        whole = np.zeros((len(driven), len(driven)))
        for name, link in self.links.items():
            if (inertial := link.find("inertial")) is None:
                continue
            centre = self.place(name, values, *numbers(inertial.find("origin").get("xyz")))
            ways = np.array([self._rates(name, values, centre, joint) for joint in driven])
            turn = self.pose(name, values)[:3, :3]
            about = turn @ tensor(inertial) @ turn.T
            whole += float(inertial.find("mass").get("value")) * ways[:, 0] @ ways[:, 0].T
            whole += ways[:, 1] @ about @ ways[:, 1].T
        return whole

    def _rates(self, link: str, values: dict, point: np.ndarray, driven: str) -> np.ndarray:
        """Return velocity of a point of a link, and its angular velocity, per rate of a joint."""
        velocity, spin = np.zeros(3), np.zeros(3)
        for joint in self._chain(link):
            of, times = mimicked(joint)
            if of != driven:
                continue
            below = self.pose(joint.find("child").get("link"), values)
            axis = times * below[:3, :3] @ numbers(joint.find("axis").get("xyz"))
            if joint.get("type") == "prismatic":
                velocity += axis
            else:
                velocity += np.cross(axis, point - below[:3, 3])
                spin += axis
        return np.array([velocity, spin])

    def _chain(self, link: str):
        while link in self._above:
            yield self._above[link]
            link = self._above[link].find("parent").get("link")
        assert link.endswith("manus_base")

    def _value(self, joint, values: dict[str, float]) -> float:
        of, times = mimicked(joint)
        return times * values.get(of, 0.0)


def numbers(text: str) -> list[float]:
    """Return the numbers of an attribute."""
    return [float(word) for word in text.split()]


def mimicked(joint) -> tuple[str, float]:
    """Return whose value a joint has, and how often."""
    mimic = joint.find("mimic")
    if mimic is None:
        return joint.get("name"), 1.0
    return mimic.get("joint"), float(mimic.get("multiplier"))


def tensor(inertial) -> np.ndarray:
    """Return the inertia of an `inertial` about its centre [kg m2]."""
    of = {key: float(value) for key, value in inertial.find("inertia").items()}
    return np.array([[of["ixx"], of["ixy"], of["ixz"]],
                     [of["ixy"], of["iyy"], of["iyz"]],
                     [of["ixz"], of["iyz"], of["izz"]]])  # fmt: skip


def turned(axis: list[float], angle: float) -> np.ndarray:
    """Return the rotation about an axis of the frame (Rodrigues)."""
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across


def _origin(joint) -> np.ndarray:
    pose, origin = np.eye(4), joint.find("origin")
    pose[:3, 3] = numbers(origin.get("xyz"))
    for axis, angle in zip(np.eye(3), numbers(origin.get("rpy", "0 0 0")), strict=True):
        pose[:3, :3] = turned(axis, angle) @ pose[:3, :3]
    return pose


def _moved(joint, value: float) -> np.ndarray:
    pose = np.eye(4)
    if joint.get("type") == "fixed":
        return pose
    axis = numbers(joint.find("axis").get("xyz"))
    if joint.get("type") == "prismatic":
        pose[:3, 3] = value * np.array(axis)
    else:
        pose[:3, :3] = turned(axis, value)
    return pose
