# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 6: force against position in each mode, and the onset of chatter."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ..curves import CURVES
from ..force_position import Spring
from ..results import Result
from .force_position import Trace, force_position

_TITLES = {
    "6-1": (("pd_100",), "Fig. 6-1: PD, 100 N/m"),
    "6-2": (("pd_1000",), "Fig. 6-2: PD, 1000 N/m, saturating below"),
    "6-5": (("pd_100", "damping_-25", "damping_-50"), "Fig. 6-5: negative damping"),
    "6-8": (("pd_100", "friction_model"), "Fig. 6-8: PD, and with the friction model"),
    "6-10": (("pd_100", "feedback_5"), "Fig. 6-10: PD, and with force feedback, gain 5"),
    "6-12": (("simulated_pd",), "Fig. 6-12: the thesis's simulation, PD"),
    "6-13": (("simulated_feedback_5",), "Fig. 6-13: the thesis's simulation, force feedback 5"),
    "gains": (
        ("feedback_1", "feedback_2", "feedback_5", "feedback_8", "combined_5"),
        "Force feedback gains, and the friction model with gain 5 (6.4.4)",
    ),
}
_LABELS = {
    "pd_100": "PD",
    "pd_1000": "PD",
    "damping_-25": "damping -25 Ns/m",
    "damping_-50": "damping -50 Ns/m",
    "friction_model": "friction model fed forward",
    "feedback_1": "gain 1",
    "feedback_2": "gain 2",
    "feedback_5": "gain 5",
    "feedback_8": "gain 8",
    "combined_5": "friction model and gain 5",
    "simulated_pd": "PD",
    "simulated_feedback_5": "force feedback, gain 5",
}


def force_position_figures(result: Result) -> dict[str, Figure]:
    """Return the figures of the measured curves by number."""
    found = {}
    for number, (names, title) in _TITLES.items():
        measured = [name for name in names if f"{name}/position" in result.data]
        if measured:
            spring = Spring(_stiffness(measured[0]), result.settings["centre"])
            traces = [_trace(result, name) for name in measured]
            found[number] = force_position(traces, spring, title)
    if {"pd_100/position", "friction_model/position"} <= result.data.keys():
        found["6-9"] = reversal(result)
    return found


def reversal(result: Result) -> Figure:
    """Draw a close-up of the upper reversal, where feed-forward has no benefit (fig 6-9)."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        axes = figure.add_subplot()
        for number, name in enumerate(("pd_100", "friction_model")):
            trace = _trace(result, name)
            axes.plot(trace.position, trace.force, color=COLOURS[number], label=trace.name)
        top = max(_trace(result, name).position.max() for name in ("pd_100", "friction_model"))
        ends = np.array([top - 0.03, top + 0.002])
        axes.plot(
            ends, 100.0 * (ends - result.settings["centre"]), color=DESIRED, linestyle=":",
            linewidth=3.0, label="desired",
        )  # fmt: skip
        axes.set_xlim(*ends)
        axes.set_xlabel("handle height z [m]")
        axes.set_ylabel("force of the patient on the robot [N]")
        axes.set_title("Fig. 6-9: closeup of the upper reversal", loc="left")
        axes.legend(loc="lower left")
    return figure


def compensation_figure(result: Result) -> Figure:
    """Draw feed-forward with the thesis's model and with the identified one."""
    names = {
        "pd_default": "PD",
        "feed_forward_default": "thesis's model fed forward",
        "feed_forward_identified": "identified model fed forward",
    }
    traces = [
        Trace(label, *(result.data[f"{name}/{column}"] for column in _COLUMNS))
        for name, label in names.items()
    ]
    return force_position(traces, Spring(100.0, 0.18), "What the identified model is worth")


def force_gain_figure(result: Result) -> Figure:
    """Draw chatter and offset against the force gain, with and without backlash."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for number, (label, table) in enumerate(result.data.items()):
            style = {"color": COLOURS[number], "marker": "o", "markersize": 3.5, "label": label}
            above.plot(table[:, 0], table[:, 2], **style)
            below.plot(table[:, 0], table[:, 1], **style)
        above.axhline(result.settings["chatter"], color=DESIRED, linewidth=0.8, linestyle="--")
        above.annotate(
            "chatter", (0.99, result.settings["chatter"]), xycoords=("axes fraction", "data"),
            xytext=(0, 3), textcoords="offset points", ha="right", fontsize=9,
        )  # fmt: skip
        above.set_ylabel("force above 30 Hz, rms [N]")
        above.set_yscale("log")
        above.set_title("Largest force gain (6.4.3)", loc="left")
        above.legend(loc="lower right")
        below.set_ylabel("mean offset [N]")
        below.set_xlabel("force gain $K_f$")
        below.set_ylim(bottom=0.0)
    return figure


_COLUMNS = ("position", "velocity", "force")


def _trace(result: Result, name: str) -> Trace:
    return Trace(_LABELS[name], *(result.data[f"{name}/{column}"] for column in _COLUMNS))


def _stiffness(name: str) -> float:
    return next(curve.stiffness for curve in CURVES if curve.name == name)
