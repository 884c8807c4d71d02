# SPDX-License-Identifier: Apache-2.0
"""What decides in the drivers, without a bus, over scripted random sequences: nothing may change.

The times between two steps are those at which something becomes due, a nanosecond less and one
more, so that a comparison that takes the other side shows. A change on purpose is renewed with
`make test ARGS="test/devices/test_kept_logic.py --write"`; the commit says what changed.
"""

from __future__ import annotations

import hashlib
import random

import pytest

from screw_module_ros.devices.cia402 import State
from screw_module_ros.devices.doubt import HOMING, Doubt
from screw_module_ros.devices.drive_logic import DriveLogic, ExcessTorque
from screw_module_ros.devices.motion import Motion, Unwrapper
from screw_module_ros.devices.polled import RequestTracker

MS = 1_000_000
DUE_MS = (20, 50, 100, 60, 500)
PATH = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON)


def digest(lines: list) -> str:
    return hashlib.sha256(repr(lines).encode()).hexdigest()[:16]


def some_time(chance: random.Random) -> int:
    """Return a time to the next step [ns]: mostly a tick, else something due."""
    if chance.random() < 0.7:
        return MS
    return chance.choice(DUE_MS) * MS + chance.choice((-1, 0, 0, 1))


def some_request(chance: random.Random, logic: DriveLogic, now_ns: int, state: State) -> None:
    chance.choice((
        logic.enable, logic.enable, logic.enable, logic.disable, logic.disable, logic.recover,
        logic.recover, logic.forget, lambda: logic.start(now_ns), lambda: logic.latch("a", "b"),
        lambda: logic.intruded("another"), lambda: logic.explain("why"),
        lambda: logic.changed(State.OPERATION_ENABLED, state, "cause"),
    ))()  # fmt: skip


def drive_logic(chance: random.Random) -> list:
    """A drive that mostly obeys, in states that mostly follow each other."""
    logic = DriveLogic("drive", chance.random() < 0.5, 0.5, 0.06)
    now_ns, lines, state, watched = 10**9, [], State.SWITCHED_ON, chance.random() < 0.7
    logic.start(now_ns)
    beat_ns, nmt = now_ns, 5
    for _ in range(400):
        now_ns += some_time(chance)
        if chance.random() < 0.1:
            state = chance.choice((*State, State.OPERATION_ENABLED, *PATH))
        if watched and chance.random() < 0.6:
            beat_ns, nmt = now_ns - chance.choice((0, MS)), chance.choice((5, 5, 5, 5, 5, 127, 4))
        if chance.random() < 0.08:
            some_request(chance, logic, now_ns, state)
        shown = State.OPERATION_ENABLED if chance.random() < 0.5 else state
        word = logic.step(
            state, shown, beat_ns if watched else None, nmt if watched else None, now_ns
        )
        due = logic.recovery.active and logic.recovery.nmt_start_due(state, now_ns)
        lines += [word, logic.fault, logic.goal.name, logic.leaving, due]
        lines.append(logic.nmt_stop_due(now_ns))
        if logic.reason and chance.random() < 0.15:
            logic.forget()
            logic.start(now_ns)
            state = State.SWITCHED_ON
    return lines


def excess_torque(chance: random.Random) -> list:
    """Excesses of all sizes round both limits, at several periods."""
    period_ns = chance.choice((MS // 2, MS, 2 * MS, 10 * MS))
    check = ExcessTorque(0.2, 0.05, period_ns)
    now_ns, lines, commanded, extra = 10**9, [], 0.0, 0.0
    for _ in range(300):
        now_ns += period_ns * chance.choice((1, 1, 1, 1, 2, 3, 4, 7))
        if chance.random() < 0.1:
            commanded = chance.choice((0.0, 0.3, -0.3))
        if chance.random() < 0.1:
            extra = chance.choice((0.0, 0.05, 0.06, -0.06, 0.19, 0.2, -0.2, 1.0))
        lines.append(check.check(commanded, commanded + extra, now_ns))
        if lines[-1]:
            check.restart()
    return lines


def requests(chance: random.Random) -> list:
    """Answers in their tick, later, twice and never, of one part and of two."""
    parts = chance.choice((1, 2, 3))
    tracker, lines = RequestTracker(parts), []
    for _ in range(200):
        lines += [tracker.ask(), tracker.listening]
        for part in range(parts):
            for _ in range(chance.choice((1, 1, 1, 1, 0, 2))):
                lines.append(tracker.answer(part))
            if chance.random() < 0.1:
                tracker.end_tick()
        if chance.random() < 0.02:
            tracker.reset()
    return lines


def motion(chance: random.Random) -> list:
    """Counts that wrap, gaps, homings here and there, at the edges of what is accepted."""
    wraps = chance.choice((2, 7, 1000, 1 << 32))
    unwrapper, moved, again = Unwrapper(wraps), Motion(30.0, MS), Doubt(0.005, HOMING, 1e3)
    now_ns, lines, count = 10**9, [], 0
    for _ in range(300):
        elapsed_ns = MS * chance.choice((1, 1, 1, 2, 9))
        elapsed_ns += chance.choice((0, 0, MS // 2, -elapsed_ns))
        now_ns += elapsed_ns
        count += chance.choice((0, 1, -1, wraps // 2, -(wraps // 2), (wraps + 1) // 2))
        lines += [unwrapper.holds(count), unwrapper.holds(count % wraps), moved.seen]
        moved.take(unwrapper.step(count % wraps) * 1e-4, elapsed_ns)
        lines += [unwrapper.count, moved.position, moved.velocity, moved.homed]
        if chance.random() < 0.1:
            moved.home(chance.choice((0.0, 0.1)))
        if chance.random() < 0.2:
            place = chance.choice((0.0, 0.005, 0.0051, 0.1, 0.105, 0.1051))
            lines += [again.refusal([0.0], [place], now_ns), again.contradicted]
            now_ns += chance.choice((10**9, 10**9 - 1, 15 * 10**9, 15 * 10**9 + 1))
        if chance.random() < 0.01:
            moved.restart()
            again.forget()
    return lines


@pytest.mark.parametrize("decides", [drive_logic, excess_torque, requests, motion])
def test_every_decision_is_the_kept_one(decides, kept):
    kept([digest(decides(random.Random(seed))) for seed in range(30)])
