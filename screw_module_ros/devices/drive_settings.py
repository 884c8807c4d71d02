# SPDX-License-Identifier: Apache-2.0
"""Settings of a CiA 402 drive, its process data objects and their bus load."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..can_io.bus_load import Traffic
from ..geometry import COUNTS_PER_TURN
from ..settings import Setting
from ..units import LARGEST_PER_MILLE, PER_MILLE
from . import pdo

_COMMAND_ENTRIES = (pdo.Entry(0x6040, 0, 16), pdo.Entry(0x6071, 0, 16))
_STATUS_ENTRIES = (
    pdo.Entry(0x6041, 0, 16), pdo.Entry(0x6064, 0, 32), pdo.Entry(0x6077, 0, 16)
)  # fmt: skip
_SLOW_STATUS_ENTRIES = (
    pdo.Entry(0x603F, 0, 16), pdo.Entry(0x6061, 0, 8), pdo.Entry(0x60FD, 0, 32)
)  # fmt: skip
SLOW_STATUS_MS = 100

_ROUNDING = 1e-6
COAST, BRAKE = "coast", "brake"


class DriveSettings(NamedTuple):
    """One drive: its node id, its units, and its guards for a program that stops."""

    node_id: Annotated[int, Setting("CANopen node id", "", 1, 127)] = 1
    master_id: Annotated[int, Setting("node id of our own heartbeat", "", 1, 127)] = 112
    rate: Annotated[float, Setting("ticks (torque commands) per second", "Hz", 1.0, 4000.0)] = (
        1000.0
    )
    sync_divider: Annotated[
        int, Setting("statusword at every n-th SYNC; 2 where the SYNC is twice as fast", "", 1, 240)
    ] = 1
    rated_torque: Annotated[
        float, Setting("rated torque, checked against object 6076", "Nm", 1e-4, 1e4)
    ] = 0.42
    max_torque: Annotated[
        float, Setting("largest torque written, also the drive's own limit, object 6072", "Nm",
                       0.0, 1e5)
    ] = 1.6
    excess_torque: Annotated[
        float, Setting("torque (6077) in excess of the command that stops the drive",
                       "of rated", 0.05, 100.0)
    ] = 0.25
    lasting_torque: Annotated[
        float, Setting("torque (6077) in excess of the command that is tolerated for long",
                       "of rated", 0.005, 10.0)
    ] = 0.05
    counts_per_turn: Annotated[
        int, Setting("counts of the position (6064) per turn of the screw or the joint", "counts",
                     4, 2**31)
    ] = COUNTS_PER_TURN
    direction: Annotated[
        int, Setting("1 when the drive's positive direction is the robot's, else -1",
                     choices=(1, -1))
    ] = 1
    stop_reaction: Annotated[
        str, Setting("reaction to a stop: coast lets the patient move out",
                     choices=(COAST, BRAKE))
    ] = COAST
    allow_unguarded: Annotated[
        bool, Setting("DANGER: enable a drive that does not stop when this program hangs")
    ] = False
    heartbeat_period: Annotated[
        float, Setting("time between our heartbeats", "s", 0.001, 1.0)
    ] = 0.025
    heartbeat_timeout: Annotated[
        float, Setting("the drive stops this long after our last heartbeat, object 1016", "s",
                       0.002, 10.0)
    ] = 0.1
    command_timeout: Annotated[
        float, Setting("the drive stops this long after our last command, object 1400:05", "s",
                       0.001, 10.0)
    ] = 0.02
    drive_heartbeat: Annotated[
        float, Setting("time between the drive's heartbeats, object 1017", "s", 0.002, 10.0)
    ] = 0.05
    stale_periods: Annotated[
        float, Setting("age of the statusword beyond which the drive's state is unknown", "periods",
                       2.0, 1000.0)
    ] = 10.0
    enable_timeout: Annotated[
        float, Setting("enabling and recovering must succeed within", "s", 0.01, 60.0)
    ] = 2.0
    vendor_id: Annotated[int, Setting("vendor expected, object 1018:01; 0 = any", "", 0)] = 0
    product_code: Annotated[int, Setting("product expected, object 1018:02; 0 = any", "", 0)] = 0
    sdo_timeout: Annotated[
        float, Setting("time limit of one SDO try; there are two", "s", 0.01, 10.0)
    ] = 0.5
    listen: Annotated[
        float, Setting("listen for another master before configuring", "s", 0.0, 2.0)
    ] = 0.15


def cross_checked(settings: DriveSettings) -> DriveSettings:
    """Return `settings` unchanged when they are consistent; else raise ValueError."""
    for name, limit in (
        ("heartbeat_period", settings.heartbeat_timeout), ("drive_heartbeat", 10.0)
    ):
        if getattr(settings, name) >= limit:
            raise ValueError(
                f"DriveSettings: {name} = {getattr(settings, name)!r} s: less than {limit:g} s "
                "is wanted, or the guard trips by itself"
            )
    if settings.command_timeout * settings.rate <= 1.0:
        raise ValueError(
            f"DriveSettings: command_timeout = {settings.command_timeout!r} s: more than one "
            f"period of {settings.rate:g} Hz is wanted, or the guard trips by itself"
        )
    if settings.lasting_torque >= settings.excess_torque:
        raise ValueError(
            f"DriveSettings: lasting_torque = {settings.lasting_torque!r} of rated: less than "
            f"excess_torque = {settings.excess_torque:g} is wanted, which stops the drive at once"
        )
    if settings.master_id == settings.node_id:
        raise ValueError(
            f"DriveSettings: master_id = {settings.master_id}: another than the drive's node_id "
            "is wanted"
        )
    return settings


def own_limit(max_torque: float, rated_torque: float) -> int:
    """Return object 6072 for max_torque and rated_torque [Nm]: whole per mille, rounded up.

    The object limits both directions, so it needs no `direction`.
    """
    per_mille = math.ceil(max_torque / rated_torque * PER_MILLE - _ROUNDING)
    return max(0, min(LARGEST_PER_MILLE, per_mille))


def milliseconds(seconds: float) -> int:
    """Return a time [s] in the object dictionary's unit [ms], at least 1."""
    return max(1, round(seconds * 1e3))


def command_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return RPDO1, effective at once, with the deadline that stops the drive."""
    cob_id = 0x200 + settings.node_id
    deadline = milliseconds(settings.command_timeout)
    return pdo.Pdo(1, False, cob_id, pdo.ON_EVENT, _COMMAND_ENTRIES, deadline)


def status_pdo(settings: DriveSettings) -> pdo.Pdo:
    """Return TPDO1, at every SYNC or every n-th."""
    cob_id = 0x180 + settings.node_id
    return pdo.Pdo(1, True, cob_id, settings.sync_divider, _STATUS_ENTRIES)


def slow_status_pdo(settings: DriveSettings, inputs: bool = True) -> pdo.Pdo:
    """Return TPDO2, on change and every 100 ms; inputs: with the digital inputs, its last entry."""
    cob_id = 0x280 + settings.node_id
    entries = _SLOW_STATUS_ENTRIES if inputs else _SLOW_STATUS_ENTRIES[:-1]
    return pdo.Pdo(2, True, cob_id, pdo.ON_EVENT, entries, SLOW_STATUS_MS)


def drive_traffic(settings: DriveSettings, sync_producer: bool = True) -> list[Traffic]:
    """Return the frames of this device for the bus load, SYNC included where we send it."""
    name, rate = f"drive {settings.node_id}", settings.rate
    frames = [
        Traffic(f"{name} RPDO1", command_pdo(settings).size, rate),
        Traffic(f"{name} TPDO1", status_pdo(settings).size, rate),
        Traffic(f"{name} TPDO2", slow_status_pdo(settings).size, 1e3 / SLOW_STATUS_MS),
        Traffic(f"{name} heartbeat", 1, 1.0 / settings.drive_heartbeat),
        Traffic(f"heartbeat {settings.master_id}", 1, 1.0 / settings.heartbeat_period),
    ]
    sync = Traffic("SYNC", 0, rate * settings.sync_divider)
    return [sync, *frames] if sync_producer else frames
