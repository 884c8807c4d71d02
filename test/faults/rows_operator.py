# SPDX-License-Identifier: Apache-2.0
"""Rows about actions of an operator and of a patient."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import row
from acts import both, called, cured, fault, held_by, paused, refused, repeated, switched
from hand import LEAVE, MARK, STILL
from record import seconds
from row import (
    BY_CHANCE,
    BY_SERVICE,
    CLEAR,
    EITHER,
    ENABLE,
    HOME,
    MISSED,
    PLANE_CLEAR,
    RESET,
    SILENT,
    STOPPED,
    VERTICAL_OFF,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
)
from screw_module_msgs.msg import ImpedanceState, SafetyState
from screw_module_msgs.srv import SetFixture
from std_srvs.srv import SetBool

from screw_module_ros.control.modes import COMBINED, FORCE_FEEDBACK
from screw_module_ros.graph import MODULE
from screw_module_ros.operator.robot import arm

GROUP = "operator"
_ESTOP = Report("supervisor", "emergency stop", "emergency stop")
_REASON = Report("", "", "emergency stop")
_ARRIVES_S = 0.02
_BOTTOM, _TOP = 0.005, 0.355  # the end stops are at 0 and 0.36 [m]
_FAST = 0.5  # [m/s]
_LIMITS = "impedance_controller: soft stop, speed limit"
_goes_on = partial(row.goes_on, group=GROUP, watch=0.3)


def _stops(name: str, text: str, act: Act, who: str, report: Report | None, services) -> Row:
    return Row(name, GROUP, text, act, report, services, who, BY_SERVICE, BY_SERVICE)


def _by_chance(name: str, text: str, act: Act, who: str) -> Row:
    """Return a row whose blow may stop the robot; a hard one looks like a jump of the encoder."""
    return Row(name, GROUP, text, act, None, (HOME, *STOPPED), who, BY_CHANCE, BY_CHANCE,
               outcome=EITHER, watch=0.8)  # fmt: skip


def _still_estopped(robot) -> None:
    """Check what the new process says; simulated time hardly moves while it starts."""
    ended = robot.time
    robot.restart("supervisor")
    robot.await_restarted()

    def newer() -> bool:
        state = robot.state(SafetyState)
        return state is not None and seconds(state.header.stamp) > ended

    robot.wait_until(newer, 2.0, "the new supervisor is silent")
    assert robot.newest(SafetyState).estopped, "the emergency stop was lost in the restart"


def _lock_reported(robot) -> None:
    def is_reported() -> bool:
        state = robot.state(SafetyState)
        return state is not None and state.vertical_locked

    robot.wait_until(is_reported, 3.0, "safety_state does not report the lock")


def _until_latched(robot) -> None:
    record = robot.record
    robot.met(lambda: len(record.disabled_at) == 2, 3.0)
    robot.met(lambda: any("encoder" in reason for reason in record.reasons), 3.0)
    robot.pause(0.6)  # until the encoder counts as lost instead of late


def _at_rest_elsewhere(robot) -> None:
    """Let the hand rest in the equilibrium of spring and arm, away from the mark."""
    robot.hand.rest()
    robot.wait_until(lambda: robot.hand.at_rest, 5.0, "the hand does not come to rest")


def _home_elsewhere(robot) -> float:
    """Request homing repeatedly, away from the last homing position: the origin must not move."""
    begin = robot.time
    for service in ENABLE:
        switched(service, False)(robot)
    there = (LEAVE, LEAVE, MARK + 0.08)  # friction stops the handle before it
    still = (LEAVE, LEAVE, 0.0)
    robot.set_arm(arm(there, amplitude=still, omega=still))
    robot.wait_until(
        lambda: robot.record.now.height > MARK + 0.02, 5.0, "the hand does not leave the mark"
    )
    robot.pause(1.0)
    before = robot.record.now.height
    repeated(refused(HOME, said="against the last homing"), 10)(robot)
    state = robot.newest(ImpedanceState)
    assert abs(state.position - before) <= 0.005, "the origin has moved"
    robot.hand.to_mark()
    return begin


def _thrown(height: float, arrived: Callable[[float], bool]) -> Act:
    """Throw the handle to a height [m]; wait until it reaches the stop, and check its speed."""

    def act(robot) -> None:
        robot.set_arm(arm((0.0, 0.0, height), 0.1, amplitude=STILL, omega=STILL))
        begin = robot.time
        robot.wait_until(
            lambda: arrived(robot.record.now.height), 3.0, "the handle did not reach the end stop"
        )
        assert max(abs(moment.speed) for moment in robot.record.since(begin)) >= _FAST

    return act


def _pin(locked: bool) -> Act:
    def act(robot) -> None:
        request = SetFixture.Request(fixture="", position=LEAVE, locked=locked)
        robot.ask(SetFixture, "sim_rig/set_fixture", request)

    return act


_estop, _reset = called("supervisor/estop"), called(RESET)
_LOCK = "supervisor/lock_vertical"
ROWS = [
    _stops("estop", "emergency stop", _estop, "supervisor", _ESTOP, STOPPED)._replace(
        mode=COMBINED),
    _stops("estop-pressed-often", "emergency stop, 20 times", repeated(_estop, 20), "supervisor",
           _ESTOP, STOPPED),
    _stops("estop-reset-at-once", "emergency stop, reset while still stopping",
           both(_estop, _reset), "supervisor", _REASON, STOPPED),
    _stops("estop-enable-without-reset", "enable after an emergency stop, without reset",
           # Before the stop has reached the drives' nodes, they are still enabled.
           both(_estop, paused(_ARRIVES_S), refused(ENABLE[0], SetBool, data=True),
                refused(ENABLE[1], SetBool, data=True)),
           "amplifier, manus refuse", _ESTOP, STOPPED),
    _stops("reset-while-cause-persists", "cable out, reset again and again",
           both(fault("encoder", "cable_out"), _until_latched, repeated(refused(RESET), 10)),
           "supervisor refuses", Report("supervisor", "encoder", "encoder"), MISSED)._replace(
        mend=cured("encoder"), within=SILENT, plane_within=SILENT + VIA_SUPERVISOR),
    _stops("estop-and-supervisor-killed", "emergency stop, and the supervisor killed at once",
           both(_estop, lambda robot: robot.kill("supervisor")),
           "supervisor: still stopped after its restart", _REASON,
           (CLEAR, PLANE_CLEAR, *STOPPED))._replace(mend=_still_estopped, shared=MODULE),
    _goes_on("reset-while-enabled", fault="reset while a drive is enabled",
             act=repeated(refused(RESET, said="still enabled"), 5), who="supervisor refuses"),
    _goes_on("enable-again", fault="enable while enabled, 20 times",
             act=repeated(both(switched(ENABLE[0], True), switched(ENABLE[1], True)), 10),
             who="amplifier, manus: nothing changes"),
    _goes_on("home-while-moving", fault="encoder/home in motion",
             act=repeated(refused(HOME, said="enabled"), 3), who="encoder refuses"),
    _goes_on("home-while-enabled", fault="encoder/home while enabled, the hand at rest elsewhere",
             act=both(_at_rest_elsewhere, refused(HOME, said="disable it first")),
             who="encoder refuses: a new origin would move soft stops and set points"),
    _stops("home-elsewhere", "encoder/home while disabled, away from the mark", _home_elsewhere,
           "encoder refuses the first request, and a repetition at once", None, (HOME, *ENABLE)
           )._replace(watch=0.3),
    _goes_on("plane-home-while-enabled", fault="manus/home while enabled",
             act=refused("manus/home", said="disable"), who="manus refuses"),
    Row("lock-vertical", GROUP, "supervisor/lock_vertical in motion",
        both(switched(_LOCK, True), _lock_reported), None, ENABLE[:1], "supervisor",
        BY_SERVICE + 20, outcome=VERTICAL_OFF, mend=switched(_LOCK, False)),
    _stops("disable", "both drives disabled by their services, in motion",
           both(switched(ENABLE[0], False), switched(ENABLE[1], False)), "amplifier, manus", None,
           ENABLE),
    _by_chance("end-stop-full-speed", "the patient throws the handle against the upper end stop",
               _thrown(0.5, lambda height: height > _TOP), _LIMITS),
    _by_chance("end-stop-bottom", "the patient throws the handle against the lower end stop",
               _thrown(-0.3, lambda height: height < _BOTTOM), _LIMITS)._replace(
        mode=FORCE_FEEDBACK),
    _goes_on("patient-lets-go", fault="the patient lets go of the handle", act=held_by("free"),
             who="no node: forces stay within their limits", mend=held_by("human_arm"),
             mode=FORCE_FEEDBACK, watch=0.8),
    _by_chance("pin-in-while-enabled", "the lock pin is inserted in motion", _pin(True),
               "no node, or impedance_controller by the jolt")._replace(mend=_pin(False)),
]  # fmt: skip
