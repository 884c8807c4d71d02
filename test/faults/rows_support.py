# SPDX-License-Identifier: Apache-2.0
"""Rows about an arm that the robot carries: the hand leaves, who asks is gone, the torque goes.

Each robot of these rows may carry 20 N with a drive that coasts, where 8 N are allowed by default.
"""

from __future__ import annotations

import os
import signal
from functools import partial

from acts import both, called, cured, fault, published, reconfigured, refused
from hand import MARK
from record import LARGEST_STEP, largest_step
from row import (
    AT_ONCE,
    BY_SERVICE,
    FROZEN,
    MISSED,
    PLANE_CLEAR,
    SILENT,
    TARE,
    VIA_SUPERVISOR,
    Act,
    Report,
    Row,
    goes_on,
)
from rows_therapy import WORDS, await_state, paused, start_session, started
from screw_module_msgs.msg import ImpedanceState, TherapySlot, TherapyState

from screw_module_ros import graph
from screw_module_ros.control.modes import FORCE_FEEDBACK, IMPEDANCE, OBSERVER
from screw_module_ros.operator.robot import RobotError, arm

GROUP = "support"
WEIGHT = 20.0
"""Of the arm, and what carries it [N]."""
_RENEW_S = 0.05
_SPRING = (0.0, 0.0, MARK, 0.0, 0.0, 0.0)
_SOON_S, _LATER_S = 0.5, 1.5  # times after the cause
_RAMP = 1000 + AT_ONCE
"""Samples: the rig's drive brakes for 1 s at most."""
_FARTHEST, _FASTEST = 0.06, 0.45  # of a handle that its hand has left [m], [m/s]
_FADE_RATE = 5.0  # [N/s]
_UP_S = 2.0
_BY_HAND = 8.0  # support that the session's node asks for [N]
_ESTOP = Report("supervisor", "emergency stop", "emergency stop")
_FREEZE = Report("force_sensor", "have not changed", "force")


def _asks(support: float) -> Act:
    return published(TherapySlot, graph.THERAPY_SLOT, 0, _RENEW_S, support=support)


def _in_use(robot, support: float) -> bool:
    return abs(robot.newest(ImpedanceState).support - support) < 0.1


def _carried(robot, support: float) -> None:
    """Let the arm be carried, or the hand be loaded, until all is at rest."""
    robot.setpoint = _SPRING
    robot.hand.rest()
    _asks(support)(robot)
    robot.wait_until(lambda: _in_use(robot, support), 5.0, "the support does not come")
    if support > 0.0:
        robot.hand.hang(support)
    robot.wait_until(lambda: robot.hand.at_rest, 5.0, "the hand does not come to rest")


def _left(robot, support: float) -> float:
    """Let go of a handle with a support; check how far and how fast it goes."""
    _carried(robot, support)
    begin, start = robot.time, robot.record.now.height
    robot.hand.let_go()
    robot.until(begin + _LATER_S)
    moments = robot.record.since(begin)
    sign = 1.0 if support > 0.0 else -1.0
    way = max(sign * (moment.height - start) for moment in moments)
    speed = max(abs(moment.speed) for moment in moments)
    assert robot.newest(ImpedanceState).hand_off, "nobody has seen that the hand has left"
    assert way < _FARTHEST and speed < _FASTEST, f"{1e3 * way:.0f} mm, {speed:.2f} m/s"
    return begin


def _held_again(robot) -> None:
    """Hold the handle once nobody asks for support: it would come back, and press on the hand."""
    robot.intruders.dismiss()
    robot.pause(_SOON_S)
    robot.hand.set_up()
    robot.hand.take_hold()


def _let_down(robot) -> None:
    """Let the support go that the session's node has asked for."""
    robot.intruders.dismiss()
    robot.hand.set_up()
    robot.wait_until(lambda: _in_use(robot, 0.0), 5.0, "the support stays")


def _up_again(robot) -> None:
    """Let the hand come up from the end of travel, slower than the limit of the speed."""
    robot.hand.set_up()
    robot.set_arm(arm((0.0, 0.0, MARK), _UP_S))
    robot.pause(_UP_S)
    _let_down(robot)


def _by_hand(robot) -> None:
    """Start the session's node; let it ask for a support."""
    robot.setpoint = _SPRING
    robot.hand.rest()
    start_session(robot)
    robot.wait_until(lambda: not _refusal(robot, _BY_HAND), 5.0, "no support is granted")
    robot.wait_until(lambda: _in_use(robot, _BY_HAND), 5.0, "the support does not come")


def _refusal(robot, force: float) -> str:
    """Ask the session's node for a support by hand; return why not."""
    try:
        robot.set_parameter("therapy_session", "support.force", force)
    except RobotError as error:
        return str(error)
    return ""


def _session_killed(robot) -> float:
    """Kill the node that asks; check that the support goes slowly, and the hand feels no step."""
    _by_hand(robot)
    robot.wait_until(lambda: robot.hand.at_rest, 5.0, "the hand does not come to rest")
    begin = robot.time
    os.kill(robot.added["therapy_session"], signal.SIGKILL)
    robot.until(begin + 1.3)  # 0.3 s of them is the lease
    left = robot.newest(ImpedanceState).support
    assert abs(left - (_BY_HAND - _FADE_RATE)) < 1.0, f"{left:.1f} N are left after a second"
    step = largest_step(robot.record.since(begin))
    assert step <= LARGEST_STEP, f"a step of {step:.1f} N on the patient's hand"
    return begin


def _too_much(robot) -> float:
    """Ask for what no weighed arm allows; check that the support stays what it was."""
    _by_hand(robot)
    begin = robot.time
    said = _refusal(robot, WEIGHT)
    assert "was not weighed: at most 15 N" in said, said or "more than 15 N are granted"
    robot.until(begin + 1.0)
    assert _in_use(robot, _BY_HAND)
    return begin


def _page_lost(robot) -> float:
    """Let the therapist's page fall silent in a session; check that the arm stays carried."""
    _by_hand(robot)
    begin = started(robot)
    WORDS(robot)
    paused(robot)
    robot.pause(_LATER_S)
    assert _in_use(robot, _BY_HAND), "the pause lets the arm down"
    return begin


def _pulls_hard(robot) -> float:
    """Let the arm press down against the end of travel; check that the walls go, not what carries.

    There it can: elsewhere the handle gives way to more than the robot's 45 N.
    """
    _by_hand(robot)
    begin = started(robot)
    robot.set_arm(arm((0.0, 0.0, -0.09), 3.0, stiffness=1000.0, damping=80.0))
    state = await_state(robot, 5.0, state=TherapyState.PAUSED)
    assert state.reason == "the arm pulls hard", state.reason
    robot.pause(_LATER_S)
    assert _in_use(robot, _BY_HAND), "the pause lets the arm down"
    return begin


def _refused(robot) -> float:
    """Ask for support in a mode that feeds no force back; check that none comes."""
    begin = robot.time
    _asks(WEIGHT)(robot)
    robot.until(begin + 1.0)
    state = robot.newest(ImpedanceState)
    assert state.support == state.support_limit == 0.0
    return begin


def _falls(robot, cause: Act, least: float, most: float) -> float:
    """Cause a stop under an arm that is carried; check how far it has come down after 0.5 s."""
    _carried(robot, WEIGHT)
    start = robot.record.now.height
    begin = cause(robot)
    robot.until(begin + _LATER_S)
    later = (m for m in robot.record.since(begin) if m.time >= begin + _SOON_S)
    down = start - next(later).height
    assert least <= down <= most, f"{1e3 * down:.0f} mm in {_SOON_S:g} s"
    return begin


def _tared(robot) -> float:
    """Tare while an arm is carried, and again once it lies on the handle without torque.

    Check that both are refused, and that neither support nor hand feel the first.
    """
    _carried(robot, WEIGHT)
    begin = robot.time
    refused(TARE, said="is enabled and would jump")(robot)
    robot.pause(_SOON_S)
    step = largest_step(robot.record.since(begin))
    assert step <= LARGEST_STEP, f"a step of {step:.1f} N on the patient's hand"
    assert _in_use(robot, WEIGHT)
    begin = called("supervisor/estop")(robot)
    robot.until(begin + _LATER_S)
    robot.wait_until(lambda: robot.hand.at_rest, 5.0, "the arm does not come to rest")
    refused(TARE, said="let the handle go")(robot)
    return begin


def _hand_off(mode: int, support: float) -> Row:
    what = "carries an arm of 20 N" if support > 0.0 else "presses down with 20 N"
    return goes_on(
        f"support-hand-off-{mode}-{support:g}", GROUP,
        f"the hand leaves a handle that {what}: it goes less than {1e3 * _FARTHEST:.0f} mm, slower "
        f"than {_FASTEST:g} m/s",
        partial(_left, support=support),
        "controller: the handle gains speed and nothing presses; the support ends, a damper acts",
        _held_again, mode=mode, watch=_LATER_S,
    )  # fmt: skip


def _torque_off(reaction: str, least: float, most: float, within: int) -> Row:
    row = Row(
        f"support-torque-off-{reaction}", GROUP,
        f"software stop while an arm of {WEIGHT:g} N is carried, stop_reaction {reaction}: it "
        f"comes down {1e3 * least:.0f} to {1e3 * most:.0f} mm in {_SOON_S:g} s",
        partial(_falls, cause=called("supervisor/estop"), least=least, most=most), _ESTOP, MISSED,
        "supervisor; nobody holds the arm", within, BY_SERVICE, FORCE_FEEDBACK,
        mend=lambda robot: robot.hand.set_up(), watch=0.3,
    )  # fmt: skip
    if reaction == "coast":
        return row
    return row._replace(
        prepare=reconfigured("amplifier", "stop_reaction", "brake"),
        mend=both(row.mend, reconfigured("amplifier", "stop_reaction", "coast")),
    )


ROWS = [
    *[_hand_off(mode, support) for mode in (FORCE_FEEDBACK, OBSERVER) for support in (20.0, -20.0)],
    goes_on(
        "support-session-killed", GROUP,
        "therapy_session killed (SIGKILL) while the arm is carried",
        _session_killed, "controller: the lease of 0.3 s lapses, then 5 N/s", _let_down,
        mode=FORCE_FEEDBACK, watch=_LATER_S,
    ),
    goes_on(
        "support-beyond-weight", GROUP, "support of 20 N is asked for, for an arm that was not "
        "weighed", _too_much, "therapy_session: refuses it; the support stays as it was",
        _let_down, mode=FORCE_FEEDBACK, watch=1.2,
    ),
    goes_on(
        "support-page-lost", GROUP, "the therapist's page falls silent in a session that carries "
        "the arm", _page_lost, "therapy_session: pauses, and goes on carrying the arm",
        _let_down, mode=FORCE_FEEDBACK, watch=0.8,
    ),
    goes_on(
        "support-spasm", GROUP, "the arm pulls with more than 60 N for 0.3 s in a session that "
        "carries it", _pulls_hard, "therapy_session: pauses, and goes on carrying the arm",
        _up_again, mode=FORCE_FEEDBACK, watch=0.8,
    ),
    goes_on(
        "support-wrong-mode", GROUP, "support is asked for in a mode that feeds no force back",
        _refused, "controller: support_limit is 0", mode=IMPEDANCE, watch=1.2,
    ),
    Row(
        "support-tare-with-arm", GROUP, "tare asked for while an arm is carried, and again after a "
        "software stop: refused", _tared, _ESTOP,
        (TARE, *MISSED), "supervisor; force_sensor refuses", BY_SERVICE, BY_SERVICE,
        FORCE_FEEDBACK, mend=lambda robot: robot.hand.set_up(), watch=0.3,
    ),
    _torque_off("coast", 0.120, 0.180, BY_SERVICE),
    _torque_off("brake", 0.004, 0.012, _RAMP),
    Row(
        "support-force-frozen", GROUP, "force sensor: gauges stand still while an arm is carried",
        both(partial(_carried, support=WEIGHT), fault("force_sensor", "freeze")), _FREEZE,
        (TARE, PLANE_CLEAR, *MISSED), "force_sensor", FROZEN + SILENT,
        FROZEN + SILENT + VIA_SUPERVISOR, FORCE_FEEDBACK,
        mend=both(cured("force_sensor"), lambda robot: robot.hand.set_up()),
    ),
]  # fmt: skip
