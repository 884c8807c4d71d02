# SPDX-License-Identifier: Apache-2.0
"""Creates the simulated devices on their buses, with their ids and ratings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

from screw_module_ros import plugins
from screw_module_ros.profiles import (
    DRIVE,
    ENCODER,
    FORCE_SENSOR,
    GENERIC_402,
    GENERIC_406,
    NET_PROTOCOL,
    NETCANOEM,
    NETCANOEM_PROTOCOL,
    Profile,
    load,
)
from screw_module_ros.rig.device import SimulatedDevice
from screw_module_ros.rig.drive import DriveRating, SimulatedDrive
from screw_module_ros.rig.encoder import SimulatedEncoder
from screw_module_ros.rig.force_sensor import SimulatedForceSensor
from screw_module_ros.rig.link import Link
from screw_module_ros.rig.net_sensor import SimulatedNetSensor
from screw_module_ros.rig.physics import Axis, Physics, PlanarAxis, VerticalAxis
from screw_module_ros.rig.port import RigPort
from screw_module_ros.settings import Setting, SettingError

BUSES = ("encoder", "drive", "force_sensor", "planar")

_VERTICAL_COUNTS_PER_TURN = 20_000
_PLANAR_COUNTS_PER_TURN = 65_536
"""9.587e-5 rad a count."""

SENSORS = {NETCANOEM_PROTOCOL: SimulatedForceSensor, NET_PROTOCOL: SimulatedNetSensor}
"""The simulated force sensors, by protocol."""
SENSOR_GROUP = "screw_module_ros.rig_sensors"
"""Entry points that name simulated force sensors of other packages, by protocol: functions of
`Link`, `Physics` and `Profile`."""


class RigSettings(NamedTuple):
    """Ids and ratings of the simulated devices."""

    encoder_node: Annotated[int, Setting("node id of the encoder", "", 1, 127)] = 2
    drive_node: Annotated[int, Setting("node id of the vertical drive", "", 1, 127)] = 1
    shoulder_node: Annotated[int, Setting("node id of the shoulder drive", "", 1, 127)] = 3
    elbow_node: Annotated[int, Setting("node id of the elbow drive", "", 1, 127)] = 4
    sensor_base: Annotated[int, Setting("base id of the force sensor", "", 1, 127)] = 0x12
    rated_torque: Annotated[
        float, Setting("rated torque of the vertical motor, object 6076", "Nm", 0.01, 10.0)
    ] = 0.42
    torque_constant: Annotated[
        float, Setting("torque of the vertical motor per ampere", "Nm/A", 0.01, 10.0)
    ] = 0.16
    planar_rated_torque: Annotated[
        float, Setting("rated torque of the planar motors, object 6076", "Nm", 0.1, 100.0)
    ] = 10.0
    planar_rated_current: Annotated[
        float, Setting("rated current of the planar motors, object 6075", "A", 0.1, 100.0)
    ] = 10.0
    drive_profile: Annotated[str, Setting("make of the drives, a file of params/devices")] = (
        GENERIC_402
    )
    encoder_profile: Annotated[str, Setting("make of the encoder, a file of params/devices")] = (
        GENERIC_406
    )
    sensor_profile: Annotated[
        str, Setting("make of the force sensor, a file of params/devices")
    ] = NETCANOEM
    max_torque: Annotated[
        int, Setting("largest torque of the drives, object 6072", "per mille", 100, 32767)
    ] = 4000
    command_latency: Annotated[
        float, Setting("from SYNC to the effect of its command, in simulated time", "s",
                       0.0, 0.1)
    ] = 600e-6


def build_devices(
    settings: RigSettings, ports: dict[str, RigPort], physics: Physics
) -> Iterator[SimulatedDevice]:
    """Yield the devices that sit on `ports` (keys as in BUSES), each plugged in.

    Raises SettingError for a profile that does not exist.
    """
    profile = load(settings.drive_profile, DRIVE)
    if "encoder" in ports:
        link = Link(ports["encoder"], "encoder")
        encoder = load(settings.encoder_profile, ENCODER)
        yield SimulatedEncoder(link, settings.encoder_node, physics.world, encoder)
    if "drive" in ports:
        axis = VerticalAxis(physics, 1.0 / settings.torque_constant)
        yield _drive("drive", ports["drive"], vertical_rating(settings), axis, physics, profile)
    if "force_sensor" in ports:
        link = Link(ports["force_sensor"], "force_sensor")
        yield _sensor(link, settings, physics)
    if "planar" in ports:
        nodes = (("shoulder", settings.shoulder_node), ("elbow", settings.elbow_node))
        for index, (name, node_id) in enumerate(nodes):
            joint, rating = PlanarAxis(physics, index), planar_rating(settings, node_id)
            yield _drive(name, ports["planar"], rating, joint, physics, profile)


def _sensor(link: Link, settings: RigSettings, physics: Physics) -> SimulatedDevice:
    profile = load(settings.sensor_profile, FORCE_SENSOR)
    protocol = profile.force_sensor.protocol
    if own := SENSORS.get(protocol):
        return own(link, settings.sensor_base, physics)
    made = plugins.load(protocol, SENSOR_GROUP, "simulated force sensor")(link, physics, profile)
    if not isinstance(made, SimulatedDevice):
        raise SettingError(
            f"simulated force sensor {protocol}: {made!r} is no "
            "screw_module_ros.rig.device.SimulatedDevice"
        )
    return made


def vertical_rating(settings: RigSettings) -> DriveRating:
    """Return the ratings that the vertical drive reports."""
    return DriveRating(
        node_id=settings.drive_node,
        rated_torque=settings.rated_torque,
        rated_current=settings.rated_torque / settings.torque_constant,
        max_torque=settings.max_torque,
        counts_per_turn=_VERTICAL_COUNTS_PER_TURN,
    )


def planar_rating(settings: RigSettings, node_id: int) -> DriveRating:
    """Return the ratings that a planar drive reports."""
    return DriveRating(
        node_id=node_id,
        rated_torque=settings.planar_rated_torque,
        rated_current=settings.planar_rated_current,
        max_torque=settings.max_torque,
        counts_per_turn=_PLANAR_COUNTS_PER_TURN,
    )


def _drive(
    name: str, port: RigPort, rating: DriveRating, axis: Axis, physics: Physics, profile: Profile
) -> SimulatedDrive:
    return SimulatedDrive(name, Link(port, name), rating, axis, physics, profile)
