# SPDX-License-Identifier: Apache-2.0
"""Emergencies by name (CiA 301 table 26, CiA 402-2 table of error codes, object 1001 bits)."""

from __future__ import annotations

import struct
from typing import NamedTuple

_LAYOUT = struct.Struct("<HB5s")

#: Whole groups, by the high digits of the code.
_GROUPS = {
    0x0000: "error reset or no error",
    0x1000: "generic error",
    0x2000: "current",
    0x2100: "current on the input side",
    0x2200: "current inside the device",
    0x2300: "current on the output side",
    0x3000: "voltage",
    0x3100: "mains voltage",
    0x3200: "voltage inside the device",
    0x3300: "output voltage",
    0x4000: "temperature",
    0x4100: "ambient temperature",
    0x4200: "device temperature",
    0x4300: "drive temperature",
    0x4400: "supply temperature",
    0x5000: "device hardware",
    0x5100: "supply",
    0x5200: "control hardware",
    0x5300: "operating unit",
    0x5400: "power section",
    0x5500: "data storage hardware",
    0x6000: "device software",
    0x6100: "internal software",
    0x6200: "user software",
    0x6300: "data set",
    0x7000: "additional modules",
    0x7100: "power module",
    0x7200: "measurement circuit",
    0x7300: "sensor",
    0x7400: "computation circuit",
    0x7500: "communication module",
    0x7600: "data storage module",
    0x8000: "monitoring",
    0x8100: "communication",
    0x8200: "protocol error",
    0x8300: "torque control",
    0x8400: "velocity control",
    0x8500: "position control",
    0x8600: "positioning",
    0x8700: "sync controller",
    0x8800: "winding controller",
    0x8900: "process data monitoring",
    0x8A00: "control",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "device specific",
}

_CODES = {
    # CiA 301
    0x8110: "CAN overrun, objects lost",
    0x8120: "CAN in error passive mode",
    0x8130: "life guard or heartbeat error",
    0x8140: "recovered from bus off",
    0x8150: "CAN-ID collision",
    0x8210: "PDO not processed, length error",
    0x8220: "PDO length exceeded",
    0x8230: "DAM MPDO not processed, destination object not available",
    0x8240: "unexpected SYNC data length",
    0x8250: "RPDO timeout",
    0x8260: "unexpected TIME data length",
    # CiA 402
    0x2110: "short circuit or earth leakage, input",
    0x2120: "earth leakage, input",
    0x2130: "short circuit, input",
    0x2211: "current inside the device, no. 1",
    0x2212: "current inside the device, no. 2",
    0x2213: "overcurrent in ramp function",
    0x2214: "overcurrent in the sequence",
    0x2220: "continuous overcurrent inside the device",
    0x2230: "short circuit or earth leakage inside the device",
    0x2240: "earth leakage inside the device",
    0x2250: "short circuit inside the device",
    0x2310: "continuous overcurrent, motor side",
    0x2320: "short circuit or earth leakage, motor side",
    0x2330: "earth leakage, motor side",
    0x2340: "short circuit, motor side",
    0x2350: "load level fault (I2t, thermal state)",
    0x2360: "load level warning (I2t, thermal state)",
    0x3110: "mains overvoltage",
    0x3120: "mains undervoltage",
    0x3130: "phase failure",
    0x3140: "mains frequency",
    0x3210: "DC link overvoltage",
    0x3220: "DC link undervoltage",
    0x3230: "load error",
    0x3310: "output overvoltage",
    0x3320: "armature circuit",
    0x3330: "field circuit",
    0x4110: "excess ambient temperature",
    0x4120: "too low ambient temperature",
    0x4210: "excess temperature, device",
    0x4220: "too low temperature, device",
    0x4310: "excess temperature, drive",
    0x4320: "too low temperature, drive",
    0x4410: "excess temperature, supply",
    0x4420: "too low temperature, supply",
    0x5110: "supply low voltage",
    0x5111: "supply +-15 V",
    0x5112: "supply +24 V",
    0x5113: "supply +5 V",
    0x5210: "measurement circuit",
    0x5220: "computing circuit",
    0x5410: "output stages",
    0x5420: "chopper",
    0x5430: "input stages",
    0x5440: "contacts",
    0x5450: "fuses",
    0x5510: "working memory (RAM)",
    0x5520: "program memory",
    0x5530: "non-volatile data memory",
    0x6010: "software reset (watchdog)",
    0x6310: "loss of parameters",
    0x6320: "parameter error",
    0x7110: "brake chopper",
    0x7120: "motor",
    0x7121: "motor blocked",
    0x7122: "motor error or commutation malfunction",
    0x7123: "motor tilted",
    0x7301: "tachometer fault",
    0x7302: "tachometer wrong polarity",
    0x7303: "resolver 1 fault",
    0x7304: "resolver 2 fault",
    0x7305: "incremental sensor 1 fault",
    0x7306: "incremental sensor 2 fault",
    0x7307: "incremental sensor 3 fault",
    0x7310: "speed",
    0x7320: "position",
    0x7510: "serial interface no. 1",
    0x7520: "serial interface no. 2",
    0x8311: "excess torque",
    0x8312: "difficult start up",
    0x8313: "standstill torque",
    0x8321: "insufficient torque",
    0x8331: "torque fault",
    0x8611: "following error",
    0x8612: "reference limit",
    0xF001: "deceleration",
    0xF002: "sub-synchronous run",
    0xF003: "stroke operation",
    0xF004: "control",
}

_REGISTER_BITS = (
    "generic", "current", "voltage", "temperature",
    "communication", "device profile", "reserved", "manufacturer",
)  # fmt: skip


class Emergency(NamedTuple):
    """One emergency message: error code, error register (object 1001), five vendor bytes."""

    code: int
    register: int
    vendor: bytes

    @property
    def is_reset(self) -> bool:
        """Whether the message reports the end of an error."""
        return self.code & 0xFF00 == 0

    @property
    def text(self) -> str:
        """Code, name, register and vendor data as text."""
        parts = [f"0x{self.code:04X} {code_name(self.code)}"]
        if self.register:
            parts.append(f"register: {', '.join(register_names(self.register))}")
        if any(self.vendor):
            parts.append(f"vendor data {self.vendor.hex(' ')}")
        return "; ".join(parts)


def decode(data: bytes) -> Emergency | None:
    """Return the emergency in `data`, None when `data` is not 8 bytes long."""
    if len(data) != _LAYOUT.size:
        return None
    return Emergency(*_LAYOUT.unpack(data))


def code_name(code: int) -> str:
    """Return the name of an error code, or of its group if the code has no name."""
    for mask in (0xFFFF, 0xFFF0):
        if code & mask in _CODES:
            return _CODES[code & mask]
    if code & 0xFF00 in _GROUPS:
        return _GROUPS[code & 0xFF00]
    # 0x0100 to 0x0FFF are of no group: 0x0000, error reset, does not name them.
    return _GROUPS.get(code & 0xF000 or code, "unknown error")


def register_names(register: int) -> list[str]:
    """Return the names of the bits set in the error register, object 1001."""
    return [name for bit, name in enumerate(_REGISTER_BITS) if register >> bit & 1]
