# SPDX-License-Identifier: Apache-2.0
"""Finds the files that come with the package, in the source tree or where colcon installed it."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE = "screw_module_ros"


class ResourceError(FileNotFoundError):
    """A file of the package is missing."""


def resource_path(name: str) -> Path:
    """Return the path of a file of the package, for example `params/plant.yaml`.

    The search covers the Python package, its source tree, and `share/screw_module_ros` of each
    prefix in AMENT_PREFIX_PATH. Raises ResourceError naming the places.
    """
    package = Path(__file__).resolve().parent
    folders = [package]
    if (package.parent / "package.xml").is_file():
        folders.append(package.parent)
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders += [Path(prefix) / "share" / PACKAGE for prefix in prefixes if prefix]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    looked_in = ", ".join(str(folder) for folder in folders)
    raise ResourceError(f"{name} not found in {looked_in}: build the package again, or name a file")
