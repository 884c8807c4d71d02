# SPDX-License-Identifier: Apache-2.0
"""Rows about therapy: slots, the session's node, the therapist's page and the web bridge."""

from __future__ import annotations

import itertools
import math
import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from typing import Any

from acts import both, published
from attending_page import AttendingPage
from hand import MARK
from row import EITHER, STOPPED, Act, Row, goes_on
from screw_module_msgs.msg import EndpointSetpoint, TherapySlot, TherapyState
from screw_module_msgs.srv import StartTherapy
from std_msgs.msg import Empty

from screw_module_ros import graph
from screw_module_ros.control.modes import FORCE_FEEDBACK

GROUP = "therapy"
_RENEW_S = 0.05
_ONE_S = round(1.0 / _RENEW_S)
_SESSION, _BRIDGE = "therapy_session", "web_bridge"
_PAGE, _STATES = "page", "states"
_WITHIN = 60
"""Samples: a slot may throw the hand and so trip the limits of speed or position jump."""
_SOFT_STOP = 0.345  # [m] height: just before the upper soft stop
_FELT = 110.0  # [N] on a hand that a slot takes to an end of travel, its arm's spring included
_ANSWER_S = 20.0  # wall clock
_SILENCE_S = 2.0  # of a page; then the session pauses
_START = {"protocol": "reach_3d", "patient": "P-22222", "record": False}
_SLOT = {
    "planar": True, "vertical": True, "start__z": MARK, "target__y": 0.1, "target__z": MARK + 0.05,
    "duration": 1.4, "back_stiffness": 200.0, "side_stiffness": 200.0, "damping": 5.0,
    "half_width": 0.01, "end_half_width": 0.002, "growth": 20.0,
}  # fmt: skip


def _slot(count: int = 0, period: float = _RENEW_S, **fields: Any) -> Act:
    return published(TherapySlot, graph.THERAPY_SLOT, count, period, **{**_SLOT, **fields})


def _led_beyond(robot) -> float:
    """Lead the hand beyond the top of the travel; check how hard it gets there."""
    begin = robot.time
    _slot(planar=False, start_ns=1, duration=0.1, target__z=0.9, back_stiffness=2000.0)(robot)
    robot.wait_until(
        lambda: robot.record.now.height > _SOFT_STOP, 3.0, "the slot does not lead the hand there"
    )
    robot.pause(0.5)
    felt = [abs(m.force[2]) for m in robot.record.since(begin) if m.height > _SOFT_STOP]
    assert max(felt) <= _FELT, f"{max(felt):.0f} N on the hand"
    return begin


def start_session(robot) -> None:
    """Start the session's node beside the graph."""
    robot.added[_SESSION] = robot.intruders.start(_SESSION)
    robot.wait_until_ready([_SESSION])
    robot.added[_STATES] = robot.intruders.listen(TherapyState, graph.THERAPY_STATE)


def started(robot) -> float:
    """Start a session, and wait for its slot, which brings the hand to the start."""
    request = StartTherapy.Request(**_START)

    def begun() -> bool:
        answer = robot.call(StartTherapy, f"{_SESSION}/start", request)
        return _accepted(answer.success, answer.message)

    return _begun(robot, begun)


def _started_by_page(robot) -> float:
    """Do the same as a page does, which attends the session from its start."""
    page = robot.added[_PAGE]

    def begun() -> bool:
        page.answer, page.asks = None, (f"{_SESSION}/start", _START)
        # By wall clock, as the bridge waits for the middleware.
        answered = robot.creep_until(lambda: page.answer is not None, _ANSWER_S)
        assert answered, f"the bridge does not answer: {page.end or 'it is silent'}"
        if isinstance(page.answer, dict):
            return _accepted(page.answer["success"], page.answer["message"])
        # Else the middleware has not discovered the service yet.
        assert "nobody offers" in page.answer
        return False

    return _begun(robot, begun)


def _accepted(success: bool, message: str) -> bool:
    assert success or graph.ENDPOINT_STATE in message, f"the session does not start: {message}"
    return success


def _begun(robot, begun: Callable[[], bool]) -> float:
    robot.wait_until(begun, 10.0, "the session's node receives no endpoint_state")
    await_state(robot, 5.0, state=TherapyState.RUNNING, phase=TherapyState.PREPARE)
    robot.pause(0.3)  # until the slot is in force
    return robot.time


def await_state(robot, seconds: float, **wanted: int) -> TherapyState:
    """Wait until the session's newest state has these values."""
    newest = TherapyState()

    def has_come() -> bool:
        nonlocal newest
        while (state := robot.added[_STATES]()) is not None:
            newest = state
        return all(getattr(newest, name) == value for name, value in wanted.items())

    assert robot.met(has_come, seconds), f"wanted: {wanted}, is: {newest}"
    return newest


def _signalled(number: signal.Signals) -> Act:
    """Start a session and its node; send that node a signal."""

    def act(robot) -> float:
        both(start_session, started)(robot)
        begin = robot.time
        os.kill(robot.added[_SESSION], number)
        return begin

    return act


def paused(robot) -> None:
    """Wait until the session has paused; check its reason."""
    state = await_state(robot, _SILENCE_S + 2.0, state=TherapyState.PAUSED)
    assert "page has been silent" in state.reason


def _attended(robot) -> None:
    """Start the bridge, and a page that publishes its attendance through it."""
    tokens = f"{robot.graph.place.state.name}/web_bridge/tokens.json"
    with socket.socket() as probe:  # its port is ours to know: an earlier bridge told another one
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    arguments = ("-p", f"port:={port}", "-p", f"token_file:={tokens}")
    robot.added[_BRIDGE] = robot.intruders.start(_BRIDGE, *arguments)
    robot.wait_until_ready([_BRIDGE])
    page = robot.added[_PAGE] = AttendingPage(f"http://127.0.0.1:{port}", tokens)
    assert robot.met(lambda: page.sent > 3, 30.0), f"the page cannot attend: {page.end}"


def _bridge_killed(robot) -> float:
    begin = robot.time
    os.kill(robot.added[_BRIDGE], signal.SIGKILL)
    return begin


def _flooded(robot) -> float:
    begin, page = robot.time, robot.added[_PAGE]
    page.floods = True
    robot.wait_until(lambda: page.end, 10.0, "the bridge does not cut off a page that floods it")
    assert "messages a second" in page.end
    return begin


def _page_closed(robot) -> None:
    if page := robot.added.pop(_PAGE, None):
        page.close()


_goes_on = partial(goes_on, group=GROUP, watch=0.8)
_REFUSE = "controller and manus refuse it, naming the field: there is no slot"
_FADES = "controller and manus: a slot fades out without renewal for 0.3 s"
_PAUSES = "therapy_session pauses: the therapist's page has been silent for 2 s"
_sides, _wishes = itertools.cycle((-0.1, 0.1)), itertools.cycle((-1e6, 1e6))
_WISH = {f"position__{axis}": lambda robot: next(_wishes) for axis in "xyz"}
WORDS = published(Empty, graph.THERAPY_ATTENDANCE, _ONE_S, _RENEW_S)
ROWS = [
    _goes_on("slot-nan", fault="a slot of no duration (NaN)", act=_slot(duration=math.nan),
             who=_REFUSE),
    _goes_on("slot-absurd", fault="a slot with walls of 1e300 N/m",
             act=_slot(back_stiffness=1e300), who=_REFUSE),
    Row("slot-strongest", GROUP, "the stiffest valid slot, from a foreign sender, hours old, "
        "with its target far from the hand",
        _slot(start_ns=1, duration=0.1, target__x=0.15, target__y=0.15, target__z=MARK + 0.09,
              back_stiffness=2000.0, side_stiffness=2000.0, growth=500.0), None, STOPPED,
        "controller and manus: the force is limited to 45 N, and fades in", _WITHIN, _WITHIN,
        outcome=EITHER, watch=0.8),
    _goes_on("slot-beyond-travel", fault="a stiff slot that leads 0.5 m beyond the travel within "
             "0.1 s", act=_led_beyond, mode=FORCE_FEEDBACK,
             who="controller: keeps it within the travel, and brakes the hand before its end"),
    _goes_on("slot-storm", fault="another slot 500 times a second, to and fro",
             act=_slot(0, 0.002, target__x=lambda robot: next(_sides)),
             who="controller and manus: one slot fades out before the next one comes"),
    _goes_on("slot-sender-gone", fault="the sender of a slot falls silent", act=_slot(_ONE_S),
             who=_FADES),
    _goes_on(f"{_SESSION}-killed", fault="therapy_session killed (SIGKILL) while its slot is in "
             "force", act=_signalled(signal.SIGKILL), who=_FADES),
    _goes_on(f"{_SESSION}-frozen", fault="therapy_session frozen (SIGSTOP) while its slot is in "
             "force, later continued", act=_signalled(signal.SIGSTOP), who=_FADES,
             mend=lambda robot: os.kill(robot.added[_SESSION], signal.SIGCONT)),
    _goes_on("wish-absurd", fault="a game requests points a thousand kilometres away, to and fro",
             act=both(start_session,
                      published(EndpointSetpoint, graph.THERAPY_WISH, 0, 0.002, **_WISH)),
             who="therapy_session: limits the point to the workspace, and its speed"),
    _goes_on("page-silent", fault="the therapist's page falls silent during a session",
             act=both(start_session, started, WORDS, paused), who=_PAUSES),
    _goes_on(f"{_BRIDGE}-killed", fault="web_bridge killed (SIGKILL) during a session that a page "
             "attends through it",
             act=both(start_session, _attended, _started_by_page, _bridge_killed, paused),
             who=_PAUSES, mend=_page_closed),
    _goes_on(f"{_BRIDGE}-flooded", fault="a page floods the bridge during a session",
             act=both(start_session, _attended, _started_by_page, _flooded),
             who="web_bridge cuts it off", mend=_page_closed),
]  # fmt: skip
