# SPDX-License-Identifier: Apache-2.0
"""Mode EXCITATION in the whole loop: on a lease, and its wide limits for one enable alone."""

from __future__ import annotations

import pytest

from screw_module_ros.control.excitation import Excitation
from screw_module_ros.control.modes import EXCITATION, IMPEDANCE, OFF

SINE = Excitation(1, 0.4, 10.0, 2000)
ENDS_TICKS = 301


def asked(bench, request, seconds):
    """Repeat a request each 0.1 s; return the size of the torque in each tick [Nm]."""
    found = []
    for _ in range(round(seconds / 0.1)):
        bench.controller.excite(request, bench.now_ns)
        found += torques(bench.seconds(0.1))
    return found


def torques(rows):
    return [abs(row.torque) for row in rows]


@pytest.fixture
def leased(bench):
    """Return a robot in mode EXCITATION, on a lease; nothing locks its rotor."""
    bench.controller.mode = EXCITATION
    asked(bench, Excitation(), 0.1)
    return bench


@pytest.fixture
def locked(leased):
    """Return one whose rotor is locked to the transducer."""
    leased.world.set_fixture("locked_rotor")
    asked(leased, Excitation(), 0.1)
    return leased


def enable(bench):
    """Enable for the mode that is commanded, the lease being kept."""
    bench.controller.excite(Excitation(), bench.now_ns)
    assert bench.axis.ready() > 0.35, "the wide limits of this mode"
    assert bench.enable() == ""
    asked(bench, Excitation(), 0.6)
    assert bench.axis.permit.enabled


@pytest.fixture
def running(locked):
    """Return one whose torque is on."""
    enable(locked)
    return locked


@pytest.fixture
def playing(running):
    """Return one that has been playing the sine for 0.3 s."""
    asked(running, SINE, 0.3)
    return running


def test_the_sine_reaches_the_drive_and_ends(running):
    sine = SINE._replace(ticks=500)
    most = max(asked(running, sine, 0.4))
    assert most == pytest.approx(0.4, abs=2e-3), "not limited, not linearized"
    assert max(asked(running, sine, 0.4)[150:]) == 0.0
    assert running.axis.permit.enabled and not running.controller.faulted


def test_a_sender_that_falls_silent_ends_the_torque(playing):
    found = torques(playing.seconds(0.4))
    assert max(found[:150]) > 0.3 and max(found[ENDS_TICKS:]) == 0.0
    assert "fallen silent" in playing.controller.reason and playing.controller.faulted
    assert max(asked(playing, SINE._replace(id=2), 0.3)) == 0.0, "it begins anew by itself"
    playing.controller.reset(playing.now_ns)
    assert playing.controller.faulted, "while the drive is on"


def test_a_lapsed_lease_is_no_fault_while_the_torque_is_off(locked):
    locked.seconds(0.6)
    assert locked.controller.lease.lapsed and not locked.controller.faulted
    asked(locked, SINE, 0.1)
    assert locked.controller.lease.lapsed, "until what the trial changed is put back"
    locked.controller.lease.end()
    asked(locked, SINE, 0.1)
    assert locked.controller.lease.held and not locked.controller.lease.lapsed


def test_no_lease_begins_while_torque_passes(enabled):
    asked(enabled, SINE, 0.3)
    assert not enabled.controller.lease.held
    enabled.seconds(0.6)
    assert enabled.axis.permit.enabled and not enabled.controller.faulted


def test_a_rotor_that_turns_ends_it(leased):
    """The rotor was not locked: nothing but a hand held the handle."""
    enable(leased)
    asked(leased, SINE._replace(frequency=0.5), 0.6)
    assert "the rotor is not locked" in leased.controller.reason
    assert leased.rows[-1].torque == 0.0
    assert abs(leased.rows[-1].position - leased.home) < 0.05


@pytest.mark.parametrize("mode", [OFF, IMPEDANCE])
def test_another_mode_on_its_gate_is_zero_and_latched(playing, mode):
    playing.controller.mode = mode
    assert max(asked(playing, SINE, 0.2)) == 0.0 and not playing.axis.permit.enabled
    assert "force command: mode" in playing.axis.permit.reason and playing.axis.permit.latched
    playing.axis.ready()
    assert "force command: mode" in playing.enable()


def test_the_mode_on_a_gate_of_the_laws_is_zero_and_latched(enabled):
    enabled.controller.mode = EXCITATION
    assert max(torques(enabled.seconds(0.2))) == 0.0 and not enabled.axis.permit.enabled
    assert "mode EXCITATION, the torque was enabled for the laws" in enabled.axis.permit.reason


@pytest.fixture
def left(playing):
    """Return one whose trial has ended, with its wide limits, in mode IMPEDANCE."""
    assert playing.disable() == ""
    playing.controller.lease.end()
    playing.controller.mode = IMPEDANCE
    playing.seconds(0.3)
    return playing


def test_wide_limits_end_with_their_enable(left):
    """The limits of a killed trial served whoever enabled next: 141 N, at any rate."""
    assert left.axis.ready() < 0.35
    assert left.enable() == ""
    left.seconds(0.6)
    sequence = left.controller.answered.sequence
    left.clock.time_ns += 1_000_000
    assert left.axis.command(sequence + 1, left.now_ns, 140.0, left.now_ns, IMPEDANCE)
    assert abs(left.axis.last.torque) < 0.1, "4000 N/s on top of the weight"


def test_an_opening_that_nobody_has_prepared_fits_no_laws_command(left):
    left.enable()
    left.seconds(0.1)
    assert not left.axis.permit.enabled
    assert "the torque was enabled for mode EXCITATION" in left.axis.permit.reason


def limited(bench, torque):
    """Tell the drive another limit as the node does, while the loop ticks; return what it has."""
    sdo = bench.drive.sdo
    return bench.served(lambda: bench.drive.limit(torque) or sdo.unsigned(0x6072))


def test_the_drive_s_own_limit_follows(bench):
    """0.313 Nm of the laws cut the sine; a limit that stays wide guards nothing afterwards."""
    assert limited(bench, 0.21) == 500
    assert limited(bench, 0.455) == 1084
    assert limited(bench, 0.21) == 500 and bench.drive.drive_limit == 0.21
    bench.controller.mode = 1
    assert bench.enable() == ""


def test_a_drive_that_refuses_its_limit_is_not_enabled(bench):
    bench.rig.inject("drive", "refuse_torque_limit", 0.0, 0.0, bench.now_ns)
    assert limited(bench, 0.455) != 1084
    assert "torque limit 6072" in bench.enable()
    bench.rig.inject("drive", "clear", 0.0, 0.0, bench.now_ns)
    assert limited(bench, 0.21) == 500
    assert bench.enable() == ""
