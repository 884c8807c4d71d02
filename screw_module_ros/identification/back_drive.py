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
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from scipy import signal
from scipy.optimize import brentq

from ..figure_style import COLOURS, DESIRED
from ..geometry import MANUS, PlanarArm, inverse, jacobian
from ..settings import Setting, validated
from .lab import Lab
from .results import DERIVED, NOTHING, Experiment, Published, Quantity, Result, beside
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
    "forward_loss_plastic": Published(0.30, "D, eqs 4 to 6", 0.05),
    "forward_loss_roller": Published(0.05, "D", 0.02),
    "forward_gain": Published(0.40, "D", 0.05),
    "anisotropy_least": Published(1.23, "D, fig 3", 0.05),
    "anisotropy_greatest": Published(1.53, "D, fig 3", 0.05),
    "major_axis_laden": Published(4.0, "D, fig 3", 0.1),
}
_KILOGRAM = 0.011  # m on the page per kg, so that neighbouring ellipses do not meet
_LIMIT = {"color": DESIRED, "linestyle": ":", "linewidth": 1.4}
LEVEL = 1.0
"""The bandwidth ends where |speed of the load / torque| falls below this [rad/s per Nm]."""
_SLOWEST, _FASTEST = 2.0 * math.pi * 0.01, 2.0 * math.pi * 1e4  # rad/s, for the search
_SLOWEST, _FASTEST = 2.0 * math.pi * 0.01, 2.0 * math.pi * 1e4  # rad/s, for the search


class JointInertia(NamedTuple):
    """M(q) = [[shoulder, coupling cos D], [coupling cos D, elbow]] [kg m^2].

    D is the angle between the links, elbow - shoulder.
    """

    shoulder: float
    elbow: float
    coupling: float


APPENDIX_D = JointInertia(0.173, 0.226, 0.171)
APPENDIX_D_ARM = MANUS._replace(base_y=-0.60)
"""Derived from appendix D, not measured: the paper prints no inertias. With its links and the base
0.60 m behind the workspace's centre these inertias reproduce all its printed figures: anisotropy
1.23 to 1.53, at most 4/3 kg without the module, 4 kg with a module of 2.7 kg."""
INMOTION2 = JointInertia(0.391, 0.228, 0.227)
INMOTION2_ARM = MANUS
"""Identified on a later commercial InMotion2, another robot than the thesis's."""
SETS = {
    "appendix_d": (APPENDIX_D, APPENDIX_D_ARM),
    "inmotion2": (INMOTION2, INMOTION2_ARM),
}
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
    plastic: Annotated[float, Setting("friction of a plastic screw", "", 0.0, 1.0)] = 0.15
    roller: Annotated[float, Setting("friction of a roller screw", "", 0.0, 1.0)] = 0.015
    module_mass: Annotated[float, Setting("of the vertical module", "kg", 0.0, 50.0)] = 2.7
    plane: Annotated[
        str, Setting("inertias of the planar arm and its base, by name", choices=tuple(SETS))
    ] = "appendix_d"
    half_width: Annotated[float, Setting("half the workspace in x", "m", 0.01, 0.5)] = 0.1905
    half_depth: Annotated[float, Setting("half the workspace in y", "m", 0.01, 0.5)] = 0.2286
    heaviest: Annotated[
        float, Setting("largest inertia allowed in the plane", "kg", 0.1, 100.0)
    ] = 4.0


class Wedge(NamedTuple):
    """The thread, unwrapped: lead angle phi and thread angle theta [rad], friction mu."""

    lead_angle: float
    thread_angle: float
    friction: float

    @property
    def back_limit(self) -> float:
        """Return the greatest friction with which the nut turns the screw (eq 5)."""
        return math.tan(self.lead_angle) * math.cos(self.thread_angle)

    @property
    def forward_limit(self) -> float:
        """Return the greatest friction with which the screw lifts the nut (eq 6)."""
        return math.cos(self.thread_angle) / math.tan(self.lead_angle)

    def back_efficiency(self) -> float:
        """Return the share of the nut's force that turns the screw (eq 4), 0 when it sticks."""
        steep, cosine, mu = self._terms()
        return max(0.0, (cosine * steep - mu) / (cosine + mu * steep) / steep)

    def forward_efficiency(self) -> float:
        """Return the share of the screw's torque that lifts the nut, 0 when it sticks."""
        steep, cosine, mu = self._terms()
        return max(0.0, steep * (cosine - mu * steep) / (cosine * steep + mu))

    def _terms(self) -> tuple[float, float, float]:
        return math.tan(self.lead_angle), math.cos(self.thread_angle), self.friction


def wedge(settings: Settings, friction: float) -> Wedge:
    """Return the module's screw; theta is the flank's angle in the plane across the thread."""
    lead_angle = math.atan(settings.lead / (math.pi * settings.diameter))
    across = math.atan(math.tan(settings.flank_angle) * math.cos(lead_angle))
    return Wedge(lead_angle, across, friction)


def run(lab: Lab, settings: Settings) -> Result:
    """Evaluate screw, plane and belt.

    Raises ValueError for settings out of range and for a workspace beyond the arm's reach.
    """
    validated(settings)
    joints, arm = SETS[settings.plane]
    area = grid(settings.half_width, settings.half_depth, 41, 41)
    bare = tensors(area, joints, arm=arm)
    laden = bare + settings.module_mass * np.eye(2)
    shown = grid(settings.half_width, settings.half_depth, 3, 3)
    friction = np.linspace(0.0, 0.5, 101)
    screws = [wedge(settings, mu) for mu in friction]
    data = {
        "points": area,
        "anisotropy_bare": anisotropy(bare),
        "anisotropy_laden": anisotropy(laden),
        "axes_bare": np.linalg.eigvalsh(bare),
        "axes_laden": np.linalg.eigvalsh(laden),
        "shown_points": shown,
        "shown_bare": tensors(shown, joints, arm=arm),
        "shown_laden": tensors(shown, joints, settings.module_mass, arm),
        "anisotropy_possible": np.array(least_anisotropy(joints, arm)),
        "heaviest": np.array(settings.heaviest),
        "module_mass": np.array(settings.module_mass),
        "friction": friction,
        "back_efficiency": np.array([screw.back_efficiency() for screw in screws]),
        "forward_efficiency": np.array([screw.forward_efficiency() for screw in screws]),
    }
    pair = (wedge(settings, settings.plastic), wedge(settings, settings.roller))
    quantities = _screw(settings, *pair) + _plane(data) + _belt(chosen())
    return Result(
        NAME,
        beside(THESIS, quantities, DERIVED),
        settings._asdict(),
        _notes(settings, data),
        data,
    )


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


def _notes(settings, data: dict[str, np.ndarray]) -> tuple[str, ...]:
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
        "10.6 Hz, 0.446 and 40 Hz (see back_drive.py). The only results are the bandwidth with "
        "belt damping and the absence of a resonance in the last two cases. The paper does not "
        "define 'bandwidth'; we chose the definition with which this bandwidth comes near.",
    )


def tensor(
    x: float, y: float, joints: JointInertia, mass: float = 0.0, arm: PlanarArm = MANUS
) -> np.ndarray:
    """Return the inertia at the tip [kg], shape (2, 2), at x, y [m] from the workspace centre.

    mass: of the module at the tip [kg]. Raises ValueError when the point is out of reach.
    """
    reach = math.hypot(x - arm.base_x, y - arm.base_y)
    if not abs(arm.forearm - arm.upper_arm) < reach < arm.forearm + arm.upper_arm:
        raise ValueError(f"x = {x:g}, y = {y:g} m is out of reach of the planar arm")
    shoulder, elbow = inverse(x, y, arm)
    back = np.linalg.inv(np.reshape(jacobian(shoulder, elbow, arm), (2, 2)))
    across = joints.coupling * math.cos(elbow - shoulder)
    matrix = np.array([[joints.shoulder, across], [across, joints.elbow]])
    return back.T @ matrix @ back + mass * np.eye(2)


def tensors(
    points: np.ndarray, joints: JointInertia, mass: float = 0.0, arm: PlanarArm = MANUS
) -> np.ndarray:
    """Return the inertia [kg], shape (n, 2, 2), at points x, y [m], shape (n, 2)."""
    return np.array([tensor(float(x), float(y), joints, mass, arm) for x, y in points])


def grid(half_width: float, half_depth: float, columns: int, rows: int) -> np.ndarray:
    """Return points x, y [m], shape (columns * rows, 2), over the workspace, its edge included."""
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, columns), np.linspace(-half_depth, half_depth, rows)
    )
    return np.column_stack([x.ravel(), y.ravel()])


def anisotropy(inertia: np.ndarray) -> np.ndarray:
    """Return the ratio of the axes, shape (n,), of inertias of shape (n, 2, 2)."""
    minor, major = np.linalg.eigvalsh(inertia).T
    return major / minor


def least_anisotropy(joints: JointInertia, arm: PlanarArm = MANUS) -> float:
    """Return the least anisotropy in the arm's reach; it does not depend on the arm's direction."""
    angles = np.radians(np.linspace(1.0, 179.0, 357))
    reach = np.sqrt(
        arm.upper_arm**2 + arm.forearm**2 + 2.0 * arm.upper_arm * arm.forearm * np.cos(angles)
    )
    points = np.column_stack([np.full_like(reach, arm.base_x), arm.base_y + reach])
    inertia = np.array([tensor(float(x), float(y), joints, arm=arm) for x, y in points])
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


class Printed(NamedTuple):
    """Printed results: resonance [Hz], bandwidths [Hz], damping factor at a tenth of damping."""

    resonance: float = 3.0
    undamped: float = 10.6
    tenth_factor: float = 0.446
    whole: float = 40.0


PRINTED = Printed()


def system(belt: Belt) -> signal.StateSpace:
    """Return motor torque [Nm] -> speed of the load [rad/s]; states: both speeds and the twist."""
    return signal.StateSpace(
        [
            [-(belt.ground + belt.damping) / belt.motor, belt.damping / belt.motor,
             -belt.stiffness / belt.motor],
            [belt.damping / belt.load, -(belt.ground + belt.damping) / belt.load,
             belt.stiffness / belt.load],
            [1.0, -1.0, 0.0],
        ],
        [[1.0 / belt.motor], [0.0], [0.0]],
        [[0.0, 1.0, 0.0]],
        [[0.0]],
    )  # fmt: skip


def mode(belt: Belt) -> tuple[float, float]:
    """Return frequency [Hz] and damping factor of the twist; above 1 it does not oscillate."""
    poles = np.linalg.eigvals(system(belt).A)
    pair = poles[np.argsort(np.abs(poles))[1:]]
    if np.abs(poles.imag).max() > 0.0:
        pair = poles[np.abs(poles.imag) > 0.0]
    natural = math.sqrt(abs(np.prod(pair)))
    return natural / (2.0 * math.pi), float(-pair.sum().real / (2.0 * natural))


def bandwidth(belt: Belt) -> float:
    """Return the highest frequency [Hz] at which |speed of the load / torque| falls below LEVEL.

    Raises ValueError if there is none.
    """
    omega = np.geomspace(_SLOWEST, _FASTEST, 3000)
    above = np.flatnonzero(_gain(belt, omega) > LEVEL)
    if len(above) == 0 or above[-1] == len(omega) - 1:
        raise ValueError("the load's speed per torque does not fall through the level")
    low, high = omega[above[-1]], omega[above[-1] + 1]
    last = brentq(lambda w: float(_gain(belt, np.array([w]))[0]) - LEVEL, low, high)
    return last / (2.0 * math.pi)


def chosen(printed: Printed = PRINTED) -> Belt:
    """Return the parameters that reproduce the printed results, with equal inertias on both sides.

    Raises ValueError if there are none.
    """
    natural = 2.0 * math.pi * printed.resonance
    if printed.undamped <= printed.resonance:
        raise ValueError("the undamped bandwidth lies above the resonance")
    omega = 2.0 * math.pi * printed.undamped
    total = 1.0 / (LEVEL * omega * ((omega / natural) ** 2 - 1.0))
    reduced = total / 4.0
    damping = 10.0 * 2.0 * printed.tenth_factor * natural * reduced
    free = Belt(total / 2.0, total / 2.0, natural**2 * reduced, damping)
    most = 0.4 / LEVEL  # from 0.5 on the gain is below the level even at zero frequency

    def excess(ground: float) -> float:
        return bandwidth(free._replace(ground=ground)) - printed.whole

    if excess(0.0) < 0.0 or excess(most) > 0.0:
        raise ValueError(f"no damping to ground gives a bandwidth of {printed.whole:g} Hz")
    return free._replace(ground=brentq(excess, 0.0, most))


def _gain(belt: Belt, omega: np.ndarray) -> np.ndarray:
    """Return |speed of the load / torque| from eqs 1 to 3, the twist eliminated."""
    coupled = np.array([belt.damping, belt.stiffness])
    motor, load = np.array([belt.motor, belt.ground]), np.array([belt.load, belt.ground])
    turning = np.polymul(np.polymul(motor, load), [1.0, 0.0])  # times s
    whole = np.polyadd(turning, np.polymul(coupled, motor + load))
    return np.abs(signal.freqs(np.trim_zeros(coupled, "f"), whole, omega)[1])


def draw(result: Result) -> dict[str, Figure]:
    """Draw the inertia ellipses at points of the workspace, seen from above."""
    data = result.data
    heaviest, module = float(data["heaviest"]), float(data["module_mass"])
    kinds = (
        ("shown_bare", COLOURS[0], "arm alone"),
        ("shown_laden", COLOURS[2], f"with the module, {module:g} kg"),
    )
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
    axes.set(xlabel="x, to the patient's right [m]", ylabel="y, away from the patient [m]")
    axes.set_title("Appendix D, fig. 3: inertia ellipses in the plane", loc="left")
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
