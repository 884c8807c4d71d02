# SPDX-License-Identifier: Apache-2.0
"""Every device's cable and frames: what a CAN bus does to a robot."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from .acts import cured, fault
from .row import EITHER, GOES_ON, MISSED, OFF, Alarm, Row
from .ticks import COMMAND_S, HEARTBEAT_S, STALE, samples

GROUP = "bus"
_SLACK = 7  # samples: the rig's service, wake-ups of two processes, the supervisor's decision
_FOLLOWS = 8  # the other axes: fault told with the state, decided at 50 Hz
_BY_CHANCE = 60


class Device(NamedTuple):
    """A device of the rig: who drives it, and within how many samples its silence is noticed."""

    name: str
    noticed_by: str
    within: int
    alarm: Alarm
    way_back: str


_DRIVE = max(samples(COMMAND_S), samples(HEARTBEAT_S), STALE)
DEVICES = (
    Device("encoder", "impedance_controller", STALE, Alarm("impedance_controller", "encoder:",
           "encoder"), f"mend it; encoder/home after a boot-up, {MISSED}, reset, enable"),
    Device("force_sensor", "impedance_controller", STALE, Alarm("impedance_controller",
           "force sensor", "force"), "mend it; force_sensor/tare after a bad status, "
           f"{MISSED}, reset, enable"),
    Device("drive", "amplifier; the drive itself", _DRIVE, Alarm("amplifier", "drive",
           "amplifier"), "mend it; amplifier/clear_fault, reset, enable"),
    Device("shoulder", "manus; the drive itself", _DRIVE, Alarm("manus", "drive|position",
           "manus"), "mend it; manus/clear_fault, manus/home after a boot-up, reset, enable"),
    Device("elbow", "manus; the drive itself", _DRIVE, Alarm("manus", "drive|position",
           "manus"), "mend it; manus/clear_fault, manus/home after a boot-up, reset, enable"),
)  # fmt: skip
_PLANAR = ("shoulder", "elbow")


class Kind(NamedTuple):
    """What happens to a device's frames; safe: what must come of it."""

    fault: str
    text: str
    safe: str = OFF
    value: float = 0.0
    watch: float = 0.5


KINDS = (
    Kind("cable_out", "CAN cable out, later back"),
    Kind("bus_off", "its CAN controller goes bus-off, later back"),
    Kind("mute", "nothing goes out, later it does"),
    Kind("truncate", "every frame loses its last byte"),
    Kind("lengthen", "every frame grows by a byte"),
    Kind("wrong_id", "frames carry a foreign identifier"),
    Kind("garbage", "payloads are random"),
    Kind("delay", "frames come 500 ms late", OFF, 500.0),
    Kind("drop", "every second frame is lost, at random", EITHER, 0.5, 2.0),
    Kind("duplicate", "every frame comes twice", EITHER),
    Kind("reorder", "frames change places in pairs", EITHER),
    Kind("delay", "frames come 3 ms late", EITHER, 3.0),
    Kind("foreign_ids", "a foreign frame follows each of its own", GOES_ON),
    Kind("flood", "a babbling device floods the bus, 1000 frames/s", EITHER, 1.0, 2.0),
)
_FLOOD_S = 30.0


def rows() -> Iterator[Row]:
    """Every kind x device; half a minute of flooding on every bus."""
    for device in DEVICES:
        for kind in KINDS:
            yield _row(device, kind)
    long = KINDS[-1]._replace(text="30 s of bus flooding, 1000 frames/s", watch=_FLOOD_S)
    for device in DEVICES[:4]:  # the elbow is on the shoulder's bus
        yield _row(device, long)._replace(name=f"{device.name}-flood-30s")


def _row(device: Device, kind: Kind) -> Row:
    stops = kind.safe == OFF
    within = device.within + _SLACK
    follows = within + _FOLLOWS
    # A drive that is deaf drops its own torque; the other axes follow.
    vertical, plane = (follows, within) if device.name in _PLANAR else (within, follows)
    alarm = _alarm(device, kind) if stops else None
    return Row(
        name=f"{device.name}-{kind.fault}{_size(kind)}",
        group=GROUP,
        fault=f"{device.name}: {kind.text}",
        inject=fault(device.name, kind.fault, kind.value),
        back=cured(device.name),
        alarm=alarm,
        way_back=device.way_back if kind.safe != GOES_ON else "none is needed",
        noticed_by=device.noticed_by if kind.safe != GOES_ON else "nobody: not our frames",
        within=0 if kind.safe == GOES_ON else vertical if stops else _BY_CHANCE,
        plane_within=0 if kind.safe == GOES_ON else plane if stops else _BY_CHANCE,
        safe=kind.safe,
        watch=kind.watch,
    )


def _size(kind: Kind) -> str:
    return f"-{kind.value:g}ms" if kind.fault == "delay" else ""


def _alarm(device: Device, kind: Kind) -> Alarm:
    if kind.fault == "garbage":  # whichever of its lies is found out first
        return Alarm("supervisor", ".", ".")
    return device.alarm

