# SPDX-License-Identifier: Apache-2.0
"""Types of command-line options."""

from __future__ import annotations

import math
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
