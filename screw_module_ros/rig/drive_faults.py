# SPDX-License-Identifier: Apache-2.0
"""Faults of a simulated drive, beside those of its cable and its CANopen side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from screw_module_ros.rig.faults import Fault

if TYPE_CHECKING:
    from screw_module_ros.rig.drive import SimulatedDrive

_CAUSES = (
    ("over_current", 0x2310, "current inside the device too high"),
    ("over_voltage", 0x3210, "DC link over-voltage"),
    ("under_voltage", 0x3220, "DC link under-voltage, statusword bit 4 goes away"),
    ("over_temperature", 0x4210, "device too hot"),
    ("motor_temperature", 0x4310, "motor too hot"),
    ("watchdog", 0x6010, "software watchdog"),
    ("feedback", 0x7300, "position feedback broken"),
    ("heartbeat_fault", 0x8130, "it reports a lost heartbeat of the master"),
)
_GENERIC_FAULT = 0x5000
_LARGEST_CODE = 0xFFFF
_MODES_WITHOUT_CYCLIC = 0x08
_MICRO = 1000
_MOST_COUNTS = 1e9


def add_drive_faults(drive: SimulatedDrive) -> None:
    """Add the faults of a drive to its book."""
    add = drive.faults.add
    for name, code, text in _CAUSES:
        add(name, _cause(drive, name, f"fault {code:04X}: {text}", code))
    add("fault", _any_fault(drive))
    add("disable", Fault("it drops to switch on disabled by itself", _disable(drive)))
    for name, attribute, text in (
        ("torque_off", "torque_off", "safe torque off: no power, no fault"),
        ("motor_open", "motor_open", "a motor wire is broken: enabled, but no torque"),
        ("warning", "warning", "statusword bit 7 is set"),
        ("refuse_enable", "refuse_enable", "it never gets beyond switched on"),
        ("mode_lost", "mode_lost", "6061 says mode 0"),
        ("refuse_torque_limit", "refuse_torque_limit", "it aborts writes to 6072"),
    ):
        add(name, _output_switch(drive, attribute, text))
    add("stuck_torque", _stuck(drive))
    add("position_freeze", _freeze(drive))
    add("position_jump", _jump(drive))
    add("inputs", _inputs(drive))
    add("no_cyclic_mode", _object(drive, 0x6502, _MODES_WITHOUT_CYCLIC, "6502: profile torque"))
    add("no_torque_mode", _object(drive, 0x6502, 0, "6502: no torque mode at all"))
    micro = drive.node.value(0x6076) * _MICRO
    add("micro_rating", _object(drive, 0x6076, micro, "6076 is in micro-Nm, as on some drives"))


def _cause(drive: SimulatedDrive, name: str, text: str, code: int) -> Fault:
    def start(_value: float) -> None:
        drive.causes[name] = code
        drive.fail(code)

    return Fault(f"{text}; cannot be reset while it lasts", start, lambda: _gone(drive, name))


def _any_fault(drive: SimulatedDrive) -> Fault:
    def start(value: float) -> None:
        drive.causes["fault"] = int(value)
        drive.fail(int(value))

    def stop() -> None:
        _gone(drive, "fault")

    text = "fault with any error code; cannot be reset while it lasts"
    unit = "error code (decimal)"
    return Fault(text, start, stop, unit, _GENERIC_FAULT, 1, _LARGEST_CODE)


def _gone(drive: SimulatedDrive, name: str) -> None:
    drive.causes.pop(name, None)


def _disable(drive: SimulatedDrive):
    def start(_value: float) -> None:
        drive.machine.disable_voltage()
        drive.refresh_output()

    return start


def _output_switch(drive: SimulatedDrive, attribute: str, text: str) -> Fault:
    def put(value: bool) -> None:
        setattr(drive, attribute, value)
        drive.refresh_output()

    return Fault(text, lambda _value: put(True), lambda: put(False))


def _stuck(drive: SimulatedDrive) -> Fault:
    def put(value: float | None) -> None:
        rated = drive.settings.rated_torque
        drive.stuck_torque = None if value is None else value * 1e-3 * rated
        drive.refresh_output()

    text = "while enabled it gives this torque, whatever the target"
    return Fault(text, put, lambda: put(None), "per mille of rated", 500.0, -4000.0, 4000.0)


def _freeze(drive: SimulatedDrive) -> Fault:
    def put(value: int | None) -> None:
        drive.frozen_position = value

    return Fault("6064 stops changing", lambda _value: put(drive.position()), lambda: put(None))


def _jump(drive: SimulatedDrive) -> Fault:
    def start(value: float) -> None:
        drive.position_shift += round(value)

    text = "6064 moves and stays away"
    return Fault(text, start, None, "counts", 5000.0, -_MOST_COUNTS, _MOST_COUNTS)


def _inputs(drive: SimulatedDrive) -> Fault:
    def put(value: float) -> None:
        drive.digital_inputs = int(value)

    text = "60FD has these bits: 1 negative limit, 2 positive limit, 4 home, 8 interlock"
    return Fault(text, put, lambda: put(0), "bits (decimal)", 3, 1, 0xFFFFFFFF)


def _object(drive: SimulatedDrive, index: int, value: int, text: str) -> Fault:
    sources = drive.node.sources

    def start(_value: float) -> None:
        sources[index, 0] = lambda: value

    return Fault(text, start, lambda: sources.pop((index, 0), None))
