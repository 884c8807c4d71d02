# SPDX-License-Identifier: Apache-2.0
"""A lab keeps finished parts after any interruption; results are read as they were saved."""

import functools
from functools import partial

import numpy as np
import pytest

from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.geometry import SCREW
from screw_module_ros.identification.lab import Lab, MissingResult, worker_pool
from screw_module_ros.identification.results import (
    DERIVED,
    Published,
    Quantity,
    Result,
    load_result,
)
from screw_module_ros.identification.stage_runs import binned
from screw_module_ros.identification.trials import (
    STAGE,
    Cancelled,
    NotPossible,
    PlanarTrial,
    Samples,
    StageTrial,
)

SPEEDS = (0.01, 0.02, 0.05)


class CountingBench:
    """Gives a sample per trial and counts."""

    rate, name, serial, offers = 1000.0, "counting", "", frozenset({STAGE})

    def __init__(self):
        self.done = []

    def record(self, trial, told):
        told(0.5)
        self.done.append(trial.speed)
        return Samples(*(np.full(3, trial.speed) for _ in Samples._fields))


def mean_force(trial, samples, scale=1.0):
    """Reduce a run to one number."""
    return {"force": np.array(scale * samples.force.mean())}


TRIALS = {f"speed_{v:g}": StageTrial(v, 0.1, 0.12) for v in SPEEDS}


@pytest.fixture
def counting():
    return CountingBench()


def test_interrupted_run_resumes_where_it_was(tmp_path, counting):
    def stop_in_the_third(doing, done, total):
        if len(counting.done) == 2 and done > 2.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        Lab(counting, tmp_path, stop_in_the_third).record("friction", TRIALS, mean_force)
    assert 0 < len(counting.done) < len(SPEEDS)
    parts = Lab(counting, tmp_path).record("friction", TRIALS, mean_force)
    assert counting.done == list(SPEEDS), "what was finished was not done again"
    assert [float(parts[f"speed_{v:g}"]["force"]) for v in SPEEDS] == pytest.approx(SPEEDS)


@pytest.mark.parametrize(
    ("name", "reduce", "fingerprint", "cut"),
    [
        ("friction", functools.partial(mean_force, scale=2.0), "", None),
        ("other", mean_force, "", None),
        ("friction", mean_force, "new", None),
        ("friction", mean_force, "", 40),
    ],
    ids=["reduced otherwise", "another experiment", "another rig", "cut off by a crash"],
)
def test_parts_of_something_else_are_not_taken(tmp_path, counting, name, reduce, fingerprint, cut):
    Lab(counting, tmp_path).record("friction", TRIALS, mean_force)
    for file in tmp_path.rglob("*.npz"):
        file.write_bytes(file.read_bytes()[:cut])
    given = {"fingerprint": fingerprint} if fingerprint else {}
    Lab(counting, tmp_path, **given).record(name, TRIALS, reduce)
    assert len(counting.done) == 2 * len(SPEEDS)


def test_what_the_bench_lacks_is_refused_before_the_first_trial(tmp_path, counting):
    """A live stand did an hour of trials, and refused the others then."""
    trials = {**TRIALS, "plane": PlanarTrial(PlanarSettings())}
    with pytest.raises(NotPossible, match="plane are only there in process"):
        Lab(counting, tmp_path).record("x", trials, mean_force)
    assert counting.done == []


def test_progress_counts_what_was_kept(tmp_path, counting):
    told = []
    lab = Lab(counting, tmp_path, lambda doing, done, total: told.append(done / total))
    lab.record("friction", TRIALS, mean_force)
    assert told == sorted(told) and told[-1] == pytest.approx(1.0)
    told.clear()
    lab.record("friction", TRIALS, mean_force)
    assert told == [pytest.approx(1.0)]


@pytest.mark.long
def test_pool_gives_what_one_process_gives_and_its_errors(tmp_path, stand):
    trials = dict(list(TRIALS.items())[1:])
    too_short = {"short": StageTrial(0.5, 0.1, 0.1005)}
    alone = Lab(stand, tmp_path / "alone").record("friction", trials, partial(binned, screw=SCREW))
    with worker_pool(2) as pool:
        lab = Lab(stand, tmp_path / "shared", pool=pool)
        shared = lab.record("friction", trials, partial(binned, screw=SCREW))
        with pytest.raises(ValueError, match="samples|deviates"):
            lab.record("friction", too_short, partial(binned, screw=SCREW))
    assert list(alone) == list(shared)
    for name in alone:
        assert np.isfinite(alone[name]["force"]).any()
        assert np.array_equal(alone[name]["force"], shared[name]["force"], equal_nan=True)


def test_result_comes_back(tmp_path):
    result = Result(
        "weighing",
        (
            Quantity("gravity", 10.04, 0.1, "N", "weight", thesis=Published("weight", 0.5, "x")),
            Quantity("n", 3.0, float("nan"), "", "n", DERIVED),
        ),
        {"speeds": (0.1, 0.2), "count": np.int64(3)},
        ("a note",),
        {"curve": np.arange(4.0)},
    )
    result.save(tmp_path)
    back = load_result(tmp_path, "weighing")
    assert back.settings == {"speeds": [0.1, 0.2], "count": 3}
    assert back.notes == ("a note",)
    assert back.quantity("gravity") == result.quantity("gravity")
    assert np.isnan(back.quantity("n").uncertainty) and back.quantity("n").kind == DERIVED
    assert np.array_equal(back.data["curve"], result.data["curve"])
    with pytest.raises(KeyError, match="weighing has no 'mass'; there are gravity, n"):
        back.value("mass")


def test_missing_and_damaged_results_are_told(tmp_path):
    lab = Lab(CountingBench(), tmp_path)
    with pytest.raises(MissingResult, match="the result of gravity is missing .* run gravity"):
        lab.result("gravity")
    (tmp_path / "gravity.yaml").write_text("quantities: [1, 2]\n")
    with pytest.raises(ValueError, match="not the result of an experiment"):
        lab.result("gravity")


@pytest.mark.parametrize("kept", [0, 100])
def test_a_result_cut_off_by_a_full_disk_is_told(tmp_path, kept):
    Result("weighing", (), {}, (), {"curve": np.arange(40.0)}).save(tmp_path)
    file = tmp_path / "weighing.npz"
    file.write_bytes(file.read_bytes()[:kept])
    with pytest.raises(ValueError, match=r"weighing\.npz: damaged"):
        load_result(tmp_path, "weighing")
