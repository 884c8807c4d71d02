# SPDX-License-Identifier: Apache-2.0
"""The adaptation judged, not tuned: what it gives each simulated patient, with and without support.

The table of docs/therapy.md is made by `make test ARGS="test/therapy/test_judged.py --write"`.
"""

from __future__ import annotations

import random
import re
from pathlib import Path
from statistics import mean, median

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from simulated_patient import ARM, MANUS, Person, Simulation, person

from screw_module_ros.plant.settings import patients
from screw_module_ros.therapy.kinematics import hull_area
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.session import Session

pytestmark = pytest.mark.long

CLOCK = load_protocol("clock_adaptive")
PAGE = Path(__file__).parents[2] / "docs/therapy.md"
BLOCK = re.compile(r"(<!-- judged -->\n).*?(<!-- end -->)", re.DOTALL)
CIRCUIT = 16
SLOW = Person(ARM._replace(stiffness=400.0, damping=40.0), 1.6, reaction=0.4)


def played(who, circuits, seed=1, support=0.0, least=None):
    """Return a session of assisted circuits; least: the adaptation's `least_effort`."""
    bounds = CLOCK.adaptation
    if least is not None:
        bounds = bounds._replace(least_effort=least)
    block = CLOCK.blocks[1]._replace(circuits=circuits)
    session = Session(CLOCK._replace(blocks=(block,), adaptation=bounds))
    Simulation(session, who, seed, MANUS._replace(support=support)).run(120.0 * circuits)
    return session


def efforts(session):
    """Return the median effort of each circuit."""
    all_of_them = [result["effort"] for result in session.results]
    return [median(all_of_them[n : n + CIRCUIT]) for n in range(0, len(all_of_them), CIRCUIT)]


def by_seed(seed):
    """Return a passive and a slow but able person, drawn by seed."""
    draw = random.Random(seed)
    passive = ARM._replace(
        stiffness=draw.uniform(5.0, 60.0), damping=draw.uniform(3.0, 15.0), carried=0.0,
        weight=draw.uniform(8.0, 20.0),
    )  # fmt: skip
    slow = SLOW._replace(duration=draw.uniform(1.4, 2.2), reaction=draw.uniform(0.25, 0.6))
    return Person(passive, 1.0, reach=0.0), slow


@pytest.mark.parametrize("seed", range(20))
def test_effort_tells_an_arm_that_does_nothing_from_one_that_is_slow(seed):
    passive, slow = (efforts(played(who, 1, seed)) for who in by_seed(seed))
    assert max(passive) < 0.1, passive
    assert min(slow) > 0.6, slow


@pytest.mark.parametrize("seed", range(20))
def test_the_effort_of_who_slacks_falls(seed):
    found = efforts(played(person("slacking"), 5, seed))
    assert found[-1] < found[0], found


def test_a_flaccid_arm_keeps_its_walls_and_its_time():
    """Without the rule it got walls as soft as allowed, as if it kept to the line by itself."""
    before, now = (played(person("flaccid"), 3, least=least).assistance for least in (0.0, 0.2))
    assert before.side_stiffness == CLOCK.adaptation.softest
    assert now.side_stiffness == CLOCK.guidance.side_stiffness
    assert now.duration >= CLOCK.guidance.duration


def test_the_work_area_is_that_of_the_hull():
    draw = random.Random(1)
    for count in (3, 10, 200):
        path = np.array([[draw.gauss(0, 1), draw.gauss(0, 2), 0.0] for _ in range(count)])
        assert hull_area(path) == pytest.approx(ConvexHull(path[:, :2]).volume)
    line = np.array([[x, 2.0 * x, 0.1] for x in (0.0, 0.5, 0.2, 0.5)])
    assert hull_area(line) == hull_area(line[:1]) == 0.0


def row(name, support):
    """Return a line of the table."""
    session = played(person(name), 3, support=support)
    results, (time, walls) = session.results, session.assistance
    last = results[-CIRCUIT:]
    figures = (
        f"{time:.2f} s", f"{walls:.0f} N/m",
        f"{sum(r['reached'] for r in results)} of {len(results)}",
        f"{mean(r['initiated'] for r in results):.0%}",
        f"{mean(r['robot_share'] for r in last):.0%}",
        f"{median(r['effort'] for r in last):.0%}",
    )  # fmt: skip
    return f"| {name} | {support:.0f} N | {' | '.join(figures)} |"


def test_the_table_of_the_page(request):
    head = "| patient | support | T | K | reached | initiated | robot's share | effort |\n"
    rows = [row(name, support) for name in patients() for support in (0.0, patients()[name].weight)]
    text = PAGE.read_text("utf-8")
    made = BLOCK.sub(
        lambda found: found[1] + head + "|---|---|---|---|---|---|---|---|\n" + "\n".join(rows)
        + "\n" + found[2], text,
    )  # fmt: skip
    if request.config.getoption("--write"):
        PAGE.write_text(made, encoding="utf-8")
    assert "<!-- judged -->" in text and made == PAGE.read_text("utf-8")
