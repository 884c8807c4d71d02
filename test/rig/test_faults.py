# SPDX-License-Identifier: Apache-2.0
"""What goes wrong with frames, per cable, and how faults are asked for and end."""

import math

import pytest

from screw_module_ros.rig.faults import CABLE, DRIVE, ENCODER, FORCE_SENSOR

GAUGES = [(0x120, "00 00 01 38 00 57 00 29"), (0x121, "FF 6F FE FC 00 C6")]


@pytest.fixture
def faulty(sensor):
    """Return a function that injects a fault into the force sensor and takes effect at once."""

    def inject(fault: str, value: float = 0.0, duration: float = 0.0) -> str:
        said = sensor.rig.inject("force_sensor", fault, value, duration, sensor.now_ns)
        sensor.run(0)
        return said

    return inject


def test_cable_out_and_back(sensor, faulty):
    assert faulty("cable_out", duration=0.01) == "force_sensor: cable_out, for 0.01 s"
    assert sensor.ask(0x120) == []
    sensor.run(10)
    assert sensor.ask(0x120) == GAUGES


def test_mute_hears_and_deaf_does_not(sensor, faulty):
    faulty("mute")
    assert sensor.ask(0x126, "01") == []
    faulty("clear")
    assert sensor.ask(0x128) == [(0x128, "01 01")]
    faulty("deaf")
    sensor.ask(0x126, "00")
    faulty("clear")
    assert sensor.ask(0x128) == [(0x128, "01 01")]


@pytest.mark.parametrize(
    ("fault", "value", "frames"),
    [
        ("truncate", 0, [(0x120, "00 00 01 38 00 57 00"), (0x121, "FF 6F FE FC 00")]),
        ("truncate", 7, [(0x120, "00"), (0x121, "")]),
        ("lengthen", 1, [GAUGES[0], (0x121, "FF 6F FE FC 00 C6 AA")]),
        ("lengthen", 8, [GAUGES[0], (0x121, "FF 6F FE FC 00 C6 AA AA")]),
        ("duplicate", 0, [GAUGES[0]] * 2 + [GAUGES[1]] * 2),
        ("reorder", 0, GAUGES[::-1]),
        ("wrong_id", 0, [(0x160, GAUGES[0][1]), (0x161, GAUGES[1][1])]),
        ("drop", 1, []),
    ],
)
def test_what_becomes_of_frames(sensor, faulty, fault, value, frames):
    faulty(fault, value)
    assert sensor.ask(0x120) == frames


def test_a_frame_held_for_reordering_is_let_go(sensor, faulty):
    faulty("reorder")
    assert sensor.ask(0x128) == []
    assert sensor.run(6) == [(0x128, "02 03")]


def test_drop_loses_about_its_share(sensor, faulty):
    faulty("drop", 0.3)
    lost = sum(not sensor.ask(0x128) for _ in range(300))
    assert 60 < lost < 120


def test_garbage_keeps_the_length(sensor, faulty):
    faulty("garbage")
    frames = sensor.ask(0x120)
    assert [(i, len(p.split())) for i, p in frames] == [(0x120, 8), (0x121, 6)]
    assert frames != GAUGES


def test_delay_is_in_milliseconds_and_keeps_the_order(sensor, faulty):
    faulty("delay", 4)
    assert sensor.ask(0x120) == []
    assert sensor.run(3) == []
    assert sensor.run(1) == GAUGES


def test_what_is_delayed_goes_out_when_the_fault_ends(sensor, faulty):
    faulty("delay", 500, 0.002)
    sensor.ask(0x128)
    assert sensor.run(3) == [(0x128, "02 03")]


def test_foreign_ids_come_beside_the_real_ones(sensor, faulty):
    faulty("foreign_ids")
    assert [can_id for can_id, _ in sensor.ask(0x120)] == [0x120, 0x160, 0x121, 0x161]


def test_flood_fills_the_bus_at_its_rate(sensor, faulty):
    faulty("flood", 20)
    frames = sensor.run(10)
    assert len(frames) == 200
    assert set(frames) == {(0x001, "FF FF FF FF FF FF FF FF")}
    faulty("clear")
    assert sensor.run(5) == []


def test_faults_combine(sensor, faulty):
    faulty("truncate", 5)
    faulty("duplicate")
    assert sensor.ask(0x125) == [(0x125, "46 54 2D")] * 2


def test_one_device_of_a_shared_bus_alone(make_bench):
    bench = make_bench("encoder", "force_sensor")
    bench.rig.inject("encoder", "cable_out", 0, 0, bench.now_ns)
    assert [can_id for can_id, _ in bench.ask(0x120)] == [0x120, 0x121]
    assert bench.ask(0x602, "40 00 10 00 00 00 00 00") == []
    bench.rig.inject("encoder_bus", "cable_out", 0, 0, bench.now_ns)
    assert bench.ask(0x120) == []
    bench.rig.inject("all", "clear", 0, 0, bench.now_ns)
    assert [can_id for can_id, _ in bench.ask(0x120)] == [0x120, 0x121]


def test_bus_off_takes_a_drive_s_torque_and_tells_when_it_is_back(torque_drive):
    drive = torque_drive
    for rpdo in ("06 00 00 00", "07 00 00 00", "0F 00 F4 01"):
        drive.ask(0x201, rpdo)
    drive.rig.inject("drive", "bus_off", 0, 0.01, drive.now_ns)
    assert drive.run(0) == []
    assert not drive.world.vertical_powered
    frames = drive.run(10)
    assert [payload[:5] for _, payload in frames] == ["40 81", "00 00"]
    assert drive.read(1, "603F:00") == "0081"


def test_bus_off_of_the_sensor_leaves_its_bit(sensor, faulty):
    faulty("bus_off", duration=0.005)
    assert sensor.ask(0x120) == []
    sensor.run(5)
    assert sensor.ask(0x120)[0] == (0x120, "C0 00 01 38 00 57 00 29")


def test_reset_and_power_loss_end_in_boot_up(encoder):
    encoder.rig.inject("encoder", "reset", 0, 0, encoder.now_ns)
    assert encoder.run(30) == [(0x702, "00")]
    encoder.rig.inject("encoder", "power_off", 0, 0.1, encoder.now_ns)
    assert encoder.run(99) == []
    assert encoder.run(1) == [(0x702, "00")]


def test_silences_one_by_one(torque_drive):
    drive = torque_drive
    drive.write(1, "1017:00", "0100")

    def heard() -> set[int]:
        drive.send(0x080)
        drive.send(0x601, "40 00 10 00 00 00 00 00")
        return {can_id for can_id, _ in drive.run(1)}

    everything = {0x181, 0x581, 0x701}
    assert heard() == everything
    for fault, missing in (("heartbeat_lost", 0x701), ("pdos_lost", 0x181), ("sdo_silent", 0x581)):
        drive.rig.inject("drive", fault, 0, 0, drive.now_ns)
        assert heard() == everything - {missing}
        drive.rig.inject("drive", "clear", 0, 0, drive.now_ns)
    assert heard() == everything


def test_rpdos_lost_runs_into_the_deadline_alone(torque_drive):
    """Commands do not arrive; SYNC, SDO and heartbeat are still heard."""
    drive = torque_drive
    drive.send(0x201, "06 00 00 00")
    drive.run(1)
    drive.rig.inject("drive", "rpdos_lost", 0, 0, drive.now_ns)
    for _ in range(30):
        drive.send(0x201, "06 00 00 00")
        drive.send(0x770, "05")
        drive.run(1)
    assert drive.read(1, "603F:00") == "5082"
    assert drive.read(1, "1000:00") != ""


def test_emcy_by_code(encoder):
    encoder.rig.inject("encoder", "emcy", 0x8120, 0, encoder.now_ns)
    assert encoder.run(1) == [(0x082, "20 81 11 00 00 00 00 00")]
    assert encoder.read(2, "1001:00") == "00"


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


def test_all_means_those_that_can(make_bench):
    bench = make_bench("encoder", "force_sensor")
    said = bench.rig.inject("all", "position_error", 0, 1, bench.now_ns)
    assert said == "encoder: position_error, for 1 s"


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
    assert rig.faults()["encoder freeze"] == "the position stops changing"


def test_every_fault_of_every_device_can_be_injected_and_cleared(make_bench):
    bench = make_bench("encoder", "drive", "force_sensor", "planar")
    for entry in bench.rig.faults():
        device, fault = entry.split()
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
