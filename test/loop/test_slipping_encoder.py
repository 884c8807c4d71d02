# SPDX-License-Identifier: Apache-2.0
"""Encoder and drive position drift apart a little at a time, or once because the drive restarts."""

from __future__ import annotations

import pytest

from screw_module_ros.control.modes import IMPEDANCE
from screw_module_ros.geometry import COUNTS_PER_TURN, SCREW


@pytest.fixture(autouse=True)
def in_impedance(bench):
    bench.controller.mode = IMPEDANCE


def rehome(bench, position: float) -> None:
    """Home the encoder where it stands, at another position [m]."""
    bench.encoder.settings = bench.encoder.settings._replace(home_position=position)
    bench.encoder.home()
    bench.ticks(12)


def slip(bench, metres: float, device: str = "drive", fault: str = "position_jump") -> None:
    """Let the position that one device reports move by `metres`, and nothing else."""
    counts = round(metres / SCREW.lead * COUNTS_PER_TURN)
    assert bench.rig.inject(device, fault, counts, 0.0, bench.now_ns)


def cycles(bench, metres: float, count: int) -> list[str]:
    """Enable, slip with the torque on or off in turn, disable; return the reasons."""
    reasons = []
    for number in range(count):
        if number % 2:
            slip(bench, metres)
        assert bench.enable() == ""
        bench.seconds(0.1)
        if not number % 2:
            slip(bench, metres)
        bench.seconds(0.1)
        reasons.append(bench.controller.reason)
        if reasons[-1]:
            break
        assert bench.disable() == ""
        bench.seconds(0.1)
    return reasons


def test_slips_add_up_over_enablings(bench):
    """The comparison began anew with each of them."""
    reasons = cycles(bench, 0.0007, 6)
    assert reasons[:2] == ["", ""]
    assert reasons[2].startswith("encoder and drive disagree by -2.1 mm")
    assert bench.rows[-1].force == 0.0


@pytest.mark.parametrize(("device", "fault"), [("encoder", "jump"), ("drive", "position_jump")])
def test_after_a_slip_no_reset_replaces_a_homing(bench, device, fault):
    """The controller cannot tell which of the two is right: the stops may be shifted by the slip.

    Homing at the same place is a homing too: it may be the drive that slipped.
    """
    assert bench.enable() == ""
    bench.seconds(0.1)
    slip(bench, 0.01, device, fault)
    bench.seconds(0.1)
    bench.rig.inject(device, "clear", 0.0, 0.0, bench.now_ns)
    assert bench.disable() == ""
    for _ in range(2):
        bench.seconds(0.1)
        bench.controller.reset(bench.now_ns)
        assert bench.controller.home_in_doubt and bench.controller.reason
        assert not bench.controller.faulted
    rehome(bench, bench.rows[-1].position)
    assert bench.controller.reason == "" and not bench.controller.home_in_doubt
    assert bench.enable() == ""
    bench.seconds(0.2)
    assert bench.axis.permit.enabled and bench.rows[-1].force != 0.0


def test_slips_one_way_and_the_other_do_not(bench):
    for metres in (0.0015, -0.0015):
        assert cycles(bench, metres, 1) == [""]


def test_a_drive_that_counts_from_elsewhere_while_off_is_no_slip(bench):
    assert cycles(bench, 0.0007, 2) == ["", ""]
    slip(bench, 0.05)
    bench.seconds(0.1)
    assert cycles(bench, 0.0007, 2) == ["", ""], "the comparison has begun anew"


@pytest.mark.parametrize("shift", [0.0001, 0.003])
def test_a_homing_elsewhere_is_no_slip(bench, shift):
    assert cycles(bench, 0.0007, 2) == ["", ""]
    rehome(bench, bench.home + shift)
    assert abs(bench.rows[-1].position - bench.home - shift) < 1e-4
    assert cycles(bench, 0.0005, 1) == [""]
