# SPDX-License-Identifier: Apache-2.0
"""A force sensor of another package: its driver, its profile and its simulated device work here.

Nothing of this package knows it: it is found as an installed one, by the entry points of its
setup.py, and has to do what the sensors of this package do.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from geometry_msgs.msg import WrenchStamped

from screw_module_ros import profiles
from screw_module_ros.clock import ManualClock
from screw_module_ros.devices import force_sensors
from screw_module_ros.devices.errors import NotConfigured, NotNow, Occupied, WrongDevice
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.operator.robot import Robot
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.profiles import NETCANOEM
from screw_module_ros.settings import SettingError
from screw_module_ros.trials.one_thread import OneThreadRobot
from screw_module_ros.trials.runner import GraphRun

pytestmark = pytest.mark.long

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_sensor"
PROFILE = "mycell:load_cell"
SLOWEST_TICKS = 30
"""Ticks from a fault to zero torque: the sensor's sample may be 20 ms old."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Return what stands on the path where the example is installed: its folder, its metadata."""
    metadata = tmp_path_factory.mktemp("metadata")
    subprocess.run(
        [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", str(metadata)],
        cwd=EXAMPLE, check=True,
    )  # fmt: skip
    return str(EXAMPLE), str(metadata)


@pytest.fixture(autouse=True)
def found(installed, monkeypatch):
    """Put the example where Python finds packages, here and in other processes."""
    for place in installed:
        monkeypatch.syspath_prepend(place)
        monkeypatch.setenv("PYTHONPATH", place, prepend=os.pathsep)
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "mycell"]:
        del sys.modules[name]


@pytest.fixture
def unready():
    made = []

    def make(sensor=PROFILE):
        made.append(OneThreadRobot(1, sensor_profile=sensor))
        return made[-1]

    yield make
    for robot in made:
        robot.close()


@pytest.fixture
def ready(unready):
    def make(sensor=PROFILE):
        robot = unready(sensor)
        robot.ready()
        return robot

    return make


@pytest.fixture
def moving(ready):
    """Return a maker of robots that follow a patient who swings the handle."""

    def make(sensor=PROFILE):
        robot = ready(sensor)
        assert robot.enable() == ""
        robot.controller.mode, robot.setpoint = 1, (0.18, 0.0)
        robot.world.set_arm(ArmSettings(kind="active", target=(0, 0, 0.18), duration=0.8,
                                        amplitude=(0, 0, 0.1), omega=(0, 0, 1.6)))  # fmt: skip
        robot.seconds(1.0)
        assert all(row.reason == "" for row in robot.rows[-500:])
        return robot

    return make


def test_it_measures_as_the_sensor_of_this_package_does(moving):
    felt = [[row.patient for row in moving(sensor).rows[-500:]] for sensor in (NETCANOEM, PROFILE)]
    assert max(map(abs, felt[0])) > 3.0
    assert max(abs(a - b) for a, b in zip(*felt, strict=True)) < 1.0


def test_it_is_tared_and_its_zero_is_in_doubt_as_that_of_any_other(ready):
    robot = ready()
    sensor = robot.force_sensor
    assert sensor.tared
    robot.rig.inject("force_sensor", "cable_out", 0.0, 0.2, robot.now_ns)
    robot.seconds(0.3)
    assert not sensor.tared and "was silent and may have restarted" in sensor.fault
    sensor.clear_fault()
    sensor.tare(robot.gather(120))
    assert sensor.tared and sensor.fault == ""


def test_it_says_who_it_is_and_what_it_costs_its_bus(ready):
    sensor = ready().force_sensor
    assert sensor.identity == "load cell of an example, node id 5"
    assert [(each.name, each.data_bytes) for each in sensor.traffic] == [
        ("force sensor request", 0), ("force sensor answer 1", 8), ("force sensor answer 2", 7),
    ]  # fmt: skip


class Case(NamedTuple):
    """A fault of the load cell, and the one of the package's sensor that does the same.

    said: of the driver. again: the robot goes on after this.
    """

    fault: str
    of_ours: str
    said: str
    withheld: str


CASES = {
    "saturation": Case("overload", "saturate", "", "saturated"),
    "frozen values": Case("freeze", "freeze", "have not changed for 0.5 s", "frozen"),
    "silence": Case("cable_out", "cable_out", "", "missing_in_a_row"),
    "half an answer is missing": Case("drop", "half", "", "missing"),
    "reboot": Case("reset", "", "restarted (boot-up), its calibration may be another", "restarts"),
}


def stopped_after(robot, fault, size=0.0):
    """Inject a fault; return the ticks until no torque passes, and why."""
    robot.rig.inject("force_sensor", fault, size, 0.0, robot.now_ns)
    begun = len(robot.rows)
    while robot.controller.reason == "" and len(robot.rows) - begun < 1000:
        robot.tick()
    return len(robot.rows) - begun, robot.controller.reason


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_what_fails_ends_the_torque_as_a_failure_of_ours_does(moving, case):
    robot = moving()
    ticks, reason = stopped_after(robot, case.fault, 1.0 if case.fault == "drop" else 0.0)
    robot.ticks(60)  # in which a device boots
    assert all(row.torque == 0.0 for row in robot.rows[-60:])
    assert case.said in robot.force_sensor.fault
    assert robot.force_sensor.counters[case.withheld] > 0
    frozen = 500 if case.fault == "freeze" else 0
    assert ticks <= frozen + SLOWEST_TICKS
    if case.of_ours:
        ours = moving(NETCANOEM)
        other, why = stopped_after(ours, case.of_ours)
        assert abs(ticks - other) <= 2 and reason == why
        assert bool(ours.force_sensor.fault) == bool(robot.force_sensor.fault)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_after_a_failure_nothing_goes_on_by_itself_and_all_goes_on_when_asked(moving, case):
    robot = moving()
    stopped_after(robot, case.fault, 1.0 if case.fault == "drop" else 0.0)
    robot.rig.inject("force_sensor", "clear", 0.0, 0.0, robot.now_ns)
    assert all(row.torque == 0.0 for row in robot.seconds(0.2)[1:])
    robot.force_sensor.clear_fault()
    robot.ticks(20)
    robot.controller.reset(robot.now_ns)
    robot.ticks(20)
    assert robot.clear_fault() == "" and robot.enable() == ""
    robot.seconds(0.1)
    assert robot.rows[-1].torque != 0.0 and robot.rows[-1].reason == ""
    assert robot.force_sensor.fault == ""


@pytest.mark.parametrize(("key", "value", "told"), [
    ((0x1000, 0), 402, "a device of CiA 402, not 404"),
    ((0x6131, 3), 0x00220000, "axis 3 is in unit 0x00220000"),
])  # fmt: skip
def test_another_device_in_its_place_is_refused(unready, key, value, told):
    robot = unready()
    robot.rig.devices["force_sensor"].objects[key] = value
    with pytest.raises(WrongDevice, match=told):
        robot.force_sensor.configure()


def test_who_else_sends_sync_on_its_bus_is_told(unready):
    robot = unready()
    robot.rig.devices["force_sensor"].link.send(0x080, b"")
    with pytest.raises(Occupied, match=r"somebody already polls the force sensor \(node id 5\)"):
        robot.force_sensor.configure()


def test_it_starts_only_when_it_is_configured(unready):
    with pytest.raises(NotConfigured, match="not configured"):
        unready().force_sensor.start()


def test_a_frozen_one_has_no_zero(moving):
    robot = moving()
    stopped_after(robot, "freeze")
    with pytest.raises(NotNow, match="have not changed"):
        robot.force_sensor.tare([])


@pytest.mark.parametrize(("settings", "told"), [
    ("{node_id: 200}", "force_sensor.settings.node_id = 200"),
    ("{node: 5}", "force_sensor.settings.node is unknown; known are node_id"),
])  # fmt: skip
def test_a_mistake_in_its_profile_is_told_by_its_key(tmp_path, settings, told):
    text = (EXAMPLE / "mycell" / "load_cell.yaml").read_text()
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace("{node_id: 5}", settings))
    chosen = ForceSensorSettings(profile=str(file))
    with pytest.raises(SettingError, match=told):
        force_sensors.driver(chosen, pytest.fail, ManualClock())


@pytest.mark.parametrize(("name", "told"), [
    ("nobody:load_cell", "there is no package nobody; is it installed?"),
    ("mycell:other", "other.yaml cannot be read"),
    ("load_cell", "the path of a .yaml file of yours, or package:NAME"),
])  # fmt: skip
def test_a_profile_that_is_not_there_is_told_with_the_way_out(name, told):
    with pytest.raises(SettingError, match=told):
        profiles.load(name)


def test_it_is_chosen_by_devices_as_any_other_make():
    assert profiles.by_kind("epos4,mycell:load_cell") == {
        profiles.DRIVE: "epos4", profiles.FORCE_SENSOR: PROFILE,
    }  # fmt: skip


@pytest.mark.graph
def test_the_real_graph_runs_with_it():
    """In nodes of their own it samples, is tared, restarts, and is set up again when asked."""
    nodes = ["sim_rig", "supervisor", "encoder", "force_sensor"]
    with GraphRun(only=nodes, devices=PROFILE) as graph, Robot("tester") as robot:
        graph.wait_until_ready(robot)
        assert robot.tare().startswith("tared, removing")
        robot.wait_until(  # the newest message may be of before the tare
            lambda: abs(robot.newest(WrenchStamped).wrench.force.z) < 0.5, 5.0, "no new zero"
        )
        robot.inject("force_sensor", "reset")
        robot.wait_until(
            lambda: "the force sensor restarted (boot-up)" in robot.complaints_text(), 5.0,
            "nobody says that the sensor has restarted",
        )  # fmt: skip
        assert robot.tare().startswith("tared, removing")
        robot.wait_until(lambda: not robot.complaints(), 5.0, "the sensor's fault stays")
        assert robot.newest(WrenchStamped)
