# SPDX-License-Identifier: Apache-2.0
"""Rows about therapy: slots, the session's node, the therapist's page and the web bridge."""

from __future__ import annotations

import itertools
import math
import os
import signal
from collections.abc import Callable, Iterator
from typing import Any

from screw_module_msgs.msg import EndpointSetpoint, TherapySlot, TherapyState
from screw_module_msgs.srv import StartTherapy
from std_msgs.msg import Empty

from screw_module_ros import graph

from .acts import both, published
from .creep import creep_until
from .page import Page
from .patient import HOME
from .row import EITHER, GOES_ON, Act, Failed, Row, nothing

GROUP = "therapy"
_RENEW_S = 0.05
_ONE_S = round(1.0 / _RENEW_S)
_SESSION, _BRIDGE = "therapy_session", "web_bridge"
_PAGE, _STATES = "page", "states"
_WITHIN = 60
"""Samples: a slot may throw the hand and so trip the limits of speed or position jump."""
_ANSWER_S = 20.0  # wall clock
_SILENCE_S = 2.0  # of a page; then the session pauses
_START = {"protocol": "reach_3d", "patient": "P-22222", "record": False}
_SLOT = {
    "planar": True, "vertical": True, "start__z": HOME, "target__y": 0.1, "target__z": HOME + 0.05,
    "duration": 1.4, "back_stiffness": 200.0, "side_stiffness": 200.0, "damping": 5.0,
    "half_width": 0.01, "end_half_width": 0.002, "growth": 20.0,
}  # fmt: skip
_FADES = "controller and manus: a slot fades out without renewal for 0.3 s"


def rows() -> Iterator[Row]:
    """Return the rows of slots, of the session's node, of the page and of the bridge."""
    yield from _slots()
    yield from _sessions()
    yield from _pages()


def _row(
    name: str, text: str, act: Act, who: str, back: Act = nothing, watch: float = 0.8,
    safe: str = GOES_ON,
) -> Row:  # fmt: skip
    stops = safe != GOES_ON
    return Row(
        name=name, group=GROUP, fault=text, inject=act, back=back, alarm=None,
        recovery="reset, enable" if stops else "none is needed", noticed_by=who, safe=safe,
        within=_WITHIN if stops else 0, plane_within=_WITHIN if stops else 0, watch=watch,
    )  # fmt: skip


def _slot(count: int = 0, period: float = _RENEW_S, **fields: Any) -> Act:
    return published(TherapySlot, graph.THERAPY_SLOT, count, period, **{**_SLOT, **fields})


def _slots() -> Iterator[Row]:
    refuse = "controller and manus refuse it, naming the field: there is no slot"
    yield _row("slot-nan", "a slot of no duration (NaN)", _slot(duration=math.nan), refuse)
    yield _row("slot-absurd", "a slot with walls of 1e300 N/m", _slot(back_stiffness=1e300), refuse)
    yield _row("slot-strongest", "the stiffest valid slot, from a foreign sender, expired for "
               "hours, with its target far from the hand",
               _slot(start_ns=1, duration=0.1, target__x=0.15, target__y=0.15,
                     target__z=HOME + 0.09, back_stiffness=2000.0, side_stiffness=2000.0,
                     growth=500.0),
               "controller and manus: the force is limited to 45 N, and fades in",
               safe=EITHER)  # fmt: skip
    sides = itertools.cycle((-0.1, 0.1))
    yield _row("slot-storm", "another slot 500 times a second, to and fro",
               _slot(0, 0.002, target__x=lambda testbed: next(sides)),
               "controller and manus: one slot fades out before the next one comes")  # fmt: skip
    yield _row("slot-sender-gone", "the sender of a slot falls silent",
               _slot(_ONE_S), _FADES)  # fmt: skip


def _sessions() -> Iterator[Row]:
    yield _row(f"{_SESSION}-killed", "therapy_session killed (SIGKILL) while its slot is in force",
               _signalled(signal.SIGKILL), _FADES)  # fmt: skip
    yield _row(f"{_SESSION}-frozen", "therapy_session frozen (SIGSTOP) while its slot is in force, "
               "later continued", _signalled(signal.SIGSTOP), _FADES, _continued)  # fmt: skip
    wishes = itertools.cycle((-1e6, 1e6))
    wish = {f"position__{axis}": lambda testbed: next(wishes) for axis in "xyz"}
    yield _row("wish-absurd", "a game requests points a thousand kilometres away, to and fro",
               both(_session, published(EndpointSetpoint, graph.THERAPY_WISH, 0, 0.002, **wish)),
               "therapy_session: limits the point to the workspace, and its speed")  # fmt: skip


def _pages() -> Iterator[Row]:
    pauses = "therapy_session pauses: the therapist's page has been silent for 2 s"
    yield _row("page-silent", "the therapist's page falls silent during a session",
               both(_session, _started,
                    published(Empty, graph.THERAPY_ATTENDANCE, _ONE_S, _RENEW_S), _paused),
               pauses)  # fmt: skip
    yield _row(f"{_BRIDGE}-killed", "web_bridge killed (SIGKILL) during a session that a page "
               "attends through it", both(_session, _attended, _started_by_page, _bridge_killed,
                                               _paused),
               pauses, _page_closed)  # fmt: skip
    yield _row(f"{_BRIDGE}-flooded", "a page floods the bridge during a session",
               both(_session, _attended, _started_by_page, _flooded), "web_bridge cuts it off",
               _page_closed)  # fmt: skip


# Acts --------------------------------------------------------------------------------------------


def _session(testbed) -> None:
    """Start the session's node beside the graph."""
    testbed.added[_SESSION] = testbed.intruders.start(_SESSION)
    testbed.robot.wait_until_ready([_SESSION])
    testbed.added[_STATES] = testbed.intruders.listen(TherapyState, graph.THERAPY_STATE)


def _started(testbed) -> float:
    """Start a session, and wait for its slot, which brings the hand to the start."""
    request = StartTherapy.Request(**_START)

    def begun() -> bool:
        answer = testbed.robot.call(StartTherapy, f"{_SESSION}/start", request)
        return _accepted(answer.success, answer.message)

    return _begun(testbed, begun)


def _started_by_page(testbed) -> float:
    """Do the same as a page does, which attends the session from its start."""
    page = testbed.added[_PAGE]

    def begun() -> bool:
        page.answer, page.asks = None, (f"{_SESSION}/start", _START)
        # By wall clock, as the bridge waits for the middleware.
        if not creep_until(testbed.robot.clock, lambda: page.answer is not None, _ANSWER_S):
            raise Failed(f"the bridge does not answer: {page.end or 'it is silent'}")
        if isinstance(page.answer, dict):
            return _accepted(page.answer["success"], page.answer["message"])
        if "nobody offers" not in page.answer:  # else the middleware has not discovered the service
            raise Failed(f"the session does not start: {page.answer}")
        return False

    return _begun(testbed, begun)


def _accepted(success: bool, message: str) -> bool:
    if not success and graph.ENDPOINT_STATE not in message:
        raise Failed(f"the session does not start: {message}")
    return success


def _begun(testbed, begun: Callable[[], bool]) -> float:
    testbed.robot.wait_until(begun, 10.0, "the session's node receives no endpoint_state")
    _wait_for(testbed, lambda state: state.state == TherapyState.RUNNING
              and state.phase == TherapyState.PREPARE, "the session does not run")  # fmt: skip
    testbed.robot.pause(0.3)  # until the slot is in force
    return testbed.listener.time


def _wait_for(testbed, wanted, problem: str, seconds: float = 5.0) -> TherapyState:
    found: list[TherapyState] = []

    def answered() -> bool:
        while (state := testbed.added[_STATES]()) is not None:
            found.append(state)
        return bool(found) and wanted(found[-1])

    if not testbed.robot.met(answered, seconds):
        last = f"state {found[-1].state}: {found[-1].reason}" if found else "it is silent"
        raise Failed(f"{problem}: {last}")
    return found[-1]


def _signalled(number: signal.Signals) -> Act:
    def act(testbed) -> float:
        _session(testbed)
        _started(testbed)
        begin = testbed.listener.time
        os.kill(testbed.added[_SESSION], number)
        return begin

    return act


def _continued(testbed) -> None:
    os.kill(testbed.added[_SESSION], signal.SIGCONT)


def _paused(testbed) -> None:
    """Wait until the session has paused; check its reason."""
    state = _wait_for(testbed, lambda state: state.state == TherapyState.PAUSED,
                      "the session does not pause", _SILENCE_S + 2.0)  # fmt: skip
    if "page has been silent" not in state.reason:
        raise Failed(f"the session paused because {state.reason}")


def _attended(testbed) -> None:
    """Start the bridge, and a page that publishes its attendance through it."""
    tokens = f"{testbed.graph.place.state.name}/web_bridge/tokens.json"
    arguments = ("-p", "port:=0", "-p", f"token_file:={tokens}")
    testbed.added[_BRIDGE] = testbed.intruders.start(_BRIDGE, *arguments)
    testbed.robot.wait_until_ready([_BRIDGE])
    testbed.robot.wait_until(lambda: "http://" in testbed.robot.said(_BRIDGE), 30.0, "no bridge")
    address = testbed.robot.said(_BRIDGE).rpartition(" ")[2]
    page = testbed.added[_PAGE] = Page(address, tokens)
    if not testbed.robot.met(lambda: page.sent > 3, 30.0):
        raise Failed(f"the page cannot attend: {page.end}")


def _bridge_killed(testbed) -> float:
    begin = testbed.listener.time
    os.kill(testbed.added[_BRIDGE], signal.SIGKILL)
    return begin


def _flooded(testbed) -> float:
    begin = testbed.listener.time
    page = testbed.added[_PAGE]
    page.floods = True
    testbed.robot.wait_until(
        lambda: page.end, 10.0, "the bridge does not cut off a page that floods it"
    )
    if "messages a second" not in page.end:
        raise Failed(f"the page was cut off because {page.end}")
    return begin


def _page_closed(testbed) -> None:
    if page := testbed.added.pop(_PAGE, None):
        page.close()
