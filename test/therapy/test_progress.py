# SPDX-License-Identifier: Apache-2.0
"""Eleven lines over sessions: intervals without a distribution, slopes, and what may be said."""

from __future__ import annotations

import itertools
import math
import random
import shutil
from contextlib import closing
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, theilslopes
from small_bag import MARCH, protocol, small_bag

from screw_module_ros.session_command import main
from screw_module_ros.therapy.progress import (
    ERRORS,
    as_text,
    disorders,
    interval,
    progress_of,
    signs,
    theil_sen,
)
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.session import State

OLD = next((Path(__file__).parents[1] / "data" / "bags").glob("P-7K3QX_*"))
WEEK = 7 * 86400


@pytest.mark.parametrize("count", [1, 5, 6, 9, 40])
def test_the_interval_of_a_median_is_that_of_its_order_statistics(count):
    values = random.Random(count).sample(range(1000), count)
    low, high = interval(values, signs(count))
    assert math.isfinite(low) == (count >= 6)
    if count >= 6:
        ordered = sorted(values)
        place = ordered.index(low)
        assert ordered.index(high) == count - 1 - place
        assert binom.cdf(place, count, 0.5) <= 0.025 < binom.cdf(place + 1, count, 0.5)


def test_chances_of_disorder_are_counted():
    for count in (2, 3, 5):
        found = np.zeros(count * (count - 1) // 2 + 1)
        for order in itertools.permutations(range(count)):
            found[sum(a > b for a, b in itertools.combinations(order, 2))] += 1
        assert disorders(count) == pytest.approx(found / found.sum())


def test_the_slope_is_theil_and_sens():
    chance = np.random.default_rng(1)
    times = np.sort(chance.uniform(0.0, 20.0, 12))
    values = 3.0 - 0.5 * times + chance.normal(0.0, 1.0, 12)
    slope, low, high = theil_sen(times, values)
    found = theilslopes(values, times)
    assert slope == pytest.approx(found.slope)
    assert low == pytest.approx(found.low_slope) and high == pytest.approx(found.high_slope)
    assert math.isnan(theil_sen(times[:4], values[:4])[1]), "four have no interval"


def test_the_interval_of_a_slope_holds_the_true_one_in_95_of_100():
    chance, times = np.random.default_rng(2), np.arange(7.0)
    held = 0
    for _ in range(1000):
        _, low, high = theil_sen(times, 2.0 * times + chance.standard_t(2, 7))
        held += low <= 2.0 <= high
    assert 940 <= held <= 995


def reaches(duration: float, count: int = 7, **more):
    spread = (n / 100 - 0.03 for n in range(count))
    fixed = {"sparc": -1.5, "path_error": 0.004, "pm4": 0.12, "mean_speed": 0.1}
    return [{"duration": duration + d, **fixed, **more} for d in spread]


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "sessions"
    place.mkdir()
    return place


def found(folder, patient="P-7K3QX"):
    with closing(Record(folder)) as record:
        record.update()
        return progress_of(record, patient)


def line(progress, beginning):
    (wanted,) = (each for each in progress.lines if each.label.startswith(beginning))
    return wanted


def test_there_are_eleven_lines_in_the_order_of_clinicians(folder):
    small_bag(folder, reaches=reaches(1.0))
    assert [each.label.split()[0] for each in found(folder).lines] == [
        "dose", "reached", "duration", "SPARC", "path", "reach", "support", "largest", "pain,",
        "rests", "what",
    ]  # fmt: skip


def test_a_figure_is_the_median_of_unassisted_reaches(folder):
    rows = [*reaches(1.0), *reaches(0.2, assisted=True), {"kind": "circle", "duration": 9.0}]
    small_bag(folder, reaches=rows)
    (point,) = line(found(folder), "duration").points
    assert (point.value, point.low, point.high) == pytest.approx((1.0, 0.97, 1.03))
    assert point.text == "1.00 (0.97 to 1.03)"
    small_bag(folder, "P-22222", reaches=reaches(1.0, 5))
    (few,) = line(found(folder, "P-22222"), "duration").points
    assert few.text == "0.99" and math.isnan(few.low)


def test_the_first_session_is_in_no_slope_and_no_change(folder):
    """It is learning; and five sessions beside it make a slope, four do not."""
    for week, duration in enumerate((9.0, 2.0, 1.9, 1.8, 1.7)):
        small_bag(folder, begin_s=MARCH + week * WEEK, reaches=reaches(duration))
    four = line(found(folder), "duration")
    assert four.slope == "" and four.base == 1
    assert four.change.startswith("-15% from session 2 to 5: within the error of measurement")
    small_bag(folder, begin_s=MARCH + 5 * WEEK, reaches=reaches(1.0))
    five = line(found(folder), "duration")
    assert five.change.startswith("-50% from session 2 to 6: beyond the error of measurement")
    assert five.change.endswith("(28%, inmotionretest)")
    slope, low, high = theil_sen(range(5), (2.0, 1.9, 1.8, 1.7, 1.0))
    assert five.slope == f"{slope:+.2g} a week ({low:+.2g} to {high:+.2g})"


def test_nothing_is_said_but_beyond_or_within_the_error_of_measurement(folder):
    for week, duration in enumerate((3.0, 2.0, 1.0)):
        small_bag(folder, begin_s=MARCH + week * WEEK, reaches=reaches(duration))
    said = [each.change for each in found(folder).lines if each.change]
    assert len(said) == len(ERRORS)
    for sentence in said:
        assert (" beyond the error of measurement (" in sentence) != (
            " within the error of measurement (" in sentence)  # fmt: skip
    text = as_text(found(folder)).lower()
    assert "of another robot and another task" in text
    assert not any(word in text for word in ("better", "worse", "improve", "benefit", "progressed"))


def test_other_protocols_are_not_compared(folder):
    small_bag(folder, begin_s=MARCH, reaches=reaches(5.0), definition=protocol(count=3))
    small_bag(folder, begin_s=MARCH + WEEK, reaches=reaches(2.0))
    progress = found(folder)
    assert line(progress, "duration").points[0].text == "–"
    assert line(progress, "dose").points[0].value > 0.0
    assert "; 1 of other protocols or versions have none." in progress.note


def test_figures_under_another_load_are_shown_and_not_compared(folder):
    for week, support in enumerate((8.0, 8.0, 9.0, 0.0, 10.0)):
        small_bag(folder, begin_s=MARCH + week * WEEK,
                  reaches=reaches(1.0 + week, support=support, pm4=0.1 + 0.01 * week))  # fmt: skip
    reach, duration = (line(found(folder), name) for name in ("reach [mm]", "duration"))
    for each in (reach, duration):
        assert [n for n, point in enumerate(each.points) if not math.isfinite(point.value)] == [3]
        assert "from session 2 to 5" in each.change
    assert reach.points[3].text == "0 N: 130 mm"
    small_bag(folder, begin_s=MARCH + 5 * WEEK, reaches=reaches(1.0, support=0.0))
    assert line(found(folder), "duration").change == ""


def test_the_first_session_of_a_protocol_is_learning_too(folder):
    small_bag(folder, begin_s=MARCH, reaches=reaches(5.0), definition=protocol(count=3))
    for week, duration in enumerate((9.0, 2.0, 1.0), 1):
        small_bag(folder, begin_s=MARCH + week * WEEK, reaches=reaches(duration))
    progress = found(folder)
    assert line(progress, "duration").change.startswith("-50% from session 3 to 4: beyond")


def test_nothing_is_said_of_a_figure_that_is_zero(folder):
    """A path up and down has no error: it was a division by zero."""
    for week in range(3):
        small_bag(folder, begin_s=MARCH + week * WEEK, reaches=reaches(1.0, path_error=0.0))
    error = line(found(folder), "path")
    assert (error.change, error.slope, error.base) == ("", "", None)
    assert error.points[2].text.startswith("0.0 (")


def test_scores_of_the_day_and_what_stopped_it_stand_beside_the_figures(folder):
    acts = ((State.RUNNING, ""), (State.PAUSED, "torque"), (State.RUNNING, ""),
            (State.PAUSED, "torque"), (State.ABORTED, "the therapist ended it"))  # fmt: skip
    small_bag(folder, reaches=reaches(1.0, support=6.0, reached=False), acts=acts)
    day = datetime.fromtimestamp(MARCH).astimezone().isoformat()
    other = datetime.fromtimestamp(MARCH + WEEK).astimezone().isoformat()
    for scale, value, at in (
        ("pain_before", "2", day), ("pain_after", "5", day), ("rests", "3", day),
        ("pain_after", "9", other),
    ):  # fmt: skip
        assert main(["score", "P-7K3QX", scale, value, "--at", at, "--folder", str(folder)]) == 0
    progress = found(folder)
    assert line(progress, "pain").points[0].text == "pain 2 → 5, tired ? → ?"
    assert line(progress, "rests").points[0].text == "3"
    assert line(progress, "what").points[0].text == "aborted; the therapist ended it; torque (2)"
    assert line(progress, "reached").points[0].text == "0 of 7"
    assert line(progress, "reach [mm]").points[0].text == "6 N: 120 mm"
    assert line(progress, "support").points[0].text == "6 N, walls in 0 of 7"
    assert line(progress, "dose").points[0].text == "0 min, 7 movements, 0.7 m"


@pytest.mark.parametrize(("scale", "value", "why"), [
    ("pain_after", "11", "pain_after ends at 10"), ("FM_UE", "-1", "below the smallest"),
])  # fmt: skip
def test_a_score_off_its_scale_is_refused(folder, scale, value, why, capsys):
    code = main(["score", "--folder", str(folder), "--", "P-7K3QX", scale, value])
    assert code == 1 and why in capsys.readouterr().err
    assert not (folder / "P-7K3QX_scores.json").exists()


def test_a_bag_of_an_older_version_has_a_progress_too(folder, capsys):
    shutil.copytree(OLD, folder / OLD.name)
    assert main(["progress", "P-7K3QX", "--folder", str(folder)]) == 0
    told = capsys.readouterr().out
    assert "4 movements" in told and "2026-11-24 12:05" in told


def test_a_patient_without_a_session_is_said_so(folder, capsys):
    assert main(["progress", "P-22222", "--folder", str(folder)]) == 1
    assert "the record has no dated session of P-22222" in capsys.readouterr().err
