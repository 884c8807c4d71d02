# SPDX-License-Identifier: Apache-2.0
"""A drive's driver in its cycle against a scripted drive whose heartbeat comes."""

from __future__ import annotations

from screw_module_ros.devices.drive import Drive


def watched_tick(wire, drive, torque=0.0):
    """One period of a torque loop in which the drive's heartbeat comes; returns what is written."""
    now_ns = wire.advance()
    wire.emit(0x701, "05")
    drive.sync(now_ns)
    drive.heartbeat(now_ns)
    wire.port.pump()
    return drive.write(torque, now_ns)


def watched_drive(wire, settings):
    """Return a drive that was configured and started, after five ticks with its heartbeat."""
    made = Drive(wire.port, settings, "vertical drive")
    made.configure()
    made.start()
    for _ in range(5):
        watched_tick(wire, made)
    return made
