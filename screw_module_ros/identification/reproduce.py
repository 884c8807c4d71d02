# SPDX-License-Identifier: Apache-2.0
"""The command `reproduce`: all experiments in process, then the page. No ROS, no hardware."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..calibration.module import THESIS_FILE
from ..calibration.version import law_version
from ..control.law import Law
from ..control.laws import LAWS, loaded, variants
from ..geometry import Screw
from ..plant.settings import load_world
from ..resources import resource_path
from ..settings import SettingError
from ..terminal import Console, command
from . import coverage
from .experiments import EXPERIMENTS
from .lab import Lab, MissingResult, worker_pool
from .page import write_page
from .report import Module, Outcome, Report, shown
from .stand import LoopSettings, SimulatedStand
from .trials import NotPossible

ON_EVERY_MODULE = (
    "static_torque",
    "torque_response",
    "friction_map",
    "gravity",
    "friction_model",
    "inertia",
    "compensation",
    "robustness",
    "calibration",
)
"""Experiments on each perturbed module; the thesis's module gets all experiments."""
OnProgress = Callable[[str, str, float], None]
"""Called with the module, the experiment, and the share of it that is done."""
_SOURCES = Path(__file__).resolve().parents[1]
_MADE_OF = ("plant", "control", "control/laws", "identification", "calibration", ".")
_ONLY_SHOWN = (
    "page.py", "report.py", "coverage.py", "reproduce.py", "figures.py", "figure_style.py",
    "drawing.py",
)  # fmt: skip


@command("reproduce", stopped="stopped; finished results are kept: run it again")
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("reproduction_output"),
    help="Output folder; results finished there by an earlier run are reused.",
)
@click.option("--seeds", default=5, type=click.IntRange(0, 100), help="Perturbed modules.")
@click.option(
    "--first-seed", type=click.IntRange(0),
    help=f"The first one's seed; by default 1, with --coverage {coverage.FIRST_SEED}.",
)  # fmt: skip
@click.option(
    "--coverage", "modules", default=0, type=click.IntRange(0, 1000),
    help="Only how often the stated 95 % intervals hold, over so many perturbed modules.",
)  # fmt: skip
@click.option(
    "--only", multiple=True, type=click.Choice(list(EXPERIMENTS)), help="These experiments alone."
)
@click.option(
    "--plant", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="Plant file."
)
@click.option(
    "--law", "laws", multiple=True, metavar="LAW",
    help="A law of another package too: package.module:NAME, or its entry point.",
)
@click.option("--workers", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--strict", is_flag=True, help="Exit with 3 on a miss without a reason.")
def reproduce(
    console: Console,
    folder: Path,
    seeds: int,
    first_seed: int | None,
    modules: int,
    only: tuple[str, ...],
    plant: Path | None,
    laws: tuple[str, ...],
    workers: int | None,
    strict: bool,
) -> bool:
    """Run the thesis's experiments and ours on the simulated module and write a report."""
    begun = time.monotonic()
    try:
        loaded(laws)
    except SettingError as error:
        raise click.UsageError(str(error)) from None
    if laws and modules:
        raise click.UsageError("--coverage judges no law of others: without --law")
    if modules:
        first = coverage.FIRST_SEED if first_seed is None else first_seed
        return _covered(console, folder, range(first, first + modules), only, plant, workers)
    first_seed = 1 if first_seed is None else first_seed
    total = len(only or EXPERIMENTS) + seeds * len(only or ON_EVERY_MODULE)
    with worker_pool(workers) as pool, _shown(console, total) as on_progress:
        examined = [
            examine(seed, folder, pool, on_progress, only, plant, laws=laws)
            for seed in (None, *range(first_seed, first_seed + seeds))
        ]
    with console.step("drawing and writing the page"):
        page, report = write_page(folder, examined, time.monotonic() - begun)
    console.show(*report.tables(), f"All in {time.monotonic() - begun:.0f} s. The report: {page}")
    return not any(miss.serious for miss in report.misses)


def _covered(
    console: Console, folder: Path, seeds: range, only: tuple[str, ...], plant: Path | None,
    workers: int | None,
) -> bool:  # fmt: skip
    """Tell how often the intervals hold on modules by seed, and leave it for the report."""
    begun, names = time.monotonic(), only or with_needs(coverage.HIDDEN)
    with worker_pool(workers) as pool, _shown(console, len(seeds) * len(names)) as on_progress:
        modules = [
            examine(seed, folder, pool, on_progress, names, plant, coverage.LEFT_OUT)
            for seed in seeds
        ]
    rows = coverage.covered(Report(modules).checked)
    coverage.save(folder, rows)
    failures = [
        f"{module.name}, {name}: {outcome.failure}"
        for module in modules for name, outcome in module.outcomes.items() if outcome.failure
    ]  # fmt: skip
    console.show(
        shown(f"95 % intervals over {len(seeds)} modules, seeds {seeds[0]} to {seeds[-1]}",
              coverage.HEAD, coverage.coverage_rows(rows)),
        *failures,
        f"{coverage.least(len(seeds))} of {len(seeds)} are wanted. "
        f"All in {time.monotonic() - begun:.0f} s.",
    )  # fmt: skip
    return not failures and all(row.verdict != coverage.TOO_NARROW for row in rows)


def with_needs(names: Sequence[str]) -> tuple[str, ...]:
    """Return experiments with those whose results they need, in the order in which they run."""
    wanted, found = list(names), set()
    while wanted:
        name = wanted.pop()
        found.add(name)
        wanted += EXPERIMENTS[name].needs
    return tuple(name for name in EXPERIMENTS if name in found)


def examine(
    seed: int | None,
    folder: Path,
    pool: ProcessPoolExecutor,
    on_progress: OnProgress,
    experiments: Sequence[str] = (),
    plant: Path | None = None,
    changed: Mapping[str, Mapping[str, Any]] = {},
    laws: tuple[str, ...] = (),
) -> Module:
    """Run experiments on one module, reusing finished trials of an earlier run.

    experiments: by name; none = all for the thesis's module, those of `ON_EVERY_MODULE` for
    another; changed: settings of experiments by name; laws: of other packages, whose modes the
    experiments measure too. After a failed experiment the others continue. Raises Cancelled,
    SettingError.
    """
    world, loop = load_world(plant, seed), LoopSettings()
    name = "thesis" if seed is None else f"seed_{seed}"
    wanted = experiments or (EXPERIMENTS if seed is None else ON_EVERY_MODULE)
    screw = Screw(world.vertical.lead)
    stand = SimulatedStand(world, loop, 1 if seed is None else seed, laws, screw)

    def progress(doing: str, done: float, total: float) -> None:
        on_progress(name, doing, done / total if total else 1.0)

    lab = Lab(stand, folder / name, progress, _fingerprint(stand.laws[len(LAWS) :]), pool)
    outcomes = {}
    for experiment in EXPERIMENTS:
        if experiment in wanted:
            on_progress(name, experiment, 0.0)
            outcomes[experiment] = _outcome(lab, experiment, name, changed.get(experiment, {}))
            on_progress(name, experiment, 1.0)
    return Module(seed, world, loop, folder / name, outcomes)


def _outcome(
    lab: Lab, experiment: str, module: str, changed: Mapping[str, Any] = {}
) -> Outcome:
    begun = time.monotonic()
    entry = EXPERIMENTS[experiment]
    settings = entry.settings()._replace(**changed)
    if "modes" in settings._fields:
        others = variants(lab.stand.laws[len(LAWS) :])
        settings = settings._replace(modes=(*settings.modes, *others))
    if "serial" in settings._fields:
        serial = "SIM-0001" if module == "thesis" else f"SIM-{module}"
        settings = settings._replace(serial=serial)
    for end in (".yaml", ".npz"):  # of an earlier run: a failure must not leave it to the others
        (lab.folder / f"{experiment}{end}").unlink(missing_ok=True)
    try:
        result = lab.run(entry, settings)
        result.save(lab.folder)
    except (ValueError, NotPossible, MissingResult) as error:
        return Outcome(None, str(error), time.monotonic() - begun)
    return Outcome(result, "", time.monotonic() - begun)


def _fingerprint(others: Iterable[Law] = ()) -> str:
    """Return a digest of all sources and files that determine an experiment's result.

    others: laws of other packages.
    """
    digest = hashlib.sha256(Path(resource_path(THESIS_FILE)).read_bytes())
    for folder in _MADE_OF:
        for file in sorted((_SOURCES / folder).glob("*.py")):
            if file.name not in _ONLY_SHOWN:
                digest.update(file.read_bytes())
    for law in others:
        digest.update(f"{law.name} {law_version(law)}".encode())
    return digest.hexdigest()[:16]


@contextmanager
def _shown(console: Console, total: int) -> Iterator[OnProgress]:
    """Show progress bars of the current experiment and of the whole run of so many."""
    columns = (
        TextColumn("{task.description:38}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    )  # fmt: skip
    done: set[tuple[str, str]] = set()
    with Progress(*columns, console=console.rich) as bars:
        everything = bars.add_task("everything", total=total)
        current = bars.add_task("", total=1.0)

        def on_progress(module: str, experiment: str, share: float) -> None:
            if share >= 1.0 and (module, experiment) not in done:
                done.add((module, experiment))
                if not console.rich.is_terminal:
                    console.show(f"{module}: {experiment}, {len(done)} of {total} done")
            bars.update(current, description=f"{module}: {experiment}", completed=share)
            bars.update(everything, completed=len(done) + (share if share < 1.0 else 0.0))

        yield on_progress
