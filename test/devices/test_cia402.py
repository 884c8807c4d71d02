# SPDX-License-Identifier: Apache-2.0
"""The whole CiA 402 state machine, from the tables of the standard; emergencies by name."""

from __future__ import annotations

import itertools

import pytest

from screw_module_ros.devices import cia402, emcy
from screw_module_ros.devices.cia402 import CONTROLWORD, Goal, State

S = State

# CiA 402-2 table 7, bit by bit: x is any. Bits 6, 5, 3, 2, 1, 0 of the statusword.
PATTERNS = {
    S.NOT_READY_TO_SWITCH_ON: "0x0000",
    S.SWITCH_ON_DISABLED: "1x0000",
    S.READY_TO_SWITCH_ON: "010001",
    S.SWITCHED_ON: "010011",
    S.OPERATION_ENABLED: "010111",
    S.QUICK_STOP_ACTIVE: "000111",
    S.FAULT_REACTION_ACTIVE: "0x1111",
    S.FAULT: "0x1000",
}


def state_by_hand(word: int) -> State:
    bits = "".join(str(word >> bit & 1) for bit in (6, 5, 3, 2, 1, 0))
    for state, pattern in PATTERNS.items():
        if all(p in ("x", b) for p, b in zip(pattern, bits, strict=True)):
            return state
    return S.UNKNOWN


def test_every_statusword_decodes_as_the_table_says():
    assert all(cia402.decode(word) is state_by_hand(word) for word in range(0x10000))


def test_the_numbers_are_those_of_the_message():
    assert [state.value for state in State] == list(range(9))
    assert (S.OPERATION_ENABLED, S.FAULT, S.UNKNOWN) == (4, 7, 8)


# CiA 402-2 figure 8 with the transitions' numbers.
ARROWS = {
    1: (S.NOT_READY_TO_SWITCH_ON, S.SWITCH_ON_DISABLED),
    2: (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON),
    3: (S.READY_TO_SWITCH_ON, S.SWITCHED_ON),
    4: (S.SWITCHED_ON, S.OPERATION_ENABLED),
    5: (S.OPERATION_ENABLED, S.SWITCHED_ON),
    6: (S.SWITCHED_ON, S.READY_TO_SWITCH_ON),
    7: (S.READY_TO_SWITCH_ON, S.SWITCH_ON_DISABLED),
    8: (S.OPERATION_ENABLED, S.READY_TO_SWITCH_ON),
    9: (S.OPERATION_ENABLED, S.SWITCH_ON_DISABLED),
    10: (S.SWITCHED_ON, S.SWITCH_ON_DISABLED),
    11: (S.OPERATION_ENABLED, S.QUICK_STOP_ACTIVE),
    12: (S.QUICK_STOP_ACTIVE, S.SWITCH_ON_DISABLED),
    14: (S.FAULT_REACTION_ACTIVE, S.FAULT),
    15: (S.FAULT, S.SWITCH_ON_DISABLED),
    16: (S.QUICK_STOP_ACTIVE, S.OPERATION_ENABLED),
}


@pytest.mark.parametrize("number", ARROWS)
def test_transition_is_there(number):
    arrows = [(t.before, t.after) for t in cia402.TRANSITIONS if t.number == number]
    assert arrows == [ARROWS[number]]
    assert cia402.is_legal(*ARROWS[number])


def test_a_fault_may_come_from_everywhere_else():
    faulting = {t.before for t in cia402.TRANSITIONS if t.number == 13}
    assert faulting == set(State) - {S.FAULT, S.FAULT_REACTION_ACTIVE, S.UNKNOWN}


def test_illegal_transitions():
    """What is no arrow is illegal; the fault reaction may pass unseen between two statuswords."""
    legal = set(ARROWS.values())
    for before in set(State) - {S.FAULT, S.FAULT_REACTION_ACTIVE, S.UNKNOWN}:
        legal |= {(before, S.FAULT_REACTION_ACTIVE), (before, S.FAULT)}
    for before, after in itertools.permutations(State, 2):
        assert cia402.is_legal(before, after) == ((before, after) in legal), (before, after)


# CiA 402-2 table 4, bits 7 3 2 1 0: what each step up and down must look like.
@pytest.mark.parametrize(
    ("goal", "state", "word"),
    [
        (Goal.OPERATION_ENABLED, S.SWITCH_ON_DISABLED, 0b0_0110),
        (Goal.OPERATION_ENABLED, S.READY_TO_SWITCH_ON, 0b0_0111),
        (Goal.OPERATION_ENABLED, S.SWITCHED_ON, 0b0_1111),
        (Goal.OPERATION_ENABLED, S.OPERATION_ENABLED, 0b0_1111),
        (Goal.SWITCHED_ON, S.SWITCH_ON_DISABLED, 0b0_0110),
        (Goal.SWITCHED_ON, S.READY_TO_SWITCH_ON, 0b0_0111),
        (Goal.SWITCHED_ON, S.SWITCHED_ON, 0b0_0111),
        (Goal.SWITCHED_ON, S.OPERATION_ENABLED, 0b0_0000),
    ],
)
def test_steps(goal, state, word):
    assert CONTROLWORD[goal][state] == word


UP = (S.SWITCH_ON_DISABLED, S.READY_TO_SWITCH_ON, S.SWITCHED_ON, S.OPERATION_ENABLED)


def test_everything_else_is_voltage_off():
    for goal, state in itertools.product(Goal, State):
        on_the_way = {Goal.OFF: (), Goal.SWITCHED_ON: UP[:-1], Goal.OPERATION_ENABLED: UP}[goal]
        assert (CONTROLWORD[goal][state] == 0) == (state not in on_the_way)


def test_operation_is_enabled_by_one_goal_only_and_no_table_resets_a_fault():
    for goal, state in itertools.product(Goal, State):
        word = CONTROLWORD[goal][state]
        assert not word & 0x80
        assert (word & 0x0F == 0x0F) <= (goal is Goal.OPERATION_ENABLED)


def test_layout_by_hand():
    found = emcy.decode(bytes.fromhex("30 81 11 DE AD 00 00 01"))
    assert found == (0x8130, 0x11, b"\xde\xad\x00\x00\x01")
    assert found.text == (
        "0x8130 life guard or heartbeat error; register: generic, communication; "
        "vendor data de ad 00 00 01"
    )


@pytest.mark.parametrize("data", ["", "00"])
def test_an_emergency_without_a_code_is_none(data):
    assert emcy.decode(bytes.fromhex(data)) is None


def test_a_short_emergency_is_read_as_far_as_it_goes():
    assert emcy.decode(bytes.fromhex("30 81 11")) == (0x8130, 0x11, bytes(5))
    assert emcy.decode(bytes.fromhex("30 81")) == (0x8130, 0, bytes(5))
    assert emcy.decode(bytes.fromhex("30 81 11 DE AD")) == (0x8130, 0x11, b"\xde\xad\0\0\0")


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (0x0000, "error reset or no error"),
        (0x1000, "generic error"),
        (0x2310, "continuous overcurrent, motor side"),
        (0x2312, "continuous overcurrent, motor side"),
        (0x3220, "DC link undervoltage"),
        (0x4310, "excess temperature, drive"),
        (0x7305, "incremental sensor 1 fault"),
        (0x73FF, "sensor"),
        (0x8250, "RPDO timeout"),
        (0x8611, "following error"),
        (0x8FFF, "monitoring"),
        (0xFF42, "device specific"),
        (0x0100, "unknown error"),
        (0xE000, "unknown error"),
    ],
)
def test_names(code, name):
    assert emcy.code_name(code) == name


def test_reset():
    assert emcy.decode(bytes(8)).is_reset
    assert not emcy.decode(bytes.fromhex("00 10 01 00 00 00 00 00")).is_reset
