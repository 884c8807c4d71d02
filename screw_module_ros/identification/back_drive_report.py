# SPDX-License-Identifier: Apache-2.0
"""Quantities and notes about back-drivability; `back_drive.py` computes the mechanics."""

from __future__ import annotations

import math

import numpy as np

from .belt_drive import Belt, bandwidth, mode
from .results import Quantity


def quantities(settings, plastic, roller, data, belt: Belt) -> tuple[Quantity, ...]:
    """Return the experiment's quantities; plastic, roller: wedges of the two screws."""
    return _screw(settings, plastic, roller) + _plane(data) + _belt(belt)


def _of(name: str, value: float, unit: str, text: str) -> Quantity:
    """Return a quantity without uncertainty."""
    return Quantity(name, float(value), math.nan, unit, text)


def _screw(settings, plastic, roller) -> tuple[Quantity, ...]:
    def least_lead(screw) -> float:
        steepness = screw.friction / math.cos(screw.thread_angle)
        return math.pi * settings.diameter * steepness

    forward = roller.forward_efficiency(), plastic.forward_efficiency()
    back = roller.back_efficiency(), plastic.back_efficiency()
    return (
        _of("lead_angle", roller.lead_angle, "rad", "lead angle at the effective diameter (eq 4)"),
        _of("thread_angle", roller.thread_angle, "rad",
           "thread angle theta of eq 4, from the groove's widths in 3.1.1"),
        _of("back_friction_limit", roller.back_limit, "",
           "greatest friction with which the handle can drive the screw (eq 5)"),
        _of("forward_friction_limit", roller.forward_limit, "",
           "greatest friction with which the motor can drive the nut (eq 6)"),
        _of("forward_loss_plastic", 1.0 - forward[1], "",
           "share lost, motor drives the nut, plastic (appendix D: roughly 30 %)"),
        _of("forward_loss_roller", 1.0 - forward[0], "",
           "share lost, motor drives the nut, roller (appendix D: less than 5 %)"),
        _of("forward_gain", _ratio(*forward) - 1.0, "",
           "force left with the roller over plastic, less one, motor drives the nut (appendix D: "
           "40 % greater acceleration)"),
        _of("back_loss_plastic", 1.0 - back[1], "",
           "share lost, handle drives the screw, plastic (appendix D: roughly 30 %)"),
        _of("back_loss_roller", 1.0 - back[0], "",
           "share lost, handle drives the screw, roller (appendix D: less than 5 %)"),
        _of("back_gain", _ratio(*back) - 1.0, "",
           "force left with the roller over plastic, less one, handle drives the screw (appendix "
           "D: 40 % greater acceleration)"),
        _of("least_lead_plastic", least_lead(plastic), "m",
           "smallest lead that the handle can drive, plastic (eq 5)"),
        _of("least_lead_roller", least_lead(roller), "m",
           "smallest lead that the handle can drive, roller (eq 5)"),
    )  # fmt: skip


def _plane(data) -> tuple[Quantity, ...]:
    bare, laden = data["anisotropy_bare"], data["anisotropy_laden"]
    return (
        _of("anisotropy_least", bare.min(), "",
           "least anisotropy of the plane without the module (appendix D: 1.23)"),
        _of("anisotropy_greatest", bare.max(), "",
           "greatest anisotropy of the plane without the module (appendix D: 1.53)"),
        _of("anisotropy_least_laden", laden.min(), "",
           "least anisotropy with the module (appendix D: less than without)"),
        _of("anisotropy_greatest_laden", laden.max(), "",
           "greatest anisotropy with the module (appendix D: less than without)"),
        _of("major_axis_bare", data["axes_bare"][:, 1].max(), "kg",
           "greatest inertia in the plane without the module (specified: 4/3 kg)"),
        _of("major_axis_laden", data["axes_laden"][:, 1].max(), "kg",
           "greatest inertia in the plane with the module (appendix D, fig 3: within 4 kg)"),
        _of("major_axis_laden_centre", data["axes_laden"][len(laden) // 2, 1], "kg",
           "greater inertia at the workspace centre with the module (fig 3: within 4 kg)"),
        _of("minor_axis_laden", data["axes_laden"][:, 0].min(), "kg",
           "least inertia in the plane with the module (fig 3)"),
    )  # fmt: skip


def _belt(belt: Belt) -> tuple[Quantity, ...]:
    free = belt._replace(ground=0.0)
    undamped = free._replace(damping=0.0)
    tenth = free._replace(damping=belt.damping / 10.0)
    return (
        _of("belt_resonance", mode(undamped)[0], "Hz",
           "belt, no damping, resonance (appendix D: 3 Hz; stiffness chosen for it)"),
        _of("belt_bandwidth_undamped", bandwidth(undamped), "Hz",
           "belt, no damping, bandwidth (appendix D: 10.6 Hz; inertia chosen for it)"),
        _of("belt_factor_tenth", mode(tenth)[1], "",
           "belt at a tenth of its damping, damping factor (appendix D: 0.446; chosen for it)"),
        _of("belt_bandwidth_damped", bandwidth(free), "Hz",
           "belt damping only, bandwidth (appendix D: 51.7 Hz; not chosen)"),
        _of("belt_factor_damped", mode(free)[1], "",
           "belt damping only, damping factor; above 0.71 there is no peak (appendix D: none)"),
        _of("belt_bandwidth_whole", bandwidth(belt), "Hz",
           "whole belt drive, bandwidth (appendix D: 40 Hz; ground damping chosen for it)"),
        _of("belt_factor_whole", mode(belt)[1], "",
           "whole belt drive, damping factor (appendix D: no resonance)"),
    )  # fmt: skip


def _ratio(left: float, right: float) -> float:
    return left / right if right > 0.0 else math.inf


def notes(settings, data: dict[str, np.ndarray]) -> tuple[str, ...]:
    """Return the notes for the report."""
    bare, laden = data["anisotropy_bare"], data["anisotropy_laden"]
    major = data["axes_laden"][:, 1]
    share = np.mean(major > settings.heaviest)
    return (
        "Appendix D has no geometry of its screw; this calculation uses the module's, with the "
        "effective diameter and the groove of 3.1.1. The paper does not say which side drives. Its "
        "losses (30 %, less than 5 %) and its 40 % match the motor driving the nut; by its eq 4 "
        "the handle driving the screw loses more with plastic. We read the 40 % as the ratio of "
        "the remaining forces for one input force; the acceleration also depends on the inertias "
        "of both sides.",
        f"Plane, set {settings.plane}: anisotropy without module {bare.min():.2f} to "
        f"{bare.max():.2f}, least value in the arm's reach "
        f"{float(data['anisotropy_possible']):.2f}. The paper prints no inertias. The set "
        "appendix_d is derived from its printed figures, so their agreement proves nothing; the "
        "set inmotion2, identified on a later commercial robot, does not reproduce them.",
        f"A module of {settings.module_mass:g} kg reduces the anisotropy to a range of "
        f"{laden.min():.2f} to {laden.max():.2f}. The major axis exceeds the allowed "
        f"{settings.heaviest:g} kg on {share:.0%} of the workspace; its least value is "
        f"{major.min():.2f} kg. In the far corners the arm is nearly stretched.",
        "Belt drive: the paper prints no parameters. All are chosen to reproduce the printed 3 Hz, "
        "10.6 Hz, 0.446 and 40 Hz (see belt_drive.py). The only results are the bandwidth with "
        "belt damping and the absence of a resonance in the last two cases. The paper does not "
        "define 'bandwidth'; we chose the definition with which this bandwidth comes near.",
    )

