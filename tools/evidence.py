# SPDX-License-Identifier: Apache-2.0
"""`make evidence`: what this build shows of its safety, in build/evidence, open hazards first.

Each hazard of docs/hazards.md is joined with the tests and fault rows that show it, as they came
out for this build: `make faults` and `make test-all` keep their results. `--run` carries out only
what hazards name. A hazard is open while something that shows it failed or was not carried out;
then the command ends with 3, and names it. It writes its content as JSON and as a page, the parts
in CycloneDX, and the sums of these files.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from datetime import datetime, timezone
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import build_state
import evidence_page
import results_of_tests
from hazards import PAGE, Hazard, hazards
from results_of_tests import FAILED, PASSED, SKIPPED, Result

ROOT = build_state.ROOT
OUT, ROWS = ROOT / "build/evidence", ROOT / "docs/faults.md"
OPEN = 3
CANNOT = (
    "What software cannot show, and nothing here does: electrical safety, the emergency stop's "
    "circuit, brakes and the rest below the arm, cradle and skin, forces and stop times of a real "
    "machine (check_hardware --acceptance prints the form), use by people, clinical benefit, "
    "ethics, insurance. No real machine was driven by this project."
)
_ROWS_FILE = "test/faults/test_rows.py"
_ROW = re.compile(r"test_row\[(.+?)(-composed)?\]")
_LAWS = ("screw_module_ros/control", "screw_module_ros/loop", "screw_module_ros/safety")


def main() -> int:
    """Write the evidence; return 3 where a hazard is open, else 0."""
    parser = argparse.ArgumentParser(prog="make evidence", description=__doc__.split("\n")[0])
    parser.add_argument("--run", action="store_true", help="first carry out what hazards name")
    parser.add_argument("--sessions", type=Path, metavar="FOLDER",
                        help="of recorded sessions: with which software each was")  # fmt: skip
    parser.add_argument("--allow-skipped", action="store_true",
                        help="a skipped test leaves its hazard open and is no failure")  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="say only what is open")
    options = parser.parse_args()
    if options.run:
        for what in ("--hazards", "--faults"):  # what fails is in the results
            subprocess.run([sys.executable, "tools/run_tests.py", what], cwd=ROOT, check=False)
    build = build_state.state()
    found = {
        "cannot": CANNOT,
        "made": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "build": build | software(),
        "hazards": joined(hazards(PAGE.read_text(encoding="utf-8")),
                          results_of_tests.of_build(build["tried"])),
        "sessions": sessions(options.sessions) if options.sessions else [],
        "parts": parts(OUT / "parts.cdx.json"),
    }  # fmt: skip
    write(OUT, found)
    return told(found, options.quiet, options.allow_skipped)


def joined(known: Iterable[Hazard], results: Iterable[Result]) -> list[dict[str, Any]]:
    """Return each hazard with its proofs and how they came out, open ones first."""
    by_file: dict[str, list[Result]] = defaultdict(list)
    for each in results:
        by_file[each.file].append(each)
    rows = [(match[1], each) for each in by_file[_ROWS_FILE]
            if (match := _ROW.fullmatch(each.name))]  # fmt: skip
    groups = groups_of(ROWS.read_text(encoding="utf-8"))
    found = []
    for hazard in known:
        proofs = [proof(name, _of_test(name, by_file)) for name in hazard.tests]
        wanted = {name: [row for row in groups if fnmatchcase(row, name)] for name in hazard.rows}
        wanted |= {f"all of {group}": [row for row in groups if groups[row] == group]
                   for group in hazard.groups}  # fmt: skip
        for name, names in wanted.items():
            own = [(row, each) for row, each in rows if row in names]
            complete = {row for row, each in own if each.came == PASSED} >= set(names)
            proofs.append(proof(name, [each for _, each in own], complete))
        is_open = not proofs or any(each["came"] != PASSED for each in proofs)
        found.append({**hazard._asdict(), "open": is_open, "proofs": proofs,
                      "by_hand": hazard.commands})  # fmt: skip
    return sorted(found, key=lambda each: not each["open"])


def proof(name: str, results: list[Result], complete: bool = True) -> dict[str, Any]:
    """Return how a proof came out: skipped or not run where not all passed that was wanted."""
    count = {came: sum(each.came == came for each in results) for came in (PASSED, FAILED, SKIPPED)}
    came = FAILED if count[FAILED] else PASSED if count[PASSED] and complete else "not run"
    if came == "not run" and results and count[SKIPPED] == len(results):
        came = SKIPPED
    last = max(results, key=lambda each: each.at, default=None)
    return {
        "name": name, "came": came, **count, "seconds": round(sum(r.seconds for r in results), 3),
        "at": last.at if last else "", "commit": last.commit if last else "",
        "machine": last.machine if last else "",
    }  # fmt: skip


def _of_test(named: str, results: Mapping[str, list[Result]]) -> list[Result]:
    """Return the results of a file, of a test in it, or of a sentence of a conversation."""
    file, _, name = named.partition("::")
    if file.endswith(".txt"):
        told = results.get(f"{file.rpartition('/')[0]}/test_conversations.py", [])
        return [each for each in told if each.name.endswith((f"[{name}]", f": {name}]"))]
    return [each for each in results.get(file, [])
            if not name or re.split(r"\[|::", each.name)[0] == name]  # fmt: skip


def groups_of(text: str) -> dict[str, str]:
    """Return the group of each row of docs/faults.md, which a test holds to the catalogue."""
    found, group = {}, ""
    for line in text.splitlines():
        if heading := re.match(r"## (.+) \(\d+ rows\)", line):
            group = heading[1].lower()
        elif group and (row := re.match(r"[|#]+ `([^`]+)`", line)):
            found[row[1]] = group
    return found


def software() -> dict[str, Any]:
    """Return which software this is: version, digests of code, laws, parameters and protocols."""
    from screw_module_ros.calibration.plane_version import plane_law_version
    from screw_module_ros.calibration.version import law_version
    from screw_module_ros.control import laws
    from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
    from screw_module_ros.software import software as digest_of_code

    files = [ROOT / name for name in (*_LAWS, "urdf", "msg_defs")]
    files += sorted([*(ROOT / "params").rglob("*.yaml"), *(ROOT / "requirements").glob("*.txt")])
    return {
        "software": digest_of_code(),
        "laws": {law.name: law_version(law) for law in laws.LAWS}
                | {PLANE_IMPEDANCE.name: plane_law_version(PLANE_IMPEDANCE)},
        "files": {each.relative_to(ROOT).as_posix(): digest_of(each) for each in files},
    }  # fmt: skip


def digest_of(place: Path) -> str:
    """Return the SHA-256 of a file, as `sha256sum` has it, or of all below a folder."""
    if place.is_file():
        return hashlib.sha256(place.read_bytes()).hexdigest()
    return build_state.digest([place])


def sessions(folder: Path) -> list[dict[str, Any]]:
    """Return with what each session of a folder was, without its patient; see `session index`."""
    from contextlib import closing

    from screw_module_ros.recording.recorder import PARAMETERS
    from screw_module_ros.recording.records import notes
    from screw_module_ros.therapy.record import Record, local

    found = []
    with closing(Record(folder)) as record:
        record.update()
        record.note("evidence", place=str(OUT))
        for row in record.sessions():
            text = json.dumps(notes(record.path(row)).get(PARAMETERS, {}), sort_keys=True)
            found.append({
                "begun": str(local(row) or ""), "robot": row["robot"],
                "software": row["software"], "law": row["law"], "protocol": row["protocol"],
                "protocol_sha256": row["protocol_sha256"],
                "parameters_sha256": hashlib.sha256(text.encode()).hexdigest(),
            })  # fmt: skip
    return found


def parts(file: Path) -> list[dict[str, str]]:
    """Write the list of what is not made here, in CycloneDX; return name, version and licence."""
    file.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "cyclonedx_py", "environment", "--no-validate",
               "--output-reproducible", "-o", str(file), sys.executable]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True)
    document = json.loads(file.read_text(encoding="utf-8"))
    for part in document["components"]:
        if not part.get("licenses"):
            part["licenses"] = [{"license": {"name": text}} for text in _licences(part["name"])]
        part["licenses"] = part["licenses"] or [{"license": {"name": "not told by the package"}}]
    file.write_text(json.dumps(document, indent=1), encoding="utf-8")
    return [{"name": part["name"], "version": part.get("version", ""),
             "licence": ", ".join(map(_licence, part["licenses"]))}
            for part in document["components"]]  # fmt: skip


def _licence(told: dict[str, Any]) -> str:
    license_ = told.get("license", {})
    return told.get("expression") or license_.get("id") or license_.get("name", "")


def _licences(name: str) -> list[str]:
    """Return what the package.xml of a ROS package says, whose wheels do not."""
    plain = name.removeprefix("ros-").replace("-", "_")
    for share in (Path(sys.prefix) / "share", ROOT / "install" / plain / "share"):
        if (told := share / plain / "package.xml").is_file():
            return re.findall(r"<license[^>]*>([^<]+)<", told.read_text(encoding="utf-8"))
    return []


def write(folder: Path, found: dict[str, Any]) -> None:
    """Write JSON, page and sums; the page names the sum of the JSON."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(found, indent=1, sort_keys=True)
    (folder / "evidence.json").write_text(text, encoding="utf-8")
    page = evidence_page.page(found, hashlib.sha256(text.encode()).hexdigest())
    (folder / "evidence.html").write_text(page, encoding="utf-8")
    sums = [f"{digest_of(folder / name)}  {name}"
            for name in ("evidence.html", "evidence.json", "parts.cdx.json")
            if (folder / name).exists()]  # fmt: skip
    (folder / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def told(found: dict[str, Any], quiet: bool, allow_skipped: bool) -> int:
    """Say what is open; return the exit code."""
    opened = [each for each in found["hazards"] if each["open"]]
    for each in opened:
        short = [f"{p['name']} {p['came']}" for p in each["proofs"] if p["came"] != PASSED]
        print(f"OPEN {each['name']}: {'; '.join(short) or 'nothing shows it'}")
    if not quiet:
        dirty = found["build"]["dirty"]
        print(f"{len(found['hazards'])} hazards, {len(opened)} open; commit "
              f"{found['build']['commit'][:12]}{', DIRTY: ' + ', '.join(dirty) if dirty else ''}; "
              f"{OUT.relative_to(ROOT)}/evidence.html")  # fmt: skip
    if opened and not any(p["at"] for each in found["hazards"] for p in each["proofs"]):
        print("No result is of this build: make faults test-all, or make evidence ARGS=--run")
    borne = {PASSED, SKIPPED} if allow_skipped else {PASSED}
    failed = [each for each in opened
              if not each["proofs"] or {p["came"] for p in each["proofs"]} - borne]  # fmt: skip
    return OPEN if failed else 0


if __name__ == "__main__":
    sys.exit(main())
