# SPDX-License-Identifier: Apache-2.0
"""Calibration files: YAML of a known format and version, and their identity."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ..plain_yaml import load_plain_yaml
from ..quoting import quoted
from ..regular_file import NotRegular, read_regular
from .strict_mapping import CalibrationError, Section, kind_of

VERSION = 1
_LARGEST_FILE = 1_000_000  # [bytes]; a calibration has a few kilobytes


def read_calibration(
    path: str | Path, kind: str, error: type[CalibrationError], way_out: str = ""
) -> Section:
    """Return the top mapping of a calibration file after checking its `format` and `version`.

    kind: required value of the key `format`; way_out: see `Section`. Raises `error` when the file
    cannot be read, is not a YAML mapping, or is of another format or version.
    """
    return parsed_calibration(str(path), file_content(path, error), kind, error, way_out)


def file_content(path: str | Path, error: type[CalibrationError]) -> bytes:
    """Return the content of a calibration file. Raises `error` when it cannot be read."""
    try:
        return read_regular(path, _LARGEST_FILE)
    except OSError as problem:
        reason = problem.strerror or problem
        odd = isinstance(problem, NotRegular)
        way = "this is no calibration file" if odd else "check path and permissions"
        raise error(f"{path}: cannot be read ({reason}); {way}") from problem


def parsed_calibration(
    file: str, content: bytes, kind: str, error: type[CalibrationError], way_out: str = ""
) -> Section:
    """Return the top mapping of a file's content, as `read_calibration` does."""
    try:
        values = load_plain_yaml(content.decode())
    except ValueError as problem:
        reason = " ".join(str(problem).split())
        way = way_out or "correct it at that place"
        raise error(f"{file}: not a YAML file ({reason}); {way}") from problem
    if not isinstance(values, dict):
        way = way_out or "start from params/"
        raise error(f"{file}: a YAML mapping is needed, found {kind_of(values)}; {way}")
    head = Section(file, "", values, error)
    found = head.text("format")
    if found != kind:
        problem = f"{quoted(found)} found, {kind!r} is needed"
        head.fail("format", problem, "name a file of that kind")
    version = head.number("version")
    if version != VERSION:
        head.fail("version", f"{version:g} is not known here", "convert the file to version 1")
    rest = {key: value for key, value in values.items() if key not in ("format", "version")}
    return Section(file, "", rest, error, way_out)


def check_serial(file: str, written: str, serial: str, error: type[CalibrationError]) -> None:
    """Raise `error` unless a file of the module `written` is for this module.

    serial: that of this module, empty if nobody said which it is: then no file is for it.
    """
    if not serial:
        raise error(
            f"{file}: serial: the file belongs to module {quoted(written)}, and which module this "
            "is was not said; set module_serial to the serial on the module"
        )
    if written != serial:
        raise error(
            f"{file}: serial: the file belongs to module {quoted(written)}, this is module "
            f"{quoted(serial)} (module_serial); name the file of this module, or identify it"
        )


def calibration_identity(path: str | Path) -> str:
    """Return the identity of a calibration for logs and bags: file name and hash of its bytes.

    Raises OSError when the file cannot be read.
    """
    digest = hashlib.sha256(read_regular(path, _LARGEST_FILE)).hexdigest()
    return f"{Path(path).name} sha256:{digest[:12]}"
