# SPDX-License-Identifier: Apache-2.0
"""Figures of appendices A and D: compliant mounting, and inertia in the plane."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ..results import Result

_KILOGRAM = 0.011  # m on the page per kg, so that neighbouring ellipses do not meet
_LIMIT = {"color": DESIRED, "linestyle": ":", "linewidth": 1.4}
_CANDIDATES = {
    "grooved": "15.9 mm, grooved",
    "outer": "15.9 mm, solid",
    "effective": "14.3 mm, solid",
    "table": "solid, reflecting 3.25 kg (Table 5.1)",
}


def mounting_figures(result: Result) -> dict[str, Figure]:
    """Return the figures of `compliant_mounting` by their number in the thesis."""
    return {
        "A-2": _over_nut(result, "case1_inertia", "moment of inertia about the nut [kg m²]",
                         "Fig. A-2: inertia about the nut, case 1"),
        "A-3": _over_nut(result, "case1_frequency", "natural frequency [Hz]",
                         "Fig. A-3: natural frequency, case 1"),
        "A-4": _over_nut(result, "case2_frequency", "natural frequency [Hz]",
                         "Fig. A-4: natural frequency, case 2"),
        "A-7": _absorber(result),
    }  # fmt: skip


def back_drive_figures(result: Result) -> dict[str, Figure]:
    """Return the figures of `back_drive` by their number in appendix D."""
    return {"D-3": _ellipses(result)}


def _over_nut(result: Result, name: str, label: str, title: str) -> Figure:
    """Draw a quantity against the position of the nut.

    Frequencies with one line per candidate for the screw; the inertias can hardly be distinguished.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.4), layout="constrained")
        axes = figure.add_subplot()
        taken = str(result.data["screw"])
        for number, screw in enumerate(result.data["screws"]):
            main = screw == taken
            if not main and not name.endswith("frequency"):
                continue
            axes.plot(
                result.data["nut"],
                result.data[name][number],
                color=COLOURS[number],
                linewidth=2.2 if main else 0.9,
                linestyle="-" if main else "--",
                label="screw " + _CANDIDATES[str(screw)] + (" (taken)" if main else ""),
            )
        if name.endswith("frequency"):
            wanted = float(result.data["wanted"])
            axes.axhline(wanted, label=f"wanted: {wanted:g} Hz", **_LIMIT)
        else:
            axes.set_ylim(bottom=0.0)
        axes.set_xlabel("nut above the centre of the screw [m]")
        axes.set_ylabel(label)
        axes.set_title(title, loc="left")
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _absorber(result: Result) -> Figure:
    """Draw magnitude and phase of velocity over torque with the tuned vibration absorber."""
    omega, response = result.data["omega"], result.data["case3_response"]
    at = list(result.data["screws"]).index(str(result.data["screw"]))
    dip = float(result.data["case3_antiresonance"][at])
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.semilogx(omega, 20.0 * np.log10(np.abs(response)), color=COLOURS[0])
        lower.semilogx(omega, np.degrees(np.angle(response)), color=COLOURS[0])
        for axes in (upper, lower):
            axes.axvline(dip, **_LIMIT)
        low, high = map(float, result.data["case3_resonances"][at])
        _mark(upper, dip, f"dip {dip:.0f} rad/s", height=0.02, side="left")
        _mark(upper, low, f"peak {low:.0f} rad/s", height=0.9, side="right")
        _mark(upper, high, f"peak {high:.0f} rad/s", height=0.9, side="left")
        upper.set_ylim(-70.0, 40.0)
        upper.set_ylabel("magnitude [dB re 1 rad/s per Nm]")
        lower.set_ylabel("phase [°]")
        lower.set_yticks([-90, -45, 0, 45, 90])
        lower.set_xlabel("frequency [rad/s]")
        upper.set_title("Fig. A-7: tuned vibration absorber, velocity over torque", loc="left")
    return figure


def _mark(axes: Axes, omega: float, text: str, height: float, side: str) -> None:
    """Label a frequency; side: of the text that touches it. A NaN has no label."""
    if np.isfinite(omega):
        axes.annotate(
            text,
            xy=(omega, height),
            xycoords=axes.get_xaxis_transform(),
            xytext=(6 if side == "left" else -6, 0),
            textcoords="offset points",
            ha=side,
            fontsize=9,
        )


def _ellipses(result: Result) -> Figure:
    """Draw the inertia ellipses at points of the workspace, seen from above."""
    data = result.data
    heaviest, module = float(data["heaviest"]), float(data["module_mass"])
    kinds = (
        ("shown_bare", COLOURS[0], "arm alone"),
        ("shown_laden", COLOURS[2], f"with the module, {module:g} kg"),
    )
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 7.6), layout="constrained")
        axes = figure.add_subplot()
        for x, y in data["shown_points"]:
            circle = 2.0 * heaviest * _KILOGRAM
            axes.add_patch(Ellipse((x, y), circle, circle, fill=False, **_LIMIT))
        for name, colour, _ in kinds:
            for place, inertia in zip(data["shown_points"], data[name], strict=True):
                axes.add_patch(_ellipse(place, inertia, colour))
        x, y = data["points"].T
        box = ([x.min(), x.max(), x.max(), x.min(), x.min()],
               [y.min(), y.min(), y.max(), y.max(), y.min()])  # fmt: skip
        axes.plot(*box, color="#888888", linewidth=0.8)
        handles = [Line2D([], [], color=colour, label=text) for _, colour, text in kinds]
        handles.append(Line2D([], [], label=f"{heaviest:g} kg, the most allowed", **_LIMIT))
        handles.append(Line2D([], [], color="#888888", linewidth=0.8, label="workspace"))
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.set_xlabel("x, to the patient's right [m]")
        axes.set_ylabel("y, away from the patient [m]")
        axes.set_title("Appendix D, fig. 3: inertia ellipses in the plane", loc="left")
    return figure


def _ellipse(place: np.ndarray, inertia: np.ndarray, colour: str) -> Ellipse:
    axes, directions = np.linalg.eigh(inertia)
    width, height = 2.0 * axes[::-1] * _KILOGRAM
    across = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    return Ellipse(tuple(place), width, height, angle=across, fill=False, color=colour, lw=1.5)
