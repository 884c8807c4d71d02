# SPDX-License-Identifier: Apache-2.0
"""Rows about a patient's arm that hangs on the handle when the torque goes.

They state what happens today, within a tenth or two: it falls. Whatever holds it in future changes
them.
"""

from __future__ import annotations

from typing import NamedTuple

from acts import both, called, cured, fault, reconfigured
from row import (
    AT_ONCE,
    BY_SERVICE,
    MISSED,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
    nothing,
)

GROUP = "arm"
WEIGHT = 20.0
"""Of the arm, on the handle: the most that thesis 2.1.1 found [N]."""
_RAMP = 1000 + AT_ONCE
"""Samples: the rig's drive brakes for 1 s at most."""
_SOON_S, _LATER_S = 0.5, 2.5  # after the fault; by then the handle is down
_LEAST_HEIGHT = 0.2  # [m] from which it falls
_OWN_SPRING = 4.0  # [N] at most, of a limp arm that has sunk
_RAISED = (0.05, 0.05, 0.36, 0.0, 0.0, 0.0)
"""Set point [m], [m/s] whose spring and the screw's friction hold the arm."""


class Fall(NamedTuple):
    """What the hand goes through: the least and the most of each.

    soon: way down in 0.5 s [m]; blow: largest force between hand and handle at the stop [N]. Some
    170 N last for 10 ms; nut and handle knock in their play on top, of which sim/truth shows every
    second millisecond.
    """

    soon: tuple[float, float]
    blow: tuple[float, float]

    @property
    def text(self) -> str:
        """The bounds in words."""
        low, high = (1e3 * way for way in self.soon)
        least, most = self.blow
        return (
            f"it falls {low:.0f} to {high:.0f} mm in {_SOON_S:g} s, meets the stop with "
            f"{least:.0f} to {most:.0f} N"
        )


_ESTOP = Report("supervisor", "emergency stop", "emergency stop")
_OVER_CURRENT = Report("amplifier", "2310", "amplifier")
_STO = Report("amplifier", "left operation enabled", "amplifier")
_COASTS = Fall((0.150, 0.180), (150.0, 350.0))
_BRAKES = Fall((0.006, 0.010), (150.0, 350.0))


def _hangs(robot) -> None:
    """Let the arm hang at rest, held by the robot's spring."""
    robot.setpoint = _RAISED
    robot.hand.rest()
    robot.wait_until(lambda: robot.hand.at_rest, 5.0, "the hand does not come to rest")
    robot.hand.hang(WEIGHT)

    def hangs() -> bool:
        return robot.hand.at_rest and abs(robot.record.now.force[2] + WEIGHT) < _OWN_SPRING

    robot.wait_until(hangs, 5.0, "the arm does not come to rest")
    height = robot.record.now.height
    assert height > _LEAST_HEIGHT, f"it has sunk to {height:.3f} m before the fault"


def _falls(cause: Act, fall: Fall) -> Act:
    """Cause the fault under a hanging arm; check at the handle what its hand goes through."""

    def act(robot) -> float:
        _hangs(robot)
        start = robot.record.now.height
        begin = cause(robot)
        robot.until(begin + _LATER_S)
        moments = robot.record.since(begin)
        soon = start - next(m.height for m in moments if m.time >= begin + _SOON_S)
        blow = max(abs(moment.force[2]) for moment in moments)
        assert fall.soon[0] <= soon <= fall.soon[1], f"{1e3 * soon:.0f} mm in {_SOON_S:g} s"
        assert fall.blow[0] <= blow <= fall.blow[1], f"{blow:.0f} N at the stop"
        return begin

    return act


def _row(
    cause: str, reaction: str, text: str, act: Act, report: Report, within: int, fall: Fall,
    mend: Act = nothing,
) -> Row:  # fmt: skip
    """Return the row of a cause; reaction: of the vertical drive, `stop_reaction`."""
    row = Row(
        f"arm-falls-{cause}-{reaction}", GROUP,
        f"{text}; arm of {WEIGHT:g} N, {reaction}: "
        f"{fall.text}",
        _falls(act, fall), report, MISSED, report.node, within,
        within if report is _ESTOP else within + VIA_SUPERVISOR,
        mend=both(lambda robot: robot.hand.set_up(), mend), watch=0.3,
    )  # fmt: skip
    if reaction == "coast":
        return row
    return row._replace(
        prepare=reconfigured("amplifier", "stop_reaction", "brake"),
        mend=both(row.mend, reconfigured("amplifier", "stop_reaction", "coast")),
        within=max(row.within, _RAMP) if fall is _BRAKES else row.within,
    )


_SOFTWARE = ("estop", "software stop", called("supervisor/estop"), _ESTOP)
_FAULT = ("fault", "drive: over-current", fault("drive", "over_current"), _OVER_CURRENT)
_SUPPLY = ("sto", "drive: safe torque off, as by the emergency stop",
           fault("drive", "torque_off"), _STO)  # fmt: skip


def _rows(kind, within: int, brakes: Fall, mend: Act = nothing) -> list[Row]:
    cause, text, act, report = kind
    return [
        _row(cause, "coast", text, act, report, within, _COASTS, mend),
        _row(cause, "brake", text, act, report, within, brakes, mend),
    ]


ROWS = [
    *_rows(_SOFTWARE, BY_SERVICE, _BRAKES),
    *_rows(_FAULT, AT_ONCE, _BRAKES, cured("drive")),
    *_rows(_SUPPLY, AT_ONCE, _COASTS, cured("drive")),  # without power nothing brakes
]
