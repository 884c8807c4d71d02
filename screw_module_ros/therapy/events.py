# SPDX-License-Identifier: Apache-2.0
"""Events of a session for an investigator's form: what, in which minute.

Nothing is judged here: which of them is adverse, and why it came about, a person says.
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
_WORDS = {
    PULLS_HARD: "spasm", PATIENT_ASKED: "patient's stop", THERAPIST_PAUSED: "pause", RESTS: "rest",
}  # fmt: skip


def events_of(session: Recorded, scores: Iterable[Any]) -> list[tuple[float, str, str]]:
    """Return minute, kind, and reason or value of each event of a session, in order.

    That are pauses and ends before time, a hand off, and pain beyond `PAIN`. scores: of its
    patient, as the record has them; those of its day count. Raises BagError.
    """
    topic, begun = session.robot + graph.CONTROLLER_STATE, session.local(session.stated_ns)
    told = read_bag(session.folder, [topic], by_index=True)
    states = [each.message for each in (told if topic in topics(session.folder) else ())]
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
