# SPDX-License-Identifier: Apache-2.0
"""Finds a frozen position sensor of a planar joint, which has one sensor only.

The vertical axis compares two sensors (`agreement`); a planar joint has only its drive's position.
But the joint is light and direct-driven: the torques of motor and hand move it unless they balance.
The check adds up the time during which the net torque (command plus hand) exceeds friction and
sensor errors while the position stays *the same to the last count*. A change by one count resets
the sum. The sum does not grow when the net torque is small: a handle at rest, a hand that holds
against a set point out of reach, a wall at the handle.

Limits of the check. Without a known hand force it does not judge. It cannot distinguish rest from
motion that needs less net torque than `FreezeSettings.torque` (slow, even motion with a constant
force). It does not find a sensor that sticks for less than `FreezeSettings.time`, drifts or has a
wrong scale. A link that something blocks elsewhere than at the handle also looks frozen; that errs
on the safe side. Near the joints' stops the check does not judge. It takes the sensor's axes as
those of `manus_base`, as everywhere in the plane.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..geometry import MANUS, PlanarArm, jacobian
from ..settings import Setting
from .planar_settings import PlanarSettings


class FreezeSettings(NamedTuple):
    """When the position of a joint that does not move counts as frozen.

    3 Nm are 6 to 7 N at the handle; the joints' friction is 0.3 Nm (thesis, appendix D), an error
    of 4 N of the force sensor makes 2 Nm. A net torque of 3 Nm moves a joint with the module's
    1.3 kg m2 by a count of 0.1 mrad in 9 ms.
    """

    torque: Annotated[
        float, Setting("net torque on a joint that must move it", "Nm", 0.5, 100.0)
    ] = 3.0
    time: Annotated[
        float, Setting("such torque without a change of count means a frozen position, 0 = off",
                       "s", 0.0, 10.0)
    ] = 0.1


class FreezeState(NamedTuple):
    """position: the newest [rad]; doubt: time with too much torque since it last changed [s]."""

    position: float
    doubt: float


def freeze_step(
    settings: FreezeSettings, state: FreezeState, position: float, torque: float, dt: float
) -> tuple[bool, FreezeState]:
    """Return whether the position is frozen, and the next state, dt [s] after the last step.

    position: of the joint [rad]; torque: net, motor and hand, that acted during dt [Nm], NaN = not
    known.
    """
    if settings.time == 0.0 or position != state.position:
        return False, FreezeState(position, 0.0)
    doubt = state.doubt + (dt if abs(torque) > settings.torque else 0.0)
    return doubt >= settings.time, FreezeState(position, doubt)


def hand_torques(
    shoulder: float, elbow: float, fx: float, fy: float, arm: PlanarArm = MANUS
) -> tuple[float, float]:
    """Return the torques of a handle force [N] at both joints [Nm]: J^T F, angles in rad."""
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow, arm)
    return x_s * fx + y_s * fy, x_e * fx + y_e * fy


def clear_of_stops(settings: PlanarSettings, shoulder: float, elbow: float) -> bool:
    """Return whether both joints [rad] are within their range, where no stop touches them."""
    return (
        settings.shoulder_low < shoulder < settings.shoulder_high
        and settings.elbow_low < elbow < settings.elbow_high
        and settings.between_low < elbow - shoulder < settings.between_high
    )
