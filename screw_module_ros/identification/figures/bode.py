# SPDX-License-Identifier: Apache-2.0
"""Bode plots: magnitude and phase over frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

_LINES = ((COLOURS[2], "-"), (DESIRED, "--"), (COLOURS[3], "-."))


def bode(
    title: str,
    frequencies: np.ndarray,
    measured: np.ndarray,
    models: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    """Draw a measured response, complex, as dots and models of it as lines; frequencies [Hz]."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        dots = {"marker": "o", "ls": "none", "ms": 4, "color": COLOURS[0], "label": "measured"}
        if models:
            dots |= {"mfc": "none", "mew": 0.9}
        above.plot(frequencies, 20.0 * np.log10(np.abs(measured)), **dots)
        below.plot(frequencies, phase_degrees(measured), **dots)
        for (name, model), (colour, dash) in zip((models or {}).items(), _LINES, strict=False):
            line = {"color": colour, "ls": dash, "label": name, "zorder": 3}
            above.plot(frequencies, 20.0 * np.log10(np.abs(model)), **line)
            below.plot(frequencies, phase_degrees(model), **line)
        above.set_xscale("log")
        above.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        above.set_title(title, loc="left")
        above.set_ylabel("magnitude [dB]")
        below.set_ylabel("phase [degrees]")
        below.set_xlabel("frequency [Hz]")
        if np.ptp(above.get_ylim()) < 1.0:
            middle = float(np.mean(above.get_ylim()))
            above.set_ylim(middle - 1.0, middle + 1.0)
        if models:
            below.legend(loc="lower left")
    return figure


def phase_degrees(values: np.ndarray) -> np.ndarray:
    """Return the phase of a complex response, without jumps [degrees]."""
    return np.degrees(np.unwrap(np.angle(values)))
