# SPDX-License-Identifier: Apache-2.0
"""Definitions of the figures of a trial, for reports, exports and screens."""

from __future__ import annotations

from typing import NamedTuple


class Definition(NamedTuple):
    """One figure: label, displayed unit, factor from SI to this unit, text of the definition."""

    label: str
    unit: str
    factor: float
    text: str


_SMOOTH = "It depends on the sampling rate, which the report states. Nearer to zero is smoother."
_MOVEMENT = "from the first to the last sample above a tenth of the peak speed"

DEFINITIONS: dict[str, Definition] = {
    "initiated": Definition(
        "started by the patient", "", 1.0,
        "The hand exceeded the start speed, or left the start, before the wait had passed (pm1).",
    ),
    "reached": Definition(
        "target reached", "", 1.0,
        "The hand came within the hit radius of the target before the time limit of the trial.",
    ),
    "pm2a": Definition(
        "power while behind the wall", "W", 1.0,
        "Mean of handle force times velocity along the line, over the samples in which the hand "
        "was behind the back wall; the force is the patient's on the robot, so it is negative "
        "where the robot moved the hand (Krebs et al. 2003).",
    ),
    "pm2b": Definition(
        "lead over the wall", "mm", 1e3,
        "Mean of the hand's way along the line minus the back wall's, from start to end of the "
        "movement; after its duration the wall stays at the target.",
    ),
    "pm3": Definition(
        "mean square off the line", "mm²", 1e6,
        "Mean of the squared distance from the straight line, from start to end of the movement.",
    ),
    "pm4": Definition("way along the line", "mm", 1e3, "Farthest the hand came along the line."),
    "duration": Definition("duration", "s", 1.0, f"Time {_MOVEMENT}."),
    "time_to_start": Definition(
        "time to start", "s", 1.0, "From the display of the target to the movement's first sample."
    ),
    "mean_speed": Definition("mean speed", "mm/s", 1e3, f"Mean speed {_MOVEMENT}."),
    "peak_speed": Definition("peak speed", "mm/s", 1e3, "Largest speed of the movement."),
    "speed_ratio": Definition(
        "mean over peak speed", "", 1.0, "A minimum-jerk reach has 0.53; many stops make it less."
    ),
    "speed_peaks": Definition(
        "speed peaks", "", 1.0,
        "Local maxima of the speed with a prominence of at least a twentieth of the peak speed.",
    ),
    "arrest_ratio": Definition(
        "time in motion", "%", 100.0,
        "Share of the movement's time in which the speed exceeds a tenth of its peak (movement "
        "arrest period ratio, Rohrer et al. 2002).",
    ),
    "sparc": Definition(
        "SPARC", "", 1.0,
        "Spectral arc length of the speed profile: cut-off 10 Hz, threshold 0.05, padding 4 "
        f"(Balasubramanian et al. 2012, 2015). {_SMOOTH}",
    ),
    "jerk": Definition(
        "dimensionless jerk", "", 1.0,
        "-(T³/vpeak²) times the integral of the speed's squared second derivative. " + _SMOOTH,
    ),
    "log_jerk": Definition(
        "LDLJ", "", 1.0, "-ln of the size of the dimensionless jerk. " + _SMOOTH
    ),
    "path_error": Definition(
        "path error", "mm", 1e3, "Mean distance of the hand from the straight line to the target."
    ),
    "path_ratio": Definition(
        "path ratio", "", 1.0, "Length of the hand's path over that of the straight line."
    ),
    "direction_error": Definition(
        "initial direction error", "°", 57.29577951308232,
        "Angle between the line to the target and the direction to the hand's position after a "
        "fifth of the way.",
    ),
    "reach_error": Definition(
        "reach error", "mm", 1e3,
        f"Distance from the target at the end of the movement ({_MOVEMENT}). It is not 0 for a "
        "target that was reached slowly, for instance by the push of the robot's wall afterwards."
    ),
    "robot_share": Definition(
        "robot's share of the work", "%", 100.0,
        "Work that the robot did on the hand over all work across the handle in both directions, "
        "on the protocol's axes. It includes mass and friction of the robot, so it is not zero "
        "without assistance.",
    ),
    "patient_work": Definition(
        "work of the patient", "J", 1.0, "Positive part of handle force times velocity, over time."
    ),
    "robot_work": Definition(
        "work of the robot", "J", 1.0, "Negative part of handle force times velocity, over time."
    ),
    "independence": Definition(
        "independence of circles", "", 1.0,
        "Small over large axis of the path's ellipse, from the covariance of x and y; a circle has "
        "1 (Dipietro et al. 2007).",
    ),
    "size": Definition("size of circles", "cm²", 1e4, "Area of the path's ellipse."),
    "hold_deviation": Definition(
        "hold deviation", "mm", 1e3, "Root mean square distance from the hold point."
    ),
    "largest_force": Definition(
        "largest force", "N", 1.0, "Largest force of the patient in the requested direction."
    ),
    "largest_vertical_force": Definition(
        "largest vertical force", "N", 1.0, "Largest vertical force of the patient, up or down."
    ),
    "missing": Definition(
        "samples lost", "", 1.0, "Missing samples between a trial's first and last one."
    ),
}  # fmt: skip

EFFECT = Definition(
    "effect size d", "", 1.0,
    "Mean of the last block of reaches without assistance minus that of the first, over their "
    "pooled standard deviation (Cohen 1988: 0.2 is small, 0.5 medium, 0.8 large); positive where "
    "the figure increased. It measures the difference of two blocks, which have few reaches, and "
    "not its cause.",
)  # fmt: skip
"""Only in the report: change of a figure from the first to the last block."""
