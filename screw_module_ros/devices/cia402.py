# SPDX-License-Identifier: Apache-2.0
"""The CiA 402 power drive state machine as tables (CiA 402-2, 7 and 8.4).

`decode` reads a statusword, `CONTROLWORD` holds the next controlword on the way to a goal, `LEGAL`
lists the transitions that a drive may make. The module keeps no state. It enables only while the
caller's goal is enabled, and these tables never leave a fault.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class State(IntEnum):
    """States of a drive; the numbers are those of AmplifierState."""

    NOT_READY_TO_SWITCH_ON = 0
    SWITCH_ON_DISABLED = 1
    READY_TO_SWITCH_ON = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION_ACTIVE = 6
    FAULT = 7
    UNKNOWN = 8

    @property
    def text(self) -> str:
        """The state as CiA 402 writes it."""
        return self.name.replace("_", " ").lower()


class Goal(IntEnum):
    """Goal of the driver for the drive: voltage off, ready to be enabled, or enabled."""

    OFF = 0
    SWITCHED_ON = 1
    OPERATION_ENABLED = 2


# Controlwords (8.4.1 table 4): bits 0 switch on, 1 enable voltage, 2 quick stop (active low),
# 3 enable operation, 7 fault reset on its rising edge.
DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
DISABLE_OPERATION = 0x0007
ENABLE_OPERATION = 0x000F
FAULT_RESET = 0x0080

# Statusword patterns (8.4.2 table 7): mask, value, state.
_PATTERNS = (
    (0x4F, 0x00, State.NOT_READY_TO_SWITCH_ON),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY_TO_SWITCH_ON),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, State.FAULT_REACTION_ACTIVE),
    (0x4F, 0x08, State.FAULT),
)


def _state_of(low_bits: int) -> State:
    for mask, value, state in _PATTERNS:
        if low_bits & mask == value:
            return state
    return State.UNKNOWN


#: State by the low seven bits of the statusword; patterns not in CiA 402 are UNKNOWN.
_STATES = tuple(_state_of(low_bits) for low_bits in range(0x80))


def decode(statusword: int) -> State:
    """Return the state that object 6041 shows; UNKNOWN for a pattern not in CiA 402."""
    return _STATES[statusword & 0x7F]


class Transition(NamedTuple):
    """One arrow of the state machine: its number in CiA 402 and its ends."""

    number: int
    before: State
    after: State


_S = State
_FAULT_FROM = (
    _S.NOT_READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON,
    _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE,
)  # fmt: skip

#: The transitions of figure 8. Number 0 starts at power-on and 13 anywhere outside the fault pair.
TRANSITIONS = (
    Transition(1, _S.NOT_READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED),
    Transition(2, _S.SWITCH_ON_DISABLED, _S.READY_TO_SWITCH_ON),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON),
    Transition(4, _S.SWITCHED_ON, _S.OPERATION_ENABLED),
    Transition(5, _S.OPERATION_ENABLED, _S.SWITCHED_ON),
    Transition(6, _S.SWITCHED_ON, _S.READY_TO_SWITCH_ON),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED),
    Transition(8, _S.OPERATION_ENABLED, _S.READY_TO_SWITCH_ON),
    Transition(9, _S.OPERATION_ENABLED, _S.SWITCH_ON_DISABLED),
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED),
    Transition(11, _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE),
    Transition(12, _S.QUICK_STOP_ACTIVE, _S.SWITCH_ON_DISABLED),
    *(Transition(13, state, _S.FAULT_REACTION_ACTIVE) for state in _FAULT_FROM),
    Transition(14, _S.FAULT_REACTION_ACTIVE, _S.FAULT),
    Transition(15, _S.FAULT, _S.SWITCH_ON_DISABLED),
    Transition(16, _S.QUICK_STOP_ACTIVE, _S.OPERATION_ENABLED),
)

#: Pairs a drive may show one after the other. A fault reaction may pass between two statuswords.
LEGAL = frozenset((each.before, each.after) for each in TRANSITIONS) | frozenset(
    (state, _S.FAULT) for state in _FAULT_FROM
)


def is_legal(before: State, after: State) -> bool:
    """Return whether CiA 402 lets a drive show `after` directly after `before`."""
    return before == after or (before, after) in LEGAL


#: Controlword for each state on the way to each goal. A drive leaves operation enabled by voltage
#: off: it coasts then, whatever its option codes say (transition 9). Faults and quick stops end in
#: voltage off too; to leave them the caller sends `FAULT_RESET` after a cleared bit 7.
CONTROLWORD: dict[Goal, dict[State, int]] = {
    Goal.OFF: dict.fromkeys(State, DISABLE_VOLTAGE),
    Goal.SWITCHED_ON: dict.fromkeys(State, DISABLE_VOLTAGE)
    | {
        _S.SWITCH_ON_DISABLED: SHUTDOWN,
        _S.READY_TO_SWITCH_ON: SWITCH_ON,
        _S.SWITCHED_ON: SWITCH_ON,
    },
    Goal.OPERATION_ENABLED: dict.fromkeys(State, DISABLE_VOLTAGE)
    | {
        _S.SWITCH_ON_DISABLED: SHUTDOWN,
        _S.READY_TO_SWITCH_ON: SWITCH_ON,
        _S.SWITCHED_ON: ENABLE_OPERATION,
        _S.OPERATION_ENABLED: ENABLE_OPERATION,
    },
}
