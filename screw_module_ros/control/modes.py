# SPDX-License-Identifier: Apache-2.0
"""Control modes of the vertical axis: the constants of screw_module_msgs/ForceCommand."""

from __future__ import annotations

OFF = 0
IMPEDANCE = 1
FRICTION_COMPENSATION = 2
FORCE_FEEDBACK = 3
COMBINED = 4
OBSERVER = 5
EXCITATION = 6

MODE_NAMES = {
    OFF: "OFF",
    IMPEDANCE: "IMPEDANCE",
    FRICTION_COMPENSATION: "FRICTION_COMPENSATION",
    FORCE_FEEDBACK: "FORCE_FEEDBACK",
    COMBINED: "COMBINED",
    OBSERVER: "OBSERVER",
}
"""Names of the laws."""
ALL_NAMES = {**MODE_NAMES, EXCITATION: "EXCITATION"}
"""With the mode that is no law: the sine of a trial, on a lease."""


def uses_impedance(mode: int) -> bool:
    """Return whether the mode makes spring, damper and gravity forces."""
    return IMPEDANCE <= mode <= OBSERVER


def uses_friction(mode: int) -> bool:
    """Return whether the mode adds the friction model's feed-forward."""
    return mode == FRICTION_COMPENSATION or mode == COMBINED


def uses_feedback(mode: int) -> bool:
    """Return whether the mode feeds the handle force back."""
    return mode == FORCE_FEEDBACK or mode == COMBINED


def uses_observer(mode: int) -> bool:
    """Return whether the mode estimates friction and cancels it."""
    return mode == OBSERVER


FORCE_GAINS = {"force_gain": uses_feedback, "observer_gain": uses_observer}
"""Settings of the law with which it feeds the handle's force back -> whether a mode does.

A mode with one of them needs a force sample, and its gain is one that gain limits hold for.
"""


def uses_force(mode: int) -> bool:
    """Return whether the mode feeds the handle's force back, by whatever law."""
    return any(uses(mode) for uses in FORCE_GAINS.values())
