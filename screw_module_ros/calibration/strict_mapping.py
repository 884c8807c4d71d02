# SPDX-License-Identifier: Apache-2.0
"""Strict reading of a mapping: every key is known, read once and checked.

A calibration determines forces on a patient, so the reader guesses nothing. It refuses a missing,
unknown or repeated key, a wrong type, a number that is not finite and a list of the wrong length,
each with a message that names the file, the key, the problem and the way out.
"""

from __future__ import annotations

import math
from typing import Any, NoReturn

from ..quoting import LONGEST, quoted


class CalibrationError(ValueError):
    """A calibration file that cannot be used; the message is one sentence for its author.

    Example: ``friction.yaml: up.trend: 7 numbers found, 8 are needed; give the polynomial's
    coefficients from the highest power to the constant``
    """


class Section:
    """One mapping of a calibration file; each method below reads one key exactly once.

    way_out: of every problem, instead of the methods' own ones: nobody corrects a generated file
    key by key.
    """

    def __init__(
        self, file: str, name: str, values: dict, error: type[CalibrationError], way_out: str = ""
    ):
        self._file = file
        self._name = name
        self._left = dict(values)
        self._error = error
        self._way_out = way_out

    def fail(self, key: str, problem: str, way_out: str) -> NoReturn:
        """Raise the file's error about one key of this section."""
        where = ".".join(part for part in (self._name, key[:LONGEST]) if part)
        raise self._error(
            f"{self._file}: {where + ': ' if where else ''}{problem}; {self._way_out or way_out}"
        )

    def section(self, key: str) -> Section:
        """Return the mapping under a key."""
        value = self._take(key)
        if not isinstance(value, dict):
            problem = f"a mapping is needed, found {kind_of(value)}"
            self.fail(key, problem, "indent its keys below it")
        name = f"{self._name}.{key}" if self._name else key
        return Section(self._file, name, value, self._error, self._way_out)

    def text(self, key: str) -> str:
        """Return the text under a key."""
        value = self._take(key)
        if not isinstance(value, str) or not value:
            self.fail(key, f"text is needed, found {kind_of(value)}", "put it in quotes")
        return value

    def number(self, key: str, low: float = -math.inf, high: float = math.inf) -> float:
        """Return the number under a key, between low and high."""
        return self._checked(key, self._take(key), low, high)

    def numbers(
        self, key: str, count: int, meaning: str, low: float = -math.inf, high: float = math.inf
    ) -> tuple[float, ...]:
        """Return the list of exactly count numbers under a key; meaning: text for the error."""
        values = self._take(key)
        if not isinstance(values, list):
            self.fail(key, f"a list is needed, found {kind_of(values)}", f"give {meaning}")
        if len(values) != count:
            self.fail(key, f"{len(values)} numbers found, {count} are needed", f"give {meaning}")
        return tuple(
            self._checked(f"{key}[{index}]", value, low, high)
            for index, value in enumerate(values)
        )

    def names(self) -> list[str]:
        """Return the keys not read yet, for a section whose keys are not fixed."""
        return [str(key) for key in self._left]

    def finish(self) -> None:
        """Refuse keys that were not read: a misspelt key must not be ignored."""
        for key in self._left:
            self.fail(str(key), "unknown key", "correct its spelling or remove it")

    def _take(self, key: str) -> Any:
        if key not in self._left:
            self.fail(key, "missing", "add it, as in the file that comes with the package")
        return self._left.pop(key)

    def _checked(self, key: str, value: Any, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.fail(
                key,
                f"a number is needed, found {kind_of(value)}",
                "write it like 12.5 or 1.0e-5, with the decimal point and without quotes",
            )
        if not abs(value) <= 1e300:
            self.fail(key, f"{quoted(value)} is not a finite number", "measure or fit it again")
        if not low <= value <= high:
            self.fail(key, f"{value:g} is outside {low:g} to {high:g}", "correct it")
        return float(value)


def kind_of(value: Any) -> str:
    """Return the type of a value and the value, for a message."""
    if value is None:
        return "nothing"
    text = quoted(value)
    return f"{type(value).__name__} {text if len(text) <= 40 else text[:37] + '...'}"
