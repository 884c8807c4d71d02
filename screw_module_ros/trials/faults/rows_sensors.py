# SPDX-License-Identifier: Apache-2.0
"""Rows about wrong readings of encoder and force sensor."""

from __future__ import annotations

from collections.abc import Iterator

from screw_module_ros.samples import FORCE_FAULT_BITS, FORCE_STATUS_BITS

from .acts import both, cured, fault, frozen, rehomed
from .limits import APART, AT_ONCE, DYING, FROZEN, SLOW, STALE, VIA_SUPERVISOR
from .patient import HOME
from .row import EITHER, GOES_ON, MISSED, OFF, Alarm, Row

_APART_M = 0.005
_SILENT = STALE + 2 + DYING
"""Samples until the absence of a sample is noticed."""
_BITS = (0, 4, 14)
"""Bits of the ATI status word: one without and two with a fault. A unit test covers all bits."""
_GAUGES = (0, 5)
"""One gauge of each of the two frames of a sample."""
_UNHOMED = f"mend it; encoder/home at the reference mark, {MISSED}, reset, enable"
_RESET = f"{MISSED}, reset, enable"
_TARE = f"mend it; let go of the handle, force_sensor/tare, {MISSED}, reset, enable"
_NOT_NEEDED = "none is needed"
_ENCODER = Alarm("impedance_controller", "encoder", "encoder")

# name, value, text, safe, within, alarm, recovery
_ENCODER_FAULTS = (
    ("freeze", 0, "position stands still", OFF, APART, _ENCODER, _RESET),
    ("jump", 2e5, "position jumps by ten turns", OFF, AT_ONCE, _ENCODER, _UNHOMED),
    ("jump", 5e3, "position jumps by a quarter turn", OFF, SLOW, _ENCODER, _UNHOMED),
    ("spike", 2e5, "one position is wrong by ten turns", OFF, AT_ONCE, _ENCODER, _RESET),
    ("noise", 20, "position is noisy by 20 counts", GOES_ON, 0, None, _NOT_NEEDED),
    ("noise", 1e5, "position is noisy by 95 mm", OFF, AT_ONCE, _ENCODER, _UNHOMED),
    ("index_lost", 0, "index pulse lost (alarm, EMCY 7305)", OFF, _SILENT,
     Alarm("encoder", "7305|index", "encoder"), _UNHOMED),
    ("position_error", 0, "position error (alarm, EMCY 7300)", OFF, _SILENT,
     Alarm("encoder", "7300|position", "encoder"), _UNHOMED),
    ("reset", 0, "restarts in operation", OFF, _SILENT, Alarm("encoder", "restarted", "encoder"),
     _UNHOMED),
    ("power_off", 0, "loses its supply, later back", OFF, _SILENT, _ENCODER, _UNHOMED),
    ("emcy", 0x3100, "an emergency frame 3100 (mains)", OFF, _SILENT,
     Alarm("encoder", "3100", "encoder"), _UNHOMED),
    ("pdos_lost", 0, "its PDOs stop, all else continues", OFF, _SILENT, _ENCODER, _RESET),
    ("heartbeat_lost", 0, "its heartbeat stops, all else continues", GOES_ON, 0, None, _NOT_NEEDED),
    ("sdo_silent", 0, "it does not answer SDO requests", GOES_ON, 0, None, _NOT_NEEDED),
)  # fmt: skip
_FORCE = Alarm("impedance_controller", "force sensor", "force")
_FORCE_FAULTS = (
    ("bias", 10, "off by 10 N", GOES_ON, 0, None, _TARE),
    ("bias", 250, "off by 250 N", OFF, AT_ONCE,
     Alarm("impedance_controller", "on the handle, more than", "on the handle"), _RESET),
    ("drift", 5, "drifts by 5 N/s", GOES_ON, 0, None, _TARE),
    ("noise", 500, "gauges noisy by 500 counts", EITHER, AT_ONCE, None, _RESET),
    ("freeze", 0, "gauges stand still", OFF, FROZEN + _SILENT,
     Alarm("force_sensor", "have not changed", "force"), _TARE),
    ("half", 0, "the second frame of each sample is missing", OFF, _SILENT, _FORCE,
     _RESET),
    ("reset", 0, "restarts after its watchdog", EITHER, _SILENT, None, _TARE),
)  # fmt: skip


def rows() -> Iterator[Row]:
    """Return the rows of both sensors; those of the force sensor in force feedback."""
    for columns in _ENCODER_FAULTS:
        row = _row("encoder", 1, *columns)
        yield row._replace(inject=frozen("encoder", "freeze")) if columns[0] == "freeze" else row
    yield _rollover()
    for columns in _FORCE_FAULTS:
        yield _row("force_sensor", 3, *columns)
    for gauge in _GAUGES:
        yield _row(
            "force_sensor", 3, "saturate", gauge, f"gauge {gauge} at its limit", OFF, _SILENT,
            Alarm("impedance_controller", "force sensor", "force"), _TARE,
        )  # fmt: skip
    for bit in _BITS:
        yield _status(bit)


def _row(device, mode, name, value, text, safe, within, alarm, recovery) -> Row:
    stops = safe != GOES_ON
    return Row(
        name=f"{device}-{name}" + (f"-{value:g}" if value or name == "saturate" else ""),
        group=device.replace("_", " "),
        fault=f"{device}: {text}",
        inject=fault(device, name, float(value)),
        back=both(cured(device), rehomed) if recovery == _UNHOMED else cured(device),
        alarm=alarm,
        recovery=recovery,
        noticed_by=_who(alarm, device) if stops else "no node: it looks like the patient's force",
        within=within,
        plane_within=within + VIA_SUPERVISOR if stops else 0,
        mode=mode,
        safe=safe,
        watch=0.3 if safe != OFF else 0.2,
    )


def _who(alarm: Alarm | None, device: str) -> str:
    return alarm.node if alarm else f"{device} or impedance_controller"


def _status(bit: int) -> Row:
    """Return the row of one bit of the ATI status word."""
    meaning = FORCE_STATUS_BITS[bit] if bit in FORCE_FAULT_BITS else ""
    text = f"status bit {bit}: {meaning}" if meaning else f"status bit {bit}, not a fault"
    alarm = Alarm("impedance_controller", f"status bit {bit}", "force") if meaning else None
    safe, within = (OFF, AT_ONCE) if meaning else (GOES_ON, 0)
    row = _row("force_sensor", 3, "status", bit, text, safe, within, alarm, _TARE)
    return row._replace(
        name=f"force_sensor-status-{bit}",
        noticed_by="impedance_controller" if meaning else "force_sensor counts it",
    )


def _moved_across(testbed) -> None:
    """Wait until the handle has been on both sides of the wrap, 1.3 mm above the mark."""
    begin = testbed.listener.time

    def across() -> bool:
        heights = [moment.height for moment in testbed.listener.since(begin)]
        return bool(heights) and min(heights) < HOME and max(heights) > HOME + _APART_M

    testbed.robot.wait_until(across, 6.0, "the handle did not move across the wrap")


def _rollover() -> Row:
    """Return the row of a counter that wraps while the patient moves the handle."""
    row = _row(
        "encoder", 1, "rollover", 0, "counter wraps at 2^32 in motion", GOES_ON, 0, None,
        _NOT_NEEDED,
    )  # fmt: skip
    return row._replace(
        prepare=both(fault("encoder", "near_rollover", 2000.0), rehomed),
        inject=_moved_across,
        noticed_by="no node: the driver unwraps it",
        watch=1.0,
    )
