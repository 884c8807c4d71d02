# SPDX-License-Identifier: Apache-2.0
"""What the pages show of the record: all patients in a list, and one of them."""

from __future__ import annotations

import json
import time
from collections import Counter
from datetime import datetime
from typing import Any

from ..settings import plain
from .arm_weights import Arms, weights_file, weights_in
from .progress import progress_of
from .record import Record, local
from .scores import SCALES

ASSESSED, ASSESSED_S = ("FM_UE", "ARAT"), 28 * 86_400
"""Clinical scores, and the age from which one is due again [s]; ours."""
_TOLD = (
    "protocol", "level", "side", "simulated", "trials", "minutes", "outcome",
    "support", "software", "law",
)  # fmt: skip
_AGAIN = ("protocol", "level", "trials", "support")  # what is proposed of the last session
_LATEST = """SELECT *, max(julianday(at)) FROM score
  WHERE ? IN ('', pseudonym) GROUP BY pseudonym, scale"""


def patients(record: Record, pseudonym: str = "") -> list[dict[str, Any]]:
    """Return what the list shows of all patients, or of one.

    Last seen, number of sessions, what is due, and what is proposed for the next session: protocol,
    level and minutes of a game (`trials`), support [N], time [s] and side walls [N/m] of the last
    one, None where it had none.
    """
    now_s, arms = time.time(), weights_in(weights_file())
    latest: dict[str, dict[str, Any]] = {}
    for score in record.base.execute(_LATEST, (pseudonym,)):
        latest.setdefault(score["pseudonym"], {})[score["scale"]] = score
    rows = record.sessions(pseudonym)
    sessions = {row["pseudonym"]: row for row in rows}
    count = Counter(row["pseudonym"] for row in rows)
    found = []
    for who in sorted({*sessions, *latest}):
        session, scores = sessions.get(who), latest.get(who, {})
        wall = session and record.last_assisted(session) or {}
        side = session["side"] if session else ""
        if "side" in scores:
            side = "right" if scores["side"]["value"] else "left"
        weighed = getattr(arms.get(who, Arms()), side or "left")
        assessed = [datetime.fromisoformat(scores[name]["at"]).timestamp()
                    for name in ASSESSED if name in scores]  # fmt: skip
        due = {"weigh": weighed is None or weighed.is_old(now_s),
               "assess": now_s - max(assessed, default=0.0) > ASSESSED_S}  # fmt: skip
        found.append({
            "patient": who, "side": side, "sessions": count[who], "seen": _date(session),
            "closed": "closed" in scores and bool(scores["closed"]["value"]),
            "due": [what for what, is_due in due.items() if is_due],
            **{name: session and session[name] for name in _AGAIN},
            "duration": wall.get("slot_duration"), "stiffness": wall.get("side_stiffness"),
        })  # fmt: skip
    return found


def patient(record: Record, pseudonym: str) -> dict[str, Any]:
    """Return what the page of a patient shows: progress, sessions and scores, oldest first."""
    sessions = record.sessions(pseudonym)
    dated = any(row["begun"] is not None for row in sessions)
    return {
        "about": next(iter(patients(record, pseudonym)), None),
        "progress": plain(progress_of(record, pseudonym)) if dated else None,
        "sessions": [{"begun": _date(row), "stops": json.loads(row["stops"]),
                      **{name: row[name] for name in _TOLD}} for row in sessions],
        "scores": [{name: row[name] for name in ("at", "scale", "value")}
                   for row in record.scores(pseudonym)],
        "scales": SCALES,
    }  # fmt: skip


def _date(session: Any) -> str:
    begun: datetime | None = session and local(session)
    return begun.isoformat(timespec="minutes") if begun else ""
