# SPDX-License-Identifier: Apache-2.0
"""`make test`: pytest in a ROS domain of its own; a run that leaves something behind has failed.

What was left is removed, so that the next run starts clean. Arguments go to pytest. Without any it
is the suite without the tests marked `long`, with `--all` the whole one, by two workers: simulated
time waits for whoever is slow. `--faults` carries out the fault rows, by a worker per core and one
more: a row that kills a node waits, idle, until the middleware has dropped it. `--hazards` is what
docs/hazards.md names, without rows. Whole runs of `--all`, `--faults` and `--hazards` keep their
results for `make evidence`.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import hazards
import isolation
import leftovers
import results_of_tests

LEAVE_S = 3.0
BY_FILE = ["--dist", "loadfile", "--no-loadscope-reorder"]  # test/conftest.py orders the files
WHOLE_SUITE = ["-p", "xdist", "-n", "2", *BY_FILE, "--durations", "20"]
SUITE = [*WHOLE_SUITE, "-m", "not long and not fault"]
WORKERS = ["-n", str(len(os.sched_getaffinity(0)) + 1), "--dist", "worksteal"]
FAULTS = ["test/faults", "-p", "xdist", *WORKERS, "-v"]
ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    """Run pytest and look for leftovers; return the exit code."""
    mark = uuid.uuid4().hex
    with isolation.own_domain() as domain:
        env = {**os.environ, **isolation.variables(domain), leftovers.MARK: mark}
        # Plugins by name only: a sourced ROS brings some that do not fit this pytest.
        env["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
        # Each worker and each of the processes that tests start would compile its sources anew.
        env.pop("PYTHONDONTWRITEBYTECODE", None)
        with leftovers.Watch(mark, isolation.dds_ports(domain)) as watch:
            code = run_kept(sys.argv[1:], env)
        clean = clean_up(watch)
    return code if clean else code or 1


def chosen(arguments: list[str]) -> list[str]:
    """Return pytest's arguments for those of `make test`."""
    if not arguments:
        print("make test: without the long tests; make test-all runs them too", flush=True)
        return SUITE
    if arguments[0] == "--faults":
        return [*FAULTS, "-m", "fault", *arguments[1:]]
    if arguments == ["--hazards"]:
        return [*WHOLE_SUITE, *named()]
    return WHOLE_SUITE if arguments == ["--all"] else arguments


def named() -> list[str]:
    """Return what docs/hazards.md names, for pytest; of a conversation its file's tests.

    In the order of each file: a test with a browser leaves an event loop behind.
    """
    tests = {re.sub(r"[^/]+\.txt::.*", "test_conversations.py", test)
             for each in hazards.hazards(hazards.PAGE.read_text("utf-8"))
             for test in each.tests}  # fmt: skip
    return sorted(tests, key=_place)


def _place(test: str) -> tuple[str, int]:
    """Return the file of a test, and where in it the test stands."""
    file, _, name = test.partition("::")
    found = re.search(rf"^(def )?{name}\b", (ROOT / file).read_text("utf-8"), re.MULTILINE)
    return file, found.start() if found and name else 0


def run_kept(arguments: list[str], env: dict[str, str]) -> int:
    """Run pytest; keep the results of a whole run."""
    if arguments not in (["--all"], ["--faults"], ["--hazards"]):
        return run(chosen(arguments), env)
    with results_of_tests.kept(arguments[0].strip("-")) as options:
        return run([*chosen(arguments), *options], env)


def run(arguments: list[str], env: dict[str, str]) -> int:
    """Run pytest to its end, also when this run is interrupted: it tears its fixtures down."""
    command = [sys.executable, "-m", "pytest", *arguments]
    with subprocess.Popen(command, cwd=ROOT, env=env) as process:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to pytest as well
        signal.signal(signal.SIGTERM, lambda *_: process.send_signal(signal.SIGINT))
        return process.wait()


def clean_up(watch: leftovers.Watch) -> bool:
    """Remove what the run left behind, saying what it was; return whether there was nothing.

    A process that ends by itself once pytest has ended, as that of multiprocessing does, may do so.
    """
    patience = time.monotonic() + LEAVE_S
    while watch.processes() and time.monotonic() < patience:
        time.sleep(0.1)
    processes, files = watch.processes(), watch.files()
    for pid, command in processes.items():
        print(f"left running, killed now: {pid} {command}", file=sys.stderr)
        leftovers.kill(pid)
    files = sorted({*files, *watch.files()})
    for file in files:
        owner = watch.owner(file) or "an unknown process"
        print(f"left in shared memory by {owner}, removed now: {file}", file=sys.stderr)
        file.unlink(missing_ok=True)
    watch.remove_closed_ports()
    if processes or files:
        print("make test: failed, the tests left something behind (above)", file=sys.stderr)
    return not (processes or files)


if __name__ == "__main__":
    sys.exit(main())
