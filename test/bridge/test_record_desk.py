# SPDX-License-Identifier: Apache-2.0
"""The record through the bridge: who reads it, what is noted, one bridge a folder, forgetting."""

from __future__ import annotations

import asyncio
import io
import json
import os
import shutil
import signal
import socket
import threading
import zipfile
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import aiohttp
import pytest
from fake_gateway import TOKENS, Served, make_server
from small_bag import MARCH, small_bag

from screw_module_ros.bridge import listener, record_desk, server
from screw_module_ros.bridge.record_desk import ACTS
from screw_module_ros.therapy import report
from screw_module_ros.therapy.arm_weights import ArmWeight, keep, weights_file
from screw_module_ros.therapy.record import Record, alone
from screw_module_ros.therapy.scores import Score, keep_scores

pytestmark = pytest.mark.long

HER, DAY, DEADLINE_S = "P-7K3QX", 86400, 60.0
T7 = TOKENS["therapist:T7"]
REACHES = [{"duration": 1.0 + n / 100, "sparc": -1.5, "path_error": 0.004, "pm4": 0.12,
            "mean_speed": 0.1, "assisted": n > 6, "slot_duration": 1.2, "side_stiffness": 90.0,
            "support": 11.0} for n in range(9)]  # fmt: skip


def addresses():
    """Return each address of the record with its method."""
    return [(method, f"/record/{what if what == 'patients' else f'{HER}/{what}'}")
            for method, what in ACTS]  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two patients, a log of ROS, state, and where the pages of a session look for no record."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    place = tmp_path / "sessions"
    (tmp_path / "log").mkdir()
    small_bag(place, HER, MARCH, REACHES)
    small_bag(place, HER, MARCH + 7 * DAY, REACHES)
    small_bag(place, "P-22222", MARCH, REACHES[:2], side="right")
    keep_scores(place, HER, [Score("2026-03-03T14:00:00+01:00", "FM_UE", 34.0)])
    keep(weights_file(), HER, "left", ArmWeight(18.4, 1.2, MARCH))
    return place


@pytest.fixture
def serve(gateway):
    """Return what serves the record of a folder: the server."""
    made = []

    def started(folder, **more):
        made.append(Served(make_server(gateway, folder=folder, **more)))
        return made[-1].__enter__()

    yield started
    for served in made:
        served.__exit__()


def ask(server, path, token=T7, method="GET", given=None):
    """Return status, body and headers of an answer."""

    async def asked():
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        body = json.dumps(given) if given is not None else None
        async with aiohttp.ClientSession() as session:
            to = server.address + path
            async with session.request(method, to, headers=headers, data=body) as response:
                return response.status, await response.read(), response.headers

    return asyncio.run(asyncio.wait_for(asked(), DEADLINE_S))


def told(server, path, **more):
    status, body, _ = ask(server, path, **more)
    assert status == 200, body
    return json.loads(body)


def noted(folder):
    with closing(Record(folder)) as record:
        return [(row["who"], row["what"], row["pseudonym"])
                for row in record.base.execute("SELECT * FROM kept.access")]  # fmt: skip


def indexed(folder):
    with closing(Record(folder)) as record:
        known = record.is_current and record.sessions()
        return [row["source"] for row in known or ()]


def found(root: Path, text: str) -> list[str]:
    return [
        str(path) for path in root.rglob("*")
        if text in path.name or path.is_file() and text.encode() in path.read_bytes()
    ]  # fmt: skip


# Who may read ------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "path"), addresses())
def test_no_address_of_the_record_answers_who_is_no_therapist(serve, folder, method, path):
    """Neither without a token, nor with the patient's, nor with a therapist's in the address."""
    given = {"pseudonym": HER, "scale": "FM_UE", "value": 1}
    before, server = found(folder, HER), serve(folder)
    for token in (None, "x" * 32, TOKENS["patient"], f"{T7}x"):
        status, body, _ = ask(server, path, token, method, given)
        assert status in (401, 403) and HER not in body.decode()
    for token in (None, TOKENS["patient"]):
        assert ask(server, f"{path}?token={T7}", token, method, given)[0] == 403
    assert noted(folder) == [] and set(before) <= set(found(folder, HER))


@pytest.mark.parametrize(("method", "path"), [
    ("POST", "patients"), ("PUT", f"{HER}/score"), ("GET", f"{HER}/score"),
    ("GET", f"{HER}/patients"),
    ("DELETE", f"{HER}/patient"), ("GET", "report"), ("GET", "forget"), ("GET", f"{HER}/access"),
])  # fmt: skip
def test_nothing_else_is_served(serve, folder, method, path):
    assert ask(serve(folder), f"/record/{path}", method=method)[0] == 404
    assert noted(folder) == []


@pytest.mark.parametrize("name", ["Erika", "P-1", "..", "P-7K3QX_", ".%2e", "P-ABCDE"])
def test_what_is_no_pseudonym_names_no_file(serve, folder, name):
    assert ask(serve(folder), f"/record/{quote(name, safe='%')}/forget")[0] in (403, 404, 409)


def test_who_read_and_wrote_what_is_kept(serve, folder):
    server = serve(folder)
    told(server, "/record/patients")
    told(server, f"/record/{HER}/patient", token=TOKENS["therapist"])
    ask(server, f"/record/{HER}/score", method="POST", given={"scale": "FM_UE", "value": 36})
    ask(server, f"/record/{HER}/export")
    assert noted(folder) == [
        ("therapist:T7", "patients", ""), ("therapist", "patient", HER),
        ("therapist:T7", "score", HER), ("therapist:T7", "export", HER),
    ]  # fmt: skip


def test_a_token_that_was_taken_away_ends_at_once(serve, folder, monkeypatch):
    monkeypatch.setattr(server, "_WATCH_NS", 0)
    tokens = dict(TOKENS)
    served = serve(folder, tokens=lambda: tokens)

    async def ended():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{served.address}/ws?token={T7}")
            other = await session.ws_connect(f"{served.address}/ws?token={TOKENS['therapist']}")
            del tokens["therapist:T7"]
            await page.receive()
            return page.closed, other.closed

    assert asyncio.run(asyncio.wait_for(ended(), DEADLINE_S)) == (True, False)
    assert ask(served, "/record/patients")[0] == 403
    assert ask(served, "/record/patients", TOKENS["therapist"])[0] == 200


# What is shown -----------------------------------------------------------------------------


def test_the_list_tells_what_is_due_and_proposes_the_last_settings(serve, folder):
    other, hers = told(serve(folder), "/record/patients")["patients"]
    assert (hers["patient"], hers["side"], hers["sessions"]) == (HER, "left", 2)
    assert hers["seen"].startswith("2026-03-10") and "+" in hers["seen"]
    assert (hers["support"], hers["duration"], hers["stiffness"]) == (11.0, 1.2, 90.0)
    assert hers["due"] == ["weigh", "assess"], "both are months old"
    assert (other["side"], other["duration"], other["closed"]) == ("right", None, False)


def test_what_was_done_lately_is_not_due(serve, folder, monkeypatch):
    monkeypatch.setattr("screw_module_ros.therapy.overview.time.time", lambda: MARCH + 13 * DAY)
    server = serve(folder)
    assert told(server, "/record/patients")["patients"][1]["due"] == []
    scored = {"scale": "side", "value": 1}
    about = told(server, f"/record/{HER}/score", method="POST", given=scored)["about"]
    assert (about["side"], about["due"]) == ("right", ["weigh"]), "the other arm was not weighed"


def test_a_patient_is_shown_with_eleven_lines_sessions_and_scores(serve, folder):
    found = told(serve(folder), f"/record/{HER}/patient")
    lines = found["progress"]["lines"]
    assert len(lines) == 11 and lines[2]["points"][0]["text"].startswith("1.03 (1.00 to 1.06)")
    assert lines[9]["points"][0]["value"] is None, "what is no number is null"
    assert [row["trials"] for row in found["sessions"]] == [9, 9]
    assert found["scores"][0]["value"] == 34.0


def test_who_has_no_session_yet_can_be_scored(serve, folder):
    server = serve(folder)
    assert told(server, "/record/P-33333/patient")["about"] is None
    scored = {"scale": "ARAT", "value": 12, "at": "2026-03-01T09:00+01:00"}
    told(server, "/record/P-33333/score", method="POST", given=scored)
    names = [each["patient"] for each in told(server, "/record/patients")["patients"]]
    assert names == ["P-22222", "P-33333", HER]


@pytest.mark.parametrize(("given", "status", "sentence"), [
    ({"scale": "FM_UE", "value": 67}, 409, "FM_UE ends at 66"),
    ({"scale": "mood", "value": 1}, 409, "scale"), ({"scale": "FM_UE", "value": "much"}, 409, ""),
    ({"scale": "FM_UE", "value": None}, 400, ""), ({"scale": "FM_UE"}, 400, "missing"),
    ({"scale": "FM_UE", "value": 3, "at": "today"}, 409, "a time like"), ([], 400, "missing"),
    ({"scale": "FM_UE", "value": 3, "at": 7}, 400, ""), ("Erika Musterfrau", 409, ""),
])  # fmt: skip
def test_a_score_that_is_none_is_refused(serve, folder, given, status, sentence):
    before = (folder / f"{HER}_scores.json").read_text()
    got, body, _ = ask(serve(folder), f"/record/{HER}/score", method="POST", given=given)
    assert got == status and sentence in body.decode()
    assert (folder / f"{HER}_scores.json").read_text() == before


def test_closed_is_kept_beside_the_bags(serve, folder):
    server = serve(folder)
    for value in (1, 0, 1):
        given = {"scale": "closed", "value": value, "at": f"2026-04-0{2 + value}T09:00:00+02:00"}
        about = told(server, f"/record/{HER}/score", method="POST", given=given)["about"]
    assert about["closed"], "the latest counts"
    (folder / "record.db").unlink()
    assert told(server, f"/record/{HER}/patient")["about"]["closed"]


def test_a_report_and_an_export_are_files(serve, folder):
    server = serve(folder)
    status, body, headers = ask(server, f"/record/{HER}/report?session=1")
    assert status == 200 and b"Sessions of P-7K3QX" in body and b"2026-03-03" in body
    assert headers["Content-Disposition"] == f'attachment; filename="report_{HER}.html"'
    assert ask(server, f"/record/{HER}/report?session=9")[0] == 400
    status, body, headers = ask(server, f"/record/{HER}/export?shift=1&rename=1")
    packed = zipfile.ZipFile(io.BytesIO(body))
    names = sorted(name.partition("/")[2] for name in packed.namelist())
    assert names == ["columns.csv", "scores.csv", "sessions.csv", "trials.csv"]
    for name in packed.namelist():
        assert HER not in name and HER.encode() not in packed.read(name)
        assert b"2026-03" not in packed.read(name)
    status, body, headers = ask(server, f"/record/{HER}/export")
    assert HER in headers["Content-Disposition"] and HER.encode() in body


def test_a_report_is_drawn_in_a_process_of_its_own(serve, folder, monkeypatch):
    """Drawing holds the interpreter's lock, and with it the software stop of a page."""
    monkeypatch.setattr(report, "report_text", None)  # of this process
    status, body, _ = ask(serve(folder), f"/record/{HER}/report")
    assert status == 200 and b"Sessions of P-7K3QX" in body


def ended(bag, number):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_report_whose_process_ends_is_told(serve, folder, monkeypatch):
    monkeypatch.setattr(record_desk, "drawn", ended)
    status, body, _ = ask(serve(folder), f"/record/{HER}/report")
    assert status == 409 and b"try again" in body


# Forget ------------------------------------------------------------------------------------


def test_forgetting_asks_for_the_pseudonym_again_and_leaves_no_byte(serve, folder, tmp_path):
    """Below the folder, the state and the logs; what it cannot reach is told."""
    (tmp_path / "log" / "old.log").write_text(f"an older version named {HER}")
    server = serve(folder)
    shown = told(server, f"/record/{HER}/forget")
    assert len(shown["own"]) == 3 and str(folder / f"{HER}_scores.json") in shown["own"]
    assert shown["shared"] == [str(tmp_path / "log" / "old.log")]
    assert any("backups" in each for each in shown["beyond"])
    before = found(tmp_path, HER)
    for given in ({}, {"pseudonym": "P-22222"}, {"pseudonym": ""}):
        status, body, _ = ask(server, f"/record/{HER}/forget", method="POST", given=given)
        assert status == 409 and b"nothing was deleted" in body
    assert set(before) <= set(found(tmp_path, HER))
    told(server, f"/record/{HER}/forget", method="POST", given={"pseudonym": HER})
    assert found(tmp_path, HER) == [str(tmp_path / "log" / "old.log")]
    assert noted(folder)[-1] == ("therapist:T7", "forget", "")
    assert [each["patient"] for each in told(server, "/record/patients")["patients"]] == ["P-22222"]


# Indexing ----------------------------------------------------------------------------------


def test_what_the_recorder_has_closed_is_indexed_by_itself(serve, folder, monkeypatch, wait_until):
    for module, name in ((record_desk, "_LOOK_NS"), (server, "_WATCH_NS")):
        monkeypatch.setattr(module, name, 10_000_000)
    bag = small_bag(folder, "P-33333", MARCH, REACHES, closed=False)
    serve(folder)
    wait_until(lambda: len(indexed(folder)) == 3)
    assert bag.name not in indexed(folder), "it is not closed"
    shutil.rmtree(bag)
    small_bag(folder, "P-33333", MARCH, REACHES)
    wait_until(lambda: bag.name in indexed(folder))
    assert noted(folder) == []


def test_a_second_bridge_on_a_folder_is_refused_until_the_first_ends(folder, gateway, wait_until):
    said, first = [], Served(make_server(gateway, folder=folder))
    told(first.__enter__(), "/record/patients")
    with Served(make_server(gateway, folder=folder, log=said.append)) as second:
        status, body, _ = ask(second, "/record/patients")
        assert status == 409 and b"another bridge shows the record of" in body
        assert ask(second, "/config.json")[0] == 200, "sessions go on"
        assert noted(folder) == [("therapist:T7", "patients", "")]
        wait_until(lambda: said)
        first.__exit__()
        assert ask(second, "/record/patients")[0] == 200
    assert len(said) == 1 and "another bridge" in said[0]


def test_another_writer_is_told_and_nothing_is_waited_for(serve, folder):
    server = serve(folder)
    with alone(folder):
        status, body, _ = ask(server, f"/record/{HER}/patient")
    assert status == 409 and b"another program writes the record" in body
    assert ask(server, f"/record/{HER}/patient")[0] == 200


def test_without_recordings_there_is_a_sentence(serve, tmp_path):
    status, body, _ = ask(serve(tmp_path / "none"), "/record/patients")
    assert status == 409 and b"nothing has been recorded in" in body
    assert not (tmp_path / "none").exists()


def test_pages_of_a_session_do_not_wait_for_the_record(serve, folder, monkeypatch):
    """A report may take long: the bridge's own thread goes on meanwhile."""
    ends = threading.Event()
    monkeypatch.setitem(ACTS, ("GET", "report"), lambda *given: ends.wait(DEADLINE_S) and {})
    server = serve(folder)
    waiting = threading.Thread(target=ask, args=(server, f"/record/{HER}/report"))
    waiting.start()
    assert ask(server, "/config.json")[0] == 200
    assert waiting.is_alive()
    ends.set()
    waiting.join()


def test_an_answer_may_take_longer_than_a_request_may(serve, folder, monkeypatch):
    """A report of a long session was cut off after 10 s, as if no request had come."""
    monkeypatch.setattr(listener, "_OPENING_S", 0.3)
    begun, ends, answers = threading.Event(), threading.Event(), []

    def slowly(*given):
        begun.set()
        return ends.wait(DEADLINE_S) and {}

    monkeypatch.setitem(ACTS, ("GET", "report"), slowly)
    server = serve(folder)
    waiting = threading.Thread(
        target=lambda: answers.append(ask(server, f"/record/{HER}/report"))
    )
    waiting.start()
    assert begun.wait(DEADLINE_S)
    host, _, port = server.address.partition("://")[2].partition(":")
    with socket.create_connection((host, int(port)), timeout=DEADLINE_S) as idle:
        assert idle.recv(1) == b"", "who came later without a request has been closed"
    ends.set()
    waiting.join()
    assert answers[0][0] == 200


def steps(folder: Path, patients: int) -> int:
    """Return the work of the database for one patient's page, in virtual instructions."""
    with closing(Record(folder)) as record:
        record.update()
        for number in range(patients):
            name = f"P-{number:05}"
            with record.writing():
                record.base.execute("INSERT INTO source VALUES (?, '')", (name,))
                for table in ("session", "trial"):
                    record.base.execute(
                        f"CREATE TEMP TABLE one AS SELECT * FROM {table} WHERE source LIKE 'P-222%'"
                    )
                    changes = ", pseudonym = ?1" if table == "session" else ""
                    record.base.execute(f"UPDATE one SET source = ?1{changes}", (name,))
                    record.base.execute(f"INSERT INTO {table} SELECT * FROM one")
                    record.base.execute("DROP TABLE one")
        count = [0]

        def step():
            count[0] += 1

        record.base.set_progress_handler(step, 100)
        ACTS["GET", "patient"](record, HER, {})
        record.base.set_progress_handler(None, 0)
        return count[0]


def test_the_page_of_a_patient_takes_no_longer_with_more_patients(folder):
    """The database does the same work for one of 3 and of 303; wall clock is not judged."""
    few, more = steps(folder, 0), steps(folder, 300)
    assert 0 < more < 1.5 * few + 5

