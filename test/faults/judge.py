# SPDX-License-Identifier: Apache-2.0
"""Checks of the safety contract (docs/faults.md); all times are simulated.

Torque zero within the row's time, no drive enables by itself, the reason is reported, recovery
needs no restart of the graph and no other service than the row's, and the patient feels no step.
"""

from __future__ import annotations

from collections.abc import Callable

from fault_robot import FaultRobot
from record import (
    DRIVES,
    LARGEST_JOINT_TORQUE,
    LARGEST_STEP,
    LARGEST_TORQUE,
    largest_step,
    plane,
    torque_samples,
    vertical,
)
from row import EITHER, GOES_ON, OFF, PERIOD, VERTICAL_OFF, Row

from screw_module_ros.control.modes import OFF as MODE_OFF

_REPORTED_S = 8.0
_AFTERWARDS_S = 0.2  # a robot that continues is observed after the cause has gone

Note = Callable[[str, str], None]
"""Receives name and value of what a row has measured."""


def judge(robot: FaultRobot, row: Row, note: Note) -> None:
    """Cause the row's fault on a robot in motion, judge what follows, bring the robot back."""
    before = robot.record.mark()
    begin = row.inject(robot) or max(before, robot.time)
    if row.outcome == EITHER:
        robot.until(begin + row.watch)
    if row.outcome == GOES_ON or row.outcome == EITHER and not robot.record.disabled_at:
        judge_goes_on(robot, row, before, begin, note)
        return
    if row.outcome == EITHER:  # the time of its effect is unknown: count from the stop
        begin = min(robot.record.disabled_at.values())
        assert robot.met(lambda: robot.record.reasons, _REPORTED_S), "stopped without a reason"
        note("reason", next(iter(robot.record.reasons)))
    judge_no_torque(robot, row, begin, note)
    judge_reported(robot, row, note)
    robot.mend(row)
    judge_stays_off(robot, row, begin)
    judge_recovery(robot, row, note)
    on = DRIVES - set(robot.record.disabled_at)
    assert row.outcome != OFF or not on, f"{' and '.join(sorted(on))} was never disabled"


def judge_no_torque(robot: FaultRobot, row: Row, begin: float, note: Note) -> None:
    """Wait for the row's time limits, then check the torque of the rig's motors."""
    robot.until(begin + row.longest + 10 * PERIOD)
    moments = robot.record.since(begin)
    on, plane_on = (torque_samples(moments, begin, which) for which in (vertical, plane))
    note("vertical", f"{on:.1f}")
    note("plane", f"{plane_on:.1f}")
    assert on <= row.within, f"vertical torque; {robot.record.text()}"
    if row.outcome == VERTICAL_OFF:
        _check_drives(robot, {"manus"})
        _check_torque(robot, row.longest, plane, "the plane")
    else:
        assert plane_on <= row.plane_within, f"planar torque; {robot.record.text()}"


def judge_reported(robot: FaultRobot, row: Row, note: Note) -> None:
    """Wait until the fault is reported as the row says."""
    if row.report is None:
        return
    reported = robot.met(lambda: robot.record.found(row.report), _REPORTED_S)
    assert reported, f"not reported: {row.report.text}; {robot.record.text()}"
    said, reason = robot.record.found(row.report)
    note("alarm", said)
    note("reason", reason)


def judge_stays_off(robot: FaultRobot, row: Row, begin: float) -> None:
    """Check that no torque and no drive comes back by itself after the fault."""
    record = robot.record
    record.look()
    record.ever_enabled.clear()
    quiet = robot.time
    robot.hand.rest()  # for the way back; the set point stays off the hand
    robot.until(quiet + row.watch)
    # From the row's limit on, not only since the cause has gone.
    moments = record.since(min(begin + row.longest, quiet))
    assert not any(map(vertical, moments)), "vertical torque came back by itself"
    works = row.outcome == VERTICAL_OFF
    assert works or not any(map(plane, moments)), "planar torque came back by itself"
    again = record.ever_enabled - ({"manus"} if works else set())
    assert not again, f"{', '.join(sorted(again))} enabled by itself"


def judge_recovery(robot: FaultRobot, row: Row, note: Note) -> None:
    """Recover; check the services that it needed, and the force step on the patient's hand."""
    operation = robot.ready(row.mode)
    step = largest_step(robot.record.since(operation.enabled_ns * 1e-9))
    note("step", f"{step:.2f}")
    note("services", " ".join(sorted(operation.services)))
    assert step <= LARGEST_STEP, f"a step of {step:.1f} N on the patient's hand on recovery"
    more = operation.services - set(row.services)
    assert not more, f"recovery needs {', '.join(sorted(more))} as well"


def judge_goes_on(
    robot: FaultRobot, row: Row, before: float, begin: float, note: Note
) -> None:
    """Check that the robot continues, also after the cause has gone, and reports an alarm."""
    robot.until(begin + row.watch)
    judge_reported(robot, row, note)
    moments = robot.record.since(before)
    assert max(abs(moment.torque) for moment in moments) <= LARGEST_TORQUE
    assert max(max(map(abs, moment.joints)) for moment in moments) <= LARGEST_JOINT_TORQUE
    _check_drives(robot, DRIVES)
    if not row.limp:
        _check_torque(robot, row.watch / 2.0, plane, "the plane")
        if row.mode != MODE_OFF:
            _check_torque(robot, row.watch / 2.0, vertical, "the vertical axis")
    robot.mend(row)
    if row.outcome == GOES_ON:  # with EITHER the end of the fault may stop the robot
        robot.pause(_AFTERWARDS_S)
        _check_drives(robot, DRIVES)


def _check_drives(robot: FaultRobot, wanted: set[str]) -> None:
    robot.record.look()
    off = wanted & set(robot.record.disabled_at)
    assert not off, f"{', '.join(sorted(off))} went off; {robot.record.text()}"
    silent = [node for node in sorted(wanted) if not robot.record.enabled(node)]
    assert not silent, f"{', '.join(silent)} is silent"


def _check_torque(robot: FaultRobot, seconds: float, has_torque, which: str) -> None:
    """Check that an enabled drive gives torque."""
    given = any(map(has_torque, robot.record.since(robot.time - seconds)))
    assert given, f"{which} is enabled but gives no torque"
