# SPDX-License-Identifier: Apache-2.0
"""How faults are asked for, and those whose frames depend on chance.

What becomes of frames stands in `conversations.txt`.
"""

import math

import pytest

from screw_module_ros.rig.faults import CABLE, DRIVE, ENCODER, FORCE_SENSOR

DISABLE_VOLTAGE, FAULT_RESET = "00 00 00 00", "80 00 00 00"
GAUGES = [(0x120, "00 00 01 38 00 57 00 29"), (0x121, "FF 6F FE FC 00 C6")]


@pytest.fixture
def faulty(sensor):
    """Return a function that injects a fault into the force sensor and takes effect at once."""

    def inject(fault: str, value: float = 0.0, duration: float = 0.0) -> str:
        said = sensor.rig.inject("force_sensor", fault, value, duration, sensor.now_ns)
        sensor.run(0)
        return said

    return inject


def test_drop_loses_about_its_share(sensor, faulty):
    faulty("drop", 0.3)
    lost = sum(not sensor.ask(0x128) for _ in range(300))
    assert 60 < lost < 120


def test_garbage_keeps_the_length(sensor, faulty):
    faulty("garbage")
    frames = sensor.ask(0x120)
    assert [(i, len(p.split())) for i, p in frames] == [(0x120, 8), (0x121, 6)]
    assert frames != GAUGES


@pytest.mark.parametrize(
    ("device", "fault", "value", "duration", "said"),
    [
        ("enc", "freeze", 0, 0, "there is no 'enc' here; there are encoder"),
        ("encoder", "melt", 0, 0, "encoder has no fault 'melt'; it has: clear, cable_out"),
        ("encoder", "drop", 1.5, 0, "value = 1.5: 0 to 1 share is wanted"),
        ("encoder", "drop", math.inf, 0, "value = inf"),
        ("encoder", "freeze", 0, -1, "duration = -1 s"),
        ("encoder", "freeze", 0, math.nan, "duration = nan s"),
        ("all", "melt", 0, 0, "has no fault 'melt'"),
    ],
)
def test_nonsense_is_refused_and_changes_nothing(make_bench, device, fault, value, duration, said):
    bench = make_bench("encoder", "drive")
    with pytest.raises(ValueError, match="is wanted|there|no fault") as refused:
        bench.rig.inject(device, fault, value, duration, bench.now_ns)
    assert said in str(refused.value)
    bench.run(1)
    assert all(device.active == () for device in bench.rig.devices.values())


def test_the_list_says_what_there_is(make_bench):
    bench = make_bench("encoder", "drive", "force_sensor", "planar")
    rig = bench.rig
    text = rig.inject("", "", 0, 0, 0)
    assert text == rig.describe()
    for name in (*CABLE, "near_rollover", "over_temperature", "status", "planar_bus"):
        assert name in text
    assert text.count("cable_out") == 1  # what all share is told once
    rig.inject("elbow", "mute", 0, 0, bench.now_ns)
    bench.run(0)
    assert "elbow, active: mute" in rig.describe()
    assert rig.devices["encoder"].FAULTS["freeze"].line() == "the position stops changing"


def test_every_fault_of_every_device_can_be_injected_and_cleared(make_bench):
    bench = make_bench("encoder", "drive", "force_sensor", "planar")
    every = [(name, fault) for name, one in bench.rig.devices.items() for fault in one.FAULTS]
    for device, fault in every:
        bench.rig.inject(device, fault, 0, 0, bench.now_ns)
        bench.run(2)
        bench.rig.inject(device, "clear", 0, 0, bench.now_ns)
        bench.run(30)
        assert bench.rig.devices[device].active == ()
    bench.run(60)
    assert bench.read(2, "1000:00") == "96010200"
    assert bench.ask(0x128) == [(0x128, "02 03")]


def test_sizes_and_texts_of_all_faults_are_the_kept_ones(kept):
    tables = {"drive": DRIVE, "encoder": ENCODER, "force_sensor": FORCE_SENSOR}
    kept({
        name: {fault: f"{each.line()}; {each.size}" for fault, each in table.items()}
        for name, table in tables.items()
    })  # fmt: skip


@pytest.mark.parametrize(
    ("fault", "code", "emcy"),
    [
        ("over_current", 0, "10 23 03 00 00 00 00 00"),
        ("fault", 0x3210, "10 32 05 00 00 00 00 00"),
        ("over_temperature", 0, "10 42 09 00 00 00 00 00"),
        ("fault", 0x4310, "10 43 09 00 00 00 00 00"),
        ("fault", 0x6010, "10 60 01 00 00 00 00 00"),
        ("fault", 0x7300, "00 73 01 00 00 00 00 00"),
        ("fault", 0x8130, "30 81 11 00 00 00 00 00"),
    ],
)
def test_injected_faults_stop_the_drive_and_last(torque_drive, fault, code, emcy):
    drive = torque_drive
    drive.write(1, "1400:05", "0000")
    drive.enable("F4 01")
    drive.rig.inject("drive", fault, code, 0, drive.now_ns)
    assert drive.run(0) == [(0x081, emcy)]
    assert not drive.world.vertical_powered
    drive.ask(0x201, DISABLE_VOLTAGE)
    drive.ask(0x201, FAULT_RESET)
    assert drive.statusword() == "1802"
    drive.rig.inject("drive", "clear", 0, 0, drive.now_ns)
    drive.ask(0x201, DISABLE_VOLTAGE)
    assert drive.ask(0x201, FAULT_RESET)[0] == (0x081, "00 00 00 00 00 00 00 00")
    assert drive.statusword() == "5002"


def test_noise_moves_the_position_about_its_value(streaming):
    streaming.rig.inject("encoder", "noise", 10, 0, streaming.now_ns)
    streaming.world.encoder_count = 10_000
    streaming.run(0)
    frames = [bytes.fromhex(data) for _ in range(50) for _, data in streaming.ask(0x080)]
    positions = [int.from_bytes(frame, "little") for frame in frames]
    assert len(set(positions)) > 5
    assert all(abs(p - 10_000) < 60 for p in positions)
