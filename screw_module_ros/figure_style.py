# SPDX-License-Identifier: Apache-2.0
"""Style of all figures, set once on import, and their output; needs no display."""

from __future__ import annotations

from pathlib import Path

from matplotlib import rcParams
from matplotlib.figure import Figure

_STYLE = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#d9d9d9",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.1,
    "savefig.dpi": 150,
}
rcParams.update(_STYLE)
# Okabe and Ito's colours: distinguishable in grey and for the colour-blind.
COLOURS = ("#0072b2", "#e69f00", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
DESIRED = "#222222"


def save(figure: Figure, file: Path | str) -> Path:
    """Write the figure as PNG (or the format of the name's suffix); return the path.

    Raises OSError when the file cannot be written.
    """
    file = Path(file)
    figure.savefig(file)
    return file
