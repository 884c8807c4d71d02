# SPDX-License-Identifier: Apache-2.0
"""Checks whether force samples may become the new zero."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from ..samples import FORCE_FAULT_MASK, ForceReading
from .ati import status_names
from .errors import NotNow
from .force_sensor_settings import ForceSensorSettings

_WRENCH = slice(ForceReading._fields.index("fx"), ForceReading._fields.index("tz") + 1)


def mean_wrench(readings: Sequence[ForceReading], settings: ForceSensorSettings) -> list[float]:
    """Return the mean of `readings` over fx, fy, fz [N], tx, ty, tz [Nm].

    Raises NotNow when there are too few, one is unusable, or the handle is loaded or moved.
    """
    if len(readings) < settings.tare_samples:
        raise NotNow(f"{len(readings)} force samples; {settings.tare_samples} are needed to tare")
    for reading in readings:
        if reading.status & FORCE_FAULT_MASK:
            raise NotNow(f"the sensor reports {', '.join(status_names(reading.status))}")
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
