# SPDX-License-Identifier: Apache-2.0
"""Mode EXCITATION in the whole loop: on a lease, and its wide limits for one enable alone."""

from __future__ import annotations

import pytest

from screw_module_ros.control.excitation import Excitation
from screw_module_ros.control.modes import EXCITATION, IMPEDANCE, OFF

SINE = Excitation(1, 0.4, 10.0, 2000)
ENDS_S = 0.3


@pytest.fixture
def locked(bench):
    """Return a robot whose rotor is locked to the transducer, in mode EXCITATION, on a lease."""
    bench.world.set_fixture("locked_rotor")
    bench.ticks(30)
    bench.controller.mode = EXCITATION
    asked(bench, Excitation(), 0.1)
    return bench


def asked(bench, request, seconds):
    """Repeat a request each 0.1 s; return the rows."""
    rows = []
    for _ in range(round(seconds / 0.1)):
        bench.controller.excite(request, bench.now_ns)
        rows += bench.seconds(0.1)
    return rows


def enabled(bench, request=None):
    """Enable for the mode that is commanded, the lease being kept."""
    bench.controller.excite(request or Excitation(), bench.now_ns)
    bench.axis.ready()
    assert bench.enable() == ""
    asked(bench, request or Excitation(), 0.6)
    assert bench.torque_passes


def torques(rows):
    return [abs(row.torque) for row in rows]


def test_the_sine_reaches_the_drive_and_ends(locked):
    enabled(locked)
    rows = asked(locked, SINE._replace(ticks=500), 0.4)
    assert max(torques(rows)) == pytest.approx(0.4, abs=2e-3), "not limited, not linearized"
    assert max(torques(asked(locked, SINE._replace(ticks=500), 0.4)[150:])) == 0.0
    assert locked.torque_passes and not locked.controller.faulted


def test_a_sender_that_falls_silent_ends_the_torque(locked):
    enabled(locked)
    asked(locked, SINE, 0.3)
    rows = locked.seconds(0.4)
    late = [row for row in rows if row.time - rows[0].time > ENDS_S]
    assert max(torques(rows[:150])) > 0.3 and max(torques(late)) == 0.0
    assert "fallen silent" in locked.controller.reason and locked.controller.faulted
    assert max(torques(asked(locked, SINE._replace(id=2), 0.3))) == 0.0, "it begins anew by itself"
    locked.controller.reset(locked.now_ns)
    assert locked.controller.faulted, "while the drive is on"


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
    assert enabled.torque_passes and not enabled.controller.faulted


def test_a_rotor_that_turns_ends_it(bench):
    """The rotor was not locked: nothing but a hand held the handle."""
    bench.controller.mode = EXCITATION
    asked(bench, Excitation(), 0.1)
    enabled(bench)
    asked(bench, SINE._replace(frequency=0.5), 0.6)
    assert "the rotor is not locked" in bench.controller.reason
    assert bench.rows[-1].torque == 0.0
    assert abs(bench.rows[-1].position - bench.home) < 0.05


@pytest.mark.parametrize("mode", [OFF, IMPEDANCE])
def test_another_mode_on_its_gate_is_zero_and_latched(locked, mode):
    enabled(locked)
    asked(locked, SINE, 0.3)
    locked.controller.mode = mode
    rows = asked(locked, SINE, 0.2)
    assert max(torques(rows)) == 0.0 and not locked.torque_passes
    assert "force command: mode" in locked.axis.permit.reason and locked.axis.permit.latched
    locked.axis.ready()
    assert "force command: mode" in locked.enable()


def test_the_mode_on_a_gate_of_the_laws_is_zero_and_latched(enabled):
    enabled.controller.mode = EXCITATION
    rows = enabled.seconds(0.2)
    assert max(torques(rows)) == 0.0 and not enabled.torque_passes
    assert "mode EXCITATION, the torque was enabled for the laws" in enabled.axis.permit.reason


@pytest.mark.parametrize("prepared", [True, False])
def test_wide_limits_end_with_their_enable(locked, prepared):
    """The limits of a killed trial served whoever enabled next: 141 N, at any rate."""
    enabled(locked)
    asked(locked, SINE, 0.3)
    wide = locked.axis.ready()
    assert locked.disable() == ""
    locked.controller.lease.end()
    locked.controller.mode = IMPEDANCE
    locked.seconds(0.3)
    if prepared:
        assert locked.axis.ready() < 0.35 < wide
        assert locked.enable() == ""
        locked.seconds(0.6)
        sequence = locked.controller.answered.sequence
        locked.clock.time_ns += 1_000_000
        assert locked.axis.command(sequence + 1, locked.now_ns, 140.0, locked.now_ns, IMPEDANCE)
        assert abs(locked.axis.last.torque) < 0.1, "4000 N/s on top of the weight"
    else:  # nobody has prepared the opening: it fits no law's command
        locked.enable()
        locked.seconds(0.1)
        assert not locked.torque_passes
        assert "the torque was enabled for mode EXCITATION" in locked.axis.permit.reason


def limited(bench, torque):
    """Tell the drive another limit as the node does, while the loop ticks; return what it has."""
    sdo = bench.drive.sdo
    return bench._asking(lambda clock: bench.drive.limit(torque) or sdo.unsigned(0x6072))


def test_the_drive_s_own_limit_follows(bench):
    """0.313 Nm of the laws cut the sine; a limit that stays wide guards nothing afterwards."""
    assert limited(bench, 0.21) == 500
    assert limited(bench, 0.455) == 1084
    assert limited(bench, 0.21) == 500 and bench.drive.told_limit == 0.21
    bench.controller.mode = 1
    assert bench.enable() == ""


def test_a_drive_that_refuses_its_limit_is_not_enabled(bench):
    bench.rig.inject("drive", "refuse_torque_limit", 0.0, 0.0, bench.now_ns)
    assert limited(bench, 0.455) != 1084
    assert "torque limit 6072" in bench.enable()
    bench.rig.inject("drive", "clear", 0.0, 0.0, bench.now_ns)
    assert limited(bench, 0.21) == 500
    assert bench.enable() == ""
