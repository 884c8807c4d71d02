# SPDX-License-Identifier: Apache-2.0
"""The command line of every command: terminal, options, exit codes. No ROS.

    @command("demo")
    @click.option("--quick", is_flag=True)
    def demo(console, quick):
        with console.step("the robot works"):
            ...
        return table.accepted
"""

from __future__ import annotations

import functools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Console as Terminal
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

FAILED, NOT_REACHED, INTERRUPTED = 1, 3, 130


class Console:
    """Shows steps with a spinner on a terminal, and as plain lines in a file or a pipe.

    folder: of the output, named if the command fails. quiet: show nothing. narrowest: columns at
    least where the output goes into a file.
    """

    def __init__(self, quiet: bool = False, narrowest: int = 110):
        self.folder: Path | None = None
        self.rich = Terminal(highlight=False, quiet=quiet)
        if not self.rich.is_terminal:
            self.rich.width = max(self.rich.width, narrowest)

    @contextmanager
    def step(self, text: str) -> Iterator[Callable[[str], None]]:
        """Show the step `text` while it runs and after it; the yielded function shows a detail."""
        begun = time.monotonic()
        with self.rich.status(text) as status:
            try:
                yield lambda more: status.update(f"{text}: {more}" if more else text)
            except BaseException:
                self.rich.print(f"[red]✗[/] {text}")
                raise
        self.rich.print(f"[green]✓[/] {text} [dim]{time.monotonic() - begun:.1f} s[/]")

    @contextmanager
    def progress(
        self, text: str, total: float, before: float = 0.0
    ) -> Iterator[Callable[[float], None]]:
        """Show a step, and a bar over `total` seconds with the time left.

        before: seconds of earlier steps; the yielded function takes those of this one.
        """
        columns = (TextColumn("  {task.description}"), BarColumn(), TimeRemainingColumn())
        with self.step(text):
            if not self.rich.is_terminal:
                yield lambda done: None
                return
            with Progress(*columns, console=self.rich, transient=True) as bar:
                task = bar.add_task(text, total=total)
                bar.update(task, completed=before)
                yield lambda done: bar.update(task, completed=before + done)

    def show(self, *what: Table | str) -> None:
        """Print tables and lines."""
        for item in what:
            self.rich.print(item, soft_wrap=isinstance(item, str))

    def fail(self, text: str) -> None:
        """Print an error message."""
        self.rich.print(f"[bold red]{text}[/]", soft_wrap=True)


def command(
    name: str,
    failures: tuple[type[Exception], ...] = (),
    before: Callable[[], None] = lambda: None,
    stopped: str = "stopped",
    narrowest: int = 110,
) -> Callable[[Callable[..., bool | None]], click.Command]:
    """Make a click command of a function of console and options, and exit codes of its outcomes.

    0; 1 for what can go wrong, with one sentence; 3 if it returns False (a wanted figure was
    missed) and --strict was given; 130 for Ctrl-C. failures: what can go wrong beside OSError and
    ValueError. before: called first. stopped: said after Ctrl-C. narrowest: as of `Console`.
    """

    known: tuple[type[Exception], ...] = (OSError, ValueError, *failures)

    def decorate(work: Callable[..., bool | None]) -> click.Command:
        @functools.wraps(work)
        def run(**options: Any) -> None:
            before()
            console = Console(narrowest=narrowest)
            try:
                reached = work(console, **options)
            except KeyboardInterrupt:
                console.fail(stopped)
                sys.exit(INTERRUPTED)
            except known as error:
                rest = f"\nThe output so far is in {console.folder}" if console.folder else ""
                console.fail(f"{name} failed: {error}{rest}")
                sys.exit(FAILED)
            if options.get("strict") and not reached:
                sys.exit(NOT_REACHED)

        return click.command(context_settings={"show_default": True})(run)

    return decorate


def output_option(default: str) -> Callable:
    """Return the option --folder of a command with output files."""
    return click.option(
        "--folder", type=click.Path(file_okay=False, path_type=Path), default=Path(default),
        help="Each run makes a folder of its own in here.",
    )  # fmt: skip
