# SPDX-License-Identifier: Apache-2.0
"""What the lint rules of this repository share: the package they check, and their verdict."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

PACKAGE = "screw_module_ros"
FOLDER = Path(__file__).resolve().parent.parent / PACKAGE


def verdict(found: Iterable[object], kept: str) -> int:
    """Print each violation, or the sentence `kept` without any; return the exit code."""
    sentences = list(map(str, found))
    for sentence in sentences:
        print(sentence, file=sys.stderr)
    if not sentences:
        print(kept)
    return 1 if sentences else 0
