# SPDX-License-Identifier: Apache-2.0
"""Restricts file names from the network to a folder that was set at start.

Any sender of a message can choose such a name, and the writing process may have many rights.
"""

from __future__ import annotations

from pathlib import Path


def root_folder(text: str) -> Path:
    """Return the folder that the parameter `folder` names, ~ and links followed.

    Raises ValueError for a home folder of no user, or an impossible one.
    """
    try:
        return Path(text).expanduser().resolve()
    except (RuntimeError, OSError, ValueError) as error:
        raise ValueError(f"cannot use folder {text[:80]!r}: {error}") from None


def below(root: Path, name: str, what: str) -> Path:
    """Return the real path of `name` below `root`.

    name: relative to `root`, or absolute and within it; links are resolved. what: description of
    the name in the error. Raises ValueError for a name outside of `root`, or one that is no path.
    """
    try:
        path = (root / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise ValueError(f"{what} {name[:80]!r} is no path: {error}") from None
    if path != root and root not in path.parents:
        raise ValueError(
            f"{what} {name[:80]!r} lies outside of {root}: give one below that folder, or start "
            "the node with another `folder`"
        )
    return path


def one_name(name: str, what: str) -> str:
    """Return `name` when it is a plain name of a file or folder. Raises ValueError otherwise."""
    if not name or name in (".", "..") or "/" in name or not name.isprintable():
        raise ValueError(f"{what} {name[:80]!r} is no plain name: no /, not . or .., no signs that "
                         "cannot be seen")
    return name
