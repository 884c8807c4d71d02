# SPDX-License-Identifier: Apache-2.0
"""Settings of the force sensor, and its bus load."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..profiles import NETCANOEM
from ..settings import Setting

#: Bases whose sixteen identifiers do not collide with CANopen's (PDO 1 to 4, SDO, NMT and so on).
FREE_BASES = frozenset(
    (*range(0x01, 0x08), *range(0x11, 0x18), *range(0x68, 0x70), *range(0x78, 0x7E), 0x7F)
)

ANY_CALIBRATION = -1

FEWEST_UNCHANGED = 10
"""Smallest number of equal samples in a row that means frozen gauges: with a noise of less than a
count fewer may be equal by chance."""


class ForceSensorSettings(NamedTuple):
    """The transducer: its identifiers, its mounting, the conditions for taring."""

    base_id: Annotated[
        int, Setting("high seven bits of its identifiers", choices=tuple(sorted(FREE_BASES)))
    ] = 0x12
    profile: Annotated[
        str, Setting("make of the sensor: a file of params/devices, or the path of one of yours")
    ] = NETCANOEM
    rate: Annotated[float, Setting("polls per second", "Hz", 1.0, 4000.0)] = 1000.0
    counts_per_force: Annotated[
        float, Setting("of a sensor that does not tell: counts per newton", "1/N", 0.0, 1e6)
    ] = 0.0
    counts_per_torque: Annotated[
        float, Setting("of a sensor that does not tell: counts per newton metre", "1/Nm", 0.0, 1e6)
    ] = 0.0
    calibration: Annotated[
        int, Setting("calibration to activate, -1 = keep the active one", "", ANY_CALIBRATION, 15)
    ] = ANY_CALIBRATION
    serial: Annotated[str, Setting("serial number expected, empty for any")] = ""
    roll: Annotated[float, Setting("mounting, sensor to handle axes, about x", "rad", -7, 7)] = 0.0
    pitch: Annotated[float, Setting("mounting, then about the fixed y", "rad", -7, 7)] = 0.0
    yaw: Annotated[float, Setting("mounting, then about the fixed z", "rad", -7, 7)] = 0.0
    sign: Annotated[
        int, Setting("1 when it shows the patient's force on the robot, else -1", choices=(1, -1))
    ] = 1
    tare_samples: Annotated[int, Setting("fewest samples to tare with", "", 1, 10000)] = 100
    tare_force_limit: Annotated[
        float, Setting("taring is refused above this mean force", "N", 0.0, 500.0)
    ] = 30.0
    tare_spread_limit: Annotated[
        float, Setting("taring is refused above this standard deviation", "N", 0.0, 100.0)
    ] = 3.0
    tare_shift: Annotated[
        float, Setting("largest shift of the zero against the last tare without a second call", "N",
                       0.0, 500.0)
    ] = 2.0  # ours: above a day's drift, below what a patient who holds the handle pushes with
    freeze_time: Annotated[
        float, Setting("unchanged gauges for this time are a fault, 0 = off", "s", 0.0, 60.0)
    ] = 0.5
    timeout: Annotated[
        float, Setting("time limit of one blocking question; two tries", "s", 0.01, 10.0)
    ] = 0.5
    listen: Annotated[
        float, Setting("listen for another poller before configuring", "s", 0.0, 2.0)
    ] = 0.1

    @property
    def claims(self) -> tuple[str, ...]:
        """What only one process of a machine may have on a bus (`locks.lock_device`)."""
        return (f"force sensor 0x{self.base_id:02x}",)


def unchanged_samples(settings: ForceSensorSettings) -> int:
    """Return the number of equal samples in a row that means frozen gauges; 0 = no limit."""
    if settings.freeze_time == 0.0:
        return 0
    return max(FEWEST_UNCHANGED, round(settings.freeze_time * settings.rate))
