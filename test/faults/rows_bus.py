# SPDX-License-Identifier: Apache-2.0
"""Rows about CAN cables and frames, for every device."""

from __future__ import annotations

from typing import NamedTuple

from acts import cured, fault
from row import (
    BY_CHANCE,
    CLEAR,
    COMMAND,
    DYING,
    EITHER,
    GOES_ON,
    HOME,
    MISSED,
    OFF,
    PLANE_BACK,
    PLANE_CLEAR,
    SILENT,
    STOPPED,
    TARE,
    VIA_SUPERVISOR,
    Report,
    Row,
    goes_on,
)

GROUP = "bus"


class Device(NamedTuple):
    """A device of the rig.

    noticed_by: its driver; within: samples from its silence to zero torque of its own axis;
    garbage: report of random payloads: the first wrong value decides which of its alarms;
    kinds: names of the faults.
    """

    name: str
    noticed_by: str
    within: int
    report: Report
    garbage: Report
    services: tuple[str, ...]
    kinds: tuple[str, ...]


class Kind(NamedTuple):
    """A fault of a device's frames; outcome: required one."""

    fault: str
    text: str
    outcome: str = OFF
    value: float = 0.0
    watch: float = 0.2

    @property
    def name(self) -> str:
        """Name of the fault in the rows."""
        return f"{self.fault}-{self.value:g}ms" if self.fault == "delay" else self.fault


KINDS = {kind.name: kind for kind in (
    Kind("cable_out", "CAN cable out, later back"),
    Kind("bus_off", "its CAN controller goes bus-off, later back"),
    Kind("adapter_out", "the CAN adapter of its node is unplugged, later back"),
    Kind("mute", "it sends nothing, later it sends again"),
    Kind("truncate", "every frame loses its last byte"),
    Kind("lengthen", "every frame grows by a byte", GOES_ON, watch=0.3),
    Kind("wrong_id", "frames carry a foreign identifier"),
    Kind("garbage", "payloads are random"),
    Kind("delay", "frames come 500 ms late", OFF, 500.0),
    Kind("drop", "every second frame is lost, at random", EITHER, 0.5, 0.5),
    Kind("duplicate", "every frame comes twice, as from two devices with its id", watch=0.3),
    Kind("reorder", "frames change places in pairs", EITHER, watch=0.3),
    Kind("delay", "frames come 3 ms late", EITHER, 3.0, 0.3),
    Kind("foreign_ids", "a foreign frame follows each of its own", GOES_ON, watch=0.3),
    Kind("flood", "a babbling device floods the bus, 1000 frames/s", EITHER, 1.0, 1.0),
)}  # fmt: skip
_ENCODER = Report("impedance_controller", "encoder:", "encoder")
_FORCE = Report("impedance_controller", "force sensor", "force")
_DRIVE = Report("amplifier", "drive", "amplifier")
_JOINT = Report("manus", "drive|position", "manus")
_BAD_ENCODER = Report(
    "impedance_controller",
    "encoder: (no sample|jumped by|.*(faster than|outside the travel))",
    "impedance_controller: encoder|encoder: ",
)
_BAD_FORCE = Report(
    "impedance_controller", r"force sensor: .*(status bit|on the handle|no sample)", "force sensor:"
)
_BAD_DRIVE = Report(
    "amplifier", "drive (left operation enabled|gives .* of torque)", "amplifier: the vertical"
)
_BAD_JOINT = Report("manus", "drive (jumped|left operation enabled|gives .* of torque)", "manus: ")
# Faults that meet the same code in all devices are injected into one of them: wrong lengths and
# identifiers, foreign frames, floods. For its node a silent sensor is the same for any reason. The
# driver of the vertical drive also reads both joints.
DEVICES = (
    Device("encoder", "impedance_controller", SILENT, _ENCODER, _BAD_ENCODER, (HOME, *MISSED),
           ("cable_out", "adapter_out", "lengthen", "wrong_id", "garbage", "delay-500ms", "drop",
            "duplicate", "reorder", "delay-3ms", "flood")),
    Device("force_sensor", "impedance_controller", SILENT, _FORCE, _BAD_FORCE,
           (TARE, PLANE_CLEAR, *MISSED),
           ("cable_out", "adapter_out", "truncate", "garbage", "drop", "duplicate", "reorder",
            "delay-3ms", "foreign_ids")),
    Device("drive", "amplifier; the drive itself", COMMAND + 2 + DYING, _DRIVE, _BAD_DRIVE,
           (CLEAR, *STOPPED),
           ("cable_out", "adapter_out", "bus_off", "mute", "truncate", "wrong_id", "garbage",
            "delay-500ms", "drop", "duplicate", "delay-3ms", "foreign_ids", "flood")),
    Device("shoulder", "manus; the drive itself", COMMAND + 4 + DYING, _JOINT, _BAD_JOINT,
           PLANE_BACK, ("cable_out", "adapter_out", "bus_off", "garbage", "drop")),
    Device("elbow", "manus; the drive itself", COMMAND + 4 + DYING, _JOINT, _BAD_JOINT, PLANE_BACK,
           ("cable_out",)),
)  # fmt: skip
_PLANAR = ("shoulder", "elbow")
_TWICE = 100
"""Samples in which two answers for one are known to be no accident."""
_NODES = {"drive": "amplifier"}
_NOT_OURS = "no node: not our frames"


def _row(device: Device, kind: Kind) -> Row:
    name, text = f"{device.name}-{kind.name}", f"{device.name}: {kind.text}"
    inject, mend = fault(device.name, kind.fault, kind.value), cured(device.name)
    if kind.outcome == GOES_ON:
        who = "its node takes the mapped bytes" if kind.fault == "lengthen" else _NOT_OURS
        return goes_on(name, GROUP, text, inject, who, mend, watch=kind.watch)
    report = device.garbage if kind.fault == "garbage" else device.report
    # A drive without commands drops its own torque; the other axes follow.
    noticed, who = device.within, device.noticed_by
    if kind.fault == "duplicate":
        noticed, who = noticed + _TWICE, _NODES.get(device.name, device.name)
        report = Report(who, "more than one device answers", who.partition("_")[0])
    elif (kind.fault, device.name) == ("adapter_out", "shoulder"):
        report = Report("manus", "cannot|drive|position", "manus")
    vertical, plane = within = noticed, noticed + VIA_SUPERVISOR
    if kind.outcome == EITHER:
        report, vertical, plane = None, BY_CHANCE, BY_CHANCE
    elif device.name in _PLANAR:
        plane, vertical = within
    return Row(
        name, GROUP, text, inject, report, device.services, who, vertical, plane,
        outcome=kind.outcome, mend=mend, watch=kind.watch,
    )  # fmt: skip


_ALL = "encoder|amplifier|manus|force"
ROWS = [_row(device, KINDS[kind]) for device in DEVICES for kind in device.kinds]
ROWS += [
    Row("all-cable_out", GROUP, "all CAN cables out, later back", fault("all", "cable_out"),
        Report("amplifier", "drive|command", _ALL), (TARE, CLEAR, *PLANE_BACK),
        "all nodes; the drives themselves", COMMAND + 2 + DYING, COMMAND + 4 + DYING,
        mend=cured("all")),
    Row("all-power_off", GROUP, "all devices lose their supply, later back",
        fault("all", "power_off"), Report("amplifier", "drive|command|restarted|boot-up", _ALL),
        (HOME, TARE, CLEAR, *PLANE_BACK), "all nodes", SILENT, SILENT, mend=cured("all")),
]  # fmt: skip
