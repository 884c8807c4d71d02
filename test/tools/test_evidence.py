# SPDX-License-Identifier: Apache-2.0
"""`make evidence`: a hazard is met while all that shows it passed on this very build."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from xml.sax.saxutils import quoteattr

import pytest
from small_bag import protocol, small_bag

import build_state
import evidence
import evidence_page
import results_of_tests
import run_tests
from hazards import PAGE, hazards
from results_of_tests import FAILED, PASSED, SKIPPED, Result

HAZARD = """## Force

### It pulls too hard

- *Cause*: a gain
- *Mitigation*: a limit
- *Shown by*: `test/control/test_limits.py::test_limit`, `test/devices/drive.txt::it
  stops`; `encoder-*`; all of bus; `make soak`
"""
ROWS = "## Bus (2 rows)\n\n| `cable-out` | x |\n| `cable-late` | x |\n\n## Sensors (1 rows)\n\n" \
       "| `encoder-freeze` | x |\n"  # fmt: skip
CASES = {
    ("test.control.test_limits", "test_limit[a::b]"): "",
    ("test.control.test_limits", "test_limit_of_another"): "<failure/>",
    ("test.devices.test_conversations", "test_conversation[drive: it stops]"): "",
    ("test.faults.test_rows", "test_row[encoder-freeze]"): "",
    ("test.faults.test_rows", "test_row[cable-out]"): "",
    ("test.faults.test_rows", "test_row[cable-late-composed]"): "",
}


def write_run(folder, cases, tried="today", name="all", at="2026-01-01T00:00:00+00:00"):
    folder.mkdir(exist_ok=True)
    told = [f"<testcase classname={quoteattr(of)} name={quoteattr(test)} time='0.5'>{came}"
            "</testcase>" for (of, test), came in cases.items()]  # fmt: skip
    (folder / f"{name}.xml").write_text(f"<testsuites>{''.join(told)}</testsuites>")
    run = {"tried": tried, "at": at, "commit": "c0ffee", "machine": "here"}
    (folder / f"{name}.json").write_text(json.dumps(run))


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Run the command on a page of one hazard and kept results; return what it wrote."""

    def run(cases=CASES, tried="today", *options):
        write_run(tmp_path / "results", cases, tried)
        for name, text in (("PAGE", HAZARD), ("ROWS", ROWS)):
            (tmp_path / name).write_text(text, encoding="utf-8")
            monkeypatch.setattr(evidence, name, tmp_path / name)
        state = {"commit": "c0ffee" * 6, "committed": "2026", "dirty": ["units.py"],
                 "tried": "today"}  # fmt: skip
        monkeypatch.setattr(build_state, "state", lambda: state)
        monkeypatch.setattr(evidence, "ROOT", tmp_path)
        monkeypatch.setattr(evidence, "OUT", tmp_path / "out")
        software = {"software": "1", "laws": {}, "files": {}}
        monkeypatch.setattr(evidence, "software", lambda: software)
        monkeypatch.setattr(evidence, "parts", lambda file: [])
        of_build = results_of_tests.of_build
        monkeypatch.setattr(results_of_tests, "of_build",
                            lambda tried: of_build(tried, tmp_path / "results"))  # fmt: skip
        monkeypatch.setattr(sys, "argv", ["evidence", *options])
        code = evidence.main()
        return code, json.loads((tmp_path / "out/evidence.json").read_text("utf-8"))

    return run


def test_a_hazard_is_met_when_all_that_shows_it_passed(made, capsys):
    code, found = made()
    assert code == 0
    (hazard,) = found["hazards"]
    assert not hazard["open"] and hazard["by_hand"] == ["make soak"]
    assert [(each["name"], each["passed"]) for each in hazard["proofs"]] == [
        ("test/control/test_limits.py::test_limit", 1), ("test/devices/drive.txt::it stops", 1),
        ("encoder-*", 1), ("all of bus", 2),
    ]  # fmt: skip
    assert {each["commit"] for each in hazard["proofs"]} == {"c0ffee"}
    assert "1 hazards, 0 open" in capsys.readouterr().out


@pytest.mark.parametrize("case", [case for case in CASES if "another" not in case[1]], ids=str)
@pytest.mark.parametrize("change", ["deleted", "<failure/>", "<error/>", "<skipped/>"])
def test_without_one_of_them_it_is_open_and_named(made, capsys, case, change):
    cases = {key: came for key, came in CASES.items() if key != case or change != "deleted"}
    if change != "deleted":
        cases[case] = change
    code, found = made(cases)
    assert code == evidence.OPEN == 3
    assert found["hazards"][0]["open"]
    assert "OPEN It pulls too hard: " in capsys.readouterr().out


@pytest.mark.parametrize("change", ["<skipped/>", "<failure/>"])
def test_what_was_skipped_may_be_borne_and_stays_open(made, capsys, change):
    case = ("test.control.test_limits", "test_limit[a::b]")
    code, found = made({**CASES, case: change}, "today", "--quiet", "--allow-skipped")
    assert code == (3 if "failure" in change else 0)
    assert found["hazards"][0]["open"]
    assert capsys.readouterr().out.startswith("OPEN It pulls too hard: ")


def test_a_row_that_did_not_run_is_not_made_up_for_by_another_one(made):
    cases = {key: came for key, came in CASES.items() if "cable-late" not in key[1]}
    cases["test.faults.test_rows", "test_row[cable-out-composed]"] = ""
    code, found = made(cases)
    assert code == 3
    assert [each["came"] for each in found["hazards"][0]["proofs"]][-1] == "not run"


def test_results_of_another_build_show_nothing(made, capsys):
    code, _ = made(CASES, "yesterday")
    assert code == 3
    assert "No result is of this build" in capsys.readouterr().out


def test_a_tree_that_differs_from_its_commit_says_so(made, capsys, tmp_path):
    made()
    assert "DIRTY: units.py" in capsys.readouterr().out
    assert "DIRTY: 1 files differ" in (tmp_path / "out/evidence.html").read_text("utf-8")


def test_what_software_cannot_show_comes_first_and_the_sums_fit(made, tmp_path):
    made()
    page = (tmp_path / "out/evidence.html").read_text("utf-8")
    assert page.partition("<body>")[2].strip().startswith('<p class="first">What software cannot')
    lines = (tmp_path / "out/SHA256SUMS").read_text().splitlines()
    sums = dict(line.split()[::-1] for line in lines)
    content = (tmp_path / "out/evidence.json").read_bytes()
    assert sums["evidence.json"] == hashlib.sha256(content).hexdigest()
    assert sums["evidence.json"] in page


def test_the_later_run_of_a_test_counts(tmp_path):
    case = ("test.control.test_limits", "test_limit")
    write_run(tmp_path, {case: ""}, name="old", at="2026-01-01T00:00:00+00:00")
    write_run(tmp_path, {case: "<failure/>"}, name="new", at="2026-01-02T00:00:00+00:00")
    (result,) = results_of_tests.of_build("today", tmp_path)
    assert result.came == FAILED


def test_results_count_only_if_nothing_changed_while_they_came(tmp_path, monkeypatch, capsys):
    states = iter([{"tried": "a"}, {"tried": "a"}, {"tried": "a"}, {"tried": "b"}])
    monkeypatch.setattr(build_state, "state", lambda: next(states))
    for _ in range(2):
        with results_of_tests.kept("all", tmp_path) as options:
            assert options == ["--junit-xml", str(tmp_path / "all.xml")]
        kept = (tmp_path / "all.json").exists()
        assert kept == ("no evidence" not in capsys.readouterr().out)
    assert not kept


def test_a_changed_byte_of_a_law_gives_another_digest(tmp_path):
    copy = shutil.copytree(build_state.ROOT / "screw_module_ros/control", tmp_path / "control")
    before = build_state.digest([copy])
    assert before == build_state.digest([build_state.ROOT / "screw_module_ros/control"])
    law = copy / "laws/thesis.py"
    law.write_bytes(law.read_bytes() + b"\n")
    assert build_state.digest([copy]) != before


def test_a_state_names_commit_and_what_differs_from_it(tmp_path):
    def git(*arguments):
        who = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@b.invalid",
               "GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL": "a@b.invalid"}  # fmt: skip
        subprocess.run(["git", "-C", tmp_path, *arguments], check=True, env={**os.environ, **who},
                       capture_output=True)  # fmt: skip

    assert build_state.state(tmp_path)["dirty"] == [build_state.UNKNOWN]
    (tmp_path / "params").mkdir()
    (tmp_path / "params/a.yaml").write_text("a: 1\n")
    git("init", "-q")
    git("add", "."), git("commit", "-qm", "a")
    clean = build_state.state(tmp_path)
    assert re.fullmatch("[0-9a-f]{40}", clean["commit"]) and clean["dirty"] == []
    (tmp_path / "params/a.yaml").write_text("a: 2\n")
    changed = build_state.state(tmp_path)
    assert changed["dirty"] == ["params/a.yaml"]
    assert changed["commit"] == clean["commit"] and changed["tried"] != clean["tried"]


def test_what_hazards_name_is_carried_out_in_the_order_of_its_files():
    """A test with a browser leaves an event loop behind, which others of its file cannot bear."""
    named = run_tests.named()
    assert named == sorted(named, key=lambda test: test.partition("::")[0])
    page = [test.partition("::")[2] for test in named if "test_web_bridge.py" in test]
    text = (build_state.ROOT / "test/nodes/test_web_bridge.py").read_text("utf-8")
    assert page and page == sorted(page, key=lambda name: text.index(f"def {name}("))


@pytest.mark.long
def test_the_parts_are_listed_with_their_licences(tmp_path):
    found = {part["name"]: part for part in evidence.parts(tmp_path / "parts.cdx.json")}
    assert found["numpy"]["version"] and "BSD" in found["numpy"]["licence"]
    assert found["screw_module_ros"]["licence"] == "Apache-2.0"
    document = json.loads((tmp_path / "parts.cdx.json").read_text("utf-8"))
    assert document["bomFormat"] == "CycloneDX"
    assert all(part["licenses"] for part in document["components"])


def test_the_software_is_named_by_law_and_files():
    found = evidence.software()
    assert set(found["laws"]) == {"thesis", "impedance"}
    file = "params/therapy/clock_adaptive.yaml"
    content = (build_state.ROOT / file).read_bytes()
    assert found["files"][file] == hashlib.sha256(content).hexdigest()


def test_each_session_names_its_software_law_protocol_and_parameters(tmp_path):
    small_bag(tmp_path, "P-7K3QX")
    small_bag(tmp_path, "P-9M4TR", definition=protocol(count=3))
    found = evidence.sessions(tmp_path)
    assert [each["software"] for each in found] == ["0.1.0 0123456789ab"] * 2
    assert {each["law"] for each in found} == {"force 1.0"}
    assert len({each["protocol_sha256"] for each in found}) == 2
    assert {len(each["parameters_sha256"]) for each in found} == {64}
    assert "P-7K3QX" not in json.dumps(found)
    known = evidence_page.page({
        "cannot": "", "made": "", "hazards": [], "parts": [], "sessions": found,
        "build": {"software": "0.1.0 0123456789ab, commit 0a1b2c3d4e5f", "commit": "",
                  "committed": "", "tried": "", "dirty": ["units.py"], "laws": {}, "files": {}},
    }, "")  # fmt: skip
    assert known.count("(this build, dirty)") == 2


@pytest.mark.long
def test_each_proof_on_the_page_of_hazards_is_a_test_that_is_carried_out():
    """With every test that pytest finds passed, no hazard is open."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "fault or not fault"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=build_state.ROOT, check=True)
    names = [line for line in run.stdout.splitlines() if line.startswith("test/")]
    results = []
    for file, _, name in (line.partition("::") for line in names):
        name = name.encode("latin-1").decode("unicode-escape")
        results.append(Result(file, name, PASSED, 0.0, "now", "c0ffee", "here"))
    found = evidence.joined(hazards(PAGE.read_text(encoding="utf-8")), results)
    assert [each["name"] for each in found if each["open"]] == []
    skipped = [each._replace(came=SKIPPED) for each in results]
    assert all(each["open"] for each in evidence.joined(hazards(PAGE.read_text("utf-8")), skipped))
