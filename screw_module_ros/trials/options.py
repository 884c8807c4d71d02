# SPDX-License-Identifier: Apache-2.0
"""Types of command-line options."""

from __future__ import annotations

import math
from typing import Any

import click


class FiniteRange(click.FloatRange):
    """A finite number in a range. click's own lets nan pass, which is outside of no range."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the number; ends the program with the option's name and what is wrong."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{number} is no finite number", param, ctx)
        return number
