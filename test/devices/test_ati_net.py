# SPDX-License-Identifier: Apache-2.0
"""The Net F/T box, frame by frame from its manual (9620-05-Net FT, chapter 15), base id 0x12."""

from __future__ import annotations

import pytest
from scripted_devices import ScriptedBox

from screw_module_ros.devices.ati_net import NetForceSensor
from screw_module_ros.devices.errors import NotConfigured, Occupied
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings

SETTINGS = ForceSensorSettings(
    listen=0.0, timeout=0.02, counts_per_force=200.0, counts_per_torque=5000.0
)


@pytest.fixture
def box(wire):
    return wire.attach(ScriptedBox(wire))


def started(wire, **changes):
    sensor = NetForceSensor(wire.port, SETTINGS._replace(**changes))
    sensor.configure()
    sensor.start()
    return sensor


def sample(wire, sensor):
    now_ns = wire.advance()
    sensor.request(now_ns // 1_000_000, now_ns, now_ns)
    wire.port.pump()
    return sensor.reading()


def test_a_wrench_from_two_frames(wire, box):
    reading = sample(wire, started(wire))
    assert reading[3:9] == (5.0, -1.0, 20.0, -0.1, 0.01, 0.0)
    assert reading.status == 0
    assert wire.frames[-1] == (0x120, b"\x02")


def test_mounting_and_sign_act_as_for_the_other_board(wire, box):
    reading = sample(wire, started(wire, sign=-1))
    assert reading[3:6] == (-5.0, 1.0, -20.0)


def test_the_number_may_wrap_but_not_stand(wire, box):
    sensor = started(wire)
    assert [sample(wire, sensor) is not None for _ in range(3)] == [True] * 3
    box.step = 0
    assert sample(wire, sensor) is None
    assert sensor.counters["repeated"] == 1
    box.step = 7
    assert sample(wire, sensor) is not None


def test_the_error_bit_withholds_the_sample_and_stays(wire, box):
    sensor = started(wire)
    box.status = "04 80"
    assert sample(wire, sensor) is None
    assert "status 0x8004" in sensor.fault
    box.status = "00 00"
    assert sample(wire, sensor) is not None
    assert "status 0x8004" in sensor.fault
    sensor.clear_fault()
    assert sensor.fault == ""


def test_one_half_is_no_sample(wire, box):
    sensor = started(wire)
    box.no_second = True
    assert sample(wire, sensor) is None


def test_a_frame_of_another_length_is_no_sample(wire, box):
    sensor = started(wire)
    box.xy = "E8 03"
    assert sample(wire, sensor) is None
    assert sensor.counters["wrong_length"] == 1


def test_an_axis_at_its_end_is_no_sample(wire, box):
    sensor = started(wire)
    box.z = "FF 7F 00 00"
    assert sample(wire, sensor) is None
    assert sensor.counters["saturated"] == 1


def test_another_master_is_noticed(wire, box):
    sensor = started(wire)
    wire.emit(0x120, b"\x02")
    wire.port.pump()
    assert "somebody else polls" in sensor.fault


def test_another_master_is_noticed_before_the_start(wire, box):
    sensor = NetForceSensor(wire.port, SETTINGS._replace(listen=0.05))
    wire.emit(0x120, b"\x02")
    with pytest.raises(Occupied):
        sensor.configure()


@pytest.mark.parametrize("missing", ["counts_per_force", "counts_per_torque"])
def test_without_its_counts_it_is_refused(wire, box, missing):
    with pytest.raises(NotConfigured, match="web page"):
        started(wire, **{missing: 0.0})
