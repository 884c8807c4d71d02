# SPDX-License-Identifier: Apache-2.0
"""Events of a session for an investigator's form, and what people did at the pages.

Nothing is judged here: which event is adverse, why it came about, and what made somebody press a
wrong button, a person says.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from itertools import pairwise
from typing import Any

from .. import graph
from ..recording.decoded import read_bag, topics
from .hand import ns_of
from .recorded import Recorded
from .session import PATIENT_ASKED, PULLS_HARD, RESTS, THERAPIST_PAUSED, State

PAIN = 5.0
"""Largest pain, of 10, that is no event; ours."""
UNDONE_S = 10.0
"""Time in which an opposite action takes one back; ours."""
_OPPOSITE = {"start": "abort", "pause": "resume", "rest": "resume", "resume": "pause"}
_INFO = 20  # level of a Log: a refused action has a higher one
_WORDS = {
    PULLS_HARD: "spasm", PATIENT_ASKED: "patient's stop", THERAPIST_PAUSED: "pause", RESTS: "rest",
}  # fmt: skip


def events_of(session: Recorded, scores: Iterable[Any]) -> list[tuple[float, str, str]]:
    """Return minute, kind, and reason or value of each event of a session, in order.

    That are pauses and ends before time, a hand off, and pain beyond `PAIN`. scores: of its
    patient, as the record has them; those of its day count. Raises BagError.
    """
    begun, states = session.local(session.stated_ns), _told(session, graph.CONTROLLER_STATE)
    found = [(act.stamp_ns, _WORDS.get(act.reason, "stop"), act.reason) for act in session.acts
             if act.state in (State.PAUSED, State.ABORTED)]  # fmt: skip
    found += [(ns_of(state.header.stamp), "hand off", "") for before, state in pairwise(states)
              if getattr(state, "hand_off", False) and not before.hand_off]  # fmt: skip
    return sorted([
        *(((at_ns - session.stated_ns) / 60e9, what, why) for at_ns, what, why in found),
        *(((at - begun.replace(tzinfo=None)).total_seconds() / 60.0, "pain",
           f"{score['scale']} {score['value']:g}")
          for score in scores if score["scale"].startswith("pain") and score["value"] > PAIN
          for at in [datetime.fromisoformat(score["at"]).replace(tzinfo=None)]
          if begun and at.date() == begun.date()),
    ])  # fmt: skip


def actions_of(session: Recorded) -> list[tuple[float, str, str, str, float | str]]:
    """Return minute, page, action, what became of it and seconds of its task, of each action.

    Those since the session before have negative minutes. What became of it: "refused"; "undone",
    when its opposite, or the same setting, follows within `UNDONE_S`; else empty. Seconds: of a
    start since a pseudonym was entered first, of a resume since the pause; else empty. Raises
    BagError.
    """
    done = sorted(
        (ns_of(each.stamp), each.name, each.msg, each.level > _INFO)
        for each in _told(session, graph.THERAPY_ACTION)
    )
    named = [at_ns for at_ns, _, action, _ in done if action == "count"]
    pauses = [act.stamp_ns for act in session.acts if act.state == State.PAUSED]
    found = []
    for number, (at_ns, page, action, refused) in enumerate(done):
        back = action if action.startswith("set ") else _OPPOSITE.get(action)
        undone = any(
            (what, fails) == (back, False) and at - at_ns <= UNDONE_S * 1e9
            for at, _, what, fails in done[number + 1 :]
        )
        begins = {"start": named[:1], "resume": [at for at in pauses if at < at_ns]}
        of_task = [] if refused else begins.get(action, [])
        found.append((
            (at_ns - session.stated_ns) / 60e9, page, action,
            "refused" if refused else "undone" if undone else "",
            round((at_ns - of_task[-1]) / 1e9, 1) if of_task else "",
        ))  # fmt: skip
    return found


def _told(session: Recorded, name: str) -> list[Any]:
    """Return the messages of a topic of the session's robot, none where the bag lacks it."""
    topic = session.robot + name
    told = read_bag(session.folder, [topic], by_index=True)
    return [each.message for each in (told if topic in topics(session.folder) else ())]
