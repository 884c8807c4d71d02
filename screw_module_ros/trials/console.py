# SPDX-License-Identifier: Apache-2.0
"""Terminal output of a long-running command: steps with their duration, and progress bars."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console as RichConsole
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

_NARROWEST = 110  # columns where the output goes into a file


class Console:
    """Shows steps with a spinner on a terminal, and as plain lines in a file or a pipe."""

    def __init__(self):
        self._rich = RichConsole(highlight=False)
        if not self._rich.is_terminal:
            self._rich.width = max(self._rich.width, _NARROWEST)

    @contextmanager
    def step(self, text: str) -> Iterator[Callable[[str], None]]:
        """Show the step `text` while it runs and after it; the yielded function shows a detail."""
        begun = time.monotonic()
        shown = text
        with self._rich.status(text) as status:

            def detail(more: str) -> None:
                nonlocal shown
                now = f"{text}: {more}" if more else text
                if now != shown:
                    shown = now
                    status.update(now)

            try:
                yield detail
            except BaseException:
                self._rich.print(f"[red]✗[/] {text}")
                raise
        self._rich.print(f"[green]✓[/] {text} [dim]{time.monotonic() - begun:.1f} s[/]")

    @contextmanager
    def progress(self, text: str, total: float) -> Iterator[Callable[[float], None]]:
        """Show a bar over `total` seconds; the yielded function takes the elapsed seconds."""
        columns = (TextColumn("  {task.description}"), BarColumn(), TimeRemainingColumn())
        with self.step(text):
            if not self._rich.is_terminal:
                yield lambda done: None
                return
            with Progress(*columns, console=self._rich, transient=True) as bar:
                task = bar.add_task(text, total=total)
                yield lambda done: bar.update(task, completed=done)

    def show(self, *what: Table | str) -> None:
        """Print tables and lines."""
        for item in what:
            self._rich.print(item, soft_wrap=isinstance(item, str))

    def fail(self, text: str) -> None:
        """Print an error message."""
        self._rich.print(f"[bold red]{text}[/]", soft_wrap=True)
