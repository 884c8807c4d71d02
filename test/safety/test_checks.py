# SPDX-License-Identifier: Apache-2.0
"""Every implausible sample latches, nothing but `reset` unlatches, and healthy samples pass."""

import math

import pytest

from screw_module_ros.safety.checks import VerticalChecks, WatchSettings
from screw_module_ros.samples import (
    FORCE_FAULT_MASK,
    FORCE_STATUS_BITS,
    EncoderReading,
    ForceReading,
)

PERIOD_NS = 1_000_000
LATER_NS = 200_000  # when samples are seen, after their acquisition


def encoder(tick, position=0.18, velocity=0.0, homed=True, stamp_ns=None):
    stamp_ns = tick * PERIOD_NS if stamp_ns is None else stamp_ns
    return EncoderReading(tick, stamp_ns, 0, 0, position, velocity, homed)


def force(tick, fz=0.0, status=0, fx=0.0, tx=0.0, stamp_ns=None):
    stamp_ns = tick * PERIOD_NS if stamp_ns is None else stamp_ns
    return ForceReading(tick, stamp_ns, 0, fx, 0.0, fz, tx, 0.0, 0.0, status)


class Bench:
    """A watch and a tick counter."""

    def __init__(self, **changes):
        self.watch = VerticalChecks(WatchSettings(**changes), PERIOD_NS)
        self.tick = 100

    @property
    def now_ns(self):
        return self.tick * PERIOD_NS + LATER_NS

    def step(self, position=0.18, velocity=0.0, homed=True, fz=0.0, status=0):
        self.tick += 1
        self.watch.force(force(self.tick, fz, status), self.now_ns)
        self.watch.encoder(encoder(self.tick, position, velocity, homed), self.now_ns)
        return self.watch.check(self.now_ns)


@pytest.fixture
def bench():
    bench = Bench()
    for _ in range(5):
        assert bench.step() == ""
    return bench


def assert_latched(bench, named):
    """The reason names the cause and survives healthy samples until the reset."""
    assert named in bench.watch.fault.reason
    for _ in range(20):
        assert named in bench.step()
    assert bench.watch.reset(bench.now_ns) == ""
    assert bench.step() == ""


def test_what_never_came_is_waited_for():
    bench = Bench()
    assert bench.watch.check(bench.now_ns) == "encoder: no sample yet"
    bench.watch.encoder(encoder(100), bench.now_ns)
    assert bench.watch.check(bench.now_ns) == "force sensor: no sample yet"
    assert bench.watch.fault.reason == ""


def test_a_robot_without_a_force_sensor_can_be_allowed():
    bench = Bench(force_required=False)
    bench.watch.encoder(encoder(100), bench.now_ns)
    assert bench.watch.check(bench.now_ns) == ""


def test_a_force_sensor_that_need_not_be_there_must_not_go():
    bench = Bench(force_required=False)
    for _ in range(5):
        assert bench.step() == ""
    for _ in range(7):
        bench.tick += 1
        bench.watch.encoder(encoder(bench.tick), bench.now_ns)
        reason = bench.watch.check(bench.now_ns)
    assert "force sensor: no sample for" in reason


def test_not_homed_is_waited_for_and_homing_is_no_jump():
    bench = Bench()
    for _ in range(3):
        assert bench.step(position=0.0, homed=False) == "encoder: not homed"
    assert bench.step(position=0.2, homed=True) == ""


def test_a_lost_home_is_a_fault(bench):
    bench.step(homed=False)
    assert "home" in bench.watch.fault.reason


@pytest.mark.parametrize("silent", ["encoder", "force sensor"])
def test_silence_of_more_than_five_periods_is_a_fault(bench, silent):
    for missing in range(1, 7):
        bench.tick += 1
        if silent != "encoder":
            bench.watch.encoder(encoder(bench.tick), bench.now_ns)
        if silent != "force sensor":
            bench.watch.force(force(bench.tick), bench.now_ns)
        reason = bench.watch.check(bench.now_ns)
        assert (reason == "") == (missing < 5), f"{missing} missing: {reason}"
    assert f"{silent}: no sample for" in bench.watch.fault.reason


def test_a_cause_that_persists_latches_again_on_reset(bench):
    bench.tick += 50
    assert "no sample" in bench.watch.check(bench.now_ns)
    assert "no sample" in bench.watch.reset(bench.now_ns)
    assert "no sample" in bench.watch.fault.reason


def test_a_gap_is_a_fault_even_if_nobody_asked_in_between(bench):
    bench.tick += 7
    bench.step()
    assert_latched(bench, "gap of 8.0 ms")


@pytest.mark.parametrize("gap", range(4))
def test_a_few_lost_samples_are_none(bench, gap):
    bench.tick += gap
    assert bench.step() == ""


@pytest.mark.parametrize("jump", [0.001, -0.001, 0.05, -0.1])
def test_a_jump_is_a_fault(bench, jump):
    bench.step(position=0.18 + jump)
    assert "jumped by" in bench.watch.fault.reason


def test_motion_under_the_motors_full_force_is_none(bench):
    """Peak force of 528 N on 5.5 kg for 5 ms, then the same force braking."""
    position, velocity = 0.18, 0.0
    for acceleration in [96.0] * 5 + [-96.0] * 10:
        velocity += acceleration * 0.001
        position += velocity * 0.001
        assert bench.step(position, velocity) == ""


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"velocity": 1.1}, "faster than"),
        ({"velocity": -1.1}, "faster than"),
        ({"velocity": math.nan}, "not a finite number"),
        ({"position": math.nan}, "not a finite number"),
        ({"position": math.inf}, "not a finite number"),
        ({"position": 0.4}, "outside the travel"),
        ({"position": -0.02}, "outside the travel"),
        ({"fz": math.nan}, "not a finite number"),
        ({"fz": 151.0}, "151 N on the handle"),
        ({"fz": -1e9}, "N on the handle"),
    ],
)
def test_what_cannot_be_is_a_fault(bench, change, named):
    bench.step(**change)
    assert_latched(bench, named)


def test_a_torque_that_is_no_number_is_a_fault(bench):
    bench.tick += 1
    bench.watch.force(force(bench.tick, tx=math.nan), bench.now_ns)
    assert "not a finite number" in bench.watch.fault.reason


@pytest.mark.parametrize("bit", range(16))
def test_status_bits_one_by_one(bench, bit):
    bench.step(status=1 << bit)
    if bit in {2, 3, 4, 5, 6, 7, 8, 11, 12, 14}:
        assert_latched(bench, FORCE_STATUS_BITS[bit])
    else:
        assert bench.watch.fault.reason == ""


def test_the_mask_is_that_of_the_manual():
    assert FORCE_FAULT_MASK == 0b0101_1001_1111_1100


def test_the_first_reason_is_kept(bench):
    bench.step(fz=200.0)
    bench.step(velocity=5.0)
    assert "on the handle" in bench.watch.fault.reason


@pytest.mark.parametrize("make", [encoder, force])
def test_a_stamp_from_the_future_is_a_fault_and_not_fresh(bench, make):
    bench.tick += 1
    take = bench.watch.encoder if make is encoder else bench.watch.force
    assert not take(make(bench.tick, stamp_ns=2**62), bench.now_ns)
    assert "future" in bench.watch.fault.reason


@pytest.mark.parametrize("off", [-1000, -2, 2, 1 << 31])
def test_a_number_that_is_not_that_of_the_tick_is_a_fault(bench, off):
    """Another rate, or a second sender: the period of filters and limits would be wrong."""
    bench.tick += 1
    sample = encoder((bench.tick + off) & 0xFFFFFFFF, stamp_ns=bench.tick * PERIOD_NS)
    assert not bench.watch.encoder(sample, bench.now_ns)
    assert "this node at 1000 Hz" in bench.watch.fault.reason


def test_numbers_wrap_and_a_late_wake_up_is_no_fault():
    bench = Bench()
    bench.tick = (1 << 32) - 4
    for _ in range(8):
        bench.tick += 1
        number = bench.tick & 0xFFFFFFFF
        late_ns = bench.tick * PERIOD_NS + 900_000
        assert bench.watch.encoder(encoder(number, stamp_ns=late_ns), late_ns)
    assert bench.watch.fault.reason == ""


def test_repeated_and_older_samples_are_not_acted_upon(bench):
    assert not bench.watch.encoder(encoder(bench.tick), bench.now_ns)
    assert not bench.watch.encoder(encoder(bench.tick - 1, 0.3), bench.now_ns)
    assert bench.step() == ""


def test_old_samples_do_not_keep_a_stream_alive(bench):
    last = bench.tick
    for _ in range(8):
        bench.tick += 1
        bench.watch.force(force(bench.tick), bench.now_ns)
        bench.watch.encoder(encoder(last), bench.now_ns)
        bench.watch.check(bench.now_ns)
    assert bench.watch.fault.reason


def test_two_senders_are_noticed(bench):
    for _ in range(10):
        bench.step()
        bench.watch.encoder(encoder(bench.tick, 0.3), bench.now_ns)
        bench.watch.encoder(encoder(bench.tick, 0.3), bench.now_ns)
    assert "second node" in bench.watch.fault.reason
