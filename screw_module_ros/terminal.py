# SPDX-License-Identifier: Apache-2.0
"""The terminal of a command."""

from __future__ import annotations

from rich.console import Console


def terminal(narrowest: int, quiet: bool = False) -> Console:
    """Return the terminal of a command; where it is a file, with so many columns at least.

    quiet: shows nothing.
    """
    console = Console(highlight=False, quiet=quiet)
    if not console.is_terminal:
        console.width = max(console.width, narrowest)
    return console
