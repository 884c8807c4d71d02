# SPDX-License-Identifier: Apache-2.0
"""The motors: their mean square torque stays within the rated one (I2t), which a pause cools."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace

import pytest
from loop_parts import MS, S, noting_drive, open_axis

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.limits import TorqueLimits
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.loop.plane_drives import PlaneDrives
from screw_module_ros.safety.permit import PermitSettings

RATED, LARGEST, TIME_CONSTANT = 10.0, 25.0, 10.0
DRIVE = DriveSettings(rated_torque=RATED, max_torque=LARGEST)
HOLD = (18.0, -23.0)
"""Torques of 45 N at the handle [Nm]."""


def plane_of(sent, **drive):
    """Return the plane's drives behind an open gate; they note what they get [Nm]."""
    drives = [noting_drive(got, DRIVE._replace(**drive)) for got in sent]
    port = SimpleNamespace(clock=ManualClock(S))
    made = PlaneDrives(drives, port, 2 * MS, PermitSettings(), TIME_CONSTANT)
    made.permit.step = lambda newest_ns, now_ns: 1.0
    return made


def asked(plane, torques, seconds, begin_ns=S):
    """Ask for these torques for a while; return the time of the last write [ns]."""
    end_ns = begin_ns + round(seconds * S)
    for now_ns in range(begin_ns, end_ns, 2 * MS):
        plane.write(torques, now_ns, now_ns)
    return end_ns - 2 * MS


def held(torques, seconds=60.0, **drive):
    """Return what both drives got [Nm], and whether the plane is hot in the end."""
    sent = [], []
    plane = plane_of(sent, **drive)
    asked(plane, torques, seconds)
    return *sent, plane.hot


def test_a_hand_that_is_held_for_long_gets_the_rated_torque_in_the_end():
    shoulder, elbow, hot = held(HOLD)
    assert (shoulder[0], elbow[0]) == HOLD
    full = sum(torque == HOLD[1] for torque in elbow) * 0.002
    assert full == pytest.approx(-TIME_CONSTANT * math.log(1.0 - 0.75 * 100.0 / 529.0), rel=0.15)
    assert elbow[-1] == pytest.approx(-RATED, rel=1e-3) and hot
    assert max(abs(b - a) for a, b in pairwise(elbow)) < 0.05, "it comes down without a step"


def test_the_force_keeps_its_direction():
    """One motor alone would turn it: the other one scales with it."""
    shoulder, elbow, _ = held(HOLD, 20.0)
    for one, other in zip(shoulder, elbow, strict=True):
        assert one / other == pytest.approx(HOLD[0] / HOLD[1])
    assert abs(shoulder[-1]) < RATED


@pytest.mark.parametrize(
    ("torques", "left"), [((20.0, 6.0), (RATED, 3.0)), ((6.0, 20.0), (3.0, RATED))]
)
def test_the_hotter_motor_decides(torques, left):
    shoulder, elbow, _ = held(torques)
    assert (shoulder[-1], elbow[-1]) == pytest.approx(left, rel=1e-3)


@pytest.mark.parametrize(
    ("torques", "settings"),
    [
        ((RATED, -RATED), {}),  # the rated torque is never reduced
        ((5.0, 0.0), {"max_torque": 5.0}),  # a limit below it needs no heat
    ],
)
def test_what_a_motor_bears_for_ever_is_never_reduced(torques, settings):
    shoulder, elbow, hot = held(torques, **settings)
    assert (set(shoulder), set(elbow), hot) == ({torques[0]}, {torques[1]}, False)
    assert not plane_of(([], [])).hot


def test_the_mean_square_stays_within_the_rated_one():
    """Loads come and go; the mean over the time constant is what the motor feels."""
    shoulder, elbow = sent = [], []
    plane, end_ns = plane_of(sent), S - 2 * MS
    for torque, seconds in ((23.0, 8.0), (0.0, 3.0), (23.0, 4.0), (15.0, 9.0), (23.0, 20.0)):
        end_ns = asked(plane, (0.0, torque), seconds, end_ns + 2 * MS)
    heat, hottest = 0.0, 0.0
    for torque in elbow:
        heat += (torque**2 - heat) * 0.002 / TIME_CONSTANT
        hottest = max(hottest, heat)
    assert 0.98 * RATED**2 < hottest <= 1.001 * RATED**2
    assert not any(shoulder)


def test_a_new_configuration_cools_no_motor():
    first = plane_of(([], []))
    end_ns = asked(first, HOLD, 20.0)
    warm, cooled = ([], []), ([], [])
    for sent, later_ns in ((warm, end_ns + S // 5), (cooled, end_ns + 60 * S)):
        second = plane_of(sent)
        second.warm_as(first)
        second.write((0.0, 0.0), later_ns, later_ns)
        asked(second, HOLD, 0.1, later_ns + 2 * MS)
    assert RATED < abs(warm[1][-1]) < 13.0
    assert (cooled[0][-1], cooled[1][-1]) == HOLD


def pressed(made, seconds):
    """Ask for 95 N, which need 0.29 Nm; return the time of the last command [ns]."""
    times = range(S, S + round(seconds * S), MS)
    for now_ns in times:
        made.write(95.0, now_ns)
    return times[-1]


def test_the_next_loop_begins_as_warm_as_the_last_one_ended():
    first = open_axis([])
    end_ns = pressed(first, 3.0)
    warm = first.heat(end_ns + MS)
    assert warm == pytest.approx(0.29**2 * 0.45, rel=0.15), "3 s of the time constant of 5 s"
    assert first.heat(end_ns + S) == pytest.approx(warm * 0.8, rel=0.01), "it cools"
    assert first.heat(end_ns + 3600 * S) == pytest.approx(0.0, abs=1e-12)
    assert open_axis([], heat=warm).heat(7 * S) == warm, "a failed activation does not cool it"


def test_a_hot_motor_gets_hardly_more_than_its_continuous_torque():
    hot, cold = [], []
    for sent, heat in ((hot, 0.01), (cold, 0.0)):
        chain = TorqueChain(limits=TorqueLimits(continuous=0.1, peak=0.4))
        pressed(open_axis(sent, chain, heat), 0.1)
    assert max(hot[50:]) < 0.13, "2 % of the heat have gone before the first command"
    assert cold[-1] > 0.2
