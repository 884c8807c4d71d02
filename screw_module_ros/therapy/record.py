# SPDX-License-Identifier: Apache-2.0
"""The record of all patients: an index over the bags of a folder and the scores beside them.

Bags and scores are the truth. `record.db` is made of nothing else, so it can be deleted and made
again, the same row for row; it holds numbers, pseudonyms and sentences of this software, no name
and no text that a person wrote. Each source, a bag or a file of scores, has its rows, all of them
or none, whatever ends the process. What no bag can tell is in `access.db`: who read what, for a
year, and the digests of patients who were forgotten.

Of a session that several bags hold, as a bag and its recovered copy do, one counts: that with the
most trials.
"""

from __future__ import annotations

import functools
import getpass
import hashlib
import json
import math
import os
import sqlite3
import time
from collections import Counter
from collections.abc import Container, Iterable, Iterator
from contextlib import closing, contextmanager
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

from .. import graph
from ..files import owner_only
from ..locks import AlreadyRunning, Lock
from ..recording.bag import METADATA_FILE, BagError
from ..recording.bag_files import files_of
from ..recording.decoded import read_bag
from ..recording.verify import sha256_of
from ..settings import SettingError
from .games import level_of
from .measures import COLUMNS, DEFINITIONS, Row
from .recorded import NoSession, Recorded, read_sessions
from .scores import ENDING, Score, scores_in
from .session import State

RECORD, ACCESS = "record.db", "access.db"
_KEPT_S = 365 * 86400  # a row of `access` stays so long; ours
_PRAGMAS = (
    "page_size=8192",  # most trials lie within a page
    "foreign_keys=ON", "secure_delete=ON", "journal_mode=DELETE", "trusted_schema=OFF",
)  # fmt: skip
_RESULT = (*COLUMNS, "jerk_cutoff", "started_ns", "ended_ns")
_ROW = (
    *_RESULT, "start_x", "start_y", "start_z", "target_x", "target_y", "target_z", "started",
)  # fmt: skip
"""What is kept of a trial; started: ISO 8601, local time."""
_SCHEMA = f"""
BEGIN IMMEDIATE;
DROP VIEW IF EXISTS patient; DROP VIEW IF EXISTS ranked;
DROP TABLE IF EXISTS trial; DROP TABLE IF EXISTS score; DROP TABLE IF EXISTS session;
DROP TABLE IF EXISTS source;
CREATE TABLE source (name TEXT PRIMARY KEY, sha256 TEXT NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE session (
  source TEXT NOT NULL REFERENCES source ON DELETE CASCADE, number INTEGER NOT NULL,
  pseudonym TEXT NOT NULL, side TEXT NOT NULL, begun REAL, utc_offset INTEGER,
  protocol TEXT NOT NULL, level TEXT NOT NULL, protocol_sha256 TEXT NOT NULL,
  simulated INTEGER NOT NULL, outcome TEXT NOT NULL, stops TEXT NOT NULL, robot TEXT NOT NULL,
  software TEXT NOT NULL, law TEXT NOT NULL, support REAL, arm_weight REAL,
  stamp_ns INTEGER NOT NULL, trials INTEGER NOT NULL, minutes REAL NOT NULL,
  PRIMARY KEY (source, number)) STRICT, WITHOUT ROWID;
CREATE INDEX session_of ON session (pseudonym, begun);
CREATE TABLE trial (
  source TEXT NOT NULL, number INTEGER NOT NULL, trial INTEGER NOT NULL,
  row TEXT NOT NULL, PRIMARY KEY (source, number, trial),
  FOREIGN KEY (source, number) REFERENCES session ON DELETE CASCADE) STRICT, WITHOUT ROWID;
CREATE TABLE score (
  pseudonym TEXT NOT NULL, at TEXT NOT NULL, scale TEXT NOT NULL, value REAL NOT NULL,
  source TEXT NOT NULL REFERENCES source ON DELETE CASCADE,
  PRIMARY KEY (pseudonym, at, scale, value)) STRICT, WITHOUT ROWID;
CREATE VIEW ranked AS SELECT *, row_number() OVER of_session AS copy,
  first_value(source) OVER of_session AS kept FROM session WINDOW of_session AS (
  PARTITION BY pseudonym, protocol_sha256, begun, stamp_ns ORDER BY trials DESC, source, number);
PRAGMA user_version = {DEFINITIONS};
COMMIT;
"""
_KEPT = """
CREATE TABLE IF NOT EXISTS kept.access (
  at INTEGER NOT NULL, who TEXT NOT NULL, what TEXT NOT NULL, pseudonym TEXT NOT NULL,
  place TEXT NOT NULL) STRICT;
CREATE TABLE IF NOT EXISTS kept.forgotten (digest TEXT PRIMARY KEY, at INTEGER NOT NULL) STRICT;
"""
_SESSION = """INSERT INTO session VALUES (:source, :number, :pseudonym, :side, :begun, :utc_offset,
  :protocol, :level, :protocol_sha256, :simulated, :outcome, :stops, :robot, :software, :law,
  :support, :arm_weight, :stamp_ns, :trials, :minutes)"""


@functools.cache
def digest(pseudonym: str) -> str:
    """Return what is kept of a forgotten patient. It takes 50 ms, against trying all pseudonyms."""
    return hashlib.scrypt(pseudonym.encode(), salt=b"screw_module_ros", n=2**14, r=8, p=1).hex()


class Record:
    """The record of a folder of bags, or one in memory of what is added to it.

    folder: None in memory; base: the database, for reading; notes: sentences about what `update`
    and `add` left out; who: reads and writes it, by default the account.
    """

    def __init__(self, folder: Path | None = None):
        """Open it; both files are their owner's alone. Raises OSError, sqlite3.Error."""
        self.folder, self.notes, self.who = folder, list[str](), getpass.getuser()
        files = [str(folder / name) if folder else ":memory:" for name in (RECORD, ACCESS)]
        for file in files if folder else ():
            os.close(owner_only(file, os.O_CREAT | os.O_RDWR))
        self.base = sqlite3.connect(files[0], isolation_level=None)
        self.base.row_factory = sqlite3.Row
        self.base.execute("ATTACH ? AS kept", files[1:])
        for pragma in _PRAGMAS:
            self.base.execute(f"PRAGMA {pragma}")
        self.base.executescript(_KEPT)
        if folder is None:
            self.base.executescript(_SCHEMA)

    @property
    def is_current(self) -> bool:
        """Whether it was made with the present definitions of the measures."""
        return self.base.execute("PRAGMA user_version").fetchone()[0] == DEFINITIONS

    def update(self, thorough: bool = False) -> None:
        """Take new sources and leave those that have gone; without news nothing is written.

        thorough: also look at bags that are known, or unfinished. With other definitions all is
        made again. Raises BagError while another process does this.
        """
        assert self.folder is not None
        known = dict(self.base.execute("SELECT * FROM source")) if self.is_current else {}
        found = {}
        for path in sources(self.folder, () if thorough else known):
            name, is_new = path.name, path.name not in known and (path / METADATA_FILE).exists()
            if thorough or is_new or name.endswith(ENDING):
                found[name] = sum_of(path)
            elif name in known:
                found[name] = known[name]
        changed = [name for name in found if found[name] != known.get(name)]
        gone = known.keys() - found.keys()
        if self.is_current and not (changed or gone):
            return
        with alone(self.folder):
            if not self.is_current:
                self.base.executescript(_SCHEMA)
            for name in gone:
                self.leave(name)
            for name in changed:
                self.add(self.folder / name, name, found[name])

    def add(self, path: Path, name: str, sha256: str) -> None:
        """Take a bag or a file of scores; a note says why something of it does not count.

        In memory that is a BagError.
        """
        sessions: list[tuple[int, Recorded]] | None = []
        scores: list[tuple[str, Score]] = []
        try:
            if name.endswith(ENDING):
                scores = [(name.removesuffix(ENDING), score) for score in scores_in(path)]
            else:
                sessions = list(enumerate(read_sessions(path, self.notes, with_samples=False)))
        except (BagError, SettingError, OSError) as error:
            if self.folder is None:
                raise BagError(str(error)) from None
            if not isinstance(error, NoSession):
                self.notes.append(str(error))
                sessions = None
        told = {*(of.patient for _, of in sessions or ()), *(of for of, _ in scores)}
        gone = {pseudonym for pseudonym in told if self.is_forgotten(pseudonym)}
        if gone:
            self.notes.append(f"{path}: a patient of it was forgotten, and does not count")
        with self.writing():
            self.base.execute("DELETE FROM source WHERE name = ?", (name,))
            if sessions is None or gone and gone == told:
                return
            self.base.execute("INSERT INTO source VALUES (?, ?)", (name, sha256))
            for number, session in sessions:
                if session.patient not in gone:
                    self._insert(name, number, session)
            self.base.executemany(
                "INSERT INTO score VALUES (?, ?, ?, ?, ?)",
                [(of, *score, name) for of, score in scores if of not in gone],
            )

    def _insert(self, name: str, number: int, session: Recorded) -> None:
        self.base.execute(_SESSION, _session_row(session, name, number))
        self.base.executemany(
            "INSERT INTO trial VALUES (?, ?, ?, ?)",
            [(name, number, row["trial"], _text(session, row)) for row in session.trials],
        )

    def leave(self, name: str) -> None:
        """Take out what came from a source."""
        with self.writing():
            self.base.execute("DELETE FROM source WHERE name = ?", (name,))

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Write all of it or nothing, whatever ends the process."""
        with self.base:
            self.base.execute("BEGIN IMMEDIATE")
            yield

    def sessions(self, pseudonym: str = "") -> list[sqlite3.Row]:
        """Return the sessions that count, of one patient or all, by patient and time."""
        which, of = ("AND pseudonym = ? ", (pseudonym,)) if pseudonym else ("", ())
        return self.base.execute(
            f"SELECT * FROM ranked WHERE copy = 1 {which}ORDER BY pseudonym, begun, source, number",
            of,
        ).fetchall()

    def trials(self, session: sqlite3.Row, which: str = "ORDER BY trial") -> list[Row]:
        """Return the trials of a session, None where they have no value; which: rest of the SQL."""
        found = self.base.execute(
            f"SELECT row FROM trial WHERE source = ? AND number = ? {which}",
            (session["source"], session["number"]),
        )
        return [dict(zip(_ROW, json.loads(text), strict=True)) for (text,) in found]

    def last_assisted(self, session: sqlite3.Row) -> Row | None:
        """Return the last trial of a session that had walls."""
        assisted = f"json_extract(row, '$[{_ROW.index('assisted')}]')"
        return next(iter(self.trials(session, f"AND {assisted} ORDER BY trial DESC LIMIT 1")), None)

    def path(self, session: sqlite3.Row) -> Path:
        """Return where the bag of a session lies."""
        return Path(self.folder or "", session["source"])

    def scores(self, pseudonym: str) -> list[sqlite3.Row]:
        """Return the scores of a patient by time."""
        return self.base.execute(
            "SELECT * FROM score WHERE pseudonym = ? ORDER BY julianday(at), scale", (pseudonym,)
        ).fetchall()

    def copies(self) -> list[str]:
        """Return a sentence for each session that does not count, as another bag has more of it."""
        found = self.base.execute(
            "SELECT source, kept FROM ranked WHERE copy > 1 ORDER BY source, number"
        )
        return [f"{copy} is a copy of {kept}: left out" for copy, kept in found]

    def note(self, what: str, pseudonym: str = "", place: str = "") -> None:
        """Keep for a year who has read or written what, of which patient; place: made there."""
        now = int(time.time())
        with self.writing():
            self.base.execute("DELETE FROM kept.access WHERE at < ?", (now - _KEPT_S,))
            self.base.execute("INSERT INTO kept.access VALUES (?, ?, ?, ?, ?)",
                              (now, self.who, what, pseudonym, place))  # fmt: skip

    def is_forgotten(self, pseudonym: str) -> bool:
        """Return whether a patient was forgotten here."""
        if self.base.execute("SELECT 1 FROM kept.forgotten").fetchone() is None:
            return False
        found = self.base.execute(
            "SELECT 1 FROM kept.forgotten WHERE digest = ?", (digest(pseudonym),)
        )
        return found.fetchone() is not None

    def close(self) -> None:
        """Close both files."""
        self.base.close()


def local(session: sqlite3.Row) -> datetime | None:
    """Return the local time at which a session began, without a zone where the bag tells none."""
    begun, offset = session["begun"], session["utc_offset"]
    if begun is None:
        return None
    zone = timezone(timedelta(seconds=offset or 0))
    found = datetime.fromtimestamp(begun, zone)
    return found if offset is not None else found.replace(tzinfo=None)


def sources(folder: Path, known: Container[str] = ()) -> list[Path]:
    """Return the bags directly below a folder, and the files of scores in it.

    known: names of bags into which it does not look.
    """
    bags = {path for path in folder.glob("[!.]*")
            if path.name in known or any(path.glob("[!.]*.mcap*"))}  # fmt: skip
    return sorted({*bags, *folder.glob(f"P-?????{ENDING}")})


def sum_of(path: Path) -> str:
    """Return a digest of a source; metadata.yaml has those of the files of a bag."""
    told = path / METADATA_FILE
    files = [path] if path.is_file() else [told] if told.exists() else files_of(path)
    return " ".join(map(sha256_of, files))


@contextmanager
def opened(folder: Path) -> Iterator[Record]:
    """Open the record of a folder. Raises BagError where that fails."""
    try:
        with closing(Record(folder)) as record:
            yield record
    except (OSError, sqlite3.Error) as error:
        raise BagError(f"the record of {folder} cannot be used: {error}") from None


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Be the one that writes the record of a folder. Raises BagError if another one does."""
    writes = "another program writes the record of {}: wait until it has finished"
    lock = folder_lock(folder, "record", writes)
    try:
        yield
    finally:
        lock.release()


def folder_lock(folder: Path, what: str, taken: str) -> Lock:
    """Lock what is done in a folder. Raises BagError if another process does it, OSError.

    taken: what is said then, with {} for the folder.
    """
    place = folder.stat()
    try:
        return Lock(f"{what}/{place.st_dev}/{place.st_ino}", taken.format(folder))
    except AlreadyRunning as error:
        raise BagError(str(error)) from None


def _session_row(session: Recorded, source: str, number: int) -> dict[str, Any]:
    begun, last = session.begun, session.acts[-1].state if session.acts else None
    offset = begun.utcoffset() if begun else None
    if begun and offset is None:
        begun = begun.replace(tzinfo=timezone.utc)
    carried = [row["support"] for row in session.trials if math.isfinite(row["support"])]
    stopped = (State.PAUSED, State.ABORTED)
    stops = Counter(act.reason for act in session.acts if act.state in stopped)
    controller = first_told(session, graph.CONTROLLER_STATE, "calibration", "law")
    return {
        "source": source, "number": number, "pseudonym": session.patient, "side": session.side,
        "begun": begun and begun.timestamp(),
        "utc_offset": None if offset is None else int(offset.total_seconds()),
        "protocol": session.protocol.name, "level": level_of(session.protocol),
        "protocol_sha256": session.protocol_sha256,
        "simulated": session.is_simulated, "outcome": last.word if last else "",
        "stops": json.dumps(stops, sort_keys=True), "robot": controller[0],
        "software": first_told(session, graph.SAFETY_STATE, "software")[0],
        "law": ", ".join(filter(None, (
            controller[1], *first_told(session, graph.MANUS_STATE, "law")
        ))),
        "support": sum(carried) / len(carried) if carried else None,
        "arm_weight": session.arm_weight, "stamp_ns": session.stamp_ns,
        "trials": len(session.trials), "minutes": minutes_of(session.trials),
    }  # fmt: skip


def minutes_of(trials: Iterable[Row]) -> float:
    """Return how long the movements of a session took."""
    return sum(row["ended_ns"] - row["started_ns"] for row in trials) / 60e9


def first_told(session: Recorded, topic: str, *names: str) -> list[str]:
    """Return texts of the first message of a topic, empty where the bag has none."""
    try:
        found = next(read_bag(session.folder, [session.robot + topic], by_index=True), None)
    except BagError:
        found = None
    return [str(getattr(found and found.message, name, "")) for name in names]


def _text(session: Recorded, row: Row) -> str:
    """Return the values of a trial as JSON, in the order of `_ROW`."""
    begun = session.local(row["started_ns"])
    started = begun.isoformat(timespec="milliseconds") if begun else ""
    told = [*(row[name] for name in _RESULT), *row["start"], *row["target"], started]
    return json.dumps([value if value == value else None for value in told])
