# SPDX-License-Identifier: Apache-2.0
"""`faults`: carry out the fault catalogue against the simulated rig."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import click
from rich.markup import escape

from screw_module_ros.domain import end_without_domain
from screw_module_ros.nodes.support.place import AlreadyRunning
from screw_module_ros.operator.robot import RobotError
from screw_module_ros.trials.isolation import DOMAIN_VARIABLE

from ..console import Console
from ..graph_run import Interrupted
from ..options import OutputFile
from .catalogue import chosen, page
from .row import GOES_ON, Row, Verdict
from .worker_pool import WorkerPool


@click.command(context_settings={"show_default": True})
@click.option("--group", multiple=True, help="Only rows of this group (repeat for more).")
@click.option("--row", multiple=True, help="Only rows with this in their name (repeat for more).")
@click.option("--list", "listed", is_flag=True, help="List the rows without carrying them out.")
@click.option("--table", is_flag=True, help="Print docs/faults.md without carrying out rows.")
@click.option(
    "--json", "json_file", type=OutputFile(), help="Write the verdicts to this file."
)
@click.option(
    "--jobs", type=click.IntRange(1), default=len(os.sched_getaffinity(0)),
    help="Parallel graphs, by default one per core; one if ROS_DOMAIN_ID is set.",
)  # fmt: skip
def command(group, row, listed, table, json_file, jobs) -> None:
    """Carry out the fault catalogue; exit with 1 if a row fails."""
    console = Console()
    try:
        rows = chosen(group, row)
        if table:
            click.echo(page(), nl=False)
        elif listed:
            for one in rows:
                click.echo(f"{one.group:12} {one.name:44} {one.fault}")
        else:
            end_without_domain("faults")
            sys.exit(_carried_out(rows, jobs, console, json_file))
    except Interrupted:
        console.fail("stopped; all nodes ended in order")
        sys.exit(130)
    except (ValueError, RobotError, AlreadyRunning, OSError) as error:
        console.fail(f"faults: {error}")
        sys.exit(2)


def _carried_out(rows: list[Row], jobs: int, console: Console, json_file: Path | None) -> int:
    begun = time.monotonic()
    named = {row.name: row for row in rows}
    verdicts: list[Verdict] = []
    failed: dict[str, str] = {}
    try:
        with WorkerPool(rows, 1 if os.environ.get(DOMAIN_VARIABLE) else jobs) as pool:
            for verdict in pool.verdicts():
                verdicts.append(verdict)
                line = _verdict_line(named[verdict.name], verdict, len(verdicts), len(rows))
                console.show(line)
                if not verdict.passed:
                    failed[verdict.name] = line
    finally:
        _write(json_file, named, verdicts)
    if failed:  # again, so that a log's end says why
        console.show("\n".join(("\nFailed:", *failed.values())))
    console.show(
        f"{len(verdicts) - len(failed)} of {len(rows)} rows passed in "
        f"{time.monotonic() - begun:.0f} s"
        + (f"; failed: {', '.join(failed)}" if failed else "")
    )
    return 1 if failed else 0


def _verdict_line(row: Row, verdict: Verdict, number: int, count: int) -> str:
    mark = "[green]✓[/]" if verdict.passed else "[red]✗[/]"
    if row.safe == GOES_ON:
        figures = "continues"
    else:
        figures = f"{verdict.vertical:.0f} of {row.within}"
        if row.plane_within:
            figures += f", plane {verdict.plane:.0f} of {row.plane_within} samples"
    line = (
        f"{mark} {number:3}/{count} {row.name:42} {figures}, step {verdict.step:.1f} N "
        f"[dim]{verdict.simulated:.1f} s "
        f"in {verdict.seconds:.1f} s[/]"
    )
    if verdict.problem:
        line += "\n      [red]" + escape(verdict.problem) + "[/]"
        if verdict.stuck:
            line += "\n      the graph did not recover; a new one is started"
    return line


def _write(file: Path | None, rows: dict[str, Row], verdicts: list[Verdict]) -> None:
    if file is None:
        return
    done = [
        {
            "group": rows[verdict.name].group,
            "mode": rows[verdict.name].mode_name,
            "within": rows[verdict.name].within,
            "plane_within": rows[verdict.name].plane_within,
            "passed": verdict.passed,
            **verdict._asdict(),
        }
        for verdict in verdicts
    ]
    file.write_text(json.dumps(done, indent=1, ensure_ascii=False) + "\n")


def main() -> None:
    """Console entry point."""
    command()
