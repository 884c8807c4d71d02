# SPDX-License-Identifier: Apache-2.0
"""Bits on the wire, with worst-case stuffing, and the load of a bus."""

from __future__ import annotations

import pytest
from scripted import Wire

from screw_module_ros.can_io.load import (
    BusOverload,
    Traffic,
    bits_per_second,
    check_load,
    frame_bits,
)
from screw_module_ros.devices.ati_net import NetForceSensor
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.drive_setup import drive_traffic
from screw_module_ros.devices.encoder_setup import EncoderSettings, encoder_traffic
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.devices.netcanoem import NetcanoemSensor


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 55), (1, 65), (4, 95), (6, 115), (8, 135)])
def test_worst_case_of_one_frame(data_bytes, bits):
    assert frame_bits(data_bytes) == bits


def test_classical_frames_carry_eight_bytes():
    with pytest.raises(ValueError, match="9"):
        frame_bits(9)


def per_tick(traffic: list[Traffic], rate: float = 1000.0) -> float:
    """Bits of the frames that go out each tick, heartbeats and slow PDOs left out."""
    return bits_per_second(each for each in traffic if each.rate == rate) / rate


def _all_three(wire: Wire, rate: float, sensor: type = NetcanoemSensor) -> list[Traffic]:
    return [
        *encoder_traffic(EncoderSettings(rate=rate)),
        *drive_traffic(DriveSettings(rate=rate), sync_producer=False),
        *sensor(wire.port, ForceSensorSettings(rate=rate)).traffic,
    ]


def test_encoder_drive_and_force_sensor_take_685_bits_a_tick(wire):
    traffic = _all_three(wire, 1000.0)
    assert per_tick(traffic) == 685
    # 55 SYNC + 95 encoder; 135 + 95 drive; 55 + 135 + 115 force sensor.
    assert [frame_bits(each.data_bytes) for each in traffic if each.rate == 1000.0] == [
        55, 95, 95, 135, 55, 135, 115,
    ]  # fmt: skip


def test_a_net_box_has_longer_frames_than_netcanoem(wire):
    # 65 + 135 + 135 where the other has 55 + 135 + 115.
    assert per_tick(_all_three(wire, 1000.0, NetForceSensor)) == 685 + 30


def test_two_planar_drives_take_52_percent():
    shoulder, elbow = DriveSettings(node_id=3), DriveSettings(node_id=4)
    traffic = [*drive_traffic(shoulder), *drive_traffic(elbow, sync_producer=False)]
    assert per_tick(traffic) / 1000 == pytest.approx(0.515)


def test_warning_above_80_and_refusal_above_100_percent(wire):
    quiet = check_load([Traffic("a", 8, 5000)], 1_000_000, "can0")
    assert quiet == (pytest.approx(0.675), "")
    load, text = check_load([Traffic("a", 8, 6000)], 1_000_000, "can0")
    assert load == pytest.approx(0.81)
    assert "can0" in text
    assert "81 %" in text
    with pytest.raises(BusOverload, match="13[789] %"):
        check_load(_all_three(wire, 2000.0), 1_000_000, "can0")


def test_half_rate_plane_still_pays_for_the_whole_sync():
    traffic = drive_traffic(DriveSettings(rate=500.0, sync_divider=2))
    assert {each.name: each.rate for each in traffic}["SYNC"] == 1000.0
