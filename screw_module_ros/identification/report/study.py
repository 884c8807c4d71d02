# SPDX-License-Identifier: Apache-2.0
"""Runs the experiments on the thesis's module and on modules perturbed by seed."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

from ...calibration.module import THESIS_FILE
from ...plant.settings import WorldSettings, load_world
from ...resources import resource_path
from ..catalogue import EXPERIMENTS
from ..in_process import InProcessBench, LoopSettings
from ..lab import Lab, MissingResult
from ..pool import PoolLab
from ..results import Result
from ..trials import NotPossible

ON_EVERY_MODULE = (
    "static_torque",
    "friction_map",
    "gravity",
    "friction_model",
    "inertia",
    "compensation",
    "robustness",
    "calibration",
)
"""Experiments on each perturbed module; the thesis's module gets all experiments."""

_SOURCES = Path(__file__).resolve().parents[2]
_MADE_OF = (
    "plant", "control", "identification", "calibration", "compiled.py", "units.py", "filters.py",
    "geometry.py",
)  # fmt: skip
_ONLY_SHOWN = ("figures", "report")


class Outcome(NamedTuple):
    """Outcome of one experiment: its result or the failure; seconds: duration [s]."""

    result: Result | None
    failure: str
    seconds: float


class Module(NamedTuple):
    """One module and its outcomes. seed: None = the thesis's module; folder: of the results."""

    seed: int | None
    world: WorldSettings
    loop: LoopSettings
    folder: Path
    outcomes: dict[str, Outcome]

    def result(self, experiment: str) -> Result | None:
        """Return the result of an experiment, None when there is none."""
        outcome = self.outcomes.get(experiment)
        return outcome.result if outcome else None


OnProgress = Callable[[str, str, float], None]
"""Called with the module, the experiment, and the share of it that is done."""


def examine(
    seed: int | None,
    folder: Path,
    pool: ProcessPoolExecutor,
    on_progress: OnProgress,
    experiments: Sequence[str] = (),
    plant: Path | None = None,
) -> Module:
    """Run experiments on one module, reusing finished parts of an earlier run.

    experiments: by name, in the catalogue's order; none = all for the thesis's module, those of
    `ON_EVERY_MODULE` for another. After a failed experiment the others continue.
    Raises Cancelled, SettingError.
    """
    world = load_world(plant, seed)
    loop = LoopSettings()
    name = "thesis" if seed is None else f"seed_{seed}"
    wanted = experiments or (EXPERIMENTS if seed is None else ON_EVERY_MODULE)
    bench = InProcessBench(world, loop, seed=1 if seed is None else seed)

    def progress(doing: str, done: float, total: float) -> None:
        on_progress(name, doing, done / total if total else 1.0)

    lab = PoolLab(bench, folder / name, pool, progress, fingerprint_of_sources())
    outcomes = {}
    for experiment in EXPERIMENTS:
        if experiment in wanted:
            on_progress(name, experiment, 0.0)
            outcomes[experiment] = _outcome(lab, experiment, name)
            on_progress(name, experiment, 1.0)
    return Module(seed, world, loop, folder / name, outcomes)


def _outcome(lab: Lab, experiment: str, module: str) -> Outcome:
    begun = time.monotonic()
    entry = EXPERIMENTS[experiment]
    settings = entry.settings()
    if "serial" in settings._fields:
        settings = settings._replace(serial=serial_of(module))
    for end in (".yaml", ".npz"):  # of an earlier run: a failure must not leave it to the others
        (lab.folder / f"{experiment}{end}").unlink(missing_ok=True)
    try:
        result = entry.run(lab, settings)
        result.save(lab.folder)
    except (ValueError, NotPossible, MissingResult) as error:
        return Outcome(None, str(error), time.monotonic() - begun)
    return Outcome(result, "", time.monotonic() - begun)


def serial_of(module: str) -> str:
    """Return the serial number of a simulated module's calibration."""
    return "SIM-0001" if module == "thesis" else f"SIM-{module}"


def fingerprint_of_sources() -> str:
    """Return a digest of all sources and files that determine an experiment's result."""
    digest = hashlib.sha256()
    for name in _MADE_OF:
        path = _SOURCES / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            if not set(file.relative_to(_SOURCES).parts) & set(_ONLY_SHOWN):
                digest.update(file.read_bytes())
    digest.update(Path(resource_path(THESIS_FILE)).read_bytes())
    return digest.hexdigest()[:16]
