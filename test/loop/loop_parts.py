# SPDX-License-Identifier: Apache-2.0
"""Loops without a robot: their drives note what is written, their gates are open."""

from __future__ import annotations

from types import SimpleNamespace

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.rig.build import RigSettings, vertical_rating
from screw_module_ros.rig.drive import SimulatedDrive
from screw_module_ros.rig.link import Link
from screw_module_ros.safety.permit import OPEN, PermitSettings

MS, S = 1_000_000, 1_000_000_000
CHAIN = TorqueChain()


def noting_drive(sent: list, settings: DriveSettings) -> SimpleNamespace:
    """Return a drive that notes what it gets [Nm]."""
    return SimpleNamespace(
        brakes=False,
        write=lambda command, now_ns: sent.append(command) or command, settings=settings
    )


def open_axis(sent: list, chain=CHAIN, heat: float = 0.0) -> VerticalDrive:
    """Return the loop of a vertical drive that is enabled."""
    port = SimpleNamespace(clock=ManualClock(S), pump=lambda until_ns: None)
    drive = noting_drive(sent, DriveSettings())
    made = VerticalDrive(drive, port, MS, PermitSettings(), chain, heat=heat)
    made.permit = SimpleNamespace(phase=OPEN, step=lambda newest_ns, now_ns: 1.0)
    return made


class LooseMotor:
    """The motor of a second drive: it turns nothing here. driving: with what its drive tells it."""

    driving = False

    def position(self) -> int:
        return 0

    def torque(self) -> float:
        return 0.0

    def drive(self, _torque: float, driving: bool, _braking: bool) -> None:
        self.driving = driving


def twin_of(bench) -> SimulatedDrive:
    """Put a second drive with the vertical drive's node id on its bus, and let it boot."""
    rig, port = bench.rig, bench.rig.devices["drive"].link.port
    twin = SimulatedDrive(
        "twin", Link(port, "twin"), vertical_rating(RigSettings()), LooseMotor(), rig.physics
    )
    rig.devices["twin"] = twin
    bench.clock.sleep(0.1)
    bench.ports["drive"].pump()
    return twin
