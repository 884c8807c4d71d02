# SPDX-License-Identifier: Apache-2.0
"""`bench`: how fast things run here, as tables and as JSON. Medians of several runs with ranges.

The graph against the simulated rig, its vertical axis as separate processes and as `module`, at 1
and 2 kHz, on request with `web_bridge` and a page besides; and the in-process loop: simulated over
real time (wanted: 200 on one core).
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

import click

from screw_module_ros.domain import end_without_domain
from screw_module_ros.identification.pool import worker_pool
from screw_module_ros.identification.speed import Speed, speeds
from screw_module_ros.nodes.support.place import AlreadyRunning
from screw_module_ros.operator.robot import RobotError
from screw_module_ros.trials.isolation import own_place

from ..console import Console
from ..graph_run import Interrupted
from ..options import FiniteRange, OutputFile
from .figures import COMPOSED, SEPARATE, Case, Run
from .graph import measure
from .report import LEGEND, content_of, loop_table, page_table, processor_table, timing_table

LOOP = "loop"


@click.command(context_settings={"show_default": True})
@click.option("--runs", default=5, type=click.IntRange(1, 100), help="Of each measurement.")
@click.option("--seconds", default=15.0, type=FiniteRange(2.0, 3600.0), help="Of a run.")
@click.option("--quick", is_flag=True, help="One run of 5 s each.")
@click.option(
    "--only", multiple=True, type=click.Choice([SEPARATE, COMPOSED, LOOP]),
    help="Measure only this (repeat for more).",
)
@click.option(
    "--rate", "rates", multiple=True, type=click.IntRange(50, 4000), default=(1000, 2000),
    help="Ticks per second of the graph (repeat for more).",
)
@click.option(
    "--bridge", is_flag=True,
    help="The graph also with web_bridge and a page connected, in turn with the runs without.",
)
@click.option(
    "--json", "file", default="bench_output.json", type=OutputFile(), help="Output file.",
)  # fmt: skip
def command(
    runs: int, seconds: float, quick: bool, only, rates, bridge: bool, file: Path
) -> None:
    """Measure and say."""
    end_without_domain("bench")
    if quick:
        runs, seconds = 1, 5.0
    wanted = only or (SEPARATE, COMPOSED, LOOP)
    cases = [
        Case(cut, rate, page)
        for cut in (SEPARATE, COMPOSED) if cut in wanted
        for rate in rates for page in ((False, True) if bridge else (False,))
    ]  # fmt: skip
    console = Console()
    measured: dict[Case, list[Run]] = {case: [] for case in cases}
    loop: list[Speed] = []
    code = 0
    try:
        if cases:
            save = partial(write, seconds=seconds, loop=loop, file=file)
            measure_graph(measured, runs, seconds, console, save)
        if LOOP in wanted:
            loop = measure_loop(runs, console)
    except (KeyboardInterrupt, Interrupted):
        console.fail("stopped; all nodes ended in order; these are the figures so far")
        code = 130
    except (AlreadyRunning, OSError) as error:
        console.fail(f"bench failed: {error}")
        code = 1
    if done := _done(measured):
        tables = (timing_table(done), LEGEND, page_table(done), processor_table(done))
        console.show(*filter(None, tables))
    if loop:
        console.show(loop_table(loop))
    try:
        write(measured, seconds, loop, file)
        console.show(f"As JSON: {file}")
    except OSError as error:  # a full disk; the figures are on the screen
        console.fail(f"bench failed: {error}")
        code = 1
    sys.exit(code)


def write(
    measured: dict[Case, list[Run]], seconds: float, loop: list[Speed], file: Path
) -> None:
    """Write what was measured so far."""
    content = {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "cores": len(os.sched_getaffinity(0)),
        **content_of(_done(measured), seconds, loop),
    }
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _done(measured: dict[Case, list[Run]]) -> dict[Case, list[Run]]:
    return {case: runs for case, runs in measured.items() if runs}


def measure_graph(
    found: dict[Case, list[Run]],
    runs: int,
    seconds: float,
    console: Console,
    save: Callable[[dict[Case, list[Run]]], None],
) -> None:
    """Add `runs` runs to each case, in turn, so that a change of the load affects all cases.

    save: called after each run, so that an interruption loses no finished run.
    """
    with tempfile.TemporaryDirectory(prefix="screw_module_bench-") as folder:
        os.environ.setdefault("ROS_LOG_DIR", folder)
        place = own_place()  # one domain for all runs
        try:
            for number in range(1, runs + 1):
                for case, done in found.items():
                    run = _one_run(case, seconds, f"run {number} of {runs}", console)
                    if run is not None:
                        done.append(run)
                        save(found)
        finally:
            place.release()


def _one_run(case: Case, seconds: float, which: str, console: Console) -> Run | None:
    """Return one run; if a node of the graph ended, show a message and return None."""
    try:
        with console.step(f"{case.title} at {case.rate} Hz, {which}"):
            return measure(case, seconds)
    except (RobotError, ValueError) as error:
        console.fail(f"no figures of this run: {error}")
        return None


def measure_loop(runs: int, console: Console) -> list[Speed]:
    """Measure the in-process loop."""
    cores = len(os.sched_getaffinity(0))
    with console.step(f"in-process loop, {runs} runs"), worker_pool(cores) as pool:
        return speeds(runs, pool, cores)


def main() -> None:
    """Console entry point."""
    command()
