# SPDX-License-Identifier: Apache-2.0
"""The simulated encoder against CiA 406: direction, scaling, range, preset, alarms, faults."""

import pytest

from screw_module_ros.rig.build import RigSettings

PHYSICAL_RANGE = 20_000 * 4096


@pytest.fixture
def streaming(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "01", "82010000")
    encoder.start(2)
    encoder.drain()
    return encoder


def position(bench) -> int:
    ((can_id, payload),) = bench.ask(0x080)
    assert can_id == 0x182
    return int.from_bytes(bytes.fromhex(payload), "little")


def test_golden_position_frame(streaming):
    streaming.world.encoder_count = 0x00BC614E
    assert streaming.ask(0x080) == [(0x182, "4E 61 BC 00")]


def test_below_zero_it_wraps_at_the_physical_range_not_at_2_to_32(streaming):
    streaming.world.encoder_count = -1
    assert position(streaming) == PHYSICAL_RANGE - 1
    streaming.world.encoder_count = PHYSICAL_RANGE + 3
    assert position(streaming) == 3


def test_parameters_act_only_with_the_scaling_bit(streaming):
    streaming.write(2, "6001:00", "D0070000")  # 2000 per turn
    streaming.write(2, "6002:00", "A00F0000")  # range 4000
    streaming.world.encoder_count = 50_010
    assert position(streaming) == 50_010
    streaming.write(2, "6000:00", "0400")
    assert position(streaming) == 5001 - 4000
    assert streaming.read(2, "6500:00") == "0400"
    streaming.world.encoder_count = -10
    assert position(streaming) == 3999
    streaming.write(2, "6000:00", "0000")
    assert position(streaming) == PHYSICAL_RANGE - 10


def test_direction_bit_reverses(streaming):
    streaming.write(2, "6000:00", "0100")
    streaming.world.encoder_count = 250
    assert position(streaming) == PHYSICAL_RANGE - 250
    assert streaming.read(2, "6500:00") == "0100"
    streaming.ask(0x000, "81 02")
    streaming.run(30)
    assert streaming.read(2, "6500:00") == "0000"


def test_preset_sets_the_position_and_its_offset(streaming):
    streaming.world.encoder_count = 1500
    assert streaming.write(2, "6003:00", "E8030000") == "ok"  # 1000
    assert position(streaming) == 1000
    streaming.world.encoder_count = 1501
    assert position(streaming) == 1001
    assert streaming.write(2, "6003:00", "FFFFFFFF") == "06090032"


def test_the_offset_of_a_linear_encoder_has_a_sign(make_bench):
    encoder = make_bench("encoder", settings=RigSettings(encoder_profile="baumer_linear"))
    encoder.world.encoder_count = 20_000  # one turn of the screw: 19 050 um
    assert encoder.write(2, "6003:00", "E8030000") == "ok"
    assert encoder.read(2, "6004:00") == "e8030000"
    assert encoder.read(2, "6509:00") == (1000 - 19050).to_bytes(4, "little", signed=True).hex()
    assert encoder.write(2, "6002:00", "00100000") == "06010002"  # read-only at this make
    assert encoder.write(2, "6000:00", "0100") == "06090030"  # it does not scale
    assert encoder.write(2, "6000:00", "0800") == "ok"  # the other direction
    encoder.world.encoder_count = 0
    assert encoder.read(2, "6004:00") == (1000 - 19050).to_bytes(4, "little", signed=True).hex()


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [
        ("6000:00", "0800", "06090030"),
        ("6001:00", "00000000", "06090032"),
        ("6001:00", "214E0000", "06090031"),
        ("6002:00", "01 00 E2 04", "06090031"),
    ],
)
def test_values_out_of_range_are_refused(encoder, key, value, code):
    assert encoder.write(2, key, value) == code


def test_resolution_and_turns(encoder):
    assert encoder.read(2, "6501:00") == "204e0000"
    assert encoder.read(2, "6502:00") == "0010"


def test_cyclic_timer_is_the_event_timer_of_tpdo1(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "FE", "82010000")
    assert encoder.write(2, "6200:00", "0500") == "ok"
    assert encoder.read(2, "1800:05") == "0500"
    assert encoder.write(2, "1800:05", "0600") == "ok"
    assert encoder.read(2, "6200:00") == "0600"
    assert encoder.write(2, "6200:00", "0500") == "ok"
    encoder.start(2)
    encoder.drain()
    assert encoder.run(10) == [(0x182, "00 00 00 00")] * 2


def test_alarm_is_told_by_emcy_and_by_6503(streaming):
    streaming.rig.inject("encoder", "position_error", 0, 0.005, streaming.now_ns)
    assert streaming.run(0) == [(0x082, "00 73 01 01 00 00 00 00")]
    assert streaming.read(2, "6503:00") == "0100"
    assert streaming.run(5) == [(0x082, "00 00 00 00 00 00 00 00")]
    assert streaming.read(2, "6503:00") == "0000"


def test_warning_sets_its_bit_and_sends_nothing(streaming):
    streaming.rig.inject("encoder", "warning", 2, 0, streaming.now_ns)
    assert streaming.run(1) == []
    assert streaming.read(2, "6505:00") == "0400"


def test_freeze_jump_spike_and_near_rollover(streaming):
    world, rig = streaming.world, streaming.rig
    world.encoder_count = 100
    rig.inject("encoder", "freeze", 0, 0.002, streaming.now_ns)
    streaming.run(0)
    world.encoder_count = 200
    assert position(streaming) == 100
    streaming.run(2)
    assert position(streaming) == 200
    rig.inject("encoder", "spike", -50, 0, streaming.now_ns)
    streaming.run(0)
    assert [position(streaming), position(streaming)] == [150, 200]
    rig.inject("encoder", "jump", 1000, 0, streaming.now_ns)
    streaming.run(0)
    assert [position(streaming), position(streaming)] == [1200, 1200]
    rig.inject("encoder", "near_rollover", 2, 0, streaming.now_ns)
    streaming.run(0)
    assert position(streaming) == PHYSICAL_RANGE - 2
    world.encoder_count += 3
    assert position(streaming) == 1


def test_noise_moves_the_position_about_its_value(streaming):
    streaming.rig.inject("encoder", "noise", 10, 0, streaming.now_ns)
    streaming.world.encoder_count = 10_000
    streaming.run(0)
    positions = [position(streaming) for _ in range(50)]
    assert len(set(positions)) > 5
    assert all(abs(p - 10_000) < 60 for p in positions)
