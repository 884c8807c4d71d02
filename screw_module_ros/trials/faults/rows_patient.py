# SPDX-License-Identifier: Apache-2.0
"""Rows about actions of a patient."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from screw_module_msgs.srv import SetFixture

from screw_module_ros.control.modes import FORCE_FEEDBACK
from screw_module_ros.operator.robot import arm

from .acts import both, held_by
from .limits import DYING, VIA_SUPERVISOR
from .row import EITHER, Act, Failed, Row
from .rows_operator import goes_on

_BY_CHANCE = VIA_SUPERVISOR + 2 * DYING
_BOTTOM, _TOP = 0.005, 0.355  # the end stops are at 0 and 0.36 [m]
_FAST = 0.5  # [m/s]


def rows() -> Iterator[Row]:
    """Return the rows of throws against the end stops, letting go, and the lock pin."""
    yield Row(
        name="end-stop-full-speed", group="operator",
        fault="the patient throws the handle against the upper end stop",
        inject=both(_throw(0.5), _hits(lambda height: height > _TOP)),
        alarm=None, recovery="reset, enable",
        noticed_by="impedance_controller: soft stop, speed limit", within=_BY_CHANCE,
        plane_within=_BY_CHANCE, safe=EITHER, watch=0.8,
    )  # fmt: skip
    yield Row(
        name="end-stop-bottom", group="operator",
        fault="the patient throws the handle against the lower end stop",
        inject=both(_throw(-0.3), _hits(lambda height: height < _BOTTOM)),
        alarm=None, recovery="reset, enable",
        noticed_by="impedance_controller: soft stop, speed limit", within=_BY_CHANCE,
        plane_within=_BY_CHANCE, safe=EITHER, watch=0.8, mode=3,
    )  # fmt: skip
    yield goes_on("patient-lets-go", "the patient lets go of the handle", held_by("free"),
                   "no node: forces stay within their limits",
                   held_by("human_arm"))._replace(mode=FORCE_FEEDBACK, watch=0.8)  # fmt: skip
    yield Row(
        name="pin-in-while-enabled", group="operator", fault="the lock pin is inserted in motion",
        inject=_pin(True), back=_pin(False), alarm=None, recovery="pin out, reset, enable",
        noticed_by="no node, or impedance_controller by the jolt", within=_BY_CHANCE,
        plane_within=_BY_CHANCE, safe=EITHER, watch=0.8,
    )  # fmt: skip


def _throw(height: float) -> Act:
    def act(testbed) -> None:
        testbed.robot.set_arm(arm((0.0, 0.0, height), 0.1, amplitude=(0.0,) * 3, omega=(0.0,) * 3))

    return act


def _hits(arrived: Callable[[float], bool]) -> Act:
    """Wait until the handle reaches the stop; check its speed."""

    def act(testbed) -> None:
        begin = testbed.listener.time
        testbed.robot.wait_until(
            lambda: arrived(testbed.listener.now.height),
            3.0,
            "the handle did not reach the end stop",
        )
        fastest = max(abs(moment.speed) for moment in testbed.listener.since(begin))
        if fastest < _FAST:
            raise Failed(f"the handle reached the end stop with only {fastest:.2f} m/s")

    return act


def _pin(locked: bool) -> Act:
    def act(testbed) -> None:
        request = SetFixture.Request(fixture="", position=float("nan"), locked=locked)
        testbed.robot.ask(SetFixture, "sim_rig/set_fixture", request)

    return act
