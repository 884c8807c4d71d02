# SPDX-License-Identifier: Apache-2.0
"""Every implausible sample latches, nothing but `reset` unlatches, and healthy samples pass."""

import math

import pytest

from screw_module_ros.safety.checks import HOME_AGAIN, Stream, VerticalChecks, WatchSettings
from screw_module_ros.safety.latch import Latch
from screw_module_ros.samples import (
    FORCE_FAULT_MASK,
    FORCE_STATUS_BITS,
    EncoderReading,
    ForceReading,
)

PERIOD_NS = 1_000_000
LATER_NS = 200_000  # when samples are seen, after their acquisition


def encoder(tick, position=0.18, velocity=0.0, homed=True, stamp_ns=None, homings=0):
    stamp_ns = tick * PERIOD_NS if stamp_ns is None else stamp_ns
    return EncoderReading(tick, stamp_ns, 0, 0, position, velocity, homed, homings)


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

    def step(self, position=0.18, velocity=0.0, homed=True, fz=0.0, status=0, homings=0):
        self.tick += 1
        self.watch.force(force(self.tick, fz, status), self.now_ns)
        sample = encoder(self.tick, position, velocity, homed, homings=homings)
        self.watch.encoder(sample, self.now_ns)
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
    assert bench.step(position=0.2, homed=True, homings=1) == ""
    assert bench.step(position=0.1, homed=True, homings=2) == ""


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


def test_motion_under_the_motors_full_force_is_none(bench):
    """Peak force of 528 N on 5.5 kg for 5 ms, then the same force braking."""
    position, velocity = 0.18, 0.0
    for acceleration in [96.0] * 5 + [-96.0] * 10:
        velocity += acceleration * 0.001
        position += velocity * 0.001
        assert bench.step(position, velocity) == ""


def sample(changes, tick=100):
    """The force sample, or else the encoder sample, of a tick with some changes."""
    if set(changes) <= {"position", "velocity"}:
        return encoder(tick)._replace(**changes)
    return force(tick)._replace(**changes)


def take(watch, one, now_ns):
    (watch.encoder if isinstance(one, EncoderReading) else watch.force)(one, now_ns)


EDGES = [
    # allowed, beyond it, named
    ({"velocity": 1.0}, {"velocity": 1.0001}, "encoder: 1 m/s, faster than 1 m/s"),
    ({"velocity": -1.0}, {"velocity": -1.0001}, "encoder: -1 m/s, faster than 1 m/s"),
    ({"position": 0.37}, {"position": 0.3701}, "encoder: 0.3701 m lies outside the travel"),
    ({"position": -0.01}, {"position": -0.0101}, "encoder: -0.0101 m lies outside the travel"),
    ({"fz": 150.0}, {"fz": 150.1}, "force sensor: 150.1 N on the handle, more than 150 N"),
    ({"fz": -150.0}, {"fz": -150.1}, "force sensor: 150.1 N on the handle, more than 150 N"),
    ({"fx": 90.0, "fy": 120.0}, {"fx": 90.0, "fy": -120.1}, "on the handle, more than 150 N"),
    ({"fx": 90.0, "fz": 120.0}, {"fx": -90.1, "fz": 120.0}, "on the handle, more than 150 N"),
    *(({}, {axis: math.nan}, "encoder: position or velocity is not a finite number")
      for axis in ("position", "velocity")),
    *(({}, {axis: -math.inf}, "force sensor: a force or torque is not a finite number")
      for axis in ("fx", "fy", "fz", "tx", "ty", "tz")),
]  # fmt: skip


@pytest.mark.parametrize(("allowed", "beyond", "named"), EDGES)
def test_every_bound_of_a_sample_holds_at_its_edge(allowed, beyond, named):
    for changes, latches in ((allowed, False), (beyond, True)):
        bench = Bench()
        take(bench.watch, sample(changes), bench.now_ns)
        assert (named in bench.watch.fault.reason) == latches
        assert bool(bench.watch.fault.reason) == latches


@pytest.mark.parametrize("change", [{"velocity": 1.1}, {"fz": math.nan}, {"fz": -1e9}])
def test_what_cannot_be_latches(bench, change):
    bench.step(**change)
    assert_latched(bench, "encoder" if "velocity" in change else "force sensor")


# A change of speed of 300 m/s^2 for the longer of a period and the time between the samples, and a
# count of 1 um at each end.
@pytest.mark.parametrize(
    ("elapsed_ns", "allowed"), [(1_000_000, 302e-6), (2_000_000, 1202e-6), (500_000, 152e-6)]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jump_is_more_than_any_motor_can_make(elapsed_ns, allowed, sign):
    for moved in (allowed - 1e-7, allowed + 1e-7):
        bench = Bench()
        stamps = [100_000_000, 101_000_000, 101_000_000 + elapsed_ns]
        for stamp_ns, position in zip(stamps, (0.18, 0.18, 0.18 + sign * moved), strict=True):
            one = encoder(stamp_ns // PERIOD_NS, position, stamp_ns=stamp_ns)
            bench.watch.encoder(one, stamp_ns + LATER_NS)
        wrong = f"jumped by {sign * moved * 1e3:.4g} mm" if moved > allowed else ""
        assert wrong in bench.watch.fault.reason
        assert bool(bench.watch.fault.reason) == bool(wrong)


def test_after_a_reset_nothing_is_expected_of_the_next_place(bench):
    bench.step(velocity=1.1)
    assert bench.watch.reset(bench.now_ns) == ""
    assert bench.step(position=0.17) == ""
    assert bench.step(position=0.17) == ""


def test_after_a_jump_a_homing_is_needed_and_no_reset_replaces_it(bench):
    """Soft stops and targets would be shifted by the jump."""
    bench.step(position=0.19)
    for _ in range(2):
        reason = bench.watch.reset(bench.now_ns)
        assert "jumped by 10 mm" in reason and HOME_AGAIN in reason
        assert bench.watch.fault.reason == ""
        assert bench.step(position=0.19) == reason
    assert bench.step(position=0.18, homings=1) == ""
    assert bench.step(position=0.18, homings=1) == ""


def test_a_jump_is_not_forgotten_behind_a_reason_of_more_weight(bench):
    bench.step(position=0.30, velocity=19.0)
    assert "faster" in bench.watch.fault.reason
    assert "jumped by 120 mm" in bench.watch.reset(bench.now_ns)


@pytest.mark.parametrize(("stamp_ns", "wrong"), [(105_000_000, ""), (105_000_001, "gap of 5.0 ms")])
def test_a_gap_is_more_than_five_periods(stamp_ns, wrong):
    bench = Bench()
    bench.watch.encoder(encoder(100), 100_000_000)
    bench.watch.encoder(encoder(105, stamp_ns=stamp_ns), stamp_ns)
    assert wrong in bench.watch.fault.reason
    assert bool(bench.watch.fault.reason) == bool(wrong)


@pytest.mark.parametrize(
    ("stamp_ns", "wrong"),
    [
        (1, ""), (101_000_000, ""), (101_000_001, "stamped in the future, or with no time"),
        (0, "stamped in the future, or with no time"), (-1, "with no time"),
    ],
)  # fmt: skip
def test_a_stamp_may_lie_a_period_ahead_and_must_exist(stamp_ns, wrong):
    stream = Stream("encoder", PERIOD_NS, fault := Latch(), numbered=False)
    assert stream.accept(100, stamp_ns, 100_000_000) == stream.seen == (not wrong)
    assert wrong in fault.reason and bool(fault.reason) == bool(wrong)
    assert stream.monotonic_ns == (0 if wrong else stamp_ns)


@pytest.mark.parametrize(("age_ns", "wrong"), [(7, ""), (8, "force sensor: no sample for 0.0 ms")])
def test_the_age_of_a_stream_at_its_edge(age_ns, wrong):
    stream = Stream("force sensor", PERIOD_NS, fault := Latch())
    stream.accept(100, 100_000_000, 100_000_000)
    stream.check_age(100_000_000 + age_ns, 7)
    assert fault.reason == wrong


@pytest.mark.parametrize(
    ("at_once", "per_period", "noticed"),
    [(10, 0.0, False), (11, 0.0, True), (1, 1.01, False), (1, 1.03, True)],
)
def test_more_samples_than_one_sender_makes(at_once, per_period, noticed):
    """Ten at once may have waited for a stalled node; 2 % more than one sends are a second one."""
    stream = Stream("encoder", PERIOD_NS, fault := Latch(), numbered=False)
    now_ns = 100 * PERIOD_NS
    for _ in range(at_once):
        stream.accept(0, now_ns, now_ns)
    for number in range(1, 2000 if per_period else 0):
        now_ns = 100 * PERIOD_NS + round(number * PERIOD_NS / per_period)
        stream.accept(0, now_ns, now_ns)
    assert ("more samples than one each 1 ms" in fault.reason) == noticed
    stream.restart()
    fault.clear()
    for _ in range(10):
        stream.accept(0, now_ns, now_ns)
    assert fault.reason == "", "counts anew after a restart"


@pytest.mark.parametrize("bit", range(16))
def test_status_bits_one_by_one(bench, bit):
    bench.step(status=1 << bit)
    if bit in {2, 3, 4, 5, 6, 7, 8, 11, 12, 14}:
        assert_latched(bench, FORCE_STATUS_BITS[bit])
    else:
        assert bench.watch.fault.reason == ""


def test_of_several_status_bits_the_lowest_is_named(bench):
    bench.step(status=1 << 11 | 1 << 5 | 1 << 1)
    assert bench.watch.fault.reason.endswith(f"{FORCE_STATUS_BITS[5]} (status bit 5)")


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


@pytest.mark.parametrize("off", [-1, 0, 1])
def test_a_number_may_be_that_of_a_tick_beside(off):
    bench = Bench()
    assert bench.watch.encoder(encoder(100 + off, stamp_ns=100 * PERIOD_NS), bench.now_ns)
    assert bench.watch.fault.reason == ""


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
