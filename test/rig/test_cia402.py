# SPDX-License-Identifier: Apache-2.0
"""The far end's state machine against the figure of CiA 402-2, arrow by arrow."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.rig import cia402
from screw_module_ros.rig.cia402 import (
    ENABLED,
    FAULT,
    FAULT_REACTION,
    QUICK_STOP,
    READY,
    SWITCH_ON_DISABLED,
    SWITCHED_ON,
    StateMachine,
)

COASTING = {0x605A: 0, 0x605B: 0, 0x605C: 0, 0x605E: 0}
BRAKING = {0x605A: 2, 0x605B: 1, 0x605C: 1, 0x605E: 2}
WAY = {
    SWITCH_ON_DISABLED: (),
    READY: (0x06,),
    SWITCHED_ON: (0x06, 0x07),
    ENABLED: (0x06, 0x07, 0x0F),
    QUICK_STOP: (0x06, 0x07, 0x0F, 0x02),
}


def machine_in(state: int, options: dict[int, int]) -> StateMachine:
    machine = StateMachine(options.__getitem__)
    machine.boot()
    for controlword in WAY[state]:
        machine.control(controlword, True, True)
    assert machine.state == state
    return machine


HOLDING = COASTING | {0x605A: 6}

ARROWS = [
    (SWITCH_ON_DISABLED, 0x06, READY),  # 2
    (SWITCH_ON_DISABLED, 0x07, SWITCH_ON_DISABLED),
    (SWITCH_ON_DISABLED, 0x0F, SWITCH_ON_DISABLED),
    (SWITCH_ON_DISABLED, 0x80, SWITCH_ON_DISABLED),
    (READY, 0x07, SWITCHED_ON),  # 3
    (READY, 0x0F, ENABLED),  # 3 and 4
    (READY, 0x00, SWITCH_ON_DISABLED),  # 7
    (READY, 0x02, SWITCH_ON_DISABLED),  # 7
    (SWITCHED_ON, 0x0F, ENABLED),  # 4
    (SWITCHED_ON, 0x06, READY),  # 6
    (SWITCHED_ON, 0x00, SWITCH_ON_DISABLED),  # 10
    (SWITCHED_ON, 0x02, SWITCH_ON_DISABLED),  # 10
    (ENABLED, 0x07, SWITCHED_ON),  # 5
    (ENABLED, 0x06, READY),  # 8
    (ENABLED, 0x00, SWITCH_ON_DISABLED),  # 9
    (ENABLED, 0x0D, SWITCH_ON_DISABLED),  # 9: bit 1 decides
    (ENABLED, 0x0B, QUICK_STOP),  # 11: bit 2
    (ENABLED, 0x8F, ENABLED),  # bit 7 makes it no command
    (QUICK_STOP, 0x00, SWITCH_ON_DISABLED),  # 12
    (QUICK_STOP, 0x0F, ENABLED),  # 16
    (QUICK_STOP, 0x06, QUICK_STOP),
]


@pytest.mark.parametrize(("state", "controlword", "expected"), ARROWS)
def test_arrows_of_the_figure(state, controlword, expected):
    machine = machine_in(state, HOLDING)
    machine.control(controlword, True, True)
    assert machine.state == expected


def test_quick_stop_with_option_0_lets_go_at_once():
    machine = machine_in(ENABLED, COASTING)
    machine.control(0x02, True, True)
    assert machine.state == SWITCH_ON_DISABLED
    assert not machine.braking


def test_quick_stop_with_option_2_brakes_and_ends_disabled():
    machine = machine_in(ENABLED, BRAKING)
    machine.control(0x02, True, True)
    assert (machine.state, machine.braking, machine.driving) == (QUICK_STOP, True, False)
    machine.control(0x0F, True, True)  # 16 only with options 5 to 8
    assert machine.state == QUICK_STOP
    machine.standstill()
    assert (machine.state, machine.braking) == (SWITCH_ON_DISABLED, False)


@pytest.mark.parametrize(("controlword", "end"), [(0x07, SWITCHED_ON), (0x06, READY)])
def test_disable_and_shutdown_brake_first_when_told_so(controlword, end):
    machine = machine_in(ENABLED, BRAKING)
    machine.control(controlword, True, True)
    assert (machine.state, machine.driving, machine.braking) == (ENABLED, False, True)
    machine.standstill()
    assert machine.state == end


def test_enabling_again_ends_a_slow_down():
    machine = machine_in(ENABLED, BRAKING)
    machine.control(0x07, True, True)
    machine.control(0x0F, True, True)
    assert machine.driving
    machine.standstill()
    assert machine.driving


@pytest.mark.parametrize("state", list(WAY))
def test_a_fault_is_reached_from_everywhere(state):
    machine = machine_in(state, HOLDING)
    machine.fault()
    assert machine.state == FAULT
    assert not machine.braking


def test_fault_reaction_brakes_until_standstill():
    machine = machine_in(ENABLED, BRAKING)
    machine.fault()
    assert (machine.state, machine.braking) == (FAULT_REACTION, True)
    machine.control(0x80, True, True)
    assert machine.state == FAULT_REACTION
    machine.standstill()
    assert machine.state == FAULT


def test_fault_reset_wants_a_rising_edge_and_the_cause_gone():
    machine = machine_in(ENABLED, COASTING)
    machine.control(0x8F, True, True)
    machine.fault()
    machine.control(0x80, True, True)  # bit 7 was set already
    assert machine.state == FAULT
    machine.control(0x00, True, True)
    machine.control(0x80, False, True)
    assert machine.state == FAULT
    machine.control(0x00, True, True)
    machine.control(0x80, True, True)
    assert machine.state == SWITCH_ON_DISABLED


def test_without_power_nothing_is_switched_on():
    machine = machine_in(SWITCH_ON_DISABLED, COASTING)
    machine.control(0x06, True, False)
    assert machine.state == SWITCH_ON_DISABLED


events = st.lists(
    st.one_of(
        st.integers(0, 0xFFFF),
        st.sampled_from(["fault", "standstill", "quick_stop", "disable_voltage"]),
    ),
    max_size=40,
)


@given(events, st.sampled_from([COASTING, BRAKING, HOLDING]))
def test_enabled_is_only_entered_by_an_enable_command(sequence, options):
    machine = StateMachine(options.__getitem__)
    machine.boot()
    for event in sequence:
        before, drove = machine.state, machine.driving
        if isinstance(event, int):
            machine.control(event, True, True)
        else:
            getattr(machine, event)()
        if machine.driving and not drove:
            assert isinstance(event, int)
            assert event & 0x8F == 0x0F
            assert before in (READY, SWITCHED_ON, ENABLED, QUICK_STOP)
        if before == FAULT and machine.state != FAULT:
            assert machine.state == SWITCH_ON_DISABLED
        assert not (machine.driving and machine.braking)


def test_statuswords_of_the_table():
    masks = (0x4F, 0x4F, 0x6F, 0x6F, 0x6F, 0x6F, 0x4F, 0x4F)
    values = (0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08)
    for bits, mask, value in zip(cia402.STATUS_BITS, masks, values, strict=True):
        assert bits & mask == value
