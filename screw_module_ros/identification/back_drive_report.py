# SPDX-License-Identifier: Apache-2.0
"""Values and sentences about back-drivability; `back_drive.py` does the mechanics."""

from __future__ import annotations

import math

import numpy as np

from .belt_drive import Belt, bandwidth, mode
from .results import Quantity


def quantities(settings, plastic, roller, data, belt: Belt) -> tuple[Quantity, ...]:
    """Return what the experiment reports; plastic, roller: the two wedges."""
    return _screw(settings, plastic, roller) + _plane(data) + _belt(belt)


def _screw(settings, plastic, roller) -> tuple[Quantity, ...]:
    def of(name: str, value: float, unit: str, text: str) -> Quantity:
        return Quantity(name, value, math.nan, unit, text)

    def least_lead(screw) -> float:
        steepness = screw.friction / math.cos(screw.thread_angle)
        return math.pi * settings.diameter * steepness

    forward = roller.forward_efficiency(), plastic.forward_efficiency()
    back = roller.back_efficiency(), plastic.back_efficiency()
    return (
        of("lead_angle", roller.lead_angle, "rad", "lead angle at the effective diameter (eq 4)"),
        of("thread_angle", roller.thread_angle, "rad",
           "thread angle theta of eq 4, from the groove's widths in 3.1.1"),
        of("back_friction_limit", roller.back_limit, "",
           "greatest friction with which the handle can drive the screw (eq 5)"),
        of("forward_friction_limit", roller.forward_limit, "",
           "greatest friction with which the motor can drive the nut (eq 6)"),
        of("forward_loss_plastic", 1.0 - forward[1], "",
           "share lost, motor drives the nut, plastic (appendix D: roughly 30 %)"),
        of("forward_loss_roller", 1.0 - forward[0], "",
           "share lost, motor drives the nut, roller (appendix D: less than 5 %)"),
        of("forward_gain", _ratio(*forward) - 1.0, "",
           "force left with the roller over plastic, less one, motor drives the nut (appendix D: "
           "40 % greater acceleration)"),
        of("back_loss_plastic", 1.0 - back[1], "",
           "share lost, handle drives the screw, plastic (appendix D: roughly 30 %)"),
        of("back_loss_roller", 1.0 - back[0], "",
           "share lost, handle drives the screw, roller (appendix D: less than 5 %)"),
        of("back_gain", _ratio(*back) - 1.0, "",
           "force left with the roller over plastic, less one, handle drives the screw (appendix "
           "D: 40 % greater acceleration)"),
        of("least_lead_plastic", least_lead(plastic), "m",
           "smallest lead that the handle can drive, plastic (eq 5)"),
        of("least_lead_roller", least_lead(roller), "m",
           "smallest lead that the handle can drive, roller (eq 5)"),
    )  # fmt: skip


def _plane(data) -> tuple[Quantity, ...]:
    def of(name: str, value: float, unit: str, text: str) -> Quantity:
        return Quantity(name, float(value), math.nan, unit, text)

    bare, laden = data["anisotropy_bare"], data["anisotropy_laden"]
    return (
        of("anisotropy_least", bare.min(), "",
           "least anisotropy of the plane without the module (appendix D: 1.23)"),
        of("anisotropy_greatest", bare.max(), "",
           "greatest anisotropy of the plane without the module (appendix D: 1.53)"),
        of("anisotropy_least_laden", laden.min(), "",
           "least anisotropy with the module (appendix D: less than without)"),
        of("anisotropy_greatest_laden", laden.max(), "",
           "greatest anisotropy with the module (appendix D: less than without)"),
        of("major_axis_bare", data["axes_bare"][:, 1].max(), "kg",
           "greatest inertia in the plane without the module (specified: 4/3 kg)"),
        of("major_axis_laden", data["axes_laden"][:, 1].max(), "kg",
           "greatest inertia in the plane with the module (appendix D, fig 3: within 4 kg)"),
        of("major_axis_laden_centre", data["axes_laden"][len(laden) // 2, 1], "kg",
           "greater inertia at the workspace centre with the module (fig 3: within 4 kg)"),
        of("minor_axis_laden", data["axes_laden"][:, 0].min(), "kg",
           "least inertia in the plane with the module (fig 3)"),
    )  # fmt: skip


def _belt(belt: Belt) -> tuple[Quantity, ...]:
    free = belt._replace(ground=0.0)
    undamped = free._replace(damping=0.0)
    tenth = free._replace(damping=belt.damping / 10.0)

    def of(name: str, value: float, unit: str, text: str) -> Quantity:
        return Quantity(name, value, math.nan, unit, text)

    return (
        of("belt_resonance", mode(undamped)[0], "Hz",
           "belt, no damping, resonance (appendix D: 3 Hz; stiffness chosen for it)"),
        of("belt_bandwidth_undamped", bandwidth(undamped), "Hz",
           "belt, no damping, bandwidth (appendix D: 10.6 Hz; inertia chosen for it)"),
        of("belt_factor_tenth", mode(tenth)[1], "",
           "belt at a tenth of its damping, damping factor (appendix D: 0.446; chosen for it)"),
        of("belt_bandwidth_damped", bandwidth(free), "Hz",
           "belt damping only, bandwidth (appendix D: 51.7 Hz; not chosen)"),
        of("belt_factor_damped", mode(free)[1], "",
           "belt damping only, damping factor; above 0.71 there is no peak (appendix D: none)"),
        of("belt_bandwidth_whole", bandwidth(belt), "Hz",
           "whole belt drive, bandwidth (appendix D: 40 Hz; ground damping chosen for it)"),
        of("belt_factor_whole", mode(belt)[1], "",
           "whole belt drive, damping factor (appendix D: no resonance)"),
    )  # fmt: skip


def _ratio(left: float, right: float) -> float:
    return left / right if right > 0.0 else math.inf


def notes(settings, data: dict[str, np.ndarray]) -> tuple[str, ...]:
    """Return what a reader must know."""
    bare, laden = data["anisotropy_bare"], data["anisotropy_laden"]
    major = data["axes_laden"][:, 1]
    share = np.mean(major > settings.heaviest)
    return (
        "Appendix D gives no geometry for its screw; here it is the module's, with the effective "
        "diameter and the groove of 3.1.1. The paper does not say which side drives; of the two "
        "reported here its losses (30 %, less than 5 %) and its 40 % match the motor driving the "
        "nut. By its own eq 4 the handle driving the screw loses more with plastic. The 40 % is "
        "taken as the ratio of the forces left for one input force; how far the acceleration "
        "follows depends on the inertias on either side.",
        f"Plane, set {settings.plane}: anisotropy without module {bare.min():.2f} to "
        f"{bare.max():.2f}, the least anywhere in the arm's reach "
        f"{float(data['anisotropy_possible']):.2f}. The paper prints no inertias: the set "
        "appendix_d is derived from the figures it does print, so that these agree is no "
        "discovery; inmotion2 was identified on a later commercial robot and cannot give them.",
        f"A module of {settings.module_mass:g} kg does reduce the anisotropy, to "
        f"{laden.min():.2f} to {laden.max():.2f}. The major axis is above the "
        f"{settings.heaviest:g} kg allowed on {share:.0%} of the workspace, {major.min():.2f} kg "
        "where it is least; the far corners are near the stretched arm.",
        "Belt drive: the paper prints no parameters; all are chosen to give the printed 3 Hz, 10.6 "
        "Hz, 0.446 and 40 Hz (see belt_drive.py). Only the bandwidth with belt damping, and that "
        "no resonance is left in the last two cases, is found and not put in; what 'bandwidth' "
        "means is our reading, kept because that one comes out near.",
    )

