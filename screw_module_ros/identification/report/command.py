# SPDX-License-Identifier: Apache-2.0
"""The command `reproduce`: all experiments in process, then the page. No ROS, no hardware."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ...settings import SettingError
from ..catalogue import EXPERIMENTS
from ..pool import worker_pool
from .page import write_page
from .study import ON_EVERY_MODULE, OnProgress, examine

_NARROWEST = 110  # columns where the output goes into a file


@click.command(context_settings={"show_default": True})
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("reproduction_output"),
    help="Output folder; results finished there by an earlier run are reused.",
)
@click.option("--seeds", default=5, type=click.IntRange(0, 100), help="Perturbed modules.")
@click.option("--first-seed", default=1, type=click.IntRange(0), help="The first one's seed.")
@click.option(
    "--only", multiple=True, type=click.Choice(list(EXPERIMENTS)), help="These experiments alone."
)
@click.option(
    "--plant", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="Plant file."
)
@click.option("--fresh", is_flag=True, help="Remove the results in the folder first.")
@click.option("--workers", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--strict", is_flag=True, help="Exit with 3 on a miss without a reason.")
def command(
    folder: Path,
    seeds: int,
    first_seed: int,
    only: tuple[str, ...],
    plant: Path | None,
    fresh: bool,
    workers: int | None,
    strict: bool,
) -> None:
    """Run every experiment of the thesis on the simulated module and write a report."""
    console, begun = Console(highlight=False), time.monotonic()
    if not console.is_terminal:
        console.width = max(console.width, _NARROWEST)
    try:
        if fresh:
            _remove_own(folder)
        with worker_pool(workers) as pool, _shown(console, only, seeds) as on_progress:
            modules = [
                examine(seed, folder, pool, on_progress, only, plant)
                for seed in (None, *range(first_seed, first_seed + seeds))
            ]
        with console.status("drawing and writing the page"):
            report = write_page(folder, modules, time.monotonic() - begun)
    except KeyboardInterrupt:
        console.print(f"[bold red]stopped[/]; finished results are in {folder}: run it again")
        sys.exit(130)
    except (SettingError, OSError) as error:
        console.print(f"[bold red]reproduce failed: {error}[/]", soft_wrap=True)
        sys.exit(1)
    console.print(*report.tables(), sep="\n")
    console.print(f"All in {time.monotonic() - begun:.0f} s. The report: {report.page}")
    if strict and any(miss.serious for miss in report.misses):
        sys.exit(3)


def _remove_own(folder: Path) -> None:
    """Remove only this command's own output from the folder."""
    for name in (*folder.glob("seed_*"), folder / "thesis", folder / "figures"):
        if name.is_dir():
            shutil.rmtree(name)


@contextmanager
def _shown(console: Console, only: tuple[str, ...], seeds: int) -> Iterator[OnProgress]:
    """Show progress bars of the current experiment and of the whole run."""
    first = len(only or EXPERIMENTS)
    total = first + seeds * len(only or ON_EVERY_MODULE)
    columns = (
        TextColumn("{task.description:38}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    )  # fmt: skip
    done: set[tuple[str, str]] = set()
    with Progress(*columns, console=console) as bars:
        everything = bars.add_task("everything", total=total)
        current = bars.add_task("", total=1.0)

        def on_progress(module: str, experiment: str, share: float) -> None:
            if share >= 1.0 and (module, experiment) not in done:
                done.add((module, experiment))
                if not console.is_terminal:
                    console.print(f"{module}: {experiment}, {len(done)} of {total} done")
            bars.update(current, description=f"{module}: {experiment}", completed=share)
            bars.update(everything, completed=len(done) + (share if share < 1.0 else 0.0))

        yield on_progress


def main() -> None:
    """Console entry point."""
    command()


