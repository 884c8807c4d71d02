# SPDX-License-Identifier: Apache-2.0
"""Parameters of the two planar drives: one master, one rate, one heartbeat."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from screw_module_ros.can_io.port import Port
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.settings import Setting

from .support.parameters import Parameters

JOINTS = ("shoulder", "elbow")
_NODE_IDS = (3, 4)
_SHARED = ("rate", "master_id", "allow_unguarded")


class SharedSettings(NamedTuple):
    """Settings that both drives share."""

    master_id: Annotated[int, Setting("node id of our own heartbeat", "", 1, 127)] = 113
    allow_unguarded: Annotated[
        bool, Setting("DANGER: enable drives that do not stop when this program hangs")
    ] = False


def declare_drives(parameters: Parameters) -> None:
    """Declare the parameters of both drives."""
    parameters.declare(SharedSettings)
    for joint, node_id in zip(JOINTS, _NODE_IDS, strict=True):
        parameters.declare(
            DriveSettings, joint, _SHARED, node_id=node_id, rated_torque=10.0, max_torque=25.0,
            counts_per_turn=65536,
        )  # fmt: skip


def read_drives(parameters: Parameters, rate: float, law: PlanarSettings) -> list[DriveSettings]:
    """Return the settings of both drives; rate: of the commands [1/s].

    law: its largest torques are also the drives' own limits, unless max_torque is smaller.
    """
    shared = parameters.read(SharedSettings)._asdict()
    largest = (law.shoulder_torque, law.elbow_torque)
    found = [parameters.read(DriveSettings, joint) for joint in JOINTS]
    return [
        each._replace(rate=rate, max_torque=min(each.max_torque, torque), **shared)
        for each, torque in zip(found, largest, strict=True)
    ]


def make_drives(port: Port, settings: list[DriveSettings]) -> list[Drive]:
    """Return both drives, with one heartbeat for them."""
    beat = Heartbeat(port, settings[0].master_id, settings[0].heartbeat_period)
    return [
        Drive(port, each, f"{joint} drive", beat)
        for joint, each in zip(JOINTS, settings, strict=True)
    ]
