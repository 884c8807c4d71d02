# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the simulated devices: one table of faults for each kind of device.

Most faults give an attribute of the device another value while they last; the class of the device
holds the healthy value. `device.SimulatedDevice` begins and ends them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from screw_module_ros.rig.link import LARGEST_BURST

SIZE = object()
"""As value of an attribute: the size that is asked for."""


class Size(NamedTuple):
    """The size of a fault: its unit, default and range. A size has the type of its default."""

    unit: str
    default: float
    low: float
    high: float


class Fault(NamedTuple):
    """One kind of fault.

    text: description. attribute, value: an attribute of the device and what it is while the fault
    lasts; without a value `start` sets it. start: method called as the fault begins, with the
    value, or the size if there is none; end: method called when it has ended. on_cable: the fault
    is one of the device's `link`.
    """

    text: str
    attribute: str = ""
    value: Any = None
    start: str = ""
    end: str = ""
    size: Size | None = None
    on_cable: bool = False

    @property
    def once(self) -> bool:
        """Return whether it is over as soon as it has happened."""
        return not (self.attribute or self.end or self.on_cable)

    def line(self) -> str:
        """Return one line with the description and the size."""
        notes = []
        if self.size:
            unit, default, low, high = self.size
            notes.append(f"value {low:g} to {high:g} {unit}, 0 = {default:g}")
        if self.once:
            notes.append("happens once")
        return f"{self.text} ({'; '.join(notes)})" if notes else self.text


def _cable(text: str, *size: Any) -> Fault:
    return Fault(text, size=Size(*size) if size else None, on_cable=True)


_COUNTS = Size("counts", 5000.0, -1e9, 1e9)
_BIT = Size("bit number", 0, 0, 15)

CABLE = {
    "cable_out": _cable("nothing goes out and nothing comes in"),
    "adapter_out": _cable("the adapter of the nodes on this bus is unplugged, which ends what they "
                          "have opened"),
    "mute": _cable("nothing goes out"),
    "deaf": _cable("nothing comes in"),
    "drop": _cable("frames it sends are lost at random", "share", 0.5, 0.0, 1.0),
    "truncate": _cable("frames lose their last bytes", "bytes", 1, 1, 8),
    "lengthen": _cable("frames shorter than 8 bytes grow", "bytes", 1, 1, 8),
    "garbage": _cable("payloads are random, of the right length"),
    "duplicate": _cable("every frame comes twice"),
    "reorder": _cable("frames change places in pairs"),
    "delay": _cable("frames come late", "ms", 3.0, 0.0, 1000.0),
    "wrong_id": _cable("frames carry the id of a node that does not exist"),
    "foreign_ids": _cable("each frame is followed by a random one of a node that is not there"),
    "flood": _cable("a babbling device fills the bus", "frames/ms", 8.0, 1.0, LARGEST_BURST),
}

CANOPEN = CABLE | {
    "bus_off": Fault("its CAN controller is off the bus; EMCY 8140 when it is back",
                     start="leave_bus", end="return_to_bus"),
    "reset": Fault("it restarts in mid-run: boot-up, configuration gone", start="restart"),
    "hung": Fault("its communication hangs until it is reset (NMT) or loses its supply; a drive "
                  "drops its torque", start="hang"),
    "power_off": Fault("it loses its supply; boots when it is back", "unpowered", True, "restart"),
    "emcy": Fault("one EMCY frame, nothing else", start="send_emcy",
                  size=Size("error code (decimal)", 0x1000, 1, 0xFFFF)),
    "heartbeat_lost": Fault("its heartbeat stops, everything else continues",
                            "mute_heartbeat", True),
    "pdos_lost": Fault("its PDOs stop, everything else continues", "mute_pdos", True),
    "rpdos_lost": Fault("it receives no PDO, everything else continues", "deaf_pdos", True),
    "sdo_silent": Fault("it does not answer SDO requests", "silent_sdo", True),
    "refuse_guards": Fault("it aborts writes to 1016, 1017 and 1400:05", "refuse_guards", True),
    "wrong_profile": Fault("device type 1000 says CiA 401", "wrong_profile", True),
}  # fmt: skip

ENCODER = CANOPEN | {
    "freeze": Fault("the position stops changing", "frozen", start="freeze"),
    "jump": Fault("the position moves and stays away", start="jump", size=_COUNTS),
    "spike": Fault("one position is wrong", start="spike_once", size=_COUNTS),
    "noise": Fault("the position is noisy", "noise", SIZE,
                   size=Size("counts, standard deviation", 20.0, 0.0, 1e6)),
    "near_rollover": Fault("the position jumps to just below its wrap", start="wrap_soon",
                           size=Size("counts below", 2000.0, 1.0, 1e7)),
    "position_error": Fault("alarm bit 0, EMCY 7300", "position_alarm", 0x0001),
    "index_lost": Fault("alarm bit 12, EMCY 7305", "index_alarm", 0x1000),
    "warning": Fault("a bit of 6505 is set", "warnings", start="warn", size=_BIT),
}  # fmt: skip

DRIVE = CANOPEN | {
    "over_current": Fault(
        "fault 2310: current inside the device too high; cannot be reset while it lasts",
        "over_current", 0x2310, "fail"),
    "over_temperature": Fault("fault 4210: device too hot; cannot be reset while it lasts",
                              "over_temperature", 0x4210, "fail"),
    "fault": Fault("fault with any error code; cannot be reset while it lasts",
                   "any_fault", SIZE, "fail",
                   size=Size("error code (decimal)", 0x5000, 1, 0xFFFF)),
    "disable": Fault("it drops to switch on disabled by itself", start="release"),
    "torque_off": Fault("safe torque off: no power, no fault", "torque_off", True),
    "motor_open": Fault("a motor wire is broken: enabled, but no torque", "motor_open", True),
    "warning": Fault("statusword bit 7 is set", "warning", True),
    "refuse_enable": Fault("it never gets beyond switched on", "refuse_enable", True),
    "mode_lost": Fault("6061 says mode 0", "mode_lost", True),
    "refuse_torque_limit": Fault("it aborts writes to 6072", "refuse_torque_limit", True),
    "stuck_torque": Fault("while enabled it gives this torque, whatever the target",
                          "stuck_torque", SIZE,
                          size=Size("per mille of rated", 500.0, -4000.0, 4000.0)),
    "position_freeze": Fault("6064 stops changing", "frozen_position", start="freeze"),
    "position_jump": Fault("6064 moves and stays away", start="jump", size=_COUNTS),
    "inputs": Fault("60FD has these bits: 1 negative limit, 2 positive limit, 4 home, 8 interlock",
                    "digital_inputs", SIZE, size=Size("bits (decimal)", 3, 1, 0xFFFFFFFF)),
    "no_cyclic_mode": Fault("6502: profile torque", "modes", 0x08),
    "no_torque_mode": Fault("6502: no torque mode at all", "modes", 0x00),
    "micro_rating": Fault("6076 is in micro-Nm, as on some drives", "micro_rating", True),
}  # fmt: skip

FORCE_SENSOR = CABLE | {
    "status": Fault("a bit of the status word is set", "injected_status", start="set_status_bit",
                    size=_BIT),
    "saturate": Fault("a gauge is at its limit", "saturated", SIZE,
                      size=Size("gauge number", 0, 0, 5)),
    "bias": Fault("the force along z is off by a step", "bias", SIZE,
                  size=Size("N", 10.0, -1000.0, 1000.0)),
    "drift": Fault("the force along z drifts", "drift", SIZE, "begin_drift",
                   size=Size("N/s", 1.0, -1000.0, 1000.0)),
    "noise": Fault("the gauges are noisy", "noise", SIZE,
                   size=Size("counts, standard deviation", 500.0, 0.0, 1e5)),
    "freeze": Fault("the gauges stop changing", "stuck", start="freeze"),
    "half": Fault("the second frame of each sample is missing", "only_first_frame", True),
    "reset": Fault("it restarts after its watchdog: status bit 0, first calibration",
                   start="watchdog_reset"),
    "bus_off": Fault("its CAN controller is off the bus; status bit 14 when it is back",
                     start="leave_bus", end="return_to_bus"),
}  # fmt: skip


def catalogue(tables: Mapping[str, Mapping[str, Fault]]) -> list[str]:
    """Return readable lines from device -> its faults, shared faults once."""
    books = {device: {k: fault.line() for k, fault in t.items()} for device, t in tables.items()}
    shared: dict[str, str] = {}
    if len(books) > 1:
        first, *others = books.values()
        shared = {k: text for k, text in first.items() if all(o.get(k) == text for o in others)}
    groups: dict[tuple, list[str]] = {}
    for device, book in books.items():
        rest = tuple((name, text) for name, text in book.items() if name not in shared)
        groups.setdefault(rest, []).append(device)
    lines = _section("each of " + ", ".join(books), tuple(shared.items())) if shared else []
    for rest, devices in groups.items():
        lines += _section(", ".join(devices), rest) if rest else []
    return lines


def _section(title: str, faults: tuple) -> list[str]:
    width = max(len(name) for name, _ in faults)
    return [title, *(f"  {name:{width}} {text}" for name, text in faults)]
