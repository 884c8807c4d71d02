# SPDX-License-Identifier: Apache-2.0
"""Figures tell simulated patients apart, by the effect sizes that docs/therapy.md gives."""

import math
import re
from pathlib import Path
from statistics import mean, variance

import pytest
from simulated_patient import FEEBLE, HEALTHY, SHAKING, Simulation

from screw_module_ros.therapy.measures import COMPUTED
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.session import Session

pytestmark = pytest.mark.long

DOCS = Path(__file__).parents[2] / "docs" / "therapy.md"
ROW = re.compile(r"^\| (\w+) \| ([+-][\d.]+) \| ([+-][\d.]+) \|$", re.MULTILINE)
OF_OTHER_TRIALS = {"independence", "size", "hold_deviation", "largest_force",
                   "largest_vertical_force", "patient_work", "robot_work",
                   "pm2a", "pm2b", "pm3", "pm4", "effort", "work_area"}  # fmt: skip


def reaches(person):
    """Figures of two sessions of sixteen reaches without assistance."""
    clock = load_protocol("clock_adaptive")
    protocol = clock._replace(
        blocks=clock.blocks[:1], rules=clock.rules._replace(give_up=6.0)
    )
    found = []
    for seed in range(2):
        session = Session(protocol)
        Simulation(session, person, seed).run()
        found += session.results
    return found


@pytest.fixture(scope="module")
def groups():
    return {name: reaches(person) for name, person in
            (("healthy", HEALTHY), ("tremor", SHAKING), ("weak", FEEBLE))}  # fmt: skip


def of(figures, name):
    return [value for each in figures if math.isfinite(value := each[name])]


def effect(one, other, name):
    """Cohen's d: mean of `other` minus that of `one`, over the pooled deviation.

    The pooled deviation weights the groups by their sizes (cohen1988, 2.5.1).
    """
    a, b = of(one, name), of(other, name)
    spread = (len(a) - 1) * variance(a) + (len(b) - 1) * variance(b)
    return (mean(b) - mean(a)) / math.sqrt(spread / (len(a) + len(b) - 2))


def test_the_table_of_effect_sizes(groups):
    table = {name: (float(tremor), float(weak)) for name, tremor, weak in ROW.findall(
        DOCS.read_text("utf-8"))}  # fmt: skip
    assert set(table) == set(COMPUTED) - OF_OTHER_TRIALS
    for name, sizes in table.items():
        for who, size in zip(("tremor", "weak"), sizes, strict=True):
            found = effect(groups["healthy"], groups[who], name)
            assert found == pytest.approx(size, abs=0.06), (name, who)


@pytest.mark.parametrize(
    ("name", "who", "sign"),
    [
        ("sparc", "tremor", -1), ("log_jerk", "tremor", -1), ("speed_peaks", "tremor", 1),
        ("speed_ratio", "tremor", -1), ("path_ratio", "tremor", 1), ("arrest_ratio", "tremor", -1),
        ("peak_speed", "weak", -1), ("mean_speed", "weak", -1), ("duration", "weak", 1),
        ("reach_error", "weak", 1), ("path_error", "weak", 1),
        ("direction_error", "weak", 1),
    ],
)  # fmt: skip
def test_figures_tell_patients_apart_by_a_large_effect(groups, name, who, sign):
    """|d| > 0.8 is a large effect (Cohen 1988)."""
    assert sign * effect(groups["healthy"], groups[who], name) > 0.8


def test_the_healthy_reach_and_start_by_themselves(groups):
    assert all(r["reached"] and r["initiated"] and r["moved"] for r in groups["healthy"])
    assert not any(r["reached"] for r in groups["weak"]), "they come 80 % of the way"
