# SPDX-License-Identifier: Apache-2.0
"""The rule of assistance: signs, levels, gains, bounds, when it acts, and why."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.settings import validated
from screw_module_ros.therapy.adaptation import (
    AFTER_CIRCUITS,
    DEAD_BAND,
    AdaptationBounds,
    Assistance,
    Circuit,
    accuracy_metric,
    adapted,
    circuit_of,
    gain,
    speed_metric,
)

BOUNDS = validated(AdaptationBounds())
MIDDLE = Assistance(1.4, 100.0)
circuits = st.lists(
    st.builds(Circuit, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=1, max_size=20
)


def moved(pm2a=0.0, pm2b=0.0, stray=0.0):
    return {"pm2a": pm2a, "pm2b": pm2b, "pm3": stray * stray}


def test_metrics_as_published():
    assert speed_metric(moved(pm2a=-0.5, pm2b=0.02)) == pytest.approx(0.65 * -0.5 + 6.0 * 0.02)
    assert speed_metric(moved(pm2a=0.5)) == 0.0, "the patient's own power is no need"
    assert accuracy_metric(moved(stray=0.01), 100.0) == pytest.approx(-8.0 * (0.0265 - 0.008))
    assert accuracy_metric(moved(stray=0.001), 100.0) == pytest.approx(-20.0 * (0.00265 - 0.008))


@pytest.mark.parametrize(
    ("metrics", "expected"),
    [
        ((-0.1, -0.1, -0.1), 1.0),
        ((-0.1, -0.1, 0.0), 0.5),
        ((-0.1, 0.0, 0.0), 0.25),
        ((-0.1, 0.0, 0.1), 0.25),
        ((0.1, 0.0, 0.0), 0.5),
        ((0.1, 0.1, 0.0), 1.0),
        ((0.1, 0.1, 0.1), 2.0),
        ((0.1, 0.1, 0.1, -0.1, -0.1, -0.1), 1.0),
        ((0.1,), 0.5),
        ((DEAD_BAND, -DEAD_BAND), 0.25),
    ],
)
def test_gain_by_the_last_three_levels(metrics, expected):
    assert gain(metrics) == expected


def test_it_acts_after_the_published_circuits_on_the_mean_since():
    history = [Circuit(0.0, 0.0)] * 20
    acted = [n for n in range(1, 21) if adapted(BOUNDS, MIDDLE, history[:n])]
    assert acted == list(AFTER_CIRCUITS) == [1, 2, 3, 4, 5, 8, 11, 14, 17]
    late = [Circuit(9.0, 9.0)] * 5 + [Circuit(s, 0.0) for s in (-0.3, 0.0, 0.0)]
    change = adapted(BOUNDS, MIDDLE, late)
    assert change.after.duration == pytest.approx(1.4 + 0.25 * 2.3 * 0.1)


@given(circuits, st.floats(0.7, 3.0), st.floats(25.0, 300.0))
def test_always_within_bounds_and_who_needs_less_gets_less(history, duration, stiffness):
    before = Assistance(duration, stiffness)
    change = adapted(BOUNDS, before, history)
    if change is None:
        assert len(history) not in AFTER_CIRCUITS
        return
    assert BOUNDS.shortest <= change.after.duration <= BOUNDS.longest
    assert BOUNDS.softest <= change.after.side_stiffness <= BOUNDS.stiffest
    if all(c.speed >= 0.0 and c.accuracy >= 0.0 for c in history):
        assert change.after.duration <= duration
        assert change.after.side_stiffness <= stiffness
    if all(c.speed <= 0.0 and c.accuracy <= 0.0 for c in history):
        assert change.after.duration >= duration
        assert change.after.side_stiffness >= stiffness


def test_reasons_say_what_and_why():
    less = adapted(BOUNDS, MIDDLE, [Circuit(0.1, 0.1)])
    assert less.reason.startswith("less time, as the hand led the wall (metric +0.100); softer")
    more = adapted(BOUNDS, MIDDLE, [Circuit(-0.1, -0.1)])
    assert "more time" in more.reason and "stiffer side walls" in more.reason
    end = adapted(BOUNDS, Assistance(BOUNDS.shortest, BOUNDS.stiffest), [Circuit(0.1, -0.1)])
    assert "time already the shortest allowed" in end.reason
    assert "side walls already the stiffest allowed" in end.reason
    assert "as before" in adapted(BOUNDS, MIDDLE, [Circuit(0.0, 0.0)]).reason


def test_iterated_on_a_steady_hand_it_settles():
    """rms 2 mm whatever the walls do: K settles where m = 0, 2.65 x 0.002 / 0.00008 = 66 N/m."""
    assistance, history = MIDDLE, []
    for _ in range(20):
        history.append(circuit_of([moved(stray=0.002)], assistance.side_stiffness))
        change = adapted(BOUNDS, assistance, history)
        assistance = change.after if change else assistance
    assert assistance.side_stiffness == pytest.approx(66.25, abs=8.0)
    assert assistance.duration == 1.4


@pytest.mark.parametrize(
    ("effort", "least", "less"),
    [(0.05, 0.2, False), (-1.0, 0.2, False), (0.3, 0.2, True), (math.nan, 0.2, True),
     (-1.0, 0.0, True)],
)  # fmt: skip
def test_nothing_is_taken_away_while_the_robot_does_the_work(effort, least, less):
    """Bags and protocols of before have no effort, or no least one: there all is as it was."""
    bounds = BOUNDS._replace(least_effort=least)
    change = adapted(bounds, MIDDLE, [Circuit(0.1, 0.1, effort)])
    assert (change.after.duration < MIDDLE.duration) is less
    assert (change.after.side_stiffness < MIDDLE.side_stiffness) is less
    assert ("the robot does the work" in change.reason) is not less
    assert change.after == MIDDLE or less
    help_more = adapted(bounds, MIDDLE, [Circuit(-0.1, -0.1, effort)])
    assert help_more == adapted(BOUNDS, MIDDLE, [Circuit(-0.1, -0.1)]), "more is given as before"


def test_a_circuit_s_effort_is_the_median_of_those_that_are_known():
    movements = [moved() | {"effort": effort} for effort in (0.1, math.nan, 0.5, 0.3)]
    assert circuit_of(movements, 100.0).effort == pytest.approx(0.3)
    assert math.isnan(circuit_of([moved()], 100.0).effort)


def test_refusals():
    with pytest.raises(ValueError, match="without movements"):
        circuit_of([], 100.0)
    with pytest.raises(ValueError, match="shortest"):
        validated(AdaptationBounds(shortest=3.0, longest=1.0))
    assert math.isfinite(speed_metric(moved()))
