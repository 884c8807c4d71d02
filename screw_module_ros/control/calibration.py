# SPDX-License-Identifier: Apache-2.0
"""Strict reading of calibration files: YAML mappings in which every key is known and checked.

A calibration decides forces on a patient, so nothing is guessed: a missing, unknown or doubled key,
a wrong type, a number that is not finite or a list of the wrong length is refused in one sentence
that names the file, the key, the problem and the way out.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any, NoReturn

import yaml

VERSION = 1
_LARGEST_FILE = 1_000_000  # [bytes]; a calibration has a few kilobytes


class CalibrationError(ValueError):
    """A calibration file that cannot be used; the message is one sentence for its author.

    Example: ``friction.yaml: up.trend: 7 numbers found, 8 are needed; give the polynomial's
    coefficients from the highest power to the constant``
    """


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader that refuses a key written twice instead of keeping the last one."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} is written twice", key_node.start_mark
                )
            if isinstance(key, str):
                seen.add(key)
        return super().construct_mapping(node, deep)


class Section:
    """One mapping of a calibration file; each reader below takes a key off it exactly once.

    way_out: of every problem in it, in place of the readers' own: a file that a program wrote is
    not corrected key by key.
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
        where = ".".join(part for part in (self._name, key) if part)
        raise self._error(
            f"{self._file}: {where + ': ' if where else ''}{problem}; {self._way_out or way_out}"
        )

    def section(self, key: str) -> Section:
        """Return the mapping under a key."""
        value = self._take(key)
        if not isinstance(value, dict):
            self.fail(key, f"a mapping is needed, found {_kind(value)}", "indent its keys below it")
        name = f"{self._name}.{key}" if self._name else key
        return Section(self._file, name, value, self._error, self._way_out)

    def text(self, key: str) -> str:
        """Return the text under a key."""
        value = self._take(key)
        if not isinstance(value, str) or not value:
            self.fail(key, f"text is needed, found {_kind(value)}", "put it in quotes")
        return value

    def number(self, key: str, low: float = -math.inf, high: float = math.inf) -> float:
        """Return the number under a key, between low and high."""
        return self._checked(key, self._take(key), low, high)

    def numbers(
        self, key: str, count: int, meaning: str, low: float = -math.inf, high: float = math.inf
    ) -> tuple[float, ...]:
        """Return the list of exactly count numbers under a key; meaning says what they are."""
        values = self._take(key)
        if not isinstance(values, list):
            self.fail(key, f"a list is needed, found {_kind(values)}", f"give {meaning}")
        if len(values) != count:
            self.fail(key, f"{len(values)} numbers found, {count} are needed", f"give {meaning}")
        return tuple(
            self._checked(f"{key}[{index}]", value, low, high)
            for index, value in enumerate(values)
        )

    def names(self) -> list[str]:
        """Return the keys not taken yet, for a section whose keys are not fixed."""
        return [str(key) for key in self._left]

    def finish(self) -> None:
        """Refuse keys that nobody asked for: a misspelt key must not be ignored."""
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
                f"a number is needed, found {_kind(value)}",
                "write it like 12.5 or 1.0e-5, with the decimal point and without quotes",
            )
        if not abs(value) <= 1e300:
            self.fail(key, f"{value} is not a finite number", "measure or fit it again")
        if not low <= value <= high:
            self.fail(key, f"{value:g} is outside {low:g} to {high:g}", "correct it")
        return float(value)


def read_calibration(
    path: str | Path, kind: str, error: type[CalibrationError], way_out: str = ""
) -> Section:
    """Return the top mapping of a calibration file after checking its `format` and `version`.

    kind: what its `format` key must say; way_out: see `Section`. Raises `error` when the file
    cannot be read, is not a YAML mapping, or is of another format or version.
    """
    file = str(path)
    try:
        content = Path(path).read_bytes()
        if len(content) > _LARGEST_FILE:
            raise error(f"{file}: larger than {_LARGEST_FILE} bytes; this is no calibration file")
        values = yaml.load(content.decode(), Loader=_StrictLoader)
    except OSError as problem:
        reason = problem.strerror or problem
        raise error(f"{file}: cannot be read ({reason}); check path and permissions") from problem
    except CalibrationError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError) as problem:
        reason = " ".join(str(problem).split())
        way = way_out or "correct it at that place"
        raise error(f"{file}: not a YAML file ({reason}); {way}") from problem
    if not isinstance(values, dict):
        way = way_out or "start from params/"
        raise error(f"{file}: a YAML mapping is needed, found {_kind(values)}; {way}")
    head = Section(file, "", values, error)
    found = head.text("format")
    if found != kind:
        head.fail("format", f"{found!r} found, {kind!r} is needed", "name a file of that kind")
    version = head.number("version")
    if version != VERSION:
        head.fail("version", f"{version:g} is not known here", "convert the file to version 1")
    rest = {key: value for key, value in values.items() if key not in ("format", "version")}
    return Section(file, "", rest, error, way_out)


def calibration_identity(path: str | Path) -> str:
    """Return the identity of a calibration for logs and bags: file name and hash of its bytes.

    Raises OSError when the file cannot be read.
    """
    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    return f"{Path(path).name} sha256:{digest[:12]}"


def _kind(value: Any) -> str:
    if value is None:
        return "nothing"
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 40 else text[:37] + '...'}"
