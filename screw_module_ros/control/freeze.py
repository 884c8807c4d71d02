# SPDX-License-Identifier: Apache-2.0
"""A joint position that stands still while it cannot: the planar joints have one sensor each.

The vertical axis compares two sensors (`agreement`); a planar joint has its drive's position alone.
But it is light and direct-driven: what the motor and the hand do to it must move it, unless they
balance. So the check adds up the time during which the net torque, commanded plus hand's, is more
than friction and errors can hold while the position stays *the same to the last count*; a change by
one count takes all doubt away. A handle at rest, a set point out of reach behind a hand that holds
against it, a wall at the handle: in all of these the net torque is small, the sum does not grow.

What it does not see. Where the hand's force is not known it judges nothing. Motion that takes less
net torque than `freeze_torque` (slow, even motion along with a constant force) cannot be
distinguished from rest; a sensor that sticks and jumps on within `freeze_time` of doubt, that
drifts or has a wrong scale is not found either. Something that blocks a link elsewhere than at the
handle looks frozen too, which errs to the safe side; at the ends of the joints' range, where their
stops are near, nothing is judged. The sensor's axes are taken to be those of `manus_base`, as
everywhere in the plane.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..geometry import MANUS, PlanarArm, jacobian
from ..settings import Setting
from .planar_settings import PlanarSettings


class FreezeSettings(NamedTuple):
    """When the position of a joint that does not move counts as frozen.

    3 Nm are 6 to 7 N at the handle; the joints' friction is 0.3 Nm (thesis, appendix D), an error
    of 4 N of the force sensor makes 2 Nm. They move a joint with the module's 1.3 kg m2 by a count
    of 0.1 mrad in 9 ms.
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
    """Return what a force on the handle [N] does to both joints [Nm]: J^T F, angles in rad."""
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow, arm)
    return x_s * fx + y_s * fy, x_e * fx + y_e * fy


def clear_of_stops(settings: PlanarSettings, shoulder: float, elbow: float) -> bool:
    """Return whether both joints [rad] are within their range, where no stop can hold them."""
    return (
        settings.shoulder_low < shoulder < settings.shoulder_high
        and settings.elbow_low < elbow < settings.elbow_high
        and settings.between_low < elbow - shoulder < settings.between_high
    )
