# SPDX-License-Identifier: Apache-2.0
"""Formats values for tables."""

from __future__ import annotations

import math

from ..results import Quantity


def value_text(quantity: Quantity) -> str:
    """Return value, uncertainty and unit as text."""
    times, unit = scaled(quantity.value, quantity.unit)
    value, spread = quantity.value * times, quantity.uncertainty * times
    if math.isnan(spread) or spread <= 0.0 or not math.isfinite(value):
        return f"{number(value)} {unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(spread)))
    if digits > 6 or abs(value) >= 1e5:
        return f"{number(value)} ± {spread:.2g} {unit}".strip()
    return f"{value:.{digits}f} ± {spread:.{digits}f} {unit}".strip()


def scaled(value: float, unit: str) -> tuple[float, str]:
    """Return the factor and the unit of the most readable form of a value."""
    if unit == "s" and abs(value) < 1e-2:
        return 1e6, "us"
    if unit in ("m", "m/s") and abs(value) < 0.5:
        return 1e3, f"m{unit}"
    return 1.0, unit


def number(value: float) -> str:
    """Return a value with the digits of a table."""
    return f"{value:.6g}" if abs(value) < 10.0 and abs(value - 1.0) < 0.01 else f"{value:.4g}"


def like(quantity: Quantity, value: float) -> str:
    """Return another value of a quantity as text, without uncertainty."""
    return value_text(quantity._replace(value=value, uncertainty=math.nan))
