# SPDX-License-Identifier: Apache-2.0
"""The smallest torque drive of CiA 402, written from the standard and apart from drivers and rig.

It knows no CANopen stack: one gives it its objects, see `application.py`. Torque actual is the
target while operation is enabled; the position goes on by the torque at each SYNC.
"""

from __future__ import annotations

from typing import NamedTuple

from application import OPERATIONAL, Application, Stack

# CiA 402-2, 8.4.2, table 7: bits 0 to 6 of the statusword; bit 9, remote, is set throughout.
_REMOTE = 0x0200
STATUSWORDS = {
    "switch on disabled": 0x40,
    "ready to switch on": 0x21,
    "switched on": 0x23,
    "operation enabled": 0x27,
    "quick stop active": 0x07,
    "fault": 0x08,
}
# 8.4.1, table 4: mask and value of bits 0 to 3 and 7 of the controlword, in the table's order.
COMMANDS = {
    "shutdown": (0x87, 0x06),
    "enable operation": (0x8F, 0x0F),
    "switch on": (0x8F, 0x07),  # the same word disables operation
    "disable voltage": (0x82, 0x00),
    "quick stop": (0x86, 0x02),
}
# Figure 8 and table 5: (state, command) -> state.
ARROWS = {
    ("switch on disabled", "shutdown"): "ready to switch on",
    ("ready to switch on", "switch on"): "switched on",
    ("ready to switch on", "enable operation"): "switched on",
    ("ready to switch on", "disable voltage"): "switch on disabled",
    ("ready to switch on", "quick stop"): "switch on disabled",
    ("switched on", "enable operation"): "operation enabled",
    ("switched on", "shutdown"): "ready to switch on",
    ("switched on", "disable voltage"): "switch on disabled",
    ("switched on", "quick stop"): "switch on disabled",
    ("operation enabled", "switch on"): "switched on",
    ("operation enabled", "shutdown"): "ready to switch on",
    ("operation enabled", "disable voltage"): "switch on disabled",
    ("operation enabled", "quick stop"): "quick stop active",
    ("quick stop active", "disable voltage"): "switch on disabled",
}
_FAULT_RESET = 0x80

HEARTBEAT_LOST, COMMAND_LATE = 0x8130, 0x8250
_NO_LIMIT = 0x7FFF
_NOTHING, _FAULT_SIGNAL, _DISABLE_VOLTAGE = 0, 1, 2  # of 6007


class Torque(NamedTuple):
    """How a make is told its torque; by default as CiA 402-2 has it.

    command, actual, limit: objects. shift: bits of the command below its number. modes: of 6060, in
    which it acts. enabled_bits: of the controlword, and conditions: values of objects, without
    which it does not. shown_enabled: 6061 shows a mode in operation enabled alone.
    """

    command: tuple[int, int] = (0x6071, 0)
    actual: tuple[int, int] = (0x6077, 0)
    limit: tuple[int, int] = (0x6072, 0)
    shift: int = 0
    modes: tuple[int, ...] = (4, 10)
    enabled_bits: int = 0
    conditions: dict[tuple[int, int], int] = {}
    shown_enabled: bool = False


STANDARD = Torque()


def named(controlword: int) -> str:
    """Return the command that a controlword is; empty for none."""
    for name, (mask, value) in COMMANDS.items():
        if controlword & mask == value:
            return name
    return ""


class PowerDrive(Application):
    """The drive; `state` as the standard writes it, `causes` what keeps it in its fault."""

    def __init__(self, stack: Stack, torque: Torque = STANDARD):
        self.stack = stack
        self.torque = torque
        self.causes: set[int] = set()
        self.restart()

    def restart(self) -> None:
        self.causes.clear()
        self.state = "switch on disabled"
        self.target = self.position = self._word = self._mode = 0
        self._operational = False
        self._watched: dict[int, tuple[int, int]] = {}  # sub-index of 1016 -> node, time [ms]
        self.stack.disarm("command")
        self._show(self.state)

    def _show(self, state: str) -> None:
        self.state = state
        self.stack.put(0x6041, 0, _REMOTE | STATUSWORDS[state])
        self._show_mode()

    def _show_mode(self) -> None:
        if self.torque.shown_enabled:
            self.stack.put(0x6061, 0, self._mode if self.state == "operation enabled" else 0)

    # What the master writes, by SDO or RPDO.

    def written(self, index: int, subindex: int, value: int) -> None:
        if index == 0x6040:
            self._command(value)
        elif (index, subindex) == self.torque.command:
            self.target = value >> self.torque.shift
        elif index == 0x6060:
            self._mode = value
            self.stack.put(0x6061, 0, value)
            self._show_mode()
        elif index == 0x1016 and subindex:
            self._watch(subindex, value)

    def _command(self, word: int) -> None:
        rising, self._word = word & ~self._word, word
        if self.state == "fault":
            if rising & _FAULT_RESET and not self.causes:
                self.stack.put(0x603F, 0, 0)
                self.stack.emergency(0x0000, 0)
                self._show("switch on disabled")
            return
        after = ARROWS.get((self.state, named(word)))
        if after:
            self._show(after)

    def commanded(self) -> None:
        """An RPDO came (CiA 301, 7.5.2.36: its event timer is a deadline, from the first on)."""
        deadline = self.stack.optional(0x1400, 5)
        if deadline:
            self.stack.alarm("command", deadline * 1e-3, lambda: self._lost(COMMAND_LATE))

    # Heartbeat consumer (CiA 301, 7.2.8.3.2.2): armed by the first heartbeat of the node.

    def _watch(self, subindex: int, entry: int) -> None:
        node, milliseconds = entry >> 16 & 0x7F, entry & 0xFFFF
        self.stack.disarm(f"heartbeat {subindex}")
        self.causes.discard(HEARTBEAT_LOST)
        self._watched.pop(subindex, None)
        if node and milliseconds:
            self._watched[subindex] = node, milliseconds
            self.stack.listen(0x700 + node, lambda: self._heard(subindex, node))

    def _heard(self, subindex: int, node: int) -> None:
        watched, milliseconds = self._watched.get(subindex, (0, 0))
        if watched == node:
            self.causes.discard(HEARTBEAT_LOST)
            lost = f"heartbeat {subindex}"
            self.stack.alarm(lost, milliseconds * 1e-3, lambda: self._lost(HEARTBEAT_LOST))

    # Lost connections and faults.

    def _lost(self, code: int) -> None:
        """Do what 6007, the abort connection option code, says."""
        reaction = self.stack.get(0x6007)
        if code == HEARTBEAT_LOST:
            self.causes.add(code)
        if reaction == _FAULT_SIGNAL:
            self.fail(code)
            return
        self.stack.emergency(code, 0x11)
        if reaction != _NOTHING and self.state == "operation enabled":
            self._show("switch on disabled" if reaction == _DISABLE_VOLTAGE
                       else "quick stop active")  # fmt: skip

    def fail(self, code: int) -> None:
        """Have a fault: transitions 13 and 14; with 605E = 0 there is no ramp between them."""
        if self.state != "fault":
            self.stack.put(0x603F, 0, code)
            self._show("fault")
            self.stack.emergency(code, 0x11 if code & 0xF000 == 0x8000 else 0x03)

    # Process data.

    def entered(self, state: int) -> None:
        """NMT: what leaves OPERATIONAL hears commands no more, so the connection is lost."""
        was, self._operational = self._operational, state == OPERATIONAL
        if not self._operational:
            self.stack.disarm("command")
            if was and self.state == "operation enabled":
                self._lost(HEARTBEAT_LOST)

    def sampled(self) -> None:
        torque = 0
        if self.state == "operation enabled" and self._obeys():
            limit = self.stack.optional(*self.torque.limit)
            limit = _NO_LIMIT if limit is None else limit
            torque = max(-limit, min(limit, self.target))
        self.position = self.position + torque
        self.stack.put(0x6064, 0, (self.position + 2**31) % 2**32 - 2**31)
        self.stack.put(*self.torque.actual, torque)

    def _obeys(self) -> bool:
        """Return whether its mode, controlword and objects let it follow the torque command."""
        wanted = self.torque
        return (
            self.stack.get(0x6061) in wanted.modes
            and self._word & wanted.enabled_bits == wanted.enabled_bits
            and all(self.stack.get(*key) == value for key, value in wanted.conditions.items())
        )
