# SPDX-License-Identifier: Apache-2.0
"""Makes the installed executables start where the path to their Python is no fit first line.

setuptools writes `#!/path/of/the/checkout/.venv/bin/python`. The kernel ends that path at a space,
and cuts off one that is too long: the shell then says `encoder: not found`. There the file begins
as a shell script that starts Python with itself, which Python reads as a string, as pip does it.
"""

from __future__ import annotations

import os
from pathlib import Path

LONGEST = 127  # bytes, of older kernels


def repair(folder: Path, python: Path) -> int:
    """Rewrite the first line of the executables in `folder` that need it; return how many."""
    path = str(python)
    if not any(character.isspace() for character in path) and len(os.fsencode(path)) + 2 <= LONGEST:
        return 0
    changed = 0
    for file in sorted(folder.iterdir()):
        first, _, rest = file.read_bytes().partition(b"\n")
        # quoted where there is a space, with the option -x where there is another letter than ASCII
        if first.replace(b'"', b"").removesuffix(b" -x") == b"#!" + os.fsencode(path):
            file.write_bytes(os.fsencode(start(path)) + rest)
            changed += 1
    return changed


def start(python: str) -> str:
    """Return lines that are a start of Python to the shell, and an idle string to Python."""
    return f"#!/bin/sh\n'''exec' \"{python}\" \"$0\" \"$@\"\n' '''\n"
