# SPDX-License-Identifier: Apache-2.0
"""Which driver speaks with a force sensor: one for each protocol that a profile may name."""

from __future__ import annotations

from ..can_io.port import Port
from ..profiles import FORCE_SENSOR, NET_PROTOCOL, NETCANOEM_PROTOCOL, load
from .ati_net import NetForceSensor
from .force_sensor import ForceSensor
from .force_sensor_settings import ForceSensorSettings

PROTOCOLS = {NETCANOEM_PROTOCOL: ForceSensor, NET_PROTOCOL: NetForceSensor}


def driver(port: Port, settings: ForceSensorSettings) -> ForceSensor:
    """Return the driver for the sensor's profile. Raises SettingError for one that is not there."""
    return PROTOCOLS[load(settings.profile, FORCE_SENSOR).force_sensor.protocol](port, settings)
