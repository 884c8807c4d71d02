# SPDX-License-Identifier: Apache-2.0
"""Checks whether force samples may become the new zero, and estimates how far the zero is off."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from ..samples import FORCE_FAULT_MASK, ForceReading, force_status_names
from .errors import NotNow
from .force_sensor_settings import ForceSensorSettings

_BLOCKS = 10
_STILL = 0.05  # [N] spread of the blocks' means; a hand at rest varies by more (pulse, breath)
_WRENCH = slice(ForceReading._fields.index("fx"), ForceReading._fields.index("tz") + 1)


def mean_wrench(readings: Sequence[ForceReading], settings: ForceSensorSettings) -> list[float]:
    """Return the mean of `readings` over fx, fy, fz [N], tx, ty, tz [Nm].

    Raises NotNow when there are too few, one is unusable, or the handle is loaded or moved.
    """
    if len(readings) < settings.tare_samples:
        raise NotNow(f"{len(readings)} force samples; {settings.tare_samples} are needed to tare")
    for reading in readings:
        if reading.status & FORCE_FAULT_MASK:
            raise NotNow(f"the sensor reports {', '.join(force_status_names(reading.status))}")
    columns = list(zip(*(reading[_WRENCH] for reading in readings), strict=True))
    mean = [statistics.fmean(column) for column in columns]
    load = math.hypot(*mean[:3])
    if load > settings.tare_force_limit:
        raise NotNow(
            f"the handle is loaded with {load:.1f} N (limit {settings.tare_force_limit:g} N): "
            "let it go"
        )
    spread = max(statistics.pstdev(column) for column in columns[:3])
    if spread > settings.tare_spread_limit:
        raise NotNow(
            f"the force varies by {spread:.1f} N (limit {settings.tare_spread_limit:g} N): "
            "keep the handle at rest"
        )
    return mean


def zero_error(readings: Sequence[ForceReading]) -> list[float] | None:
    """Return by how much the zero seems to be off, fx, fy, fz [N]; None while somebody may hold.

    readings: of a second or more. A handle that nobody holds shows a constant force, which is the
    transducer's drift since the tare or the handle's weight; a hand's force varies. A load that
    hangs on the handle is taken for an error too, so nothing is removed without a tare.
    """
    size = len(readings) // _BLOCKS
    forces = [(reading.fx, reading.fy, reading.fz) for reading in readings]
    blocks = [forces[k : k + size] for k in range(0, _BLOCKS * size, size)] if size else []
    axes = [[statistics.fmean(axis) for axis in zip(*block, strict=True)] for block in blocks]
    columns = list(zip(*axes, strict=True))
    if not columns or max(map(statistics.pstdev, columns)) > _STILL:
        return None
    return [statistics.fmean(column) for column in columns]
