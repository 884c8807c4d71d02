# SPDX-License-Identifier: Apache-2.0
"""The force sensor driver where values vary: mounting, status bits, any frames, its zero."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import Wire
from talk import SENSOR, Talk, converse

from screw_module_ros.devices.errors import NotNow
from screw_module_ros.devices.force_base import mounted, rotation
from screw_module_ros.devices.force_sensor_settings import (
    FREE_BASES,
    ForceSensorSettings,
    unchanged_samples,
)
from screw_module_ros.devices.tare import zero_error
from screw_module_ros.samples import ForceReading


def test_free_bases_are_those_of_the_design_and_meet_no_canopen_identifier():
    taken = {0x000, 0x080, 0x100, 0x7E4, 0x7E5}
    for function in (0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600,
                     0x700):  # fmt: skip
        taken |= {function + node for node in range(1, 128)}
    free = {
        base for base in range(0x80) if not taken & {base << 4 | opcode for opcode in range(16)}
    }
    assert free == FREE_BASES


# -- mounting ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("angles", "force", "torque"),
    [
        ({"roll": math.pi}, (1.0, -2.0, -3.0), (4.0, -5.0, -6.0)),
        ({"yaw": math.pi / 2}, (-2.0, 1.0, 3.0), (-5.0, 4.0, 6.0)),
        ({"pitch": math.pi / 2}, (3.0, 2.0, -1.0), (6.0, 5.0, -4.0)),
        ({"sign": -1}, (-1.0, -2.0, -3.0), (-4.0, -5.0, -6.0)),
    ],
)
def test_mounting_turns_force_and_torque(angles, force, torque):
    settings = SENSOR._replace(**angles)
    unit = [tuple(float(row == column) for column in range(6)) for row in range(6)]
    rows = mounted(unit, settings)
    gauges = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    wrench = [sum(a * g for a, g in zip(row, gauges, strict=True)) for row in rows]
    assert wrench == pytest.approx((*force, *torque))


@given(*[st.floats(-7, 7)] * 3)
def test_rotation_keeps_length_and_handedness(roll, pitch, yaw):
    x, y, z = rotation(roll, pitch, yaw)
    assert math.hypot(*x) == pytest.approx(1.0)
    cross = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
    assert cross == pytest.approx(z, abs=1e-9)


# -- frames --------------------------------------------------------------------------------------


@pytest.mark.parametrize("bit", range(16))
def test_each_status_bit(wire, bit):
    talk = Talk(wire, "sensor", [])
    talk.device.first = (1 << bit).to_bytes(2, "big").hex() + "00" * 6
    talk.run("1")
    sensor, is_fault = talk.driver, bit in (2, 3, 4, 5, 6, 7, 8, 11, 12, 14)
    assert (talk.sample.status, bool(sensor.fault)) == (1 << bit, is_fault)
    assert sensor.counters["status_faults"] == is_fault
    assert sensor.counters["reserved_bits"] == (bit in (9, 10, 13))


@pytest.mark.parametrize(
    ("rate", "freeze_time", "count"),
    [(1000.0, 0.5, 500), (50.0, 0.5, 25), (50.0, 0.05, 10), (1000.0, 0.0, 0), (2000.0, 1.0, 2000)],
)
def test_how_many_samples_are_too_many(rate, freeze_time, count):
    settings = ForceSensorSettings(rate=rate, freeze_time=freeze_time)
    assert unchanged_samples(settings) == count


def test_late_row_of_the_matrix_is_never_taken_for_the_next_row(wire):
    """Replies carry no row: the second reply to a repeated request must not count for the next."""
    talk = Talk(wire, "new_sensor", [])
    answer, late = talk.device.handle, []

    def one_behind(can_id, data):
        asks_row = can_id == 0x122 and len(data) == 1
        if asks_row and not late:
            late.append((can_id, data))  # its reply comes after the time limit
        elif can_id >> 4 == 0x12 and late:
            answer(*late.pop())
            late.append((can_id, data))  # the board is busy with the requests in their order
            if not asks_row:
                answer(*late.pop())
                talk.device.handle = answer
        else:
            answer(can_id, data)

    talk.device.handle = one_behind
    talk.device.first, talk.device.second = "00 00 00 00 03 E8 00 00", "07 D0 00 00 00 00"
    talk.begin()
    talk.run("1")
    assert talk.sample[3:9] == pytest.approx((-1.0, 2.0, 1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("frame", ["126 00", "12C"])
@pytest.mark.parametrize("calibration", [3, -1])
def test_who_sets_its_calibration_or_restarts_it_is_a_fault(wire, frame, calibration):
    """The status word shows neither, and our matrix is that of the calibration before."""
    converse(
        Talk(wire, "sensor", [f"calibration={calibration}"]),
        "run 1; see samples = 1; see fault = nothing",
        f"send {frame}; run 1; see sample = None",
        "see fault = *somebody else*calibration*; see counters.foreign_requests = 1",
        "drain; do clear_fault; sent 122 = 00 | 01 | 02 | 03 | 04 | 05",  # the matrix is read anew
        "run 1; see samples = 1; see fault = nothing",
    )


@given(st.lists(st.tuples(st.sampled_from([0x120, 0x121]), st.binary(max_size=8)), max_size=30))
def test_no_frames_whatever_crash_the_driver(frames):
    wire = Wire("any frames")
    try:
        talk = Talk(wire, "sensor", [])
        talk.device.answering = False
        for can_id, data in frames:
            talk.request()
            wire.emit(can_id, data)
            talk.pump()
            assert talk.sample is None or all(map(math.isfinite, talk.sample))
    finally:
        wire.close()


# -- taring --------------------------------------------------------------------------------------


def readings(*forces, status=0):
    return [ForceReading(n, n, n, 0.0, 0.0, fz, 0.0, 0.1, 0.0, status) for n, fz in
            enumerate(forces)]  # fmt: skip


@pytest.mark.parametrize(("trembles", "shows"), [(0.0, True), (0.03, True), (0.2, False)])
def test_the_zero_seems_off_by_a_force_that_no_hand_holds(trembles, shows):
    """The noise of a sample is 0.05 N; a hand at rest varies by some tenths of a newton."""
    draw = random.Random(1)
    force = [
        -0.8 + draw.gauss(0.0, 0.05) + trembles * math.sin(2.0 * math.pi * 0.8 * k / 100.0)
        for k in range(200)
    ]
    found = zero_error(readings(*force))
    assert found == (pytest.approx([0.0, 0.0, -0.8], abs=0.02) if shows else None)
    assert zero_error(readings(*force[:9])) is None


RESTARTS = {
    "by its watchdog": "let first 00 01 00 00 27 10 00 00; run 1",
    "after a silence": "let mute True; run 21; let mute False; run 3",
    "by us": "do reset; do start",
    "by others": "send 12C; run 1; do clear_fault",
    "with a new activation": "do stop; begin",
}


@pytest.mark.parametrize("restart", RESTARTS.values(), ids=RESTARTS)
def test_a_tare_does_not_outlive_a_restart_of_the_board(wire, restart):
    """The bias stays in use, since without it the force would jump by the handle's weight."""
    converse(
        Talk(wire, "sensor", []),
        "let first 00 00 00 00 27 10 00 00",  # 10 N in z
        "2 x tare; see tared = True",
        restart,
        "see tared = False; run 1; see sample.fz = 0",
        "do untare; see tared = False",  # that of before is as old
        "tare; see tared = True; do untare; see tared = False",
    )


@pytest.mark.parametrize(
    ("samples", "reason"),
    [
        (readings(1.0), "2 are needed"),
        (readings(31.0, 31.0), "loaded with 31.0 N"),
        (readings(-31.0, -31.0), "loaded with 31.0 N"),
        (readings(5.0, -5.0), "varies by 5.0 N"),
        (readings(1.0, 1.0, status=0x4000), "CAN bus error"),
    ],
)
def test_taring_refuses(wire, samples, reason):
    sensor = Talk(wire, "sensor", []).driver
    with pytest.raises(NotNow, match=reason):
        sensor.tare(samples)
    assert sensor.bias == (0.0,) * 6
