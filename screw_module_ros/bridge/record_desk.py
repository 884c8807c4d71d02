# SPDX-License-Identifier: Apache-2.0
"""The record of the patients for therapists' pages, and its only writer while a bridge runs.

One thread reads and writes it, so that no page of a session waits for a whole answer. It has the
bridge's own priority: at a lower one, others kept it from the processor while it held the
interpreter's lock, and the pages waited with it. A report is drawn in a process of its own, since
drawing holds that lock too, and the software stop of a page must not wait. The thread also takes
into the record what the recorder has closed. Who has asked for what is kept with it.
"""

from __future__ import annotations

import asyncio
import io
import json
import signal
import zipfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from aiohttp import web

from ..locks import Lock
from ..recording.bag import METADATA_FILE, BagError
from ..recording.pseudonym import checked_pseudonym
from ..therapy.export import csv_text, masked, tables
from ..therapy.keeping import BEYOND_REACH, forget, of_patient
from ..therapy.overview import patient, patients
from ..therapy.record import Record, alone, folder_lock, opened
from ..therapy.recorded import read_sessions
from ..therapy.replay import replayed
from ..therapy.scores import Score, keep_scores, time_now

_LOOK_NS = 10_000_000_000
_TAKEN = (
    "another bridge shows the record of {}: open the pages of that one, end it, or give this one "
    "another folder (parameter recordings)"
)
_Given = Mapping[str, Any]
_Act = Callable[[Record, str, _Given], Any]


def drawn(bag: Path, number: int) -> bytes:
    """Return the report of a session of a bag. Raises BagError, OSError."""
    from ..therapy.report import report_text  # matplotlib takes a second

    session = read_sessions(bag)[number]
    return report_text([session], [replayed(session)]).encode()


def _report(record: Record, pseudonym: str, given: _Given) -> Any:
    row = record.sessions(pseudonym)[int(given.get("session", 0)) - 1]
    ctrl_c = signal.SIGINT, signal.SIG_IGN  # it is the bridge's, which ends this process
    with ProcessPoolExecutor(1, get_context("spawn"), signal.signal, ctrl_c) as apart:
        body = apart.submit(drawn, record.path(row), row["number"]).result()
    return f"report_{pseudonym}.html", body, "text/html"


def _export(record: Record, pseudonym: str, given: _Given) -> Any:
    mask = masked([pseudonym], "shift" in given, "rename" in given)[pseudonym]
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, text in tables(record, pseudonym, mask, csv_text).items():
            packed.writestr(f"{mask.patient}/{name}", text)
    return f"export_{mask.patient}.zip", stream.getvalue(), "application/zip"


def _score(record: Record, pseudonym: str, given: _Given) -> Any:
    at = given.get("at") or time_now()
    folder = Path(record.folder or "")
    with alone(folder):
        keep_scores(folder, pseudonym, [Score(at, given["scale"], float(given["value"]))])
    record.update()
    return patient(record, pseudonym)


def _forgets(record: Record, pseudonym: str, given: _Given) -> Any:
    own, shared = of_patient(record, Path(record.folder or ""), pseudonym)
    return {"own": [*map(str, own)], "shared": [*map(str, shared)], "beyond": BEYOND_REACH}


def _forget(record: Record, pseudonym: str, given: _Given) -> Any:
    if given.get("pseudonym") != pseudonym:
        raise ValueError("the pseudonym was not written again: nothing was deleted")
    told = _forgets(record, pseudonym, given)
    forget(record, Path(record.folder or ""), pseudonym)
    record.note("forget")  # what named the patient has gone
    return told


ACTS: dict[tuple[str, str], _Act] = {
    ("GET", "patients"): lambda record, *_: {"patients": patients(record), "notes": record.notes},
    ("GET", "patient"): lambda record, pseudonym, _: patient(record, pseudonym),
    ("GET", "report"): _report, ("GET", "export"): _export, ("GET", "forget"): _forgets,
    ("POST", "score"): _score, ("POST", "forget"): _forget,
}  # fmt: skip
"""By method and last part of the address: what is done. It returns what becomes JSON, or name,
content and type of a file."""


class RecordDesk:
    """Answers what therapists ask of the record of a folder, and takes new bags into it.

    log: takes a sentence, none of which names a patient.
    """

    def __init__(self, folder: Path, log: Callable[[str], None]):
        self.folder, self._log = folder, log
        self._thread = ThreadPoolExecutor(1, "record")
        self._lock: Lock | None = None
        self._next_ns, self._seen, self._told = 0, set[Path](), ""

    def look(self, now_ns: int) -> None:
        """Take what the recorder has closed into the record, each 10 s."""
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + _LOOK_NS
            self._thread.submit(self._index)

    def close(self) -> None:
        """End; another bridge may then show the record. What is under way is done or undone."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        if self._lock is not None:
            self._lock.release()

    async def answer(self, request: web.Request, who: str) -> web.Response:
        """Return what somebody asks for; who: as the tokens name them. Raises HTTPException."""
        what, name = request.match_info["what"], request.match_info.get("patient", "")
        act = ACTS.get((request.method, what))
        if act is None or (what == "patients") == bool(name):
            raise web.HTTPNotFound
        try:
            pseudonym = name and checked_pseudonym(name)
            given = dict(await request.json() if request.method == "POST" else request.query)
            job = self._thread.submit(self._carry_out, act, who, what, pseudonym, given)
            found = await asyncio.wrap_future(job)
        except (LookupError, TypeError):
            raise web.HTTPBadRequest(text="something that was asked for is missing\n") from None
        except BrokenExecutor:
            raise web.HTTPConflict(text="the report's process has ended: try again\n") from None
        except (BagError, OSError, ValueError) as error:
            raise web.HTTPConflict(text=f"{error}\n") from None
        if isinstance(found, dict):
            finite = json.loads(json.dumps(found), parse_constant=lambda _: None)
            return web.Response(text=json.dumps(finite), content_type="application/json")
        file, body, kind = found
        kept = {"Content-Disposition": f'attachment; filename="{file}"'}
        return web.Response(body=body, content_type=kind, headers=kept)

    def _carry_out(self, act: _Act, who: str, what: str, pseudonym: str, given: _Given) -> Any:
        with self._opened() as record:
            record.who = who
            record.note(what, pseudonym)
            return act(record, pseudonym, given)

    def _index(self) -> None:
        try:
            found = set(self.folder.glob(f"[!.]*/{METADATA_FILE}"))
            if found != self._seen:
                with self._opened():
                    self._seen = found
            told = ""
        except BagError as error:
            told = str(error)
        if told and told != self._told:
            self._log(told)
        self._told = told

    @contextmanager
    def _opened(self) -> Iterator[Record]:
        if not self.folder.is_dir():
            raise BagError(f"nothing has been recorded in {self.folder}")
        if self._lock is None:
            self._lock = folder_lock(self.folder, "record_desk", _TAKEN)
        with opened(self.folder) as record:
            record.update()
            yield record
