# SPDX-License-Identifier: Apache-2.0
"""Rows about a law that somebody else wrote, in the running graph: whatever it does, it is bounded.

What it takes too long for is judged by wall clock alone: `test/nodes/test_laws_of_others.py`.
"""

from __future__ import annotations

from laws_of_others import ODD
from row import (
    AT_ONCE,
    BY_CHANCE,
    CLEAR,
    EITHER,
    MODE,
    STOPPED,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
    goes_on,
)

GROUP = "laws of others"
_FADED_S = 1.1
_CONTROLLER = "impedance_controller"
_QUIET = {"odd.pull": 0.0, "odd.damping": 5.0, "odd.nan": False, "odd.raises": False}
_BY_SERVICE = 30
"""Samples in which a client's change of a parameter is answered, after it has taken effect."""


def _law_with(**asked) -> Act:
    """Let the law take over, then ask for something."""

    def act(robot) -> float:
        robot.set_mode(ODD)
        robot.pause(_FADED_S)
        begun = robot.time
        robot.set_parameters(_CONTROLLER, {f"odd.{name}": value for name, value in asked.items()})
        return begun

    return act


def _quiet(robot) -> None:
    robot.set_parameters(_CONTROLLER, _QUIET)


def _ends(name: str, fault: str, said: str, **asked) -> Row:
    return Row(
        f"law-{name}", GROUP, f"a law from outside the package {fault}", _law_with(**asked),
        Report(_CONTROLLER, said, _CONTROLLER), (CLEAR, MODE, *STOPPED), "impedance_controller",
        _BY_SERVICE + AT_ONCE, _BY_SERVICE + AT_ONCE + VIA_SUPERVISOR, mend=_quiet,
    )  # fmt: skip


ROWS = [
    _ends("nan", "answers NaN", "law odd: its answer is no number", nan=True),
    _ends("raises", "raises an error", "law odd: KeyError", raises=True),
    goes_on("law-asks-500-n", GROUP, "a law from outside the package asks for 500 N on the hand",
            _law_with(pull=500.0), "no node: the envelope bounds it", mend=_quiet),
    Row("law-unstable", GROUP, "a law from outside the package has a damper of -100 Ns/m",
        _law_with(damping=-100.0), None, (CLEAR, MODE, *STOPPED), "guard's damper, speed limit",
        BY_CHANCE, BY_CHANCE, mend=_quiet, outcome=EITHER, watch=1.0),
]  # fmt: skip
