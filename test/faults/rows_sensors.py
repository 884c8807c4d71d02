# SPDX-License-Identifier: Apache-2.0
"""Rows about wrong readings of encoder and force sensor."""

from __future__ import annotations

from acts import both, cured, fault, frozen, rehomed
from hand import MARK
from row import (
    APART,
    AT_ONCE,
    EITHER,
    FROZEN,
    GOES_ON,
    HOME,
    MISSED,
    OFF,
    PLANE_CLEAR,
    SILENT,
    SLOW,
    TARE,
    VIA_SUPERVISOR,
    Report,
    Row,
)

from screw_module_ros.control.modes import (
    FORCE_FEEDBACK,
    FRICTION_COMPENSATION,
    IMPEDANCE,
    OBSERVER,
)
from screw_module_ros.samples import FORCE_FAULT_BITS, FORCE_STATUS_BITS

_APART_M = 0.005
_BITS = (0, 4, 14)
"""Bits of the ATI status word: one without and two with a fault. A unit test covers all bits."""
_GAUGES = (0, 5)
"""One gauge of each of the two frames of a sample."""
_UNHOMED, _TARED = (HOME, *MISSED), (TARE, PLANE_CLEAR, *MISSED)
_LOST = (PLANE_CLEAR, *MISSED)  # the plane stops without force samples, too
_ENCODER = Report("impedance_controller", "encoder", "encoder")
_FORCE = Report("impedance_controller", "force sensor", "force")


def _by_driver(node: str, said: str) -> Report:
    return Report(node, said, node.partition("_")[0])


# fault of the rig, value, in words, outcome, noticed within, report, services of the operator
_ENCODER_FAULTS = (
    ("freeze", 0, "position stands still", OFF, APART, _ENCODER, _UNHOMED),
    ("jump", 2e5, "position jumps by ten turns", OFF, AT_ONCE, _ENCODER, _UNHOMED),
    ("jump", 5e3, "position jumps by a quarter turn", OFF, SLOW, _ENCODER, _UNHOMED),
    ("spike", 2e5, "one position is wrong by ten turns", OFF, AT_ONCE, _ENCODER, _UNHOMED),
    ("noise", 20, "position is noisy by 20 counts", GOES_ON, 0, None, ()),
    ("noise", 1e5, "position is noisy by 95 mm", OFF, AT_ONCE, _ENCODER, _UNHOMED),
    ("index_lost", 0, "index pulse lost (alarm, EMCY 7305)", OFF, SILENT,
     _by_driver("encoder", "7305|index"), _UNHOMED),
    ("position_error", 0, "position error (alarm, EMCY 7300)", OFF, SILENT,
     _by_driver("encoder", "7300|position"), _UNHOMED),
    ("reset", 0, "restarts in operation", OFF, SILENT, _by_driver("encoder", "restarted"),
     _UNHOMED),
    ("power_off", 0, "loses its supply, later back", OFF, SILENT, _ENCODER, _UNHOMED),
    ("hung", 0, "its communication hangs until it is reset", OFF, SILENT, _ENCODER, _UNHOMED),
    ("emcy", 0x3100, "an emergency frame 3100 (mains)", OFF, SILENT,
     _by_driver("encoder", "3100"), _UNHOMED),
    ("pdos_lost", 0, "its PDOs stop, all else continues", OFF, SILENT, _ENCODER, MISSED),
    ("heartbeat_lost", 0, "its heartbeat stops, all else continues", GOES_ON, 0, None, ()),
    ("sdo_silent", 0, "it does not answer SDO requests", GOES_ON, 0, None, ()),
)  # fmt: skip
_FORCE_FAULTS = (
    ("bias", 10, "off by 10 N", GOES_ON, 0, None, (TARE,)),
    ("bias", 250, "off by 250 N", OFF, AT_ONCE,
     Report("impedance_controller", "on the handle, more than", "on the handle"), _LOST),
    ("drift", 5, "drifts by 5 N/s", GOES_ON, 0, None, (TARE,)),
    ("noise", 500, "gauges noisy by 500 counts", EITHER, AT_ONCE, None, _LOST),
    ("freeze", 0, "gauges stand still", OFF, FROZEN + SILENT,
     _by_driver("force_sensor", "have not changed"), _TARED),
    ("half", 0, "the second frame of each sample is missing", OFF, SILENT, _FORCE, _LOST),
    ("reset", 0, "restarts after its watchdog", EITHER, SILENT, None, _TARED),
)  # fmt: skip


_LAWS = {"reset": OBSERVER, "pdos_lost": OBSERVER, "emcy": FRICTION_COMPENSATION}
"""Control modes of the encoder's rows, IMPEDANCE else."""
_UNSEEN = {
    "encoder": "no node: plausible positions still come",
    "force_sensor": "no node: it looks like the patient's force",
}


def _row(device, mode, name, value, text, outcome, within, report, services) -> Row:
    stops = outcome != GOES_ON
    who = report.node if report else f"{device} or impedance_controller"
    return Row(
        f"{device}-{name}" + (f"-{value:g}" if value or name in ("saturate", "status") else ""),
        device.replace("_", " "), f"{device}: {text}",
        frozen(device, name) if (device, name) == ("encoder", "freeze")
        else fault(device, name, float(value)), report,
        services, who if stops else _UNSEEN[device], within,
        within + VIA_SUPERVISOR if stops else 0, mode, outcome,
        both(cured(device), rehomed) if HOME in services else cured(device),
        watch=0.3 if outcome != OFF else 0.2,
    )  # fmt: skip


def _status(bit: int) -> Row:
    """Return the row of one bit of the ATI status word."""
    if bit not in FORCE_FAULT_BITS:
        row = _row("force_sensor", FORCE_FEEDBACK, "status", bit,
                   f"status bit {bit}, not a fault", GOES_ON, 0, None, ())  # fmt: skip
        return row._replace(noticed_by="force_sensor counts it")
    report = Report("impedance_controller", f"status bit {bit}", "force")
    text = f"status bit {bit}: {FORCE_STATUS_BITS[bit]}"
    return _row("force_sensor", FORCE_FEEDBACK, "status", bit, text, OFF, AT_ONCE, report, _TARED)


def _moved_across(robot) -> None:
    """Wait until the handle has been on both sides of the wrap, 1.3 mm above the mark."""
    begin = robot.time

    def across() -> bool:
        heights = [moment.height for moment in robot.record.since(begin)]
        return bool(heights) and min(heights) < MARK and max(heights) > MARK + _APART_M

    robot.wait_until(across, 6.0, "the handle did not move across the wrap")


ROWS = [
    _row("encoder", _LAWS.get(columns[0], IMPEDANCE), *columns) for columns in _ENCODER_FAULTS
]
ROWS.append(
    _row("encoder", IMPEDANCE, "rollover", 0, "counter wraps at 2^32 in motion", GOES_ON, 0, None,
         ())._replace(prepare=both(fault("encoder", "near_rollover", 2000.0), rehomed),
                      inject=_moved_across, noticed_by="no node: the driver unwraps it", watch=1.0)
)  # fmt: skip
ROWS += [_row("force_sensor", FORCE_FEEDBACK, *columns) for columns in _FORCE_FAULTS]
ROWS += [
    _row("force_sensor", FORCE_FEEDBACK, "saturate", gauge, f"gauge {gauge} at its limit", OFF,
         SILENT, _FORCE, _TARED)
    for gauge in _GAUGES
]  # fmt: skip
ROWS += map(_status, _BITS)
