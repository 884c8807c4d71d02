# SPDX-License-Identifier: Apache-2.0
"""The force sensor driver against a scripted ATI NETCANOEM board: raw frames in, wrenches out."""

from __future__ import annotations

import math
import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from running_drivers import tick
from scripted import Wire

from screw_module_ros.devices import ati
from screw_module_ros.devices.errors import BusError, NotAnswering, NotNow, Occupied, WrongDevice
from screw_module_ros.devices.force_sensor import ForceSensor
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings, unchanged_samples
from screw_module_ros.devices.tare import zero_error
from screw_module_ros.samples import ForceReading

SETTINGS = ForceSensorSettings(listen=0.0, timeout=0.02, tare_samples=2)


def started(wire, settings=SETTINGS):
    sensor = ForceSensor(wire.port, settings)
    sensor.configure()
    sensor.start()
    return sensor


@pytest.fixture
def sensor(wire, sensor_end):
    return started(wire)


# -- frames by hand ------------------------------------------------------------------------------


def test_poll_and_its_two_halves(wire, sensor, sensor_end):
    #                  status  gauge 0  gauge 2  gauge 4
    sensor_end.first = "00 01  03 E8    FC 18    00 64"
    #                   gauge 1  gauge 3  gauge 5
    sensor_end.second = "07 D0    27 10    FF 9C"
    sample = tick(wire, sensor, 9)
    assert wire.frames[-1] == (0x120, b"")
    assert (sample.sequence, sample.monotonic_ns, sample.stamp_ns) == (
        9, wire.now_ns, wire.now_ns + 5,
    )  # fmt: skip
    # Row 0 is 2 g0 - 0.5 g1, 1000 counts per N; rows 3 to 5 have 10000 counts per Nm.
    assert sample[3:9] == pytest.approx((1.0, 2.0, -1.0, 1.0, 0.01, -0.01))
    assert sample.status == 1
    assert sensor.fault == ""  # a watchdog reset alone is no fault


def test_dialogue_frames(wire, sensor):
    asked = [(i, d) for i, d in wire.frames if i >> 4 == 0x12]
    assert asked[0] == (0x125, b"")
    assert asked[1:5] == [(0x128, b""), (0x127, b""), (0x125, b""), (0x12F, b"")]
    assert asked[5:] == [(0x122, bytes([row])) for row in range(6)]
    assert sensor.sensor == ("FT012345", "2.5.300", 1000, 10000, 1.0, 1.0)


def test_calibration_whose_reply_equals_the_request(wire, sensor_end):
    started(wire, SETTINGS._replace(calibration=3))
    assert wire.sent(0x126) == [b"\x03"]


def test_diagnostic_voltages(wire, sensor):
    sensor.poll_slow()
    names = ("mid supply", "thermistor", "power", "DAC", "ground")
    counts = (0x0010, 0x0210, 0x0310, 0x0410, 0x0510)
    assert sensor.voltages == dict(zip(names, counts, strict=True))


# -- who is there --------------------------------------------------------------------------------


def test_silent_sensor_is_named(wire):
    with pytest.raises(NotAnswering, match=r"base id 0x12.*does not answer.*check its power"):
        ForceSensor(wire.port, SETTINGS).configure()


def test_another_serial_is_refused(wire, sensor_end):
    with pytest.raises(WrongDevice, match="FT012345"):
        started(wire, SETTINGS._replace(serial="FT0"))


@pytest.mark.parametrize("codes", ["00 03", "06 03", "02 00", "02 07"])
def test_units_that_are_not_known_are_refused(wire, sensor_end, codes):
    sensor_end.units = codes
    with pytest.raises(WrongDevice, match="units that are not known"):
        started(wire)


@pytest.mark.parametrize(
    ("codes", "force", "torque"),
    [("01 02", 4.4482216, 1.3558179), ("04 04", 1000.0, 0.001), ("05 05", 9.80665, 0.0980665)],
)
def test_other_units_are_converted(wire, sensor_end, codes, force, torque):
    sensor_end.units = codes
    sensor_end.first, sensor_end.second = "00 00 00 00 03 E8 00 00", "00 00 27 10 00 00"
    sample = tick(wire, started(wire))
    assert sample.fz == pytest.approx(force)
    assert sample.tx == pytest.approx(torque)


@pytest.mark.parametrize("cell", ["7F C0 00 00", "7F 80 00 00", "00 00 00 00"])
def test_matrix_that_makes_no_sense_is_refused(wire, sensor_end, cell):
    sensor_end.rows[0][0] = f"{cell} 00 00 00 00"
    with pytest.raises(WrongDevice, match="matrix"):
        started(wire)


@pytest.mark.parametrize("counts", ["00 00 00 00", "FF FF FF 70", "FF FF FF FF"])
def test_counts_per_unit_of_zero_or_less_are_refused(wire, sensor_end, counts):
    sensor_end.counts = f"{counts} 00 00 27 10"
    with pytest.raises(WrongDevice, match="counts per unit"):
        started(wire)


def test_late_row_of_the_matrix_is_never_taken_for_the_next_row(wire, sensor_end, monkeypatch):
    """Replies carry no row: the second reply to a repeated request must not count for the next."""
    answer, late = sensor_end.handle, []

    def one_behind(can_id, data):
        asks_row = can_id == 0x122 and len(data) == 1
        if asks_row and not late:
            late.append((can_id, data))  # its reply comes after the time limit
            return
        if can_id >> 4 == 0x12 and late:
            answer(*late.pop())
            late.append((can_id, data))  # the board is busy with the requests in their order
            if not asks_row:
                answer(*late.pop())
                sensor_end.handle = answer
            return
        answer(can_id, data)

    sensor_end.handle = one_behind
    sensor_end.first, sensor_end.second = "00 00 00 00 03 E8 00 00", "07 D0 00 00 00 00"
    sample = tick(wire, started(wire))
    assert sample[3:9] == pytest.approx((-1.0, 2.0, 1.0, 0.0, 0.0, 0.0))


def test_second_poller_is_refused_before_anything_is_sent(wire, sensor_end):
    wire.emit(0x120, "")
    with pytest.raises(Occupied, match="second copy"):
        ForceSensor(wire.port, SETTINGS._replace(listen=0.05)).configure()
    assert wire.frames == []


@pytest.mark.parametrize(
    ("field", "value"),
    [("base_id", 0x10), ("base_id", 0x20), ("sign", 0), ("roll", math.inf), ("calibration", 16)],
)
def test_settings_out_of_range_name_the_field(wire, field, value):
    with pytest.raises(ValueError, match=field):
        ForceSensor(wire.port, SETTINGS._replace(**{field: value}))


def test_free_bases_are_those_of_the_design_and_meet_no_canopen_identifier():
    taken = {0x000, 0x080, 0x100, 0x7E4, 0x7E5}
    for function in (0x080, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600,
                     0x700):  # fmt: skip
        taken |= {function + node for node in range(1, 128)}
    free = {
        base for base in range(0x80) if not taken & {base << 4 | opcode for opcode in range(16)}
    }
    assert free == ati.FREE_BASES


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
    settings = SETTINGS._replace(**angles)
    unit = [tuple(float(row == column) for column in range(6)) for row in range(6)]
    turn = ati.rotation(settings.roll, settings.pitch, settings.yaw)
    rows = ati.counts_to_wrench(unit, ati.SensorIdentity("", "", 1, 1), turn, settings.sign)
    gauges = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    wrench = [sum(a * g for a, g in zip(row, gauges, strict=True)) for row in rows]
    assert wrench == pytest.approx((*force, *torque))


@given(*[st.floats(-7, 7)] * 3)
def test_rotation_keeps_length_and_handedness(roll, pitch, yaw):
    x, y, z = ati.rotation(roll, pitch, yaw)
    assert math.hypot(*x) == pytest.approx(1.0)
    cross = (x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0])
    assert cross == pytest.approx(z, abs=1e-9)


# -- status --------------------------------------------------------------------------------------


@pytest.mark.parametrize("bit", range(16))
def test_each_status_bit(wire, sensor, sensor_end, bit):
    sensor_end.first = (1 << bit).to_bytes(2, "big").hex() + "00" * 6
    sample = tick(wire, sensor)
    assert sample.status == 1 << bit
    is_fault = bit in (2, 3, 4, 5, 6, 7, 8, 11, 12, 14)
    assert bool(sensor.fault) == is_fault
    assert sensor.counters["status_faults"] == is_fault
    assert sensor.counters["reserved_bits"] == (bit in (9, 10, 13))


def test_status_fault_is_latched_by_name(wire, sensor, sensor_end):
    sensor_end.first = "C8 00" + "00" * 6
    tick(wire, sensor)
    sensor_end.first = "00" * 8
    tick(wire, sensor)
    assert sensor.fault == (
        "force sensor status: sensor temperature too high, CAN bus error, any error"
    )
    wire.frames.clear()
    sensor.clear_fault()
    assert sensor.fault == ""
    assert wire.frames[0] == (0x12C, b"")  # what the board latches, its restart clears
    assert tick(wire, sensor) is not None


def test_restart_loses_a_calibration_that_was_chosen(wire, sensor_end):
    sensor = started(wire, SETTINGS._replace(calibration=3))
    assert tick(wire, sensor) is not None
    sensor_end.first = "80 01" + "00" * 6
    assert tick(wire, sensor) is None
    assert "restarted" in sensor.fault
    assert sensor.counters["restarts"] == 1
    sensor.clear_fault()
    assert wire.sent(0x126) == [b"\x03", b"\x03"]
    assert tick(wire, sensor) is not None


def test_a_long_silence_loses_a_calibration_that_was_chosen(wire, sensor_end):
    sensor = started(wire, SETTINGS._replace(calibration=3))
    for silent, fault in ((20, ""), (21, "was silent and may have restarted")):
        assert tick(wire, sensor) is not None
        sensor_end.mute = True  # the supply is off; the status word does not tell that later
        assert set(ticks(wire, sensor, silent - 1)) == {None}
        sensor_end.mute = False
        assert (ticks(wire, sensor, 3)[-1] is None) == bool(fault)
        assert fault in sensor.fault
    sensor.clear_fault()
    assert wire.sent(0x126) == [b"\x03", b"\x03"]
    assert tick(wire, sensor) is not None


def test_a_long_silence_is_no_fault_of_its_own(wire, sensor, sensor_end):
    sensor_end.mute = True
    ticks(wire, sensor, 200)
    sensor_end.mute = False
    assert ticks(wire, sensor, 3)[-1] is not None
    assert sensor.fault == ""


@pytest.mark.parametrize("gauge", ["7F FF", "80 00", "80 01"])
@pytest.mark.parametrize("half", ["first", "second"])
def test_saturated_gauge_is_no_sample(wire, sensor, sensor_end, gauge, half):
    if half == "first":
        sensor_end.first = f"00 00 {gauge} 00 00 00 00"
    else:
        sensor_end.second = f"00 00 {gauge} 00 00"
    assert tick(wire, sensor) is None
    assert sensor.counters["saturated"] == 1
    sensor_end.first, sensor_end.second = "00" * 8, "00" * 6
    assert tick(wire, sensor) is not None


# -- gauges that stand still -----------------------------------------------------------------------

FREEZING = SETTINGS._replace(rate=50.0, freeze_time=0.5)
UNCHANGED = 25  # half a second at 50 Hz


def show(sensor_end, gauge_0=0, gauge_5=0, status=0):
    """Set the words of the next sample; gauge 0 is in the first half, gauge 5 in the second."""
    sensor_end.first = struct.pack(">Hhhh", status, gauge_0, 20, 30).hex()
    sensor_end.second = struct.pack(">hhh", 40, 50, gauge_5).hex()


def ticks(wire, sensor, count):
    return [tick(wire, sensor, n) for n in range(count)]


def frozen(wire, sensor_end, settings=FREEZING):
    sensor = started(wire, settings)
    ticks(wire, sensor, unchanged_samples(settings) + 1)
    assert "have not changed" in sensor.fault
    return sensor


@pytest.mark.parametrize(
    ("rate", "freeze_time", "count"),
    [(1000.0, 0.5, 500), (50.0, 0.5, 25), (50.0, 0.05, 10), (1000.0, 0.0, 0), (2000.0, 1.0, 2000)],
)
def test_how_many_samples_are_too_many(rate, freeze_time, count):
    settings = ForceSensorSettings(rate=rate, freeze_time=freeze_time)
    assert unchanged_samples(settings) == count


def test_frozen_gauges_are_noticed_after_their_time_and_not_before(wire, sensor_end):
    sensor = started(wire, FREEZING)
    samples = ticks(wire, sensor, 1 + UNCHANGED)
    assert None not in samples[:-1]
    assert samples[-1] is None
    assert sensor.fault == (
        "the gauges of the force sensor have not changed for 0.5 s: its converter hangs; restart "
        "the sensor, then tare"
    )


@pytest.mark.parametrize("gauge", [{"gauge_0": 1}, {"gauge_5": 1}])
def test_one_count_of_one_gauge_in_time_is_enough(wire, sensor_end, gauge):
    sensor = started(wire, FREEZING)
    for _ in range(5):
        show(sensor_end)
        assert None not in ticks(wire, sensor, UNCHANGED)
        show(sensor_end, **gauge)
        assert tick(wire, sensor) is not None
    assert sensor.fault == ""


def test_a_status_word_that_changes_is_no_gauge(wire, sensor_end):
    sensor = started(wire, FREEZING)
    for number in range(1 + UNCHANGED):
        show(sensor_end, status=number % 2 << 9)
        tick(wire, sensor)
    assert "have not changed" in sensor.fault


def test_frozen_stays_when_the_gauges_move_again(wire, sensor_end):
    sensor = frozen(wire, sensor_end)
    for value in range(10):
        show(sensor_end, gauge_0=value)
        assert tick(wire, sensor) is None
    assert "have not changed" in sensor.fault
    assert sensor.counters["frozen"] == 11


def test_frozen_is_cleared_by_a_restart_of_the_board(wire, sensor_end):
    sensor = frozen(wire, sensor_end)
    show(sensor_end, gauge_0=1)
    wire.frames.clear()
    sensor.clear_fault()
    assert wire.frames[0] == (0x12C, b"")
    assert sensor.fault == ""
    assert None not in ticks(wire, sensor, UNCHANGED)


def test_frozen_comes_back_at_once_while_its_cause_persists(wire, sensor_end):
    sensor = frozen(wire, sensor_end)
    sensor.clear_fault()
    assert tick(wire, sensor) is None
    assert "have not changed" in sensor.fault
    with pytest.raises(NotNow, match="have not changed"):
        sensor.tare(readings(1.0, 1.0))


def test_a_failed_restart_leaves_it_frozen(wire, sensor_end):
    sensor = frozen(wire, sensor_end)
    sensor_end.mute = True
    with pytest.raises(NotAnswering):
        sensor.clear_fault()
    sensor_end.mute = False
    show(sensor_end, gauge_0=1)
    assert "have not changed" in sensor.fault
    assert tick(wire, sensor) is None


def test_board_that_restarts_slowly_is_not_restarted_again(wire, sensor_end):
    sensor = frozen(wire, sensor_end)
    sensor_end.mute = True  # for longer than the two tries
    with pytest.raises(NotAnswering):
        sensor.clear_fault()
    sensor_end.mute = False
    show(sensor_end, gauge_0=1)
    sensor.clear_fault()
    assert wire.sent(0x12C) == [b""]
    assert sensor.fault == ""
    assert tick(wire, sensor) is not None


def test_zero_switches_the_look_at_frozen_gauges_off(wire, sensor_end):
    sensor = started(wire, FREEZING._replace(freeze_time=0.0))
    assert None not in ticks(wire, sensor, 4 * UNCHANGED)
    assert sensor.fault == ""


# -- what goes wrong -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("can_id", "payload"),
    [(0x120, "00" * 7), (0x120, "00"), (0x121, ""), (0x121, "00" * 5), (0x121, "00" * 8)],
)
def test_wrong_length_is_counted_and_no_sample(wire, sensor, sensor_end, can_id, payload):
    sensor_end.answers_polls = False
    sensor.request(1, wire.advance(), 0)
    for identifier, right in ((0x120, "00" * 8), (0x121, "00" * 6)):
        wire.emit(identifier, payload if identifier == can_id else right)
    wire.port.pump()
    assert sensor.reading() is None
    assert sensor.counters["wrong_length"] == 1
    sensor_end.answers_polls = True
    assert tick(wire, sensor, 2).sequence == 2


def test_late_half_is_discarded_and_counted(wire, sensor, sensor_end):
    sensor_end.answers_polls = False
    sensor.request(1, wire.advance(), 0)
    wire.emit(0x120, "00 00 11 11 11 11 11 11")
    wire.port.pump()
    assert sensor.reading() is None
    sensor.request(2, wire.advance(), 0)
    wire.emit(0x121, "22 22 22 22 22 22")  # of the first request
    wire.port.pump()
    assert sensor.reading() is None
    assert sensor.counters["late"] == 1
    sensor_end.answers_polls = True
    samples = [tick(wire, sensor, n) for n in range(3, 8)]
    assert [s.sequence for s in samples if s][-3:] == [5, 6, 7]


def test_late_pair_before_the_new_one(wire, sensor, sensor_end):
    sensor_end.answers_polls = False
    sensor.request(1, wire.advance(), 0)
    sensor.request(2, wire.advance(), 0)
    for gauge in ("00 64", "03 E8"):
        wire.emit(0x120, f"00 00 00 00 {gauge} 00 00")
        wire.emit(0x121, "00" * 6)
    wire.port.pump()
    sample = sensor.reading()
    assert (sample.sequence, sample.fz) == (2, pytest.approx(1.0))
    assert sensor.counters["late"] == 2
    assert sensor.counters["missing"] == 1


@pytest.mark.parametrize("answered", [True, False])
def test_a_tick_without_a_sample_is_missing_also_when_the_bus_fails(
    wire, sensor, sensor_end, monkeypatch, answered
):
    def fails(timeout_s=0.0):
        raise BusError("the cable is out")

    sensor_end.answers_polls = answered
    assert (tick(wire, sensor, 1) is not None) == answered
    monkeypatch.setattr(wire.port, "pump", fails)
    for _ in range(3):
        with pytest.raises(BusError):
            sensor.request(2, wire.advance(), 0)
    # The third one has not ended yet.
    assert sensor.counters["missing_in_a_row"] == (2 if answered else 3)
    assert (sensor.counters["requests"], sensor.counters["bus_errors"]) == (4, 3)


def test_one_pair_too_many_does_not_make_all_later_samples_old(wire, sensor, sensor_end):
    for n in range(10):
        sensor_end.first = f"00 00 00 00 {100 * n:04X} 00 00"
        sample = tick(wire, sensor, n)
        assert (sample.sequence, sample.fz) == (n, pytest.approx(0.1 * n))
        if n == 3:  # after the tick's last look
            wire.emit(0x120, "00 00 00 00 7F FF 00 00")
            wire.emit(0x121, "00" * 6)


def test_halves_in_the_wrong_order_are_no_sample(wire, sensor, sensor_end):
    sensor_end.answers_polls = False
    sensor.request(1, wire.advance(), 0)
    wire.emit(0x121, "00" * 6)
    wire.emit(0x120, "00" * 8)
    wire.port.pump()
    assert sensor.reading() is None
    assert sensor.counters["out_of_order"] == 1


def test_another_poller_is_a_fault(wire, sensor):
    wire.emit(0x120, "")
    wire.port.pump()
    assert "somebody else polls" in sensor.fault
    assert sensor.counters["foreign_requests"] == 1


@pytest.mark.parametrize(("can_id", "data"), [(0x126, "00"), (0x12C, "")])
@pytest.mark.parametrize("calibration", [3, -1])
def test_who_sets_its_calibration_or_restarts_it_is_a_fault(
    wire, sensor_end, can_id, data, calibration
):
    """The status word shows neither, and our matrix is that of the calibration before."""
    sensor = started(wire, SETTINGS._replace(calibration=calibration))
    assert tick(wire, sensor) is not None and sensor.fault == ""
    wire.emit(can_id, data)
    assert tick(wire, sensor) is None
    assert "somebody else" in sensor.fault and "calibration" in sensor.fault
    assert sensor.counters["foreign_requests"] == 1
    wire.frames.clear()
    sensor.clear_fault()
    assert len(wire.sent(0x122)) == 6, "the matrix is read anew"
    assert tick(wire, sensor) is not None and sensor.fault == ""


@given(st.lists(st.tuples(st.sampled_from([0x120, 0x121]), st.binary(max_size=8)), max_size=30))
def test_no_frames_whatever_crash_the_driver(frames):
    wire = Wire("any frames")
    try:
        sensor = ForceSensor(wire.port, SETTINGS)
        sensor._rows = tuple((1.0,) * 6 for _ in range(6))
        sensor.start()
        for sequence, (can_id, data) in enumerate(frames):
            sensor.request(sequence, wire.advance(), 0)
            wire.emit(can_id, data)
            wire.port.pump()
            sample = sensor.reading()
            assert sample is None or all(map(math.isfinite, sample))
    finally:
        wire.close()


# -- taring --------------------------------------------------------------------------------------


def readings(*forces, status=0):
    return [ForceReading(n, n, n, 0.0, 0.0, fz, 0.0, 0.1, 0.0, status) for n, fz in
            enumerate(forces)]  # fmt: skip


@pytest.mark.parametrize("trembles", [0.0, 0.03, 0.2])
def test_the_zero_seems_off_by_a_force_that_no_hand_holds(trembles):
    """The noise of a sample is 0.05 N; a hand at rest varies by some tenths of a newton."""
    draw = random.Random(1)
    force = [
        -0.8 + draw.gauss(0.0, 0.05) + trembles * math.sin(2.0 * math.pi * 0.8 * k / 100.0)
        for k in range(200)
    ]
    found = zero_error(readings(*force))
    if trembles > 0.1:
        assert found is None
    else:
        assert found == pytest.approx([0.0, 0.0, -0.8], abs=0.02)


def test_too_few_samples_show_no_error_of_the_zero():
    assert zero_error(readings(*[0.5] * 9)) is None


def test_tare_moves_the_zero_and_can_be_undone(wire, sensor, sensor_end):
    sensor_end.first = "00 00 00 00 27 10 00 00"  # 10 N in z
    samples = [tick(wire, sensor), tick(wire, sensor)]
    assert sensor.tare(samples)[2] == pytest.approx(10.0)
    assert tick(wire, sensor).fz == pytest.approx(0.0)
    sensor_end.first = "00 00 00 00 2A F8 00 00"  # 11 N
    sensor.tare([tick(wire, sensor), tick(wire, sensor)])
    assert tick(wire, sensor).fz == pytest.approx(0.0)
    sensor.untare()
    assert tick(wire, sensor).fz == pytest.approx(1.0) and sensor.tared, "the first one counts"
    for _ in range(2):
        sensor.untare()
        assert tick(wire, sensor).fz == pytest.approx(11.0) and not sensor.tared


def watchdog(wire, sensor, sensor_end):
    sensor_end.first = "00 01" + sensor_end.first[5:]
    tick(wire, sensor)


def silence(wire, sensor, sensor_end):
    sensor_end.mute = True
    ticks(wire, sensor, 21)
    sensor_end.mute = False
    ticks(wire, sensor, 3)


def restart_by_us(wire, sensor, sensor_end):
    sensor.reset()
    sensor.start()


def restart_by_others(wire, sensor, sensor_end):
    wire.emit(0x12C, "")
    tick(wire, sensor)
    sensor.clear_fault()


def new_activation(wire, sensor, sensor_end):
    sensor.stop()
    sensor.configure()
    sensor.start()


@pytest.mark.parametrize(
    "restart", [watchdog, silence, restart_by_us, restart_by_others, new_activation]
)
def test_a_tare_does_not_outlive_a_restart_of_the_board(wire, sensor, sensor_end, restart):
    """The bias stays in use, since without it the force would jump by the handle's weight."""
    sensor_end.first = "00 00 00 00 27 10 00 00"  # 10 N in z
    for _ in range(2):
        sensor.tare([tick(wire, sensor), tick(wire, sensor)])
    assert sensor.tared
    restart(wire, sensor, sensor_end)
    assert not sensor.tared
    assert tick(wire, sensor).fz == pytest.approx(0.0)
    sensor.untare()
    assert not sensor.tared, "that of before is as old"
    sensor.tare([tick(wire, sensor), tick(wire, sensor)])
    assert sensor.tared
    sensor.untare()
    assert not sensor.tared


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
def test_taring_refuses(wire, sensor, samples, reason):
    with pytest.raises(NotNow, match=reason):
        sensor.tare(samples)
    assert sensor.bias == (0.0,) * 6
