# SPDX-License-Identifier: Apache-2.0
"""Back-drivability of screw, plane and belt (thesis appendix D, eqs 1 to 6, fig 3): no trials.

Screw: a block on a wedge with lead angle phi, thread angle theta and friction mu. A force F on the
nut turns the screw with P (eq 4) if the nut slides (eq 5); in the other direction P lifts the nut
(eq 6).

Plane: with joint inertia M(q) and Jacobian J the inertia at the tip is J^-T M J^-1; a module of
mass m at the tip adds m in every direction. The axes of the ellipse are the eigenvalues [kg]; the
anisotropy is the ratio of the larger to the smaller one.

Belt: the drive that was not built, of motor, belt and load. The paper prints results but no
parameters. They are chosen here: belt stiffness, belt damping and inertia from the resonance, from
the damping factor at a tenth of the belt damping and from the bandwidth without damping; the
damping to ground, equal on both sides, from the bandwidth of the whole drive. The only independent
result is the bandwidth with belt damping alone. The paper does not define its bandwidth. Here it is
the frequency at which the load's speed per motor torque falls below a fixed level, 1 rad/s per Nm,
which only scales the inertia: with this definition the independent bandwidth comes near the
paper's.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from scipy import signal
from scipy.optimize import brentq

from ..geometry import MANUS, inverse, jacobian
from ..plant.planar import JointInertia
from ..plant.settings import load_world
from ..settings import Setting
from .figures import COLOURS, DESIRED, panels
from .lab import Lab
from .results import DERIVED, NOTHING, Drawn, Experiment, Published, Quantity, Result, beside
from .screw_geometry import (
    EFFECTIVE_DIAMETER,
    GROOVE_AT_INNER,
    GROOVE_AT_OUTER,
    INNER_DIAMETER,
    LEAD,
    OUTER_DIAMETER,
)

NAME = "back_drive"
THESIS = {
    "forward_loss_plastic": Published("d_loss_plastic", 0.05),
    "forward_loss_roller": Published("d_loss_roller", 0.02),
    "forward_gain": Published("d_gain_roller", 0.05),
    "anisotropy_least": Published("d_anisotropy", 0.05, part=0),
    "anisotropy_greatest": Published("d_anisotropy", 0.05, part=1),
    "major_axis_laden": Published("d_laden_inertia", 0.1),
}
_KILOGRAM = 0.011  # m on the page per kg, so that neighbouring ellipses do not meet
_LIMIT: dict[str, Any] = {"color": DESIRED, "linestyle": ":", "linewidth": 1.4}
LEVEL = 1.0
"""The bandwidth ends where |speed of the load / torque| falls below this [rad/s per Nm]."""
_SEARCHED = np.geomspace(2.0 * math.pi * 0.01, 2.0 * math.pi * 1e4, 3000)  # [rad/s]
_RESONANCE = 3.0  # [Hz] thesis: d_belt_resonance
_UNDAMPED = 10.6  # [Hz] thesis: d_belt_bandwidth_undamped
_TENTH = 0.446  # thesis: d_belt_factor_tenth
_WHOLE = 40.0  # [Hz] thesis: d_belt_bandwidth
"""Printed results that choose the belt: resonance [Hz], bandwidth undamped [Hz], damping factor at
a tenth of the belt's damping, bandwidth of the whole drive [Hz]."""


ARM = MANUS


@cache
def joint_inertia() -> JointInertia:
    """Return the set `appendix_d` of `params/plant.yaml`, whatever set the simulated rig has.

    Derived from appendix D, not measured: the paper prints no inertias. With `ARM` it reproduces
    the printed anisotropy, 1.23 to 1.53, and keeps the bounds that the paper set itself: 4/3 kg
    without the module, 4 kg with one of 2.7 kg. Raises SettingError where the file cannot be read.
    """
    return load_world().planar.appendix_d


FLANK_ANGLE = math.atan((GROOVE_AT_OUTER - GROOVE_AT_INNER) / (OUTER_DIAMETER - INNER_DIAMETER))
"""Slope of the groove's flanks [rad], from its widths at the two diameters (thesis 3.1.1)."""


class Settings(NamedTuple):
    """Screw, friction, planar arm and module."""

    lead: Annotated[float, Setting("travel of the nut per turn", "m", 1e-4, 0.1)] = LEAD
    diameter: Annotated[
        float, Setting("effective diameter of the screw", "m", 1e-3, 0.2)
    ] = EFFECTIVE_DIAMETER
    flank_angle: Annotated[
        float, Setting("of the thread, in a plane through the axis", "rad", 0.0, 1.2)
    ] = FLANK_ANGLE
    plastic: Annotated[
        float, Setting("friction of a plastic screw", "", 0.0, 1.0)
    ] = 0.15  # thesis: d_mu_plastic
    roller: Annotated[
        float, Setting("friction of a roller screw", "", 0.0, 1.0)
    ] = 0.015  # thesis: d_mu_roller
    module_mass: Annotated[
        float, Setting("of the vertical module", "kg", 0.0, 50.0)
    ] = 2.7  # thesis: d_module_mass
    half_width: Annotated[
        float, Setting("half the workspace in x", "m", 0.01, 0.5)
    ] = 0.1905  # thesis: workspace_width / 2
    half_depth: Annotated[
        float, Setting("half the workspace in y", "m", 0.01, 0.5)
    ] = 0.2286  # thesis: workspace_depth / 2
    heaviest: Annotated[
        float, Setting("largest inertia allowed in the plane", "kg", 0.1, 100.0)
    ] = 4.0  # thesis: d_laden_inertia


class Wedge(NamedTuple):
    """The thread, unwrapped: lead angle phi and thread angle theta [rad]."""

    lead_angle: float
    thread_angle: float

    @property
    def limits(self) -> tuple[float, float]:
        """Greatest friction with which the nut turns the screw (eq 5), the screw lifts the nut
        (eq 6)."""
        steep, cosine = math.tan(self.lead_angle), math.cos(self.thread_angle)
        return steep * cosine, cosine / steep

    def efficiencies(self, mu: float) -> tuple[float, float]:
        """Return the share of the nut's force that turns the screw (eq 4) and of the screw's torque
        that lifts the nut, 0 when it sticks; mu: friction."""
        steep, cosine = math.tan(self.lead_angle), math.cos(self.thread_angle)
        back = (cosine * steep - mu) / (cosine + mu * steep) / steep
        return max(0.0, back), max(0.0, steep * (cosine - mu * steep) / (cosine * steep + mu))


def wedge(settings: Settings) -> Wedge:
    """Return the module's screw; theta is the flank's angle in the plane across the thread."""
    lead_angle = math.atan(settings.lead / (math.pi * settings.diameter))
    return Wedge(lead_angle, math.atan(math.tan(settings.flank_angle) * math.cos(lead_angle)))


def run(lab: Lab, settings: Settings) -> Result:
    """Evaluate screw, plane and belt.

    Raises ValueError for a workspace beyond the arm's reach.
    """
    area = grid(settings.half_width, settings.half_depth, 41)
    bare = np.array([tensor(*point) for point in area])
    laden = bare + settings.module_mass * np.eye(2)
    shown = grid(settings.half_width, settings.half_depth, 3)
    shown_bare = np.array([tensor(*point) for point in shown])
    data = {
        "points": area,
        "anisotropy_bare": anisotropy(bare),
        "anisotropy_laden": anisotropy(laden),
        "axes_bare": np.linalg.eigvalsh(bare),
        "axes_laden": np.linalg.eigvalsh(laden),
        "shown_points": shown,
        "shown_bare": shown_bare,
        "shown_laden": shown_bare + settings.module_mass * np.eye(2),
    }
    quantities = beside(THESIS, _screw(settings) + _plane(data) + _belt(chosen()), DERIVED)
    return Result(NAME, quantities, settings._asdict(), _notes(settings, data), data)


def _of(name: str, value: float, unit: str, text: str) -> Quantity:
    """Return a quantity without uncertainty."""
    return Quantity(name, float(value), math.nan, unit, text)


def _screw(settings: Settings) -> tuple[Quantity, ...]:
    screw = wedge(settings)
    roller_back, roller_forward = screw.efficiencies(settings.roller)
    plastic_back, plastic_forward = screw.efficiencies(settings.plastic)
    back_limit, forward_limit = screw.limits
    back_gain = roller_back / plastic_back if plastic_back > 0.0 else math.inf
    forward_gain = roller_forward / plastic_forward if plastic_forward > 0.0 else math.inf
    around = math.pi * settings.diameter
    return (
        _of("lead_angle", screw.lead_angle, "rad", "lead angle at the effective diameter (eq 4)"),
        _of("thread_angle", screw.thread_angle, "rad",
           "thread angle theta of eq 4, from the groove's widths in 3.1.1"),
        _of("back_friction_limit", back_limit, "",
           "greatest friction with which the handle can drive the screw (eq 5)"),
        _of("forward_friction_limit", forward_limit, "",
           "greatest friction with which the motor can drive the nut (eq 6)"),
        _of("forward_loss_plastic", 1.0 - plastic_forward, "",
           "share lost, motor drives the nut, plastic (appendix D: roughly 30 %)"),
        _of("forward_loss_roller", 1.0 - roller_forward, "",
           "share lost, motor drives the nut, roller (appendix D: less than 5 %)"),
        _of("forward_gain", forward_gain - 1.0, "",
           "force left with the roller over plastic, less one, motor drives the nut (appendix D: "
           "40 % greater acceleration)"),
        _of("back_loss_plastic", 1.0 - plastic_back, "",
           "share lost, handle drives the screw, plastic (appendix D: roughly 30 %)"),
        _of("back_loss_roller", 1.0 - roller_back, "",
           "share lost, handle drives the screw, roller (appendix D: less than 5 %)"),
        _of("back_gain", back_gain - 1.0, "",
           "force left with the roller over plastic, less one, handle drives the screw (appendix "
           "D: 40 % greater acceleration)"),
        _of("least_lead_plastic",
           around * (settings.plastic / math.cos(screw.thread_angle)), "m",
           "smallest lead that the handle can drive, plastic (eq 5)"),
        _of("least_lead_roller",
           around * (settings.roller / math.cos(screw.thread_angle)), "m",
           "smallest lead that the handle can drive, roller (eq 5)"),
    )  # fmt: skip


def _plane(data: dict[str, np.ndarray]) -> tuple[Quantity, ...]:
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


def _notes(settings: Settings, data: dict[str, np.ndarray]) -> tuple[str, ...]:
    """Return the notes for the report."""
    bare, laden = data["anisotropy_bare"], data["anisotropy_laden"]
    major = data["axes_laden"][:, 1]
    return (
        "Appendix D has no geometry of its screw; this calculation uses the module's, with the "
        "effective diameter and the groove of 3.1.1. The paper does not say which side drives. Its "
        "losses (30 %, less than 5 %) and its 40 % match the motor driving the nut; by its eq 4 "
        "the handle driving the screw loses more with plastic. We read the 40 % as the ratio of "
        "the remaining forces for one input force; the acceleration also depends on the inertias "
        "of both sides.",
        f"Plane: anisotropy without module {bare.min():.2f} to "
        f"{bare.max():.2f}, least value in the arm's reach "
        f"{least_anisotropy():.2f}. The paper prints no inertias. Ours are derived from its "
        "printed figures, so their agreement proves nothing.",
        f"A module of {settings.module_mass:g} kg reduces the anisotropy to a range of "
        f"{laden.min():.2f} to {laden.max():.2f}. The major axis exceeds the allowed "
        f"{settings.heaviest:g} kg on {np.mean(major > settings.heaviest):.0%} of the workspace; "
        f"its least value is {major.min():.2f} kg. In the corners "
        "near the patient the arm is nearly stretched.",
        "Belt drive: the paper prints no parameters. All are chosen to reproduce the printed 3 Hz, "
        "10.6 Hz, 0.446 and 40 Hz (see back_drive.py). The only results are the bandwidth with "
        "belt damping and the absence of a resonance in the last two cases. The paper does not "
        "define 'bandwidth'; we chose the definition with which this bandwidth comes near.",
    )


def tensor(x: float, y: float) -> np.ndarray:
    """Return the arm's inertia at the tip [kg], shape (2, 2), at x, y [m] from the centre.

    Raises ValueError when the point is out of reach.
    """
    if not abs(ARM.forearm - ARM.upper_arm) < math.hypot(x - ARM.base_x, y - ARM.base_y) < (
        ARM.forearm + ARM.upper_arm
    ):
        raise ValueError(f"x = {x:g}, y = {y:g} m is out of reach of the planar arm")
    shoulder, elbow = inverse(x, y, ARM)
    back = np.linalg.inv(np.reshape(jacobian(shoulder, elbow, ARM), (2, 2)))
    joints = joint_inertia()
    across = joints.coupling * math.cos(elbow - shoulder)
    return back.T @ np.array([[joints.shoulder, across], [across, joints.elbow]]) @ back


def grid(half_width: float, half_depth: float, count: int) -> np.ndarray:
    """Return points x, y [m], shape (count^2, 2), over the workspace, its edge included."""
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, count), np.linspace(-half_depth, half_depth, count)
    )
    return np.column_stack([x.ravel(), y.ravel()])


def anisotropy(inertia: np.ndarray) -> np.ndarray:
    """Return the ratio of the axes, shape (n,), of inertias of shape (n, 2, 2)."""
    minor, major = np.linalg.eigvalsh(inertia).T
    return major / minor


def least_anisotropy() -> float:
    """Return the least anisotropy in the arm's reach; it does not depend on the arm's direction."""
    angles = np.radians(np.linspace(1.0, 179.0, 357))
    reach = np.sqrt(
        ARM.upper_arm**2 + ARM.forearm**2 + 2.0 * ARM.upper_arm * ARM.forearm * np.cos(angles)
    )
    inertia = np.array([tensor(ARM.base_x, ARM.base_y - far) for far in reach])
    return float(anisotropy(inertia).min())


class Belt(NamedTuple):
    """Parameters of eqs 1 to 3.

    motor, load: inertias [kg m^2]; stiffness [Nm/rad] and damping [Nm s/rad] of the belt; ground:
    damping of motor and of load to ground, each [Nm s/rad].
    """

    motor: float
    load: float
    stiffness: float
    damping: float = 0.0
    ground: float = 0.0


def mode(belt: Belt) -> tuple[float, float]:
    """Return frequency [Hz] and damping factor of the twist; above 1 it does not oscillate.

    States: speed of the motor, speed of the load, twist.
    """
    poles = np.linalg.eigvals([
        [-(belt.ground + belt.damping) / belt.motor, belt.damping / belt.motor,
         -belt.stiffness / belt.motor],
        [belt.damping / belt.load, -(belt.ground + belt.damping) / belt.load,
         belt.stiffness / belt.load],
        [1.0, -1.0, 0.0],
    ])  # fmt: skip
    pair = poles[np.argsort(np.abs(poles))[1:]]
    if np.abs(poles.imag).max() > 0.0:
        pair = poles[np.abs(poles.imag) > 0.0]
    natural = math.sqrt(abs(np.prod(pair)))
    return natural / (2.0 * math.pi), float(-pair.sum().real / (2.0 * natural))


def bandwidth(belt: Belt) -> float:
    """Return the highest frequency [Hz] at which |speed of the load / torque| falls below LEVEL."""
    last = np.flatnonzero(gain(belt, _SEARCHED) > LEVEL)[-1]
    found = brentq(
        lambda w: float(gain(belt, np.array([w]))[0]) - LEVEL, *_SEARCHED[last : last + 2]
    )
    return found / (2.0 * math.pi)


def chosen() -> Belt:
    """Return the parameters that reproduce the printed results, with equal inertias on both sides.

    The damping to ground is sought below 0.4: from 0.5 on the gain is below the level even at zero
    frequency.
    """
    natural, omega = 2.0 * math.pi * _RESONANCE, 2.0 * math.pi * _UNDAMPED
    total = 1.0 / (LEVEL * omega * ((omega / natural) ** 2 - 1.0))
    reduced = total / 4.0
    damping = 10.0 * 2.0 * _TENTH * natural * reduced
    free = Belt(total / 2.0, total / 2.0, natural**2 * reduced, damping)
    ground = brentq(lambda g: bandwidth(free._replace(ground=g)) - _WHOLE, 0.0, 0.4 / LEVEL)
    return free._replace(ground=ground)


def gain(belt: Belt, omega: np.ndarray) -> np.ndarray:
    """Return |speed of the load / torque| from eqs 1 to 3, the twist eliminated."""
    coupled = np.array([belt.damping, belt.stiffness])
    motor, load = np.array([belt.motor, belt.ground]), np.array([belt.load, belt.ground])
    turning = np.polymul(np.polymul(motor, load), [1.0, 0.0])  # times s
    whole = np.polyadd(turning, np.polymul(coupled, motor + load))
    return np.abs(signal.freqs(np.trim_zeros(coupled, "f"), whole, omega)[1])


def draw(result: Result) -> Drawn:
    """Draw the inertia ellipses at points of the workspace, seen from above."""
    data = result.data
    heaviest, module = result.settings["heaviest"], result.settings["module_mass"]
    kinds = (
        ("shown_bare", COLOURS[0], "arm alone"),
        ("shown_laden", COLOURS[2], f"with the module, {module:g} kg"),
    )
    figure, axes = panels(size=(6.4, 7.6))
    circle = 2.0 * heaviest * _KILOGRAM
    for place in data["shown_points"]:
        axes.add_patch(Ellipse(tuple(place), circle, circle, fill=False, **_LIMIT))
    for name, colour, _ in kinds:
        for place, inertia in zip(data["shown_points"], data[name], strict=True):
            axes.add_patch(_ellipse(place, inertia, colour))
    x, y = data["points"].T
    box = ([x.min(), x.max(), x.max(), x.min(), x.min()],
           [y.min(), y.min(), y.max(), y.max(), y.min()])  # fmt: skip
    axes.plot(*box, color="#888888", linewidth=0.8)
    handles = [
        *(Line2D([], [], color=colour, label=text) for _, colour, text in kinds),
        Line2D([], [], label=f"{heaviest:g} kg, the most allowed", **_LIMIT),
        Line2D([], [], color="#888888", linewidth=0.8, label="workspace"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    axes.set(xlabel="x, to the patient's right [m]", ylabel="y, away from the patient [m]",
             title="Appendix D, fig. 3: inertia ellipses in the plane", aspect="equal")  # fmt: skip
    axes.autoscale_view()
    return {"D-3": figure}


def _ellipse(place: np.ndarray, inertia: np.ndarray, colour: str) -> Ellipse:
    axes, directions = np.linalg.eigh(inertia)
    width, height = 2.0 * axes[::-1] * _KILOGRAM
    across = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    return Ellipse(tuple(place), width, height, angle=across, fill=False, color=colour, lw=1.5)


EXPERIMENT = Experiment(
    NAME, "back-drivability of screw, plane and belt (thesis appendix D): no trials", Settings,
    run, draw, NOTHING,
)  # fmt: skip
