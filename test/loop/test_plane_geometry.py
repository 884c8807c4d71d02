# SPDX-License-Identifier: Apache-2.0
"""The plane against a robot that this file builds from geometry alone, with the shipped numbers.

The robot stands beyond the workspace, opposite the patient (thesis 1.1). It knows nothing of
`geometry.py`: its elbow is where two circles meet, its force at the handle follows from virtual
work. Frames are those of the CiA 402 drives.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from scripted import Wire, unsigned
from scripted_devices import ScriptedDrive

from screw_module_ros.control.planar_settings import STUDIED_GAIN, PlanarSettings
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.geometry import PlanarArm
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings
from screw_module_ros.plant.planar import resting_plane
from screw_module_ros.plant.settings import load_world
from screw_module_ros.safety.permit import PermitSettings
from screw_module_ros.samples import ForceReading
from screw_module_ros.settings import fields

ROOT = Path(__file__).resolve().parents[2]
BASE, UPPER_ARM, FOREARM = (0.0, 0.60), 16.0 * 0.0254, 20.25 * 0.0254
WIDTH, DEPTH = 0.381, 0.457  # of the workspace (thesis 2.1.1) [m]
POSE = (-32.3, -131.9)  # of shoulder and elbow with the handle in the centre [degrees]
MS, PERIOD_MS, NODES = 1_000_000, 2.0, (3, 4)
COUNTS, OFFSETS, RATED = 65536, (1234, -777), 10.0
names = (f"plane of geometry {number}" for number in itertools.count())


class Robot(NamedTuple):
    """A five-bar of the shipped dimensions; left: its elbow is on the patient's left."""

    left: bool = False

    def pose(self, x: float, y: float) -> tuple[float, float]:
        """Absolute angles of the links [rad] with the handle at x, y; the elbow where circles meet.

        Each within half a turn of its angle with the handle in the centre.
        """
        reach = np.array([x, y]) - BASE
        distance = np.hypot(*reach)
        along = (UPPER_ARM**2 - FOREARM**2 + distance**2) / (2.0 * distance)
        across = math.sqrt(UPPER_ARM**2 - along**2) * np.array([-reach[1], reach[0]]) / distance
        bent = along * reach / distance
        elbow = max(bent + across, bent - across, key=lambda e: -e[0] if self.left else e[0])
        rest = reach - elbow
        return math.atan2(elbow[1], elbow[0]) - 2.0 * math.pi * (self.left and elbow[1] > 0.0), (
            math.atan2(rest[1], rest[0])
        )

    def force(self, x: float, y: float, torques: tuple[float, float]) -> tuple[float, float]:
        """Force on the hand [N] that joint torques [Nm] give: their work for a small way is its."""
        small = 1e-6
        ways = [np.subtract(self.pose(x + dx, y + dy), self.pose(x - dx, y - dy)) / (2.0 * small)
                for dx, dy in ((small, 0.0), (0.0, small))]  # fmt: skip
        return float(np.dot(torques, ways[0])), float(np.dot(torques, ways[1]))


def bench_file() -> dict:
    """The parameters of `manus` in params/hardware.yaml."""
    content = yaml.safe_load((ROOT / "params/hardware.yaml").read_text(encoding="utf-8"))
    return content["/**/manus"]["ros__parameters"]


def shipped_law(left: bool = False) -> PlanarSettings:
    """The law with the numbers of params/hardware.yaml; left: the elbow on the other side."""
    written = bench_file()
    law = PlanarSettings(
        arm=PlanarArm(**{name: written[f"arm.{name}"] for name in PlanarArm._fields}),
        **{name: written[name] for name in PlanarSettings._fields if name in written},
    )
    if not left:
        return law.validated()
    turned = {  # mirrored in the y axis: an absolute angle a becomes -pi - a
        f"{joint}_{end}": middle - getattr(law, f"{joint}_{other}")
        for joint, middle in (("shoulder", -math.pi), ("elbow", -math.pi), ("between", 0.0))
        for end, other in (("low", "high"), ("high", "low"))
    }
    return law._replace(arm=law.arm._replace(elbow="left"), **turned).validated()


class Station:
    """The robot with its two drives on a bus, the plane that controls it, and a hand.

    turns: 1 where a drive's positive direction turns its link counter-clockwise, else -1;
    directions: what the drives' parameter says of that, the truth unless given. aim: set point.
    """

    def __init__(
        self, robot: Robot, turns: tuple[int, int], law: PlanarSettings,
        directions: tuple[int, int] | None = None,
    ):  # fmt: skip
        self.robot, self.turns = robot, turns
        self.place, self.push, self.aim = (0.0, 0.0), (0.0, 0.0), (math.nan, math.nan)
        self.wire = Wire(next(names))
        self.ends = [self.wire.attach(ScriptedDrive(self.wire, node)) for node in NODES]
        settings = [
            DriveSettings(node_id=node, master_id=113, rate=500.0, rated_torque=RATED,
                          max_torque=25.0, counts_per_turn=COUNTS, direction=direction,
                          enable_timeout=0.1, listen=0.0, sdo_timeout=0.02)
            for node, direction in zip(NODES, directions or turns, strict=True)
        ]  # fmt: skip
        beat = Heartbeat(self.wire.port, 113, settings[0].heartbeat_period)
        drives = [Drive(self.wire.port, each, f"drive {each.node_id}", beat) for each in settings]
        for end, drive in zip(self.ends, drives, strict=True):
            end.objects[0x6076, 0] = unsigned(10_000, 4)
            drive.configure()
            drive.start()
        self.plane = Plane(
            (drives[0], drives[1]), self.wire.port, round(PERIOD_MS * MS), law, JointSettings(),
            PermitSettings(),
        )  # fmt: skip
        self.number = 0

    def tick(self) -> None:
        """One period: the encoders show where the handle stands, the sensor what the hand does."""
        now_ns = self.wire.advance(PERIOD_MS)
        angles = self.robot.pose(*self.place)
        for end, turn, offset, angle in zip(
            self.ends, self.turns, OFFSETS, angles, strict=True
        ):
            end.position = round(turn * angle * COUNTS / (2.0 * math.pi)) + offset
            self.wire.emit(0x700 + end.node_id, "05" if end.operational else "7F")
            end.report_slowly()
        self.plane.drives.permit.supervise(True, "", now_ns)
        self.number += 1
        self.plane.controller.on_force(
            ForceReading(self.number, now_ns, now_ns, *self.push, 0.0, 0.0, 0.0, 0.0, 0), now_ns
        )
        self.plane.controller.wanted.ask(self.aim, (0.0, 0.0), now_ns)
        self.plane.drives.request(now_ns)
        self.wire.port.pump()
        assert self.plane.drives.answered(now_ns)
        self.plane.act(now_ns)
        assert self.plane.drives.permit.fault.reason == ""

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    def move(self, x: float, y: float) -> None:
        """Take the handle there in a straight line, at 0.2 m/s."""
        start, steps = self.place, max(1, round(math.dist(self.place, (x, y)) / 4e-4))
        for k in range(1, steps + 1):
            self.place = (start[0] + (x - start[0]) * k / steps,
                          start[1] + (y - start[1]) * k / steps)  # fmt: skip
            self.tick()

    def home(self) -> None:
        """Home with the handle at the reference mark."""
        self.ticks(40)
        assert self.plane.take_home(self.wire.now_ns) == ""

    def enable(self) -> None:
        assert self.plane.drives.permit.open(self.wire.now_ns) == ""
        self.ticks(400)  # gate and law fade in
        assert self.plane.drives.permit.enabled

    def shown(self) -> tuple[float, float]:
        """The handle's place [m] that the controller tells."""
        self.tick()
        return self.plane.controller.output.x, self.plane.controller.output.y

    def force(self) -> tuple[float, float]:
        """Force of the motors on the hand [N], by the frames that the drives got."""
        torques = [
            turn * end.torque * RATED / 1000.0
            for turn, end in zip(self.turns, self.ends, strict=True)
        ]
        return self.robot.force(*self.place, (torques[0], torques[1]))


@pytest.fixture(params=[False, True], ids=["elbow right", "elbow left"])
def robot(request):
    return Robot(request.param)


@pytest.fixture(params=[1, -1], ids=["direction 1", "direction -1"])
def station(request, robot):
    made = Station(robot, (request.param, request.param), shipped_law(robot.left))
    yield made
    made.wire.close()


# -- the shipped numbers ---------------------------------------------------------------------------


def test_controller_and_plant_have_the_same_robot_beyond_the_workspace():
    arm, plant, written = PlanarArm(), load_world().planar, bench_file()
    for name in PlanarArm._fields:
        assert getattr(arm, name) == getattr(plant, name) == written[f"arm.{name}"], name
    assert (arm.base_x, arm.base_y) == BASE
    assert (arm.upper_arm, arm.forearm) == pytest.approx((UPPER_ARM, FOREARM))
    assert arm.base_y > DEPTH / 2.0, "opposite the patient"
    defaults = PlanarSettings()
    for name in fields(PlanarSettings):
        if name.endswith(("_low", "_high", "half_width", "half_depth")):
            assert getattr(defaults, name) == written[name], name


def test_in_the_centre_the_arm_stands_as_it_must():
    s = resting_plane(load_world().planar, 0.0, 0.0)
    from_plant = math.degrees(s.shoulder), math.degrees(s.elbow)
    assert from_plant == pytest.approx(POSE, abs=0.05)
    assert [math.degrees(a) for a in Robot().pose(0.0, 0.0)] == pytest.approx(POSE, abs=0.05)
    station = Station(Robot(), (1, 1), shipped_law())
    station.home()
    homed = [math.degrees(motion.position) for motion in station.plane.controller.motions]
    station.wire.close()
    assert homed == pytest.approx(POSE, abs=0.05)


@pytest.mark.parametrize("left", [False, True], ids=["elbow right", "elbow left"])
def test_limits_and_stops_lie_a_tenth_of_a_radian_outside_the_workspace(left):
    """The controller's soft stops, which begin 0.1 rad before its limits, touch nothing inside."""
    law, plant = shipped_law(left), load_world().planar
    places = itertools.product(
        np.linspace(-WIDTH / 2.0, WIDTH / 2.0, 61), np.linspace(-DEPTH / 2.0, DEPTH / 2.0, 61)
    )
    angles = np.array([Robot(left).pose(*place) for place in places])
    shoulder, elbow = angles.T
    found = {"shoulder": shoulder, "elbow": elbow, "between": elbow - shoulder}
    for joint, values in found.items():
        low, high = getattr(law, f"{joint}_low"), getattr(law, f"{joint}_high")
        assert low + 0.1 <= values.min() and values.max() <= high - 0.1, joint
        if joint != "elbow" and not left:
            assert getattr(plant, f"{joint}_low") < low and high < getattr(plant, f"{joint}_high")


# -- step 8 of docs/hardware.md --------------------------------------------------------------------


def test_x_rises_to_the_right_and_y_away_from_the_patient(station):
    station.home()
    assert station.shown() == pytest.approx((0.0, 0.0), abs=1e-4)
    for place in ((0.1, 0.0), (0.1, 0.1), (-0.12, 0.1), (-0.12, -0.15)):
        station.move(*place)
        assert station.shown() == pytest.approx(place, abs=3e-4)


@pytest.mark.parametrize("directions", [(-1, 1), (1, -1), (-1, -1)])
def test_a_wrong_direction_does_not_pass_this_step(robot, directions):
    """The plane's own sign of an axis, or of both, would be another than the eye's."""
    station = Station(robot, (1, 1), shipped_law(robot.left), directions)
    station.home()
    wrong = []
    for place in ((0.05, 0.0), (0.0, 0.05)):
        station.move(*place)
        wrong.append(math.dist(station.shown(), place))
    station.wire.close()
    assert max(wrong) > 0.05


@pytest.mark.parametrize("robot_left", [False, True])
def test_the_wrong_side_of_the_elbow_does_not_pass_this_step(robot_left):
    station = Station(Robot(robot_left), (1, 1), shipped_law(not robot_left))
    station.home()
    station.move(0.0, 0.05)
    _, y = station.shown()
    station.wire.close()
    assert y < 0.0, "y reads reversed"


# -- signs of force and motion ---------------------------------------------------------------------


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.12, -0.15), (-0.1, 0.12)])
def test_the_spring_pushes_the_hand_towards_its_set_point(station, place):
    station.home()
    station.move(*place)
    station.enable()
    stiffness = station.plane.controller.settings.stiffness
    for way in ((0.05, 0.0), (-0.03, 0.0), (0.0, 0.05), (0.03, -0.04)):
        station.aim = place[0] + way[0], place[1] + way[1]
        station.ticks(150)
        wanted = stiffness * way[0], stiffness * way[1]
        assert station.force() == pytest.approx(wanted, abs=0.15)


@pytest.mark.parametrize("push", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_force_feedback_helps_the_hand_that_pushes(station, push):
    """A wrench is the patient's on the robot: the motors push the way that the hand does.

    Briefly: a handle that stands against more torque counts as frozen.
    """
    controller = station.plane.controller
    controller.settings = controller.settings._replace(force_gain=STUDIED_GAIN)
    station.home()
    station.enable()
    assert station.force() == pytest.approx((0.0, 0.0), abs=0.05)
    station.push = push
    station.ticks(40)
    fx, fy = station.force()
    assert math.hypot(fx, fy) > 3.0
    assert fx * push[0] + fy * push[1] == pytest.approx(math.hypot(fx, fy), rel=1e-3)


def test_a_hand_that_the_spring_moves_goes_there(station):
    """Closed loop: each tick the handle yields by a little along the motors' own force."""
    station.home()
    station.aim = (0.04, -0.03)
    station.enable()
    for _ in range(1000):
        fx, fy = station.force()
        x, y = station.place
        station.place = x + 6e-5 * fx, y + 6e-5 * fy
        station.tick()
    assert station.place == pytest.approx(station.aim, abs=1e-3)
