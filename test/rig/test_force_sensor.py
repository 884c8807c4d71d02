# SPDX-License-Identifier: Apache-2.0
"""The simulated NETCANOEM against the layouts of manual 9610-05-1030: id = 0x12 << 4 | opcode."""

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.rig.force_sensor import CONVERTER_NOISE
from screw_module_ros.rig.transducer_calibration import CALIBRATIONS, ZERO_OFFSETS

MS = 1_000_000


def gauges(frames) -> tuple[int, list[int]]:
    """Decode the two halves of a sample: status, gauges 0 to 5."""
    (first, even), (second, odd) = frames
    assert (first, second) == (0x120, 0x121)
    status, sg0, sg2, sg4 = struct.unpack(">Hhhh", bytes.fromhex(even))
    sg1, sg3, sg5 = struct.unpack(">hhh", bytes.fromhex(odd))
    return status, [sg0, sg1, sg2, sg3, sg4, sg5]


def read_matrix(bench) -> np.ndarray:
    rows = []
    for row in range(6):
        frames = bench.ask(0x122, f"{row:02X}")
        assert [can_id for can_id, _ in frames] == [0x122, 0x123, 0x124]
        rows.append([v for _, p in frames for v in struct.unpack(">ff", bytes.fromhex(p))])
    return np.array(rows)


def test_matrix_frames_carry_big_endian_floats(sensor):
    frames = sensor.ask(0x122, "02")
    values = [v for _, p in frames for v in struct.unpack(">ff", bytes.fromhex(p))]
    assert values == pytest.approx(CALIBRATIONS[0].matrix[2])
    # Fz is carried by the three axial gauges in equal parts, but for the cross-talk.
    assert values[0::2] == pytest.approx([144 / 130] * 3, rel=0.15)


def test_wrench_comes_back_through_the_matrix(sensor):
    wrench = (12.0, -7.5, 40.0, 0.8, -0.3, 1.1)
    _, zero = gauges(sensor.ask(0x120))
    assert zero == list(ZERO_OFFSETS)
    sensor.world.load = wrench
    _, loaded = gauges(sensor.ask(0x120))
    counts = read_matrix(sensor) @ (np.array(loaded) - np.array(zero))
    assert counts / [144, 144, 144, 5665, 5665, 5665] == pytest.approx(wrench, abs=0.02)


def test_second_calibration_is_in_pounds(sensor):
    sensor.world.load = (0.0, 0.0, 44.482216152605, 0.0, 0.0, 0.0)
    assert sensor.ask(0x126, "01") == [(0x126, "01")]
    assert sensor.ask(0x128) == [(0x128, "01 01")]
    assert sensor.ask(0x127) == [(0x127, "00 00 02 80 00 00 02 80")]
    _, loaded = gauges(sensor.ask(0x120))
    counts = read_matrix(sensor) @ (np.array(loaded) - np.array(ZERO_OFFSETS))
    assert counts[2] / 640 == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize("bit", range(16))
def test_status_bits_one_by_one(sensor, bit):
    sensor.rig.inject("force_sensor", "status", bit, 0.001, sensor.now_ns)
    sensor.run(0)
    fault = bit in (2, 3, 4, 5, 6, 7, 8, 11, 12, 14)
    assert gauges(sensor.ask(0x120))[0] == (1 << bit) | (0x8000 if fault else 0)
    sensor.run(1)
    assert gauges(sensor.ask(0x120))[0] == 0


def later(bench):
    """Ask one period after the last time: the noise belongs to the time."""
    bench.now_ns += 1_000_000
    return bench.ask(0x120)


def test_the_noise_belongs_to_the_time(make_bench):
    bench = make_bench("force_sensor")
    once = gauges(bench.ask(0x120))
    assert gauges(bench.ask(0x120)) == once
    asked_often = [gauges(later(bench)) for _ in range(4)][-1]
    other = make_bench("force_sensor")
    other.now_ns += 3_000_000
    assert gauges(later(other)) == asked_often


def test_bias_drift_noise_freeze_and_half(sensor):
    inverse = CALIBRATIONS[0].gains

    def force() -> float:
        _, loaded = gauges(sensor.ask(0x120))
        return np.linalg.solve(np.array(inverse), np.array(loaded) - np.array(ZERO_OFFSETS))[2]

    def inject(fault: str, value: float = 0.0) -> None:
        sensor.rig.inject("force_sensor", fault, value, 0, sensor.now_ns)
        sensor.run(0)

    inject("bias", 20.0)
    assert force() == pytest.approx(20.0, abs=0.05)
    inject("clear")
    inject("drift", -50.0)
    sensor.run(100)
    assert force() == pytest.approx(-5.0, abs=0.1)
    inject("clear")
    inject("noise", 100.0)
    assert len({tuple(gauges(later(sensor))[1]) for _ in range(5)}) == 5
    inject("clear")
    inject("freeze")
    sensor.world.load = (0.0, 0.0, 30.0, 0.0, 0.0, 0.0)
    assert force() == pytest.approx(0.0, abs=0.05)
    inject("clear")
    assert force() == pytest.approx(30.0, abs=0.05)
    inject("half")
    assert [can_id for can_id, _ in sensor.ask(0x120)] == [0x120]


def test_a_healthy_converter_flickers_though_the_world_stands_still(make_bench):
    """By about a count, the same in every run: nothing else tells it from one that hangs."""

    def words() -> list[tuple]:
        bench = make_bench("force_sensor")
        return [tuple(gauges(later(bench))[1]) for _ in range(1000)]

    first = words()
    # six axes that all round to the same count twice: about once in 2000 pairs
    assert sum(before == after for before, after in itertools.pairwise(first)) <= 5
    noise = np.array(first) - np.array(ZERO_OFFSETS)
    assert np.abs(noise.mean(axis=0)).max() < 0.15
    assert noise.std(axis=0) == pytest.approx([CONVERTER_NOISE] * 6, abs=0.15)
    assert words() == first


loads = st.tuples(*[st.floats(-100.0, 100.0)] * 3, *[st.floats(-3.0, 3.0)] * 3)


@given(loads)
def test_calibrations_invert_what_the_gauges_do(load):
    for calibration in CALIBRATIONS.values():
        counts = np.array(calibration.matrix) @ np.array(calibration.gauges(load))
        scale = calibration.force_counts, calibration.torque_counts
        newtons = 4.4482216152605 if calibration.force_unit == 1 else 1.0
        metres = 0.0254 * newtons if calibration.torque_unit == 1 else 1.0
        back = [*counts[:3] / scale[0] * newtons, *counts[3:] / scale[1] * metres]
        assert back == pytest.approx(load, abs=1e-6)


def test_the_therapy_s_loads_stay_within_the_gauges():
    for calibration in CALIBRATIONS.values():
        for load in np.vstack(
            [np.diag([150.0] * 3 + [4.0] * 3), -np.diag([150.0] * 3 + [4.0] * 3)]
        ):
            assert max(map(abs, calibration.gauges(tuple(load)))) < 32_000
