# SPDX-License-Identifier: Apache-2.0
"""Every bound of the loops: what is just allowed, and what is just beyond it."""

from __future__ import annotations

import math

import pytest
from loop_parts import MS, open_axis

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.arms import FIVE_BAR
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.slot import Reach, Slot, SlotLimits
from screw_module_ros.geometry import MANUS, inverse
from screw_module_ros.loop.controller import NO_FORCE
from screw_module_ros.loop.inputs import Guide
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import (
    Joint,
    JointSettings,
    clear_of_stops,
    hand_torques,
)
from screw_module_ros.loop.ticker import Ticker, period_of
from screw_module_ros.safety.checks import FreezeSettings
from screw_module_ros.trials.one_thread import PERIOD_NS

LAW = PlanarSettings()
REACH = Reach(-1.0, 1.0, -1.0, 1.0)


# -- joints ----------------------------------------------------------------------------------------


def joint() -> Joint:
    made = Joint(JointSettings(), FreezeSettings(), 2 * MS)
    assert made.take(0.0, 1) == ""
    made.motion.homed = True
    return made


@pytest.mark.parametrize(
    ("periods", "largest"), [(1, 0.02), (2, 0.04), (5, 0.1), (6, 0.1), (1500, 0.1)]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jump_of_a_joint_is_two_hundredths_of_a_radian_a_period(periods, largest, sign):
    """After a gap no more than after five: a drive that restarted unheard counts from elsewhere."""
    allowed, beyond = joint(), joint()
    assert "jumped" not in allowed.take(sign * (largest - 1e-6), periods)
    assert allowed.motion.homed
    said = beyond.take(sign * (largest + 1e-6), periods)
    assert said == f"jumped by {sign * largest:.3f} rad"
    assert not beyond.motion.homed


@pytest.mark.parametrize(("speed", "said"), [(5.99, ""), (6.01, "turns at 6.0 rad/s")])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_turns_with_six_radians_a_second_at_most(speed, said, sign):
    turning = joint()
    found = [turning.take(sign * speed * 0.002 * k, 1) for k in range(1, 400)]
    assert found[-1] == said.replace("at ", "at -" if sign < 0.0 else "at ")


@pytest.mark.parametrize("name", [n for n in LAW._fields if n.endswith(("_low", "_high"))])
def test_a_joint_is_clear_of_its_stops_only_between_them(name):
    """Each stop by itself; the others are far away."""
    stops = ("shoulder_low", "shoulder_high", "elbow_low", "elbow_high", "between_low",
             "between_high")  # fmt: skip
    assert name in stops
    law = LAW._replace(**{n: -9.0 if n.endswith("low") else 9.0 for n in stops})
    at = getattr(LAW, name)
    law = law._replace(**{name: at})
    inward = 1e-6 if name.endswith("low") else -1e-6
    for place, clear in ((at + inward, True), (at, False), (at - inward, False)):
        angles = (place, 0.0) if name.startswith("shoulder") else (0.0, place)
        assert clear_of_stops(FIVE_BAR, law, *angles) == clear


def test_the_plane_is_homed_where_its_mark_is_and_only_at_rest(bench):
    old = bench.plane
    bench.plane = plane = Plane(
        bench.planar_drives, bench.ports["planar"], PERIOD_NS, LAW,
        JointSettings(home_x=0.03, home_y=-0.02, home_shift=1.0), old.drives.permit.settings,
    )  # fmt: skip
    bench.ticks(30)
    assert plane.take_home(bench.now_ns) == ""
    angles = [each.motion.position for each in plane.controller.joints]
    assert angles == pytest.approx(inverse(0.03, -0.02))
    for number, label in enumerate(("shoulder", "elbow")):
        rest = plane.controller.joints[number].motion
        rest.velocity = -0.02
        assert plane.take_home(bench.now_ns) == ""
        rest.velocity = -0.0201
        assert plane.take_home(bench.now_ns).startswith(f"{label} drive turns at -0.020 rad/s")
        rest.velocity = 0.0


def test_a_plane_whose_drives_were_silent_for_a_tenth_of_a_second_is_not_homed(bench):
    measured = bench.plane.controller.measured
    last_ns = measured.stamp_ns
    assert measured.fresh(last_ns + 100 * MS) and not measured.fresh(last_ns + 100 * MS + 1)
    assert bench.plane.take_home(last_ns + 100 * MS + 1) == "the drives do not answer"


@pytest.mark.parametrize(("missed", "reason"), [(19, ""), (20, "20 deadlines missed in a row")])
def test_a_plane_with_torque_stops_after_twenty_missed_deadlines(bench, plane, missed, reason):
    plane.meter.consecutive_missed = missed
    plane.check(bench.now_ns)
    assert plane.drives.permit.fault.reason == reason


@pytest.mark.parametrize(("sign", "faulty", "doubted"), [(-1, 0, 0), (1, 0, 1), (1, 1, 0)])
def test_a_joint_is_judged_by_motor_and_hand_together(bench, plane, sign, faulty, doubted):
    """Against the hand they balance; with a faulty force sample nobody knows."""
    sample = bench._readings[-1]._replace(
        monotonic_ns=bench.now_ns, fx=20.0, fy=-25.0, status=faulty << 4
    )
    controller = plane.controller
    controller.on_force(sample, bench.now_ns)
    controller.fault.clear()
    angles = [each.motion.position for each in controller.joints]
    pushed = hand_torques(FIVE_BAR, *angles, 20.0, -25.0, MANUS)
    assert max(map(abs, pushed)) > 3.0
    for _ in range(120):
        controller.check_frozen((sign * pushed[0], sign * pushed[1]), True)
    assert ("position (6064)" in controller.fault.reason) == bool(doubted)


def test_before_the_first_tick_nothing_is_commanded(bench, plane):
    assert open_axis([]).last == (0.0, 0.0, False) and open_axis([]).asked == 0.0
    bench.planar_setpoint = (0.05, 0.05, 0.0, 0.0)
    bench.ticks(100)
    assert plane.drives.written != (0.0, 0.0) and plane.meter.samples
    plane.restart()
    assert (plane.drives.written, plane.meter.samples, plane.skipped) == ((0.0, 0.0), 0, 0)
    assert plane.controller.output is None and not plane.controller.homed
    assert not plane.controller.measured.fresh(bench.now_ns)


def test_what_a_frozen_joint_has_added_up_is_forgotten_without_torque(bench):
    for each in bench.plane.controller.joints:
        assert each.frozen.check(each.motion.position, 50.0, 0.0) == ""
        assert each.frozen.check(each.motion.position, 50.0, 0.09) == ""
    bench.tick()
    for each in bench.plane.controller.joints:
        assert each.frozen.check(each.motion.position, 50.0, 0.09) == ""


def test_ticks_that_an_overrun_skips_are_counted_by_each_part(bench):
    parts = (bench.plane, bench.axis, *bench.roles[:2])
    before = [part.skipped for part in parts]
    bench.clock.time_ns += 3_400_000
    bench.tick()
    # The plane's last tick came after that of the vertical loop.
    assert [part.skipped - old for part, old in zip(parts, before, strict=True)] == [2, 3, 3, 3]


def test_without_samples_every_part_of_the_command_is_zero(enabled):
    enabled.setpoint = (enabled.home + 0.03, 0.0)
    enabled.ticks(100)
    shown = enabled.controller.output.desired_position
    output = enabled.controller.stop_when_silent(enabled.now_ns + 10**9)
    assert output == NO_FORCE._replace(desired_position=shown)
    assert output[:6] == (0.0,) * 6 and not output.saturated
    assert (output.desired_velocity, output.share) == (0.0, 1.0)
    assert enabled.controller.stop_when_silent(enabled.now_ns + 10**9) is None, "zero is sent once"


# -- slot -----------------------------------------------------------------------------------------


def test_a_slot_expires_after_three_tenths_of_a_second():
    guide = Guide(SlotLimits(fade_time=0.2), REACH)
    guide.ask(Slot(target_y=0.14), 0, MS)
    place = 0.03, 0.0, 0.0, 0.0
    weights = [guide.guidance(*place, MS + k * 100_000_000, 0.02).weight for k in (0, 1, 2, 3)]
    assert weights == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert guide.guidance(*place, MS + 300_000_001, 0.02).weight == pytest.approx(0.3)
    for _ in range(4):
        last = guide.guidance(*place, MS + 300_000_001, 0.02)
    assert last == (0.0, 0.0, 0.0)
    assert guide.guidance(math.nan, *place[1:], MS + 300_000_001, 0.02) == (0.0, 0.0, 0.0)


# -- ticks -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset_ns", [0, 500_000])
def test_ticks_are_whole_periods_and_their_offset(offset_ns):
    clock = ManualClock(7_600_000)
    ticker = Ticker(clock, 2 * MS, offset_ns)
    first = ticker.sleep()
    assert first[:2] == (4, 8 * MS + offset_ns) and first.skipped == 0
    assert ticker.due_ns() == 10 * MS + offset_ns
    clock.time_ns = 10 * MS + offset_ns - 1  # woken early: still the next tick, and none skipped
    assert ticker.take()[::3] == (5, 0)
    clock.time_ns = 15 * MS + offset_ns
    assert ticker.sleep()[::3] == (7, 1)
    clock.time_ns = (2**32 + 5) * 2 * MS + offset_ns
    assert ticker.take().sequence == 5


def test_a_period_is_a_whole_number_of_microseconds():
    assert period_of(1000.0) == MS and period_of(125.0) == 8 * MS
    with pytest.raises(ValueError, match=r"rate = 300\.0 Hz"):
        period_of(300.0)


# -- the vertical drive's writes -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pause_ns", "step"), [(MS, 4.0), (3 * MS, 12.0), (5 * MS, 20.0), (50 * MS, 20.0), (0, 0.004)]
)
def test_after_a_pause_the_force_leaps_by_five_periods_at_most(pause_ns, step):
    """4 N a millisecond; two writes in one nanosecond count as a microsecond apart."""
    made, newton = open_axis([]), 0.01905 / (2.0 * math.pi)
    begin = 1000 * MS
    made.write(0.0, begin)
    made.write(90.0, begin + pause_ns)
    assert made.last.torque == pytest.approx(step * newton)
    assert made.last.saturated
    made.write(step, begin + pause_ns + MS)
    assert made.last == pytest.approx((step * newton, step * newton, False))


@pytest.mark.parametrize(("elapsed", "counted"), [(99, 99), (100, 100), (5000, 100)])
def test_a_pause_heats_for_a_hundred_periods_at_most(elapsed, counted):
    made, torque = open_axis([]), 50.0 * 0.01905 / (2.0 * math.pi)
    for k in range(60):
        made.write(50.0, (1000 + k) * MS)
    before = made.heat(1059 * MS)
    made.write(50.0, (1059 + elapsed) * MS)
    share = counted * 1e-3 / 5.0
    assert made.heat((1059 + elapsed) * MS) == pytest.approx(before + (torque**2 - before) * share)


def test_a_force_is_written_again_after_two_periods_without_a_command():
    sent = []
    made = open_axis(sent)
    made.write(3.0, 1000 * MS)
    made.serve_without_command(1002 * MS - 1)
    assert len(sent) == 1
    made.serve_without_command(1002 * MS)
    assert len(sent) == 2
