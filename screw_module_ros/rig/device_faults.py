# SPDX-License-Identifier: Apache-2.0
"""Faults that every simulated CANopen device can have, beside those of its cable."""

from __future__ import annotations

from typing import TYPE_CHECKING

from screw_module_ros.rig.emergency import register_bits
from screw_module_ros.rig.faults import Fault

if TYPE_CHECKING:
    from screw_module_ros.rig.canopen_device import CanopenDevice

_LARGEST_CODE = 0xFFFF
_GENERIC_ERROR = 0x1000


def add_common_faults(device: CanopenDevice) -> None:
    """Add the faults of any CANopen device to its book."""
    add = device.faults.add
    add("bus_off", _bus_off(device))
    add("reset", Fault("it restarts in mid-run: boot-up, configuration gone", _reset(device)))
    add("power_off", Fault("it loses its supply; boots when it is back", *_power(device)))
    add("emcy", _emcy(device))
    for name, attribute, text in (
        ("heartbeat_lost", "mute_heartbeat", "its heartbeat stops, everything else continues"),
        ("pdos_lost", "mute_pdos", "its PDOs stop, everything else continues"),
        ("rpdos_lost", "deaf_pdos", "it receives no PDO, everything else continues"),
        ("sdo_silent", "silent_sdo", "it does not answer SDO requests"),
        ("refuse_guards", "refuse_guards", "it aborts writes to 1016, 1017 and 1400:05"),
    ):
        add(name, switch(device, attribute, text))
    add("wrong_profile", _constant(device, 0x1000, 0, 0x00000191, "device type 1000 says CiA 401"))


def switch(device: object, attribute: str, text: str) -> Fault:
    """Return a fault that sets a flag of the device while it lasts."""
    return Fault(
        text,
        lambda _value: setattr(device, attribute, True),
        lambda: setattr(device, attribute, False),
    )


def _constant(device: CanopenDevice, index: int, subindex: int, value: int, text: str) -> Fault:
    sources, key = device.node.sources, (index, subindex)

    def start(_value: float) -> None:
        sources[key] = lambda: value

    return Fault(text, start, lambda: sources.pop(key, None))


def _bus_off(device: CanopenDevice) -> Fault:
    def start(_value: float) -> None:
        device.went_bus_off()

    def stop() -> None:
        device.back_on_bus()

    return Fault("its CAN controller is off the bus; EMCY 8140 when it is back", start, stop)


def _reset(device: CanopenDevice):
    return lambda _value: device.reset(device.now_ns)


def _power(device: CanopenDevice):
    def start(_value: float) -> None:
        device.reset(device.now_ns)
        device.unpowered = True

    def stop() -> None:
        device.unpowered = False

    return start, stop


def _emcy(device: CanopenDevice) -> Fault:
    def start(value: float) -> None:
        code = int(value)
        device.errors.emit(code, register_bits(code) if code > 0xFF else 0)

    text = "one EMCY frame, nothing else"
    return Fault(text, start, None, "error code (decimal)", _GENERIC_ERROR, 1, _LARGEST_CODE)
