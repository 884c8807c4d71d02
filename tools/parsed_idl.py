# SPDX-License-Identifier: Apache-2.0
"""Lets the generators of ROS messages parse each interface file once, not seven times.

Each generator is a program that parses all files, character by character (Earley), comments too:
of the 40 s of processor time that our messages take that is 18 s. `make build` copies this file
into the environment, where rosidl_parser applies `parsed_once` to its function, and names a folder
for what is parsed. Without the folder nothing changes.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

FOLDER = "SCREW_MODULE_PARSED_IDL"


def parsed_once(parse: Callable[..., Any]) -> Callable[..., Any]:
    """Return `parse`, which takes the locator of a file, with what it returned for the same one."""

    @functools.wraps(parse)
    def kept(locator: Any, **options: Any) -> Any:
        if not (folder := os.environ.get(FOLDER)):
            return parse(locator, **options)
        path = locator.get_absolute_path()
        what = hashlib.sha256(str(path).encode() + path.read_bytes())
        file = Path(folder, what.hexdigest())
        if file.exists():
            return pickle.loads(file.read_bytes())
        found = parse(locator, **options)
        draft = file.with_suffix(f".{os.getpid()}")  # generators run beside each other
        draft.write_bytes(pickle.dumps(found))
        draft.replace(file)
        return found

    return kept
