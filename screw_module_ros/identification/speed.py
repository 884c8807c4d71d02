# SPDX-License-Identifier: Apache-2.0
"""Speed of the in-process loop relative to real time: part of `make bench`.

Compiled plant, drivers' scaling, law and arm at 2 kHz samples with the plant's substeps, after a
warm-up run; medians of several runs, on one core and on all cores in parallel.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from statistics import median
from typing import NamedTuple

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..plant.settings import load_world
from .bench import InProcessBench
from .trials import MotionTrial, StageTrial, Trial

SECONDS = 60.0
TRIALS: dict[str, Trial] = {
    "closed loop, combined law, arm": MotionTrial(
        modes.COMBINED, VerticalSettings(), duration=SECONDS
    ),
    "stage, no torque": StageTrial(0.3 / SECONDS, 0.03, 0.33),
}


class Speed(NamedTuple):
    """Simulated over real time of each run, ascending; cores: number of parallel processes."""

    trial: str
    cores: int
    factors: tuple[float, ...]

    @property
    def median(self) -> float:
        """The median of the runs."""
        return median(self.factors)


def speeds(runs: int, pool: ProcessPoolExecutor, cores: int) -> list[Speed]:
    """Measure every trial on one core and on `cores` in parallel, `runs` times each."""
    found = []
    for name in TRIALS:
        alone = [pool.submit(one_run, name).result() for _ in range(runs)]
        found.append(Speed(name, 1, tuple(sorted(alone))))
    for name in TRIALS:
        together = []
        for _ in range(runs):
            futures = [pool.submit(one_run, name) for _ in range(cores)]
            together.append(sum(future.result() for future in futures))
        found.append(Speed(name, cores, tuple(sorted(together))))
    return found


def one_run(name: str) -> float:
    """Return simulated over real time of one run, after a short warm-up run."""
    bench, trial = InProcessBench(load_world()), TRIALS[name]
    bench.record(_shortened(trial), lambda share: None)
    begun = time.perf_counter()
    samples = bench.record(trial, lambda share: None)
    return float(samples.time[-1]) / (time.perf_counter() - begun)


def _shortened(trial: Trial) -> Trial:
    if isinstance(trial, StageTrial):
        return trial._replace(end=trial.start + 0.001)
    return trial._replace(duration=0.1)
