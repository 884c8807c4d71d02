# SPDX-License-Identifier: Apache-2.0
"""The gate: torque only after `enable`, only while everything holds, and never by itself again."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control import gate
from screw_module_ros.control.gate import GATE_CLOSED, GateInput, GateSettings, gate_step

SETTINGS = GateSettings()
PERIOD_NS = 1_000_000
START_NS = 10**12


def inputs(now_ns, **changes):
    """What the gate sees when all is well."""
    good = GateInput(now_ns, now_ns - 200_000, PERIOD_NS, now_ns - 10_000_000, True, True, False)
    return good._replace(**changes)


def opened(now_ns=START_NS, ticks=1000):
    """A gate that has been open long enough for its ramp."""
    state, refusal = gate.enable(SETTINGS, GATE_CLOSED, inputs(now_ns))
    assert refusal == ""
    for tick in range(ticks):
        state = gate_step(SETTINGS, state, inputs(now_ns + tick * PERIOD_NS))
    return state, now_ns + ticks * PERIOD_NS


def test_closed_stays_closed_however_well_everything_is():
    state = GATE_CLOSED
    for tick in range(100):
        state = gate_step(SETTINGS, state, inputs(START_NS + tick * PERIOD_NS))
        assert (state.phase, state.scale) == (gate.CLOSED, 0.0)


def test_opens_once_the_drive_is_there_and_ramps_in():
    state, _ = gate.enable(SETTINGS, GATE_CLOSED, inputs(START_NS, drive_enabled=False))
    state = gate_step(SETTINGS, state, inputs(START_NS + PERIOD_NS, drive_enabled=False))
    assert (state.phase, state.scale) == (gate.OPENING, 0.0)
    scales = []
    for tick in range(2, 600):
        state = gate_step(SETTINGS, state, inputs(START_NS + tick * PERIOD_NS))
        scales.append(state.scale)
    steps = [after - before for before, after in zip(scales, scales[1:], strict=False)]
    assert state.phase == gate.OPEN
    assert scales[0] == 0.0
    assert scales[-1] == 1.0
    assert max(steps) <= 0.001 / 0.5 + 1e-9


def test_a_pause_makes_no_leap_in_the_ramp():
    state, now_ns = opened(ticks=2)
    state = gate_step(SETTINGS, state, inputs(now_ns + 10**10))
    assert state.scale <= 0.02 / 0.5 + 0.01


WRONG = [
    ({"command_ns": -6 * PERIOD_NS}, gate.COMMAND_STALE, True),
    ({"command_ns": 2 * PERIOD_NS}, gate.COMMAND_STALE, True),
    ({"safety_ns": -101_000_000}, gate.SAFETY_STALE, True),
    ({"safety_ns": 10**15}, gate.SAFETY_STALE, True),
    ({"drive_faulted": True}, gate.DRIVE_FAULT, True),
    ({"drive_enabled": False}, gate.DRIVE_LEFT, True),
    ({"permitted": False}, gate.NO_PERMISSION, False),
]


@pytest.mark.parametrize(("change", "reason", "latched"), WRONG)
def test_anything_wrong_closes_at_once_and_does_not_open_again(change, reason, latched):
    state, now_ns = opened()
    change = {
        key: now_ns + value if key.endswith("_ns") else value for key, value in change.items()
    }
    state = gate_step(SETTINGS, state, inputs(now_ns, **change))
    assert (state.phase, state.scale, state.reason) == (gate.CLOSED, 0.0, reason)
    assert state.latched == latched
    for tick in range(1, 50):
        state = gate_step(SETTINGS, state, inputs(now_ns + tick * PERIOD_NS))
        assert (state.phase, state.reason) == (gate.CLOSED, reason)


@pytest.mark.parametrize(("change", "reason", "latched"), WRONG)
def test_after_a_latch_clear_comes_before_enable(change, reason, latched):
    state, now_ns = opened()
    change = {
        key: now_ns + value if key.endswith("_ns") else value for key, value in change.items()
    }
    state = gate_step(SETTINGS, state, inputs(now_ns, **change))
    again, refusal = gate.enable(SETTINGS, state, inputs(now_ns + PERIOD_NS))
    assert (gate.REASONS[reason] in refusal) == latched
    assert (again.phase == gate.CLOSED) == latched
    cleared = gate.clear(state)
    assert cleared.phase == gate.CLOSED
    _, refusal = gate.enable(SETTINGS, cleared, inputs(now_ns + PERIOD_NS))
    assert refusal == ""


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"permitted": False}, gate.NO_PERMISSION),
        ({"safety_ns": 0}, gate.SAFETY_STALE),
        ({"command_ns": 0}, gate.COMMAND_STALE),
        ({"drive_faulted": True}, gate.DRIVE_FAULT),
    ],
)
def test_enable_is_refused_with_its_reason(change, reason):
    state, refusal = gate.enable(SETTINGS, GATE_CLOSED, inputs(START_NS, **change))
    assert refusal == gate.REASONS[reason]
    assert state.phase == gate.CLOSED


def test_a_drive_that_never_starts_is_given_up():
    state, _ = gate.enable(SETTINGS, GATE_CLOSED, inputs(START_NS, drive_enabled=False))
    late = inputs(START_NS + 1_001_000_000, drive_enabled=False)
    state = gate_step(SETTINGS, state, late)
    assert (state.phase, state.reason) == (gate.CLOSED, gate.DRIVE_SLOW)


def test_enabling_twice_does_not_start_the_ramp_again():
    state, now_ns = opened()
    again, refusal = gate.enable(SETTINGS, state, inputs(now_ns))
    assert (again, refusal) == (state, "")


def test_disable_closes_and_keeps_a_latch():
    state, now_ns = opened()
    closed = gate.disable(state, now_ns)
    assert (closed.phase, closed.scale, closed.latched) == (gate.CLOSED, 0.0, False)
    faulted = gate_step(SETTINGS, state, inputs(now_ns, drive_faulted=True))
    assert gate.disable(faulted, now_ns).latched


def test_clear_does_not_touch_an_open_gate():
    state, _ = opened()
    assert gate.clear(state) == state


near = st.integers(-150_000_000, 3_000_000)
anywhere = st.integers(-(2**63), 2**63 - 1)
seen = st.tuples(
    st.integers(-2_000_000, 50_000_000),  # time since the last tick, the clock may even go back
    st.one_of(near, anywhere),
    st.one_of(near, anywhere),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)
good = st.just((1_000_000, -200_000, -10_000_000, True, True, False))
acts = st.sampled_from(["enable", "disable", "clear"])


@given(st.lists(st.one_of(good, seen, acts), max_size=60))
def test_whatever_happens_torque_passes_only_while_all_holds_since_an_enable(events):
    state, now_ns, asked = GATE_CLOSED, START_NS, False
    for event in events:
        if event == "disable":
            state, asked = gate.disable(state, now_ns), False
            continue
        if event == "clear":
            state = gate.clear(state)
            continue
        if event == "enable":
            state, refusal = gate.enable(SETTINGS, state, inputs(now_ns, drive_enabled=False))
            asked = asked or refusal == ""
            continue
        step_ns, command, safety, permitted, enabled, faulted = event
        now_ns += step_ns
        inp = GateInput(
            now_ns, now_ns + command, PERIOD_NS, now_ns + safety, permitted, enabled, faulted
        )
        before, state = state, gate_step(SETTINGS, state, inp)
        holds = (
            permitted and not faulted and -5 * PERIOD_NS <= command <= PERIOD_NS
            and -100_000_000 <= safety <= PERIOD_NS
        )  # fmt: skip
        asked = asked and holds and state.phase != gate.CLOSED
        assert 0.0 <= state.scale <= before.scale + 0.02 / 0.5 + 1e-9
        if state.scale > 0.0 or state.phase == gate.OPEN:
            assert asked
            assert enabled
        assert (state.reason == gate.PASSING) == (state.phase == gate.OPEN)
