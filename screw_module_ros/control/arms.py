# SPDX-License-Identifier: Apache-2.0
"""Planar arms: all that the law of the plane, its loop and its node know of one.

An arm has two motors, `shoulder` and `elbow`, whose angles are what their drives measure: absolute
ones of both links in MIT-MANUS, whose motors stand at the base; of a serial arm the second is the
angle between the links. An arm moves nothing: limits, stops and torques are those of the envelope
(`plane_envelope`), which no arm can leave out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from .. import plugin_flaws, plugins
from ..geometry import MANUS_NAME, PlanarArm, forward, inverse, jacobian
from ..settings import fields
from .limits import NUMBER

GROUP = "screw_module_ros.arms"
"""Entry points that name arms of other packages."""
STRETCHED = 0.02
"""Sine of the angle between the links up to which an arm counts as stretched or folded: the torque
that leads out of there does not vanish."""
FUNCTIONS = ("forward", "inverse", "jacobian", "between", "singular")
LIMITS = ("shoulder_low", "shoulder_high", "elbow_low", "elbow_high", "between_low", "between_high")
"""Fields of `PlanarSettings` for which an arm may have defaults of its own."""
_SAME_PLACE = 1e-6  # [m] between a point and where the angles for it lead
_DIFFERENCE = 1e-5  # [rad] to either side
_SAME_CHANGE = 1e-4  # [m/rad] between a Jacobian and differences


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm, which is itself alone. Each function also gets the arm's settings, `own`.

    forward(shoulder, elbow, own): the handle's x, y [m] from the workspace's centre at angles
    [rad]; inverse(x, y, own): the angles there, or near there where it is out of reach;
    jacobian(shoulder, elbow, own): dx/dshoulder, dx/delbow, dy/dshoulder, dy/delbow [m/rad];
    between(shoulder, elbow, own): the angle between the links [rad], and how much it changes with
    each motor's, for the stop that keeps the arm from being stretched or folded; singular(own):
    size of the Jacobian's determinant up to which it counts as stretched [m^2].

    name: as recorded; settings: a NamedTuple of `Setting`s, which are the parameters `arm.NAME`;
    limits: its joints' ranges, in place of the defaults in `PlanarSettings` [rad].
    """

    name: str
    settings: Any
    forward: Callable[[float, float, Any], tuple[float, float]]
    inverse: Callable[[float, float, Any], tuple[float, float]]
    jacobian: Callable[[float, float, Any], tuple[float, float, float, float]]
    between: Callable[[float, float, Any], tuple[float, float, float]]
    singular: Callable[[Any], float]
    limits: Mapping[str, float] = field(default_factory=dict)


def five_bar_between(shoulder: float, elbow: float, own: Any) -> tuple[float, float, float]:
    """Return the angle between the links [rad], and its changes with both absolute angles."""
    return elbow - shoulder, -1.0, 1.0


def two_links_singular(own: Any) -> float:
    """Return the determinant [m^2] of two links at `STRETCHED`."""
    return STRETCHED * own.upper_arm * own.forearm


FIVE_BAR = Arm(
    MANUS_NAME, PlanarArm, forward, inverse, jacobian, five_bar_between, two_links_singular
)
"""MIT-MANUS (thesis 2.2.2)."""


def reaches(arm: Arm, x: float, y: float, own: Any) -> bool:
    """Return whether the handle can stand at x, y [m] from the workspace's centre."""
    return math.dist(arm.forward(*arm.inverse(x, y, own), own), (x, y)) < _SAME_PLACE


def load(path: str) -> Arm:
    """Return the arm `five_bar`, `package.module:NAME`, or of an entry point of that name.

    Raises SettingError when there is none, or none that can be taken.
    """
    if path == FIVE_BAR.name:
        return FIVE_BAR
    return plugin_flaws.taken(plugins.load(path, GROUP, "arm"), f"arm {path}", Arm, _flaw)


def flaw(arm: Arm) -> str:
    """Return why an arm of others cannot be taken, empty if it can."""
    return plugin_flaws.first_flaw(arm, _flaw)


def _flaw(arm: Arm) -> str:
    if arm.name == FIVE_BAR.name:
        return f"{FIVE_BAR.name} is the name of this package's own: choose another one"
    wrong = plugin_flaws.prefix_flaw(arm.name) or plugin_flaws.functions_flaw(arm, FUNCTIONS)
    if wrong := wrong or plugin_flaws.settings_flaw(arm.settings):
        return wrong
    if live := [name for name, field in fields(arm.settings).items() if field.setting.live]:
        return f"its setting {live[0]} is live: an arm does not change while torque acts on it"
    if unknown := sorted({*arm.limits} - {*LIMITS}):
        return f"its limit {unknown[0]} is none of {', '.join(LIMITS)}"
    if no := [name for name, limit in arm.limits.items() if not isinstance(limit, (int, float))]:
        return f"its limit {no[0]} is {arm.limits[no[0]]!r}, no angle"
    return ""


def kinematics_flaw(arm: Arm, own: Any, half_width: float, half_depth: float) -> str:
    """Return what of an arm's functions does not fit together, empty if all does.

    own: its settings; half_width, half_depth: of the workspace [m]. Looks in its centre, at its
    edges and corners, as far as its inverse leads into the workspace; a wrong Jacobian would turn
    the force on the hand into another direction, and where the arm counts as stretched its stops
    press more.
    """
    seen, largest = 0, 0.0
    try:
        for x, y in product((-half_width, 0.0, half_width), (-half_depth, 0.0, half_depth)):
            angles = arm.inverse(x, y, own)
            to_x, to_y = arm.forward(*angles, own)
            wide, deep = half_width + _SAME_PLACE, half_depth + _SAME_PLACE
            if not (abs(to_x) <= wide and abs(to_y) <= deep):  # out of reach, or NaN
                continue
            seen += math.dist((to_x, to_y), (x, y)) < _SAME_PLACE
            x_s, x_e, y_s, y_e = arm.jacobian(*angles, own)
            largest = max(largest, abs(x_s * y_e - x_e * y_s))
            if not _same((x_s, x_e, y_s, y_e), _jacobian(arm, angles, own)):
                return f"at x, y = {to_x:g}, {to_y:g} m its jacobian is not how its forward changes"
            if not _same(arm.between(*angles, own)[1:], _turning(arm, angles, own)):
                return (
                    f"at x, y = {to_x:g}, {to_y:g} m the changes that its between tells are not "
                    "how its angle changes"
                )
        if not 0.0 <= (size := arm.singular(own)) <= NUMBER:
            return f"its singular is {size!r}, no size"
        if seen and size >= largest:
            return (
                f"its singular, {size:g} m^2, is more than its jacobian's determinant anywhere in "
                f"the workspace, {largest:.3g} m^2 at most: it would always count as stretched"
            )
    except BaseException as error:  # somebody else's: anything may come out of it
        return plugins.told(error)
    return "" if seen else "its inverse leads to no point of the workspace, by its own forward"


def _same(told: Any, found: Any) -> bool:
    return all(abs(a - b) <= _SAME_CHANGE for a, b in zip(told, found, strict=True))


def _jacobian(arm: Arm, at: tuple[float, float], own: Any) -> tuple[float, ...]:
    x_s, y_s = _slopes(arm.forward, at, own, 0)[:2]
    x_e, y_e = _slopes(arm.forward, at, own, 1)[:2]
    return x_s, x_e, y_s, y_e


def _turning(arm: Arm, at: tuple[float, float], own: Any) -> tuple[float, ...]:
    return _slopes(arm.between, at, own, 0)[0], _slopes(arm.between, at, own, 1)[0]


def _slopes(function: Any, at: tuple[float, float], own: Any, number: int) -> list[float]:
    """Return the change of a function's numbers with one of both angles, by differences."""
    more, less = list(at), list(at)
    more[number] += _DIFFERENCE
    less[number] -= _DIFFERENCE
    pairs = zip(function(*more, own), function(*less, own), strict=True)
    return [(a - b) / (2.0 * _DIFFERENCE) for a, b in pairs]


def answering(arm: Arm) -> Arm:
    """Return an arm of others whose functions answer NaN where it raises; this package's as it is.

    NaN of an arm is no torque (`plane_envelope`).
    """
    if arm is FIVE_BAR:
        return arm
    return replace(
        arm, forward=_caught(arm.forward, 2), inverse=_caught(arm.inverse, 2),
        jacobian=_caught(arm.jacobian, 4), between=_caught(arm.between, 3),
        singular=lambda own: _caught(lambda: (arm.singular(own),), 1)()[0],
    )  # fmt: skip


def _caught(function: Callable, size: int) -> Callable:
    def caught(*given: Any) -> Any:
        try:
            numbers = tuple(map(float, function(*given)))
        except KeyboardInterrupt:
            raise
        except BaseException:  # somebody else's: anything may come out of it
            numbers = ()
        return numbers if len(numbers) == size else (math.nan,) * size

    return caught
