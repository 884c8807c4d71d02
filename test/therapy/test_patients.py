# SPDX-License-Identifier: Apache-2.0
"""The patients of params/patients.yaml in sessions: each does what he is named for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from simulated_patient import MANUS, Simulation, person

from screw_module_ros.plant.settings import patients
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.session import Session, State

pytestmark = pytest.mark.long

CLOCK = load_protocol("clock_adaptive")


def session(name, blocks=1, circuits=1, assisted=False, support=0.0, breaks=()):
    """Return results by block, and the samples, of blocks of 16 reaches.

    support: upward on the hand [N]; breaks: numbers of blocks before which he rests 2 min.
    """
    block = CLOCK.blocks[1 if assisted else 0]._replace(circuits=circuits)
    rules = CLOCK.rules._replace(give_up=4.0)
    found = Session(CLOCK._replace(blocks=(block,) * blocks, rules=rules))
    simulation = Simulation(found, person(name), 1, MANUS._replace(support=support))
    samples, rested = [], set()
    while found.state == State.RUNNING and simulation.now < 600.0 * blocks * circuits:
        number = found.trial.plan.block
        if number in breaks and number not in rested:
            rested.add(number)
            found.pause("a break")
            for _ in range(int(120.0 / 2.5e-3)):
                simulation.step()
            found.resume()
        samples += simulation.run(0.5)
    return found, samples


@pytest.mark.parametrize("assisted", [False, True])
@pytest.mark.parametrize("name", patients())
def test_each_begins_and_ends_a_session_of_sixteen_reaches(name, assisted):
    found, _ = session(name, assisted=assisted)
    assert (found.state, found.reason) == (State.FINISHED, "")
    assert len(found.results) == 16


def area(name, support):
    """Return the area that the hand covers [m^2], sent far out in sixteen directions in turn."""
    found = Session(CLOCK)
    found.pause("nobody guides the hand")
    simulation, ends = Simulation(found, person(name), 1, MANUS._replace(support=support)), []
    for angle in np.linspace(0.0, 2.0 * np.pi, 17)[:-1]:
        simulation.go((0.14 * np.cos(angle), 0.14 * np.sin(angle), 0.18), 1.0, 0.0, 1.0)
        for _ in range(1600):
            simulation.step()
        ends.append(simulation.position[:2])
    return ConvexHull(np.array(ends)).volume


def test_support_gives_a_synergy_a_larger_work_area_and_a_healthy_arm_none():
    supports = (0.0, 5.0, 10.0, 15.0, 20.0)
    synergy = [area("synergy", support) for support in supports]
    assert all(b > 1.001 * a for a, b in zip(synergy, synergy[1:], strict=False)), synergy
    assert synergy[-1] > 1.03 * synergy[0], synergy
    healthy = [area("healthy", support) for support in supports]
    assert max(healthy) < 1.001 * min(healthy), healthy


def test_a_tiring_patient_reaches_less_and_recovers_in_a_break_of_two_minutes():
    found, _ = session("tiring", blocks=5, circuits=3, breaks=(5,))
    reached = [sum(r["reached"] for r in found.results if r["block"] == n) for n in range(1, 6)]
    assert reached[3] < reached[0] - 3, reached
    assert reached[4] > reached[3] + 3, reached
