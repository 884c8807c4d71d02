# SPDX-License-Identifier: Apache-2.0
"""`bench`: how fast things run here, as a table and as JSON. Medians of several runs with ranges.

The in-process loop: simulated over real time (wanted: 200 on one core).
"""

from __future__ import annotations

import json
import os
import platform
import sys
from datetime import datetime, timezone
from pathlib import Path

import click
from rich.table import Table

from screw_module_ros.identification.pool import worker_pool
from screw_module_ros.identification.speed import Speed, speeds

from .support.console import Console

WANTED_FACTOR = 200.0


@click.command(context_settings={"show_default": True})
@click.option("--runs", default=5, type=click.IntRange(1, 100), help="Of each measurement.")
@click.option(
    "--json", "file", default="bench_output.json", type=click.Path(dir_okay=False, path_type=Path),
    help="Where the figures go.",
)  # fmt: skip
def command(runs: int, file: Path) -> None:
    """Measure and say."""
    console = Console()
    cores = len(os.sched_getaffinity(0))
    try:
        with console.step(f"in-process loop, {runs} runs"), worker_pool(cores) as pool:
            found = speeds(runs, pool, cores)
        content = {
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "python": platform.python_version(),
            "cores": cores,
            "in_process_loop": [
                {**speed._asdict(), "median": speed.median} for speed in found
            ],
        }
        file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    except KeyboardInterrupt:
        sys.exit(130)
    except OSError as error:
        console.fail(f"bench did not work: {error}")
        sys.exit(1)
    console.show(loop_table(found), f"As JSON: {file}")


def loop_table(found: list[Speed]) -> Table:
    """Return the table of the in-process loop."""
    table = Table(title="In-process loop, 2 kHz samples, substeps of 50 us", title_justify="left")
    for name in ("trial", "cores", "x real time", "range", f"wanted {WANTED_FACTOR:g} on one core"):
        table.add_column(name, justify="left" if name == "trial" else "right")
    for speed in found:
        low, high = speed.factors[0], speed.factors[-1]
        verdict = "" if speed.cores > 1 else "yes" if speed.median >= WANTED_FACTOR else "MISSED"
        table.add_row(
            speed.trial, str(speed.cores), f"{speed.median:.0f}", f"{low:.0f}..{high:.0f}", verdict
        )
    return table


def main() -> None:
    """Console entry point."""
    command()


if __name__ == "__main__":
    main()
