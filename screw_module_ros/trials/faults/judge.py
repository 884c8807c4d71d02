# SPDX-License-Identifier: Apache-2.0
"""Carries out one row and checks the safety contract.

The contract (docs/faults.md): torque zero within the row's time, no drive re-enables by itself,
the reason is reported, recovery needs no restart of the graph, and the patient feels no step. All
times are simulated.
"""

from __future__ import annotations

from screw_module_ros.clock import WallClock
from screw_module_ros.control.modes import OFF as MODE_OFF
from screw_module_ros.operator.robot import RobotError

from ..graph_run import Interrupted
from .limits import PERIOD
from .measures import (
    LARGEST_STEP,
    beyond_limits,
    largest_step,
    missing_of,
    plane,
    torque_samples,
    vertical,
)
from .row import EITHER, GOES_ON, OFF, VERTICAL_OFF, Failed, Row, Verdict
from .testbed import Testbed

ROW_S = 60.0
_ALARM_S = 8.0
_AFTERWARDS_S = 0.2  # a robot that continues is observed after the cause has gone
_DRIVES = ("amplifier", "manus")
_WALL = WallClock()  # measures the duration of a row


def judge(testbed: Testbed, row: Row) -> Verdict:
    """Carry out one row on a running testbed. Raises Interrupted after Ctrl-C."""
    return _Trial(testbed, row).verdict()


class _Trial:
    """One row: motion, fault, detection, removal of the cause, recovery to operation."""

    def __init__(self, testbed: Testbed, row: Row):
        self.testbed, self.row, self.listener = testbed, row, testbed.listener
        self._facts: dict = {}
        self._cause_removed = False

    def verdict(self) -> Verdict:
        """Carry out the row."""
        testbed, begun_ns, begun = self.testbed, _WALL.now_ns(), self.listener.time
        problem = self._problem()
        stuck = bool(problem) and not self._recovered()
        testbed.deadline = float("inf")
        return Verdict(
            self.row.name, problem, stuck,
            seconds=(_WALL.now_ns() - begun_ns) * 1e-9,
            simulated=self.listener.time - begun,
            **self._facts,
        )  # fmt: skip

    def _problem(self) -> str:
        testbed, row = self.testbed, self.row
        testbed.deadline = self.listener.time + ROW_S
        try:
            row.prepare(testbed)
            testbed.ready(row.mode)
            testbed.patient.move(row.mode)
            self._inject()
        except (Failed, RobotError) as error:
            return str(error)
        except Interrupted:
            raise
        except Exception as error:
            return f"defect in the row: {type(error).__name__}: {error}"
        return ""

    def _recovered(self) -> bool:
        """End the fault and recover after a failure, for the next row; return success."""
        self.testbed.deadline = self.listener.time + ROW_S
        try:
            if not self._cause_removed:
                self._remove_cause()
            self.testbed.ready(self.row.mode)
        except Interrupted:
            raise
        except Exception:
            return False
        return True

    def _remove_cause(self) -> None:
        """Remove the cause; wait for restarted nodes, which might enable a drive by themselves."""
        self._cause_removed = True
        self.row.back(self.testbed)
        self.testbed.intruders.dismiss()
        self.testbed.await_restarted()

    # Fault -----------------------------------------------------------------------------------

    def _inject(self) -> None:
        row, testbed = self.row, self.testbed
        before = self.listener.mark()
        begin = row.inject(testbed) or max(before, testbed.listener.time)
        if row.safe == EITHER:
            self._pass(begin + row.watch)
        if row.safe == GOES_ON or row.safe == EITHER and not self.listener.disabled_at():
            self._goes_on(before, begin)
        else:
            self._stops(begin)

    def _stops(self, begin: float) -> None:
        if self.row.safe == EITHER:  # the time of its effect is unknown: count from the stop
            begin = min(self.listener.disabled_at().values())
            self._await_reason()
        self._await_no_torque(begin)
        if self.row.safe == VERTICAL_OFF:
            self._check_drives({"manus"})
            self._check_torque(self._longest, plane, "the plane")
        self._await_alarm()
        self._remove_cause()
        self._check_it_stays_off(begin)
        self._recover()
        on = set(_DRIVES) - set(self.listener.disabled_at())
        if self.row.safe == OFF and on:
            raise Failed(f"{' and '.join(sorted(on))} was never disabled")

    def _pass(self, until: float) -> None:
        """Let simulated time pass."""
        self.testbed.robot.pause(max(0.0, until - self.listener.time))

    # Off ---------------------------------------------------------------------------------------

    @property
    def _longest(self) -> float:
        """The longer time limit of the row [s]."""
        return max(self.row.within, self.row.plane_within) * PERIOD

    def _await_no_torque(self, begin: float) -> None:
        """Wait for the row's time limits, then check the torque of the rig's motors."""
        row = self.row
        self._pass(begin + self._longest + 10 * PERIOD)
        moments = self.listener.since(begin)
        on, plane_on = (torque_samples(moments, begin, which) for which in (vertical, plane))
        self._facts.update(vertical=on, plane=plane_on)
        if on > row.within:
            raise Failed(f"vertical torque after {row.within} samples ({self._reasons()})")
        if row.safe != VERTICAL_OFF and plane_on > row.plane_within:
            raise Failed(f"planar torque after {row.plane_within} samples ({self._reasons()})")

    def _check_it_stays_off(self, begin: float) -> None:
        """Check that no torque and no drive comes back by itself after the fault."""
        listener, row = self.listener, self.row
        listener.forget_enabled()
        quiet = listener.time
        self._pass(quiet + row.watch)
        moments = listener.since(min(begin + self._longest, quiet))
        if any(map(vertical, moments)):
            raise Failed("vertical torque came back by itself")
        if row.safe != VERTICAL_OFF and any(map(plane, moments)):
            raise Failed("planar torque came back by itself")
        allowed = {"manus"} if row.safe == VERTICAL_OFF else set()
        if again := listener.ever_enabled() - allowed:
            raise Failed(f"{', '.join(sorted(again))} enabled by itself")

    def _recover(self) -> None:
        """Recover with the services of the row only; check the force step on the patient's hand."""
        self.testbed.recovery.steps.clear()
        self.testbed.ready(self.row.mode)
        self._facts["step"] = largest_step(self.listener.since(self.testbed.recovery.enabled_at))
        if self._facts["step"] > LARGEST_STEP:
            raise Failed(f"a step of {self._facts['step']:.1f} N on the patient's hand on recovery")
        steps = self.testbed.recovery.steps
        if more := [step for step in steps if step.rpartition("/")[2] not in self.row.recovery]:
            raise Failed(f"recovery needs {', '.join(sorted(more))} as well")

    # On ----------------------------------------------------------------------------------------

    def _goes_on(self, before: float, begin: float) -> None:
        """Check that the robot continues, also after the cause has gone, and reports an alarm."""
        self._pass(begin + self.row.watch)
        self._await_alarm()
        if problem := beyond_limits(self.listener.since(before)):
            raise Failed(problem)
        self._check_drives(set(_DRIVES))
        if not self.row.limp:
            half = self.row.watch / 2.0
            self._check_torque(half, plane, "the plane")
            if self.row.mode != MODE_OFF:
                self._check_torque(half, vertical, "the vertical axis")
        self._remove_cause()
        if self.row.safe == GOES_ON:  # with EITHER the end of the fault may stop the robot
            self._pass(self.listener.time + _AFTERWARDS_S)
            self._check_drives(set(_DRIVES))

    def _check_drives(self, wanted: set[str]) -> None:
        off = wanted & set(self.listener.disabled_at())
        if off:
            raise Failed(f"{', '.join(sorted(off))} went off ({self._reasons()})")
        silent = [node for node in sorted(wanted) if not self.listener.enabled(node)]
        if silent:
            raise Failed(f"{', '.join(silent)} is silent")

    def _check_torque(self, seconds: float, has_torque, which: str) -> None:
        """Check that an enabled drive gives torque."""
        if not any(map(has_torque, self.listener.since(self.listener.time - seconds))):
            raise Failed(f"{which} is enabled but gives no torque")

    # Reports -----------------------------------------------------------------------------------

    def _reasons(self) -> str:
        return "; ".join(self.listener.reasons()) or "no reason reported"

    def _await_reason(self) -> None:
        self.testbed.robot.wait_until(
            self.listener.reasons, _ALARM_S, "stopped without a reason in safety_state"
        )
        self._facts["reason"] = self.listener.reasons()[0]

    def _await_alarm(self) -> None:
        """Wait until the fault is reported as the row says."""
        alarm, listener = self.row.alarm, self.listener
        if alarm is None:
            return
        if not self.testbed.robot.met(
            lambda: not missing_of(alarm, listener, self._facts), _ALARM_S
        ):
            missing = missing_of(alarm, listener, self._facts)
            alarms = "; ".join(f"{n}: {', '.join(m)}" for n, m in listener.alarms().items())
            raise Failed(f"no alarm: {missing}; alarms: {alarms}; reasons: {self._reasons()}")
