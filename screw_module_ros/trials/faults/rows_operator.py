# SPDX-License-Identifier: Apache-2.0
"""Rows about actions of an operator."""

from __future__ import annotations

import math
from collections.abc import Iterator

from screw_module_msgs.msg import ImpedanceState, SafetyState
from std_srvs.srv import SetBool

from screw_module_ros.control.modes import COMBINED
from screw_module_ros.operator.robot import arm

from .acts import both, called, cured, fault, refused, repeated, switched
from .limits import BY_SERVICE, DYING, STALE, VIA_SUPERVISOR
from .listener import seconds
from .patient import HOME
from .recovery import AGAIN
from .row import GOES_ON, MISSED, OFF, VERTICAL_OFF, Act, Alarm, Failed, Row, nothing

_ESTOP = Alarm("supervisor", "emergency stop", "emergency stop")
_RESET = "supervisor/reset, enable"
_ARRIVES_S = 0.02


def rows() -> Iterator[Row]:
    """Return the rows of emergency stop, reset, enable, home and lock."""
    yield _stops("estop", "emergency stop", called("supervisor/estop"), "supervisor", _ESTOP,
                 _RESET)._replace(mode=COMBINED)  # fmt: skip
    yield from _operator()


def _stops(name: str, text: str, act: Act, who: str, alarm: Alarm | None, recovery: str) -> Row:
    return Row(
        name=name, group="operator", fault=text, inject=act, alarm=alarm, recovery=recovery,
        noticed_by=who, within=BY_SERVICE, plane_within=BY_SERVICE,
    )  # fmt: skip


def goes_on(name: str, text: str, act: Act, who: str, back: Act = nothing) -> Row:
    """Return a row in which the robot continues without any recovery."""
    return Row(
        name=name, group="operator", fault=text, inject=act, back=back, alarm=None,
        recovery="none is needed", noticed_by=who, safe=GOES_ON, watch=0.3,
    )  # fmt: skip


def _operator() -> Iterator[Row]:
    estop, reset = called("supervisor/estop"), called("supervisor/reset")
    yield _stops("estop-pressed-often", "emergency stop, 20 times", repeated(estop, 20),
                 "supervisor", _ESTOP, _RESET)  # fmt: skip
    yield _stops("estop-reset-at-once", "emergency stop, reset while still stopping",
                 both(estop, reset), "supervisor", Alarm("", "", "emergency stop"),
                 "reset where it was refused, enable")  # fmt: skip
    yield _stops("estop-enable-without-reset", "enable after an emergency stop, without reset",
                 both(estop, _await_stop, refused("amplifier/enable", SetBool, data=True),
                      refused("manus/enable", SetBool, data=True)),
                 "amplifier, manus refuse", _ESTOP, _RESET)  # fmt: skip
    yield _stops("reset-while-cause-persists", "cable out, reset again and again",
                 both(fault("encoder", "cable_out"), _until_latched,
                      repeated(refused("supervisor/reset", said=""), 10)),
                 "supervisor refuses", Alarm("supervisor", "encoder", "encoder"),
                 f"plug it in; {MISSED}, reset, enable")._replace(
        back=cured("encoder"), within=STALE + 2 + DYING,
        plane_within=STALE + 2 + DYING + VIA_SUPERVISOR)  # fmt: skip
    yield _stops("estop-and-supervisor-killed", "emergency stop, and the supervisor killed at once",
                 both(estop, lambda testbed: testbed.kill("supervisor")),
                 "supervisor: still stopped after its restart", Alarm("", "", "emergency stop"),
                 "start it; clear_fault of both drives, reset, enable")._replace(
        back=_still_estopped)  # fmt: skip
    yield goes_on("reset-while-enabled", "reset while a drive is enabled",
                   repeated(refused("supervisor/reset", said="still enabled"), 5),
                   "supervisor refuses")  # fmt: skip
    yield goes_on("enable-again", "enable while enabled, 20 times",
                   repeated(both(switched("amplifier/enable", True),
                                 switched("manus/enable", True)), 10),
                   "amplifier, manus: nothing changes")  # fmt: skip
    yield goes_on("home-while-moving", "encoder/home in motion",
                   repeated(refused("encoder/home", said="enabled"), 3),
                   "encoder refuses")  # fmt: skip
    yield goes_on("home-while-enabled", "encoder/home while enabled, the hand at rest elsewhere",
                   both(_at_rest_elsewhere, refused("encoder/home", said="disable it first")),
                   "encoder refuses: a new origin would move soft stops and set points"
                   )  # fmt: skip
    yield goes_on("home-elsewhere", "encoder/home while disabled, away from the mark",
                   _home_elsewhere, "encoder refuses the first request, and a repetition at once",
                   )._replace(safe=OFF, within=BY_SERVICE, plane_within=BY_SERVICE,
                              recovery="encoder/home at the mark, enable")  # fmt: skip
    yield goes_on("plane-home-while-enabled", "manus/home while enabled",
                   refused("manus/home", said="disable"), "manus refuses")  # fmt: skip
    yield Row(
        name="lock-vertical", group="operator", fault="supervisor/lock_vertical in motion",
        inject=both(switched("supervisor/lock_vertical", True), _lock_reported),
        back=switched("supervisor/lock_vertical", False), alarm=None,
        recovery="lock_vertical off, amplifier/enable", noticed_by="supervisor",
        within=BY_SERVICE + 20, plane_within=0, safe=VERTICAL_OFF,
    )  # fmt: skip
    yield _stops("disable", "both drives disabled by their services, in motion",
                 both(switched("amplifier/enable", False), switched("manus/enable", False)),
                 "amplifier, manus", None, "enable")  # fmt: skip


def _await_stop(testbed) -> None:
    """Wait until the stop has reached the drives' nodes: before, the drives are still enabled."""
    testbed.robot.pause(_ARRIVES_S)


def _still_estopped(testbed) -> None:
    """Check what the new process says; simulated time hardly moves while it starts."""
    ended = testbed.listener.time
    testbed.restart("supervisor")
    testbed.await_restarted()

    def newer() -> SafetyState | None:
        state = testbed.robot.state(SafetyState)
        return state if state is not None and seconds(state.header.stamp) > ended else None

    testbed.robot.wait_until(newer, 2.0, "the new supervisor is silent")
    if not testbed.robot.newest(SafetyState).estopped:
        raise Failed("the emergency stop was lost in the restart")


def _lock_reported(testbed) -> None:
    def is_reported() -> bool:
        state = testbed.robot.state(SafetyState)
        return state is not None and state.vertical_locked

    testbed.robot.wait_until(is_reported, 3.0, "safety_state does not report the lock")


def _until_latched(testbed) -> None:
    testbed.robot.met(lambda: len(testbed.listener.disabled_at()) == 2, 3.0)
    testbed.robot.met(lambda: any("encoder" in r for r in testbed.listener.reasons()), 3.0)
    testbed.robot.pause(0.6)  # until the encoder counts as lost instead of late


def _at_rest_elsewhere(testbed) -> None:
    """Let the hand rest in the equilibrium of spring and arm, away from the mark."""
    testbed.patient.rest()
    testbed.robot.wait_until(lambda: testbed.patient.at_rest, 5.0, "the hand does not come to rest")


def _home_elsewhere(testbed) -> float:
    """Request homing repeatedly, away from the last homing position: the origin must not move."""
    begin = testbed.listener.time
    for node in ("amplifier", "manus"):
        testbed.robot.call(SetBool, f"{node}/enable", SetBool.Request(data=False))
    there = (math.nan, math.nan, HOME + 0.08)  # friction stops the handle before it
    still = (math.nan, math.nan, 0.0)
    testbed.robot.set_arm(arm(there, amplitude=still, omega=still))
    testbed.robot.wait_until(
        lambda: testbed.listener.now.height > HOME + 0.02, 5.0, "the hand does not leave the mark"
    )
    testbed.robot.pause(1.0)
    before = testbed.listener.now.height
    for _ in range(10):
        refused("encoder/home", said=AGAIN)(testbed)
    state = testbed.robot.state(ImpedanceState)
    if state is None or abs(state.position - before) > 0.005:
        raise Failed("the origin has moved")
    testbed.patient.place()
    return begin
