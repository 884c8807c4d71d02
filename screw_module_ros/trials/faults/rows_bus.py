# SPDX-License-Identifier: Apache-2.0
"""Rows about CAN cables and frames, for every device."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from .acts import cured, fault
from .limits import COMMAND, DYING, STALE, VIA_SUPERVISOR
from .row import EITHER, GOES_ON, MISSED, OFF, PLANE_BACK, Alarm, Row

GROUP = "bus"
_BY_CHANCE = VIA_SUPERVISOR + 2 * DYING


class Device(NamedTuple):
    """A device of the rig.

    noticed_by: its driver; within: samples from its silence to zero torque of its own axis; kinds:
    names of the faults.
    """

    name: str
    noticed_by: str
    within: int
    alarm: Alarm
    recovery: str
    kinds: tuple[str, ...]


class Kind(NamedTuple):
    """A fault of a device's frames; safe: required safe state."""

    fault: str
    text: str
    safe: str = OFF
    value: float = 0.0
    watch: float = 0.2

    @property
    def name(self) -> str:
        """Name of the fault in the rows."""
        return f"{self.fault}-{self.value:g}ms" if self.fault == "delay" else self.fault


KINDS = {kind.name: kind for kind in (
    Kind("cable_out", "CAN cable out, later back"),
    Kind("bus_off", "its CAN controller goes bus-off, later back"),
    Kind("mute", "it sends nothing, later it sends again"),
    Kind("truncate", "every frame loses its last byte"),
    Kind("lengthen", "every frame grows by a byte"),
    Kind("wrong_id", "frames carry a foreign identifier"),
    Kind("garbage", "payloads are random"),
    Kind("delay", "frames come 500 ms late", OFF, 500.0),
    Kind("drop", "every second frame is lost, at random", EITHER, 0.5, 0.5),
    Kind("duplicate", "every frame comes twice", EITHER, watch=0.3),
    Kind("reorder", "frames change places in pairs", EITHER, watch=0.3),
    Kind("delay", "frames come 3 ms late", EITHER, 3.0, 0.3),
    Kind("foreign_ids", "a foreign frame follows each of its own", GOES_ON, watch=0.3),
    Kind("flood", "a babbling device floods the bus, 1000 frames/s", EITHER, 1.0, 1.0),
)}  # fmt: skip
# Faults that meet the same code in all devices are injected into one of them: wrong lengths and
# identifiers, foreign frames, floods. For its node a silent sensor is the same for any reason. The
# driver of the vertical drive also reads both joints.
DEVICES = (
    Device("encoder", "impedance_controller", STALE + 2 + DYING, Alarm("impedance_controller",
           "encoder:", "encoder"),
           f"mend it; encoder/home after a boot-up, {MISSED}, reset, enable",
           ("cable_out", "lengthen", "wrong_id", "garbage", "delay-500ms", "drop", "duplicate",
            "reorder", "delay-3ms", "flood")),
    Device("force_sensor", "impedance_controller", STALE + 2 + DYING, Alarm("impedance_controller",
           "force sensor", "force"), "mend it; force_sensor/tare after a bad status, "
           f"{MISSED}, reset, enable", ("cable_out", "truncate", "garbage", "drop", "duplicate",
                                        "reorder", "delay-3ms", "foreign_ids")),
    Device("drive", "amplifier; the drive itself", COMMAND + 2 + DYING, Alarm("amplifier", "drive",
           "amplifier"), "mend it; amplifier/clear_fault, reset, enable",
           ("cable_out", "bus_off", "mute", "truncate", "wrong_id", "garbage", "delay-500ms",
            "drop", "duplicate", "delay-3ms", "foreign_ids", "flood")),
    Device("shoulder", "manus; the drive itself", COMMAND + 4 + DYING, Alarm("manus",
           "drive|position", "manus"),
           PLANE_BACK, ("cable_out", "bus_off", "garbage", "drop")),
    Device("elbow", "manus; the drive itself", COMMAND + 4 + DYING, Alarm("manus", "drive|position",
           "manus"), PLANE_BACK, ("cable_out",)),
)  # fmt: skip
_PLANAR = ("shoulder", "elbow")


def rows() -> Iterator[Row]:
    """Every device x its faults; all cables and all power at once."""
    for device in DEVICES:
        for kind in device.kinds:
            yield _row(device, KINDS[kind])
    within = STALE + 2 + DYING
    yield Row(
        name="all-cable_out", group=GROUP, fault="all CAN cables out, later back",
        inject=fault("all", "cable_out"), back=cured("all"),
        alarm=Alarm("amplifier", "drive|command", "encoder|amplifier|manus|force"),
        recovery=f"mend it; clear_fault, {MISSED}, manus/home, reset, enable",
        noticed_by="all nodes; the drives themselves", within=COMMAND + 2 + DYING,
        plane_within=COMMAND + 4 + DYING,
    )  # fmt: skip
    yield Row(
        name="all-power_off", group=GROUP, fault="all devices lose their supply, later back",
        inject=fault("all", "power_off"), back=cured("all"),
        alarm=Alarm("amplifier", "drive|command|restarted|boot-up",
                    "encoder|amplifier|manus|force"),
        recovery="power on; encoder/home, force_sensor/tare, manus/home, clear_fault, reset, "
        "enable", noticed_by="all nodes", within=within, plane_within=within,
    )  # fmt: skip


def _row(device: Device, kind: Kind) -> Row:
    stops = kind.safe == OFF
    within, follows = device.within, device.within + VIA_SUPERVISOR
    # A drive without commands drops its own torque; the other axes follow.
    vertical, plane = (follows, within) if device.name in _PLANAR else (within, follows)
    return Row(
        name=f"{device.name}-{kind.name}",
        group=GROUP,
        fault=f"{device.name}: {kind.text}",
        inject=fault(device.name, kind.fault, kind.value),
        back=cured(device.name),
        alarm=_alarm(device, kind) if stops else None,
        recovery=device.recovery if kind.safe != GOES_ON else "none is needed",
        noticed_by=device.noticed_by if kind.safe != GOES_ON else "no node: not our frames",
        within=0 if kind.safe == GOES_ON else vertical if stops else _BY_CHANCE,
        plane_within=0 if kind.safe == GOES_ON else plane if stops else _BY_CHANCE,
        safe=kind.safe,
        watch=kind.watch,
    )


def _alarm(device: Device, kind: Kind) -> Alarm:
    if kind.fault == "garbage":  # the first wrong value found decides the message
        return Alarm("supervisor", ".", ".")
    return device.alarm
