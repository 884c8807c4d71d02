# SPDX-License-Identifier: Apache-2.0
"""Drivers in their cycle against scripted ends.

A sensor, a drive whose heartbeat comes, and two drives on one bus.
"""

from __future__ import annotations

from scripted_devices import ScriptedDrive

from screw_module_ros.devices.canopen import Heartbeat
from screw_module_ros.devices.drive import Drive


def tick(wire, sensor, sequence=1):
    """One period: request, then whatever came in; returns the sample, stamped 5 ns later."""
    now_ns = wire.advance()
    sensor.request(sequence, now_ns, now_ns + 5)
    wire.port.pump()
    return sensor.reading()


def watched_tick(wire, drive, torque=0.0):
    """One period of a torque loop in which the drive's heartbeat comes; returns what is written."""
    now_ns = wire.advance()
    wire.emit(0x701, "05")
    drive.sync(now_ns)
    drive.heartbeat(now_ns)
    wire.port.pump()
    return drive.write(torque, now_ns)


def watched_drive(wire, settings, period=watched_tick):
    """Return a drive that was configured and started, after five ticks with its heartbeat.

    period: carries out one tick.
    """
    made = Drive(wire.port, settings, "vertical drive")
    made.configure()
    made.start()
    for _ in range(5):
        period(wire, made)
    return made


def two_drives(wire, settings):
    """Return the scripted ends 3 and 4, and their drives with one heartbeat for both."""
    ends = [wire.attach(ScriptedDrive(wire, node)) for node in (3, 4)]
    beat = Heartbeat(wire.port, 113, 0.025)
    drives = [
        Drive(wire.port, settings._replace(node_id=node, master_id=113), f"drive {node}", beat)
        for node in (3, 4)
    ]
    return ends, drives


def tick_both(wire, drives):
    """One period of both drives without torque."""
    now_ns = wire.advance()
    drives[0].sync(now_ns)
    wire.port.pump()
    for drive in drives:
        drive.heartbeat(now_ns)
        drive.write(0.0, now_ns)
