# SPDX-License-Identifier: Apache-2.0
"""Types of command-line options."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import click


class FiniteRange(click.FloatRange):
    """A finite number in a range; `click.FloatRange` accepts nan."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the number; exit with a message that names the option if it is not finite."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number", param, ctx)
        return number


class OutputFile(click.Path):
    """A file to write; what prevents it is said before the work, not after it."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False, writable=True, path_type=Path)

    def convert(self, value: Any, param: Any, ctx: Any) -> Path:
        """Return the path; exit with a message that names the option if it cannot be written."""
        file = super().convert(value, param, ctx)
        if not file.parent.is_dir():
            self.fail(f"{file}: there is no folder {file.parent}", param, ctx)
        if not file.exists() and not os.access(file.parent, os.W_OK | os.X_OK):
            self.fail(f"{file}: no permission to write into {file.parent}", param, ctx)
        return file
