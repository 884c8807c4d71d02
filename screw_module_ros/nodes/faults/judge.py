# SPDX-License-Identifier: Apache-2.0
"""Carries out one row and says whether the robot kept its promise.

The promise (design section 6): torque zero within the row's time, nothing re-enables by itself, the
reason can be read, the way back needs no restart of the graph, and the patient feels no step.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence

from ..support.graph_run import Interrupted
from ..support.robot import RobotError
from .listener import ALARMS, NO_JOINT_TORQUE, NO_TORQUE, Moment
from .row import EITHER, GOES_ON, OFF, VERTICAL_OFF, Alarm, Failed, Row, Verdict
from .stand import Stand
from .ticks import PERIOD

LARGEST_STEP = 5.0
"""Change of the force on the resting hand within `STEP_S` [N]."""
STEP_S = 0.025
ROW_S = 75.0
_ALARM_S = 8.0
_SILENT_S = 2.5
_LONG_PAUSE_MS, _ATTEMPTS = 20, 3
_LARGEST_TORQUE = 0.25  # 65 N at the handle and the linearization's 0.025 Nm [Nm]
_LARGEST_JOINT_TORQUE = 26.0  # limit of the planar drives [Nm]


def judge(stand: Stand, row: Row) -> Verdict:
    """Carry out one row on a running stand. Raises Interrupted after Ctrl-C.

    A failure while the machine stood still, by the rig's own clock, says nothing about the robot:
    the row is then carried out again, which the verdict counts.
    """
    verdict, attempts = _judged(stand, row), 1
    while _says_nothing(verdict) and attempts < _ATTEMPTS:
        verdict, attempts = _judged(stand, row), attempts + 1
    return verdict._replace(attempts=attempts)


def _says_nothing(verdict: Verdict) -> bool:
    return not (verdict.passed or verdict.stuck) and verdict.stood_still > _LONG_PAUSE_MS


def _judged(stand: Stand, row: Row) -> Verdict:
    begun = time.monotonic()
    stand.deadline = begun + ROW_S
    facts: dict = {}
    problem, stuck = "", False
    slipped = stand.heard.slipped
    try:
        row.prepare(stand)
        _bring_up(stand, row.mode)
        _strike(stand, row, facts)
    except Failed as error:
        problem = str(error)
    except RobotError as error:
        problem = str(error)
    except Interrupted:
        raise
    except Exception as error:
        problem = f"the row itself is broken: {type(error).__name__}: {error}"
    stood_still = stand.heard.slipped - slipped
    if problem:
        stuck = not _recovered(stand, row, facts)
    stand.deadline = float("inf")
    facts.pop("back", None)
    seconds = time.monotonic() - begun
    return Verdict(
        row.name, problem, stuck=stuck, seconds=seconds, stood_still=stood_still, **facts
    )


def _bring_up(stand: Stand, mode: int) -> None:
    """Bring the robot into motion; what stopped it meanwhile was not the row."""
    while True:
        stand.ready(mode)
        try:
            stand.move()
        except RobotError:
            if time.monotonic() > stand.deadline - ROW_S / 2.0:
                raise
        else:
            return


def _take_back(stand: Stand, row: Row, facts: dict) -> None:
    facts["back"] = True
    row.back(stand)
    stand.dismiss()


def _recovered(stand: Stand, row: Row, facts: dict) -> bool:
    """Take the fault back after a failure, so that the next row has a fair chance."""
    stand.deadline = time.monotonic() + ROW_S
    try:
        if "back" not in facts:
            _take_back(stand, row, facts)
        stand.ready(row.mode)
    except Interrupted:
        raise
    except Exception:
        return False
    return True


def _strike(stand: Stand, row: Row, facts: dict) -> None:
    heard = stand.heard
    before = heard.mark()
    again = row.inject(stand)
    # The rig acts when it answers; what the question took is not the robot's time.
    begin = again or max(before, heard.now.time - PERIOD)
    if row.safe == EITHER:
        stand.until(lambda: heard.now.time > begin + row.watch, 10.0 + 2.0 * row.watch)
    if row.safe == GOES_ON or row.safe == EITHER and not heard.ever_disabled():
        _check_it_goes_on(stand, row, begin, facts)
        return
    if row.blind:
        _await_disabled(stand)
    else:
        _await_no_torque(stand, row, begin, facts)
    _await_alarm(stand, row, facts)
    _take_back(stand, row, facts)
    if not row.blind:
        _check_it_stays_off(stand, row, begin)
    stand.ready(row.mode)
    facts["step"] = _largest_step(heard.since(stand.enabled_at))
    if facts["step"] > LARGEST_STEP:
        raise Failed(f"a step of {facts['step']:.1f} N on the patient's hand on recovery")
    on = {"amplifier", "manus"} - heard.ever_disabled()
    if row.safe == OFF and on and not row.blind:
        raise Failed(f"{' and '.join(sorted(on))} was never disabled")


# Torque ------------------------------------------------------------------------------------


def _await_no_torque(stand: Stand, row: Row, begin: float, facts: dict) -> None:
    """Wait until the row's time is over and judge what the rig's motors did meanwhile."""
    if row.safe == EITHER:
        begin = stand.heard.now.time - row.within * PERIOD
    limit = begin + _longest(row) * PERIOD
    patience = 5.0 + 2.0 * _longest(row) * PERIOD
    if not stand.until(lambda: stand.heard.now.time > limit + 2 * PERIOD, patience):
        raise Failed("simulated time stands still")
    moments = stand.heard.since(begin)
    facts["vertical"] = _torque_samples(moments, begin, _vertical)
    facts["plane"] = _torque_samples(moments, begin, _plane)
    late = [("vertical", row.within)] if facts["vertical"] > row.within else []
    if row.safe == OFF and facts["plane"] > row.plane_within:
        late.append(("planar", row.plane_within))
    for which, limit in late:
        told = "; ".join(stand.heard.reasons()) or "no reason told"
        raise Failed(f"{which} torque after {limit} samples ({told})")


def _longest(row: Row) -> int:
    return max(row.within, row.plane_within)


def _vertical(moment: Moment) -> bool:
    return abs(moment.torque) > NO_TORQUE


def _plane(moment: Moment) -> bool:
    return max(map(abs, moment.joints)) > NO_JOINT_TORQUE


def _torque_samples(moments: Sequence[Moment], begin: float, has_torque) -> float:
    """Return for how many samples after `begin` there was torque."""
    last = max((moment.time for moment in moments if has_torque(moment)), default=begin)
    return (last - begin) / PERIOD


def _await_disabled(stand: Stand) -> None:
    """Wait until both drives say that they are off, where no rig can be asked."""
    heard = stand.heard
    if not stand.until(lambda: not (heard.enabled("amplifier") or heard.enabled("manus")), 5.0):
        raise Failed("a drive still says that it is enabled")


def _check_it_stays_off(stand: Stand, row: Row, begin: float) -> None:
    """The fault is gone: nothing may come back by itself."""
    heard = stand.heard
    if not heard.fresh("sim_rig") and not stand.until(lambda: heard.fresh("sim_rig"), 5.0):
        raise Failed("the rig is silent")
    heard.forget_enabled()
    quiet = heard.now.time
    stand.until(lambda: heard.now.time > quiet + row.watch, 10.0 + 2.0 * row.watch)
    off_since = quiet if row.safe == EITHER else min(begin + _longest(row) * PERIOD, heard.now.time)
    moments = heard.since(off_since)
    back = "vertical" if any(map(_vertical, moments)) else ""
    if row.safe == OFF and not back and any(map(_plane, moments)):
        back = "planar"
    if back:
        raise Failed(f"{back} torque came back by itself")
    allowed = {"manus"} if row.safe == VERTICAL_OFF else set()
    if again := heard.ever_enabled() - allowed:
        raise Failed(f"{', '.join(sorted(again))} enabled by itself")


def _check_it_goes_on(stand: Stand, row: Row, begin: float, facts: dict) -> None:
    """The robot must work on, and the row's alarm must come all the same."""
    heard = stand.heard
    stand.until(lambda: heard.now.time > begin + row.watch, 10.0 + 2.0 * row.watch)
    _await_alarm(stand, row, facts)
    moments, off = heard.since(begin), heard.ever_disabled()
    told = "; ".join(heard.reasons()) or "no reason told"
    _take_back(stand, row, facts)
    if not moments:
        raise Failed("simulated time stands still")
    if max(abs(m.torque) for m in moments) > _LARGEST_TORQUE:
        raise Failed("the vertical torque exceeds its limit")
    if max(max(map(abs, m.joints)) for m in moments) > _LARGEST_JOINT_TORQUE:
        raise Failed("a joint's torque exceeds its limit")
    if off:
        raise Failed(f"{', '.join(sorted(off))} went off ({told})")


def _largest_step(moments: Sequence[Moment]) -> float:
    """Return the largest change of a component of the patient's force within STEP_S [N].

    A knock in the play between nut and handle, of 5 ms, is none: the median of three counts.
    """
    largest, first = 0.0, 0
    times = [moment.time for moment in moments[1:-1]]
    forces = [_median(three) for three in zip(moments, moments[1:], moments[2:], strict=False)]
    for time_now, force in zip(times, forces, strict=True):
        while times[first] < time_now - STEP_S * 1.01:
            first += 1
        pairs = zip(forces[first], force, strict=True)
        largest = max(largest, *(abs(b - a) for a, b in pairs))
    return largest


def _median(three: Sequence[Moment]) -> tuple[float, ...]:
    return tuple(sorted(axis)[1] for axis in zip(*(one.force for one in three), strict=True))


# Alarm -------------------------------------------------------------------------------------


def _await_alarm(stand: Stand, row: Row, facts: dict) -> None:
    """Wait until the fault is told as the row says."""
    if row.alarm is None:
        return
    alarm, heard = row.alarm, stand.heard
    if not stand.until(lambda: not _missing(stand, alarm, facts), _ALARM_S):
        missing = _missing(stand, alarm, facts)
        said = [f"{n}: {m}" for n, level, m in heard.told() if level in ALARMS]
        raise Failed(
            f"no alarm: {missing}; told: {'; '.join(said) or 'nothing'}; "
            f"reasons: {'; '.join(heard.reasons()) or 'none'}"
        )


def _missing(stand: Stand, alarm: Alarm, facts: dict) -> str:
    """Return which part of the alarm has not come, empty when all has."""
    heard = stand.heard
    if alarm.node and not alarm.said:
        if heard.silent_for(f"diagnostics of {alarm.node}") < _SILENT_S:
            return f"{alarm.node} still speaks"
    elif alarm.node:
        found = [m for n, level, m in heard.told() if n == alarm.node and level in ALARMS
                 and re.search(alarm.said, m)]
        if not found:
            return f"diagnostics of {alarm.node}: {alarm.said!r}"
        facts["alarm"] = f"{alarm.node}: {found[0]}"
    if alarm.reason:
        found = [reason for reason in heard.reasons() if re.search(alarm.reason, reason)]
        if not found:
            return f"safety_state reason {alarm.reason!r}"
        facts["reason"] = found[0]
    return ""
