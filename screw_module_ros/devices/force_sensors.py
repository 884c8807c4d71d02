# SPDX-License-Identifier: Apache-2.0
"""Which driver speaks with a force sensor: one for each protocol that a profile may name."""

from __future__ import annotations

from collections.abc import Callable

from .. import plugins
from ..can_io.port import Port
from ..clock import Clock
from ..profiles import FORCE_SENSOR, NET_PROTOCOL, NETCANOEM_PROTOCOL, load
from ..settings import SettingError, read
from .ati_net import NetForceSensor
from .force_base import ForceSensor
from .force_sensor_settings import ForceSensorSettings
from .netcanoem import NetcanoemSensor

PROTOCOLS: dict[str, type[ForceSensor]] = {
    NETCANOEM_PROTOCOL: NetcanoemSensor, NET_PROTOCOL: NetForceSensor,
}  # fmt: skip
GROUP = "screw_module_ros.force_sensors"
"""Entry points that name drivers of other packages, by protocol."""


def driver(
    settings: ForceSensorSettings, open_port: Callable[..., Port], clock: Clock
) -> ForceSensor:
    """Return the driver for the sensor's profile, on its line; see `ForceSensor.opened`.

    Raises SettingError for a profile or driver that is not there, BusError, AlreadyRunning.
    """
    given = load(settings.profile, FORCE_SENSOR).force_sensor
    kind = PROTOCOLS.get(given.protocol) or plugins.load(given.protocol, GROUP, "protocol")
    if not (isinstance(kind, type) and issubclass(kind, ForceSensor)):
        raise SettingError(
            f"protocol {given.protocol}: {kind!r} is no subclass of "
            "screw_module_ros.devices.force_base.ForceSensor"
        )
    own = read(kind.OWN, given.settings, f"profile {settings.profile}: force_sensor.settings")
    return kind.opened(settings, own, open_port, clock)
