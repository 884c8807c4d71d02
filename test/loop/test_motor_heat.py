# SPDX-License-Identifier: Apache-2.0
"""The motor's heat outlives a deactivation of the drive's loop, and cools meanwhile."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.limits import TorqueLimits
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.safety.permit import OPEN, PermitSettings

MS, S = 1_000_000, 1_000_000_000
LIMITS = TorqueLimits()
BUDGET = LIMITS.continuous**2
CHAIN = TorqueChain(limits=LIMITS)


def axis(heat, sent, chain=CHAIN):
    """Return a drive's loop that is enabled, and notes what it writes [Nm]."""
    drive = SimpleNamespace(
        write=lambda command, now_ns: sent.append(command) or command, settings=DriveSettings()
    )
    port = SimpleNamespace(clock=ManualClock(S))
    made = VerticalDrive(drive, port, MS, PermitSettings(), chain, heat=heat)
    made.permit = SimpleNamespace(step=lambda newest_ns, now_ns: 1.0, phase=OPEN)
    return made


def pressed(made, seconds, begin_ns=S):
    """Ask for 95 N, which need 0.29 Nm; return the time of the last command [ns]."""
    end_ns = begin_ns + round(seconds * S)
    for now_ns in range(begin_ns, end_ns, MS):
        made._write(95.0, now_ns)
    return end_ns - MS


def test_the_next_loop_begins_as_warm_as_the_last_one_ended():
    first = axis(0.0, [])
    end_ns = pressed(first, 3.0)
    warm = first.heat(end_ns + MS)
    assert warm == pytest.approx(0.29**2 * 0.45, rel=0.15), "3 s of the time constant of 5 s"
    assert first.heat(end_ns + S) == pytest.approx(warm * 0.8, rel=0.01), "it cools"
    assert first.heat(end_ns + 3600 * S) == pytest.approx(0.0, abs=1e-12)
    assert axis(warm, []).heat(7 * S) == warm, "an activation that failed does not cool it"


def test_a_hot_motor_gets_hardly_more_than_its_continuous_torque():
    limits = LIMITS._replace(continuous=0.1, peak=0.4)
    hot, cold = [], []
    for sent, heat in ((hot, 0.01), (cold, 0.0)):
        made = axis(heat, sent, CHAIN._replace(limits=limits))
        pressed(made, 0.1)
    assert max(hot[50:]) < 0.13, "2 % of the heat have gone before the first command"
    assert cold[-1] > 0.2
