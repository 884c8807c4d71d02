# SPDX-License-Identifier: Apache-2.0
"""The gate: torque only after `enable`, only while everything holds, and never by itself again."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

import hazards
from screw_module_ros.clock import ManualClock
from screw_module_ros.loop.gate import clear_fault, enable
from screw_module_ros.loop.requests import Requests
from screw_module_ros.safety.latch import Age
from screw_module_ros.safety.permit import (
    CLOSED,
    CONDITIONS,
    OPEN,
    OPENING,
    STARTING,
    Permit,
    PermitSettings,
)
from screw_module_ros.settings import fields

SETTINGS = PermitSettings()
PERIOD_NS = 1_000_000
START_NS = 10**12
NAMES = [each.name for each in hazards.hazards(hazards.PAGE.read_text(encoding="utf-8"))]


@dataclass
class Switch:
    """A drive as the gate sees it."""

    on: bool = True
    in_another_mode: bool = False
    fault: str = ""
    refused: str = ""
    recovering: bool = False
    leaving: bool = False
    asked: list[str] = field(default_factory=list)

    def is_on(self, now_ns):
        return self.on and not self.in_another_mode

    def is_enabled(self, now_ns):
        return self.on

    def refusal(self):
        return self.refused

    def request_enable(self):
        self.asked.append("enable")

    def request_disable(self):
        self.asked.append("disable")


class Gate:
    """A permit with its time; what is not said otherwise is as it should be."""

    def __init__(self, drives=1):
        self.drives = [Switch() for _ in range(drives)]
        self.permit = Permit(self.drives, SETTINGS, PERIOD_NS)
        self.now_ns = START_NS

    def step(self, command=-200_000, safety=-10_000_000, permitted=True, elapsed=PERIOD_NS):
        """One tick; command, safety: stamps from now on [ns]."""
        self.now_ns += elapsed
        self.permit.supervise(permitted, "", self.now_ns + safety)
        if permitted:  # a refusal stands for 200 ms, which is `test_permission`'s concern
            self.permit._permitted = True
        return self.permit.step(self.now_ns + command, self.now_ns)

    def ask(self, act, **wrong):
        """Act between two ticks, as the loop does for a service; return the answer."""
        self.step(**wrong)
        answer = act()
        self.step(**wrong)
        return answer

    def open(self):
        return self.permit.open(self.now_ns)


@pytest.fixture
def opened():
    """A gate that has been open long enough for its ramp."""
    gate = Gate()
    gate.step()
    assert gate.ask(gate.open) == ""
    for _ in range(1000):
        gate.step()
    assert (gate.permit.phase, gate.permit.scale, gate.permit.reason) == (OPEN, 1.0, "")
    return gate


def test_opens_once_every_drive_is_there_and_ramps_in():
    gate = Gate(drives=2)
    gate.drives[1].on = False
    assert gate.ask(gate.open) == ""
    for _ in range(20):
        assert gate.step() == 0.0
    assert (gate.permit.phase, gate.permit.reason) == (OPENING, STARTING)
    gate.drives[1].on = True
    scales = [gate.step() for _ in range(600)]
    steps = [after - before for before, after in zip(scales, scales[1:], strict=False)]
    assert (scales[0], scales[-1]) == (0.0, 1.0)
    assert steps[:499] == pytest.approx([0.002] * 499) and set(steps[501:]) == {0.0}


@pytest.mark.parametrize(
    ("elapsed", "leap"), [(10**10, 0.04), (20_000_000, 0.04), (15_000_000, 0.03), (-5_000_000, 0.0)]
)
def test_a_pause_makes_no_leap_in_the_ramp(elapsed, leap):
    """A longer pause counts as one of 20 ms; the clock may even go back."""
    gate = Gate()
    gate.ask(gate.open)
    assert gate.step() == pytest.approx(0.002)
    assert gate.step(elapsed=elapsed) == pytest.approx(0.002 + leap)


def fault(gate):
    gate.drives[0].fault = "over-current"


def leave(gate):
    gate.drives[0].on = False


def own(gate):
    gate.permit.fault.set("a fault of the owner")


WRONG = [
    (None, {"command": -5_000_001}, "no fresh command", True),
    (None, {"command": 1_000_001}, "no fresh command", True),
    (None, {"safety": -100_000_001}, "no fresh safety_state", True),
    (None, {"safety": 1_000_001}, "no fresh safety_state", True),
    (fault, {}, "over-current", True),
    (own, {}, "a fault of the owner", True),
    (leave, {}, "the drive left operation enabled by itself", True),
    (None, {"permitted": False}, "safety_state does not permit motion", False),
]


@pytest.mark.parametrize(
    "edge", [{"command": -5_000_000}, {"command": 1_000_000}, {"safety": -100_000_000},
             {"safety": 1_000_000}],
)  # fmt: skip
def test_the_oldest_and_the_newest_stamps_that_are_fresh(opened, edge):
    assert opened.step(**edge) == 1.0 and opened.permit.reason == ""


@pytest.mark.parametrize(
    ("stamp_ns", "now_ns", "fresh"),
    [
        (0, 0, False), (0, 10, False), (1, 1, True), (1, 101, True), (1, 102, False),
        (105, 100, True), (106, 100, False),
    ],
)  # fmt: skip
def test_what_is_fresh_was_ever_there_is_not_too_old_and_not_of_the_future(stamp_ns, now_ns, fresh):
    age = Age(100, 5)
    age.note(stamp_ns)
    assert age.fresh(now_ns) == fresh


@pytest.mark.parametrize("reason", ["", "the pin is in"])
def test_a_refusal_holds_for_a_fifth_of_a_second(reason):
    """A second sender of safety_state cannot override the supervisor's."""
    gate = Gate()
    permit, begin_ns = gate.permit, gate.now_ns
    asked = {}
    for after_ns in (0, 200_000_000, 200_000_001):
        now_ns = begin_ns + after_ns
        permit.supervise(after_ns > 0, reason, now_ns)
        permit.step(now_ns, now_ns)
        asked[after_ns] = permit.open(now_ns)
    why = f"not permitted: {reason}" if reason else "safety_state does not permit motion"
    assert asked == {0: why, 200_000_000: why, 200_000_001: ""}


@pytest.mark.parametrize(("happens", "wrong", "reason", "latched"), WRONG)
def test_anything_wrong_closes_at_once_and_does_not_open_again(
    opened, happens, wrong, reason, latched
):
    if happens:
        happens(opened)
    assert opened.step(**wrong) == 0.0
    permit = opened.permit
    assert (permit.phase, permit.scale, permit.reason, permit.latched) == (
        CLOSED, 0.0, reason, latched
    )  # fmt: skip
    assert opened.drives[0].asked == ["enable", "disable"]
    opened.drives[0].on = True
    assert [opened.step() for _ in range(50)] == [0.0] * 50
    assert permit.reason == reason


@pytest.mark.parametrize(("happens", "wrong", "reason", "latched"), WRONG)
def test_after_a_latch_clear_comes_before_enable(opened, happens, wrong, reason, latched):
    if happens:
        happens(opened)
    opened.step(**wrong)
    opened.drives[0].on, opened.drives[0].fault = True, ""
    permit = opened.permit
    refusal = opened.ask(opened.open)
    assert (reason in refusal) == latched
    assert (permit.phase == CLOSED) == latched
    opened.ask(permit.close)
    assert opened.ask(lambda: permit.clear(permit.fault.reason)) == ""
    assert opened.ask(opened.open) == ""


@pytest.mark.parametrize(
    ("happens", "wrong", "reason"),
    [
        (None, {"permitted": False}, "safety_state does not permit motion"),
        (None, {"safety": -(10**12)}, "no fresh safety_state"),
        (None, {"command": -(10**12)}, "no fresh command"),
        (fault, {}, "over-current"),
    ],
)
def test_enable_is_refused_with_its_reason_and_no_drive_is_asked(happens, wrong, reason):
    gate = Gate()
    if happens:
        happens(gate)
    assert gate.ask(gate.open, **wrong) == reason
    assert gate.permit.phase == CLOSED and gate.drives[0].asked == []


def test_a_latch_whose_cause_lasts_is_told_by_its_cause(opened):
    """Not by the latch: clearing it would not help."""
    fault(opened)
    opened.step()
    assert opened.ask(opened.open) == "over-current"
    opened.drives[0].fault = ""
    assert "latched: call ~/clear_fault first" in opened.ask(opened.open)


def test_what_one_drive_refuses_is_asked_of_none():
    gate = Gate(drives=2)
    gate.drives[1].refused = "it is still recovering"
    assert gate.ask(gate.open) == "it is still recovering"
    assert gate.permit.phase == CLOSED and gate.drives[0].asked == []


def test_a_drive_that_never_starts_is_given_up():
    gate = Gate()
    gate.drives[0].on = False
    gate.ask(gate.open)
    gate.step(elapsed=1_000_000_000 - PERIOD_NS)
    assert gate.permit.phase == OPENING
    gate.step(elapsed=1)
    assert gate.permit.phase == CLOSED and not gate.permit.latched
    assert gate.permit.reason == "the drive did not reach operation enabled in time"


def test_enabling_twice_does_not_start_the_ramp_again(opened):
    assert opened.ask(opened.open) == ""
    assert opened.step() == 1.0 and opened.drives[0].asked == ["enable"]


def test_disable_closes_and_keeps_a_latch(opened):
    opened.ask(opened.permit.close)
    permit = opened.permit
    assert (permit.phase, permit.scale, permit.reason) == (CLOSED, 0.0, "not enabled")
    opened.ask(opened.open)
    opened.step()
    opened.step(command=-(10**9))
    opened.ask(permit.close)
    assert permit.latched and permit.reason == "no fresh command"


def test_clear_does_not_touch_an_open_gate(opened):
    assert opened.ask(lambda: opened.permit.clear(opened.permit.fault.reason)) == ""
    assert opened.step() == 1.0


def test_a_fault_that_comes_while_a_drive_recovers_is_not_cleared_with_the_old_one():
    gate = Gate()
    gate.permit.fault.set("a jump")
    gate.step()
    known = gate.permit.fault.reason
    gate.permit.fault.clear()
    gate.permit.fault.set("beyond 150 N")
    assert gate.ask(lambda: gate.permit.clear(known)) == "beyond 150 N"
    assert gate.permit.faulted


def test_missed_deadlines_stop_only_while_torque_passes(opened):
    opened.permit.missed(19, 20)
    assert opened.step() == 1.0
    opened.permit.missed(20, 20)
    assert opened.step() == 0.0
    assert opened.permit.reason == "20 deadlines missed in a row"
    opened.ask(lambda: opened.permit.clear(opened.permit.fault.reason))
    opened.permit.missed(20, 20)
    assert opened.permit.fault.reason == ""


def test_at_rest_is_closed_with_every_drive_off(opened):
    assert not opened.permit.at_rest(opened.now_ns)
    opened.ask(opened.permit.close)
    assert not opened.permit.at_rest(opened.now_ns), "the drive still shows operation enabled"
    opened.drives[0].in_another_mode = True
    assert not opened.permit.at_rest(opened.now_ns), "enabled in another mode is enabled"
    opened.drives[0].on = False
    assert opened.permit.at_rest(opened.now_ns)


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
    gate, permit, asked = Gate(), None, False
    permit, drive = gate.permit, gate.drives[0]
    for event in events:
        if isinstance(event, str):
            if event == "enable":
                asked = permit.open(gate.now_ns) == "" or asked
            elif event == "disable":
                permit.close()
            else:
                permit.clear(permit.fault.reason)
            asked = asked and event != "disable"
            continue
        elapsed, command, safety, permitted, drive.on, faulted = event
        drive.fault = "a fault" if faulted else ""
        before = permit.scale
        gate.step(command, safety, permitted, elapsed)
        holds = (
            permitted and not faulted and -5 * PERIOD_NS <= command <= PERIOD_NS
            and -100_000_000 <= safety <= PERIOD_NS
        )  # fmt: skip
        asked = asked and holds and permit.phase != CLOSED
        assert 0.0 <= permit.scale <= before + 0.02 / 0.5 + 1e-9
        if permit.scale > 0.0 or permit.phase == OPEN:
            assert asked
            assert drive.on
        assert (permit.reason == "") == (permit.phase == OPEN)


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.wrong.__name__)
def test_every_condition_names_a_hazard_and_the_parameters_that_exist(condition):
    assert condition.hazard in NAMES
    for name in filter(None, condition.limit.split(", ")):
        assert name.removeprefix("gate.") in fields(PermitSettings)


class NotedClock(ManualClock):
    """A clock by hand: while a service waits, the loop serves `requests` and ticks.

    longest: how long each wait may take [s].
    """

    def __init__(self, gate):
        super().__init__(gate.now_ns)
        self.gate, self.longest = gate, []
        self.requests = Requests(self)

    def wait_for(self, condition, seconds):
        self.longest.append(seconds)
        self.requests.serve()
        self.tick()
        return condition()

    def sleep(self, seconds):
        for _ in range(round(seconds * 1e9) // PERIOD_NS):
            self.tick()

    def tick(self):
        self.gate.step()
        self.time_ns = self.gate.now_ns


def test_how_long_an_enable_and_a_recovery_are_waited_for():
    """A second more than the drive may take, for its answer."""
    gate = Gate()
    permit = Permit(gate.drives, SETTINGS, PERIOD_NS, recovery_s=2.5)
    gate.permit = permit
    gate.step()
    clock = NotedClock(gate)
    assert enable(permit, clock.requests) == ""
    assert clock.longest[1:] == [2.0]  # after that of the loop's answer
    gate.drives[0].fault, gate.drives[0].recovering = "over-current", True
    gate.drives[0].clear_fault = lambda: gate.drives[0].asked.append("clear")
    clock = NotedClock(gate)
    assert clear_fault(permit, clock.requests) == "over-current"
    assert clock.longest == [3.5] and gate.drives[0].asked[-2:] == ["clear", "disable"]
    gate.drives[0].fault = ""
    assert clear_fault(permit, NotedClock(gate).requests) == "" and not permit.faulted
    assert gate.drives[0].asked.count("clear") == 1, "a healthy drive has nothing to recover from"


@pytest.mark.parametrize(("lacking", "waited_ms"), [("", 0), ("leaving", 300), ("permission", 300)])
def test_an_enable_waits_for_a_permission_or_a_disabling_under_way(lacking, waited_ms):
    gate = Gate()
    gate.drives[0].refused = "not now"
    gate.drives[0].leaving = lacking == "leaving"
    gate.permit._permitted = lacking != "permission"
    gate.step = partial(gate.step, permitted=lacking != "permission")
    gate.step()
    clock = NotedClock(gate)
    begin_ns = clock.time_ns
    refused = enable(gate.permit, clock.requests)
    why = "not now" if lacking != "permission" else "safety_state does not permit motion"
    assert refused == why
    waited = (clock.time_ns - begin_ns) / 1e6
    assert waited_ms <= waited <= waited_ms + 10
