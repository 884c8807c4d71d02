# SPDX-License-Identifier: Apache-2.0
"""The machine in motion along recorded paths: one HTML page that loads nothing else.

The page draws with the modules of the therapist's page, written into it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..bridge.pages import FOLDER
from ..drawing import Path3D

_MODULES = ("parts", "kinematics", "picture", "seated")  # each imports from those before it
_BORDER = re.compile(r"^import .*?;\n|^export ", re.MULTILINE | re.DOTALL)
_RATE = 25.0  # pictures [1/s]


def moving_picture(paths: Sequence[Path3D], seconds: Sequence[float], file: Path) -> Path:
    """Write the page and return its file; seconds: how long each path took [s].

    Raises OSError when the file cannot be written.
    """
    modules = [(FOLDER / f"js/machine/{name}.js").read_text("utf-8") for name in _MODULES]
    told = [
        {"name": path.name, "seconds": round(time, 3), "points": _thinned(path.points, time)}
        for path, time in zip(paths, seconds, strict=True)
    ]
    page = Path(__file__).with_suffix(".html").read_text("utf-8")
    page = page.replace("/* the paths */ []", json.dumps(told))
    page = page.replace("/* the modules */", "\n".join(_BORDER.sub("", text) for text in modules))
    file.write_text(page, encoding="utf-8")
    return file


def _thinned(points: np.ndarray, seconds: float) -> list[list[float]]:
    """Return a path as places for the pictures, to a tenth of a millimetre [m]."""
    wanted = np.linspace(0, len(points) - 1, max(2, round(_RATE * seconds))).astype(int)
    return [[round(float(value), 4) for value in point] for point in points[wanted]]
