# SPDX-License-Identifier: Apache-2.0
"""The sine of a trial on the locked rotor."""

from __future__ import annotations

import math

import numpy as np
import pytest

from screw_module_ros.control.excitation import (
    LARGEST_TORQUE,
    Excitation,
    Excited,
    as_numbers,
    excitation_step,
    from_numbers,
)
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.torque_chain import (
    COLD,
    TorqueChain,
    commanded,
    excitation_chain,
    followed,
    largest_command,
)
from screw_module_ros.geometry import Screw, force_to_torque

RATE = 200.0
FIRST = 2**32 - 30  # the tick numbers start again within a test
SINE = Excitation(7, 0.3, 10.0, 40)


def played(wanted, ticks, memory=None, position=lambda tick: 0.2, active=lambda tick: True):
    """Return the torque of each tick [Nm], and the reasons."""
    memory = memory or Excited()
    steps = [
        excitation_step(wanted, memory, (FIRST + tick) % 2**32, position(tick), RATE, active(tick))
        for tick in ticks
    ]
    return force_to_torque(np.array([force for force, _ in steps])), [why for _, why in steps]


def test_plays_the_sine_once():
    torque, why = played(SINE, range(60))
    expected = 0.3 * np.sin(2.0 * np.pi * 10.0 * np.arange(40) / RATE)
    np.testing.assert_allclose(torque, [*expected, *[0.0] * 20], atol=1e-12)
    assert not any(why)
    kept = [tick for tick in range(60) if tick % 7 != 3]  # lost ticks do not shift it
    np.testing.assert_allclose(played(SINE, kept)[0], torque[kept], atol=1e-12)
    late, _ = played(SINE, range(50), active=lambda tick: tick >= 5)  # it waits for the torque
    np.testing.assert_allclose(late[5:45], torque[:40], atol=1e-12)


def test_linearized_and_through_the_message():
    numbers = as_numbers(default_linearization())
    wanted = SINE._replace(linearization=from_numbers(np.array(numbers)))
    assert wanted.linearization == default_linearization()
    torque, _ = played(wanted, range(40))
    assert torque.max() == pytest.approx(wanted.peak) == pytest.approx(0.325)


def test_a_rotor_that_turns_ends_it_for_good():
    memory = Excited()
    torque, why = played(SINE, range(1, 60), memory, lambda tick: 0.2 + 6e-5 * tick)
    assert "the nut has moved by 1.0 mm: the rotor is not locked" in " ".join(why)
    assert torque[:16].any() and not torque[17:].any()
    assert not played(SINE, range(60, 70), memory)[0].any()


def test_a_position_that_is_no_number_ends_it():
    torque, why = played(SINE, range(20), position=lambda tick: 0.2 if tick < 9 else math.nan)
    assert not torque[9:].any() and "not locked" in why[9]


def test_an_interrupted_sine_does_not_go_on():
    """The torque came back in the middle of the sine, without its ramp from zero."""
    memory = Excited()
    torque, _ = played(SINE, range(40), memory, active=lambda tick: tick not in (10, 11))
    assert torque[9] != 0.0 and not torque[10:].any()
    again, _ = played(SINE._replace(id=8), range(40, 60), memory)
    np.testing.assert_allclose(again[:10], torque[:10], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [({"amplitude": 0.43}, "continuous torque of 0.42 Nm"), ({"amplitude": -0.1}, "amplitude"),
     ({"amplitude": math.nan}, "amplitude"), ({"frequency": 100.0}, "needs more than 200"),
     ({"frequency": math.nan}, "a sine of nan Hz"),
     ({"linearization": default_linearization()._replace(joints_Nm=(0.1, -0.1))}, "joints_Nm"),
     ({"amplitude": 0.42, "linearization": default_linearization(0.045, 0.045)}, "at most 0.455")],
)  # fmt: skip
def test_what_cannot_be_played_is_refused(change, said):
    assert SINE.refusal(RATE) == ""
    assert said in SINE._replace(**change).refusal(RATE)


@pytest.mark.parametrize("lead", [0.01905, 0.025])
def test_the_chain_passes_the_sine_as_it_is_whatever_the_lead(lead):
    """An amplifier with a lead of 25 mm gave 0.55 Nm where 0.42 Nm were asked for."""
    laws = TorqueChain(screw=Screw(lead), linearization=default_linearization())
    chain, heat, last = excitation_chain(laws), COLD, 0.0
    wanted, memory = Excitation(1, LARGEST_TORQUE, 50.0, 200, default_linearization()), Excited()
    for tick in range(200):
        force, _ = excitation_step(wanted, memory, tick, 0.2, 1e3, True)
        last = followed(chain, last, force, 1e-3)
        made, heat = commanded(chain, heat, last, 1.0, 1e-3)
        assert made.command == pytest.approx(wanted.torque(tick, 1e3), abs=1e-12)
        assert not made.limited
    assert largest_command(laws) < wanted.peak < largest_command(chain)
