# SPDX-License-Identifier: Apache-2.0
"""All fuzzers: `make fuzz ARGS="--seconds 60 --seed 1 --what yaml --what can"`.

Feeds the program what nobody should send and checks that it ends in sentences: no traceback, no
hang, no node ended, no torque without its guards, no message lost that could be read. Prints
counts; exits with 1 when a case failed and says how to run it again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

from runner import Target, run

# As a program; pytest knows these folders from pyproject.toml.
for _folder in ("devices", "nodes", "recording"):
    sys.path.insert(0, str(Path(__file__).parents[1] / _folder))


def _bags(folder: Path) -> Target:
    from bag_files import BagFiles

    return BagFiles(folder)


def _yaml(folder: Path) -> Target:
    from yaml_inputs import YamlInputs

    return YamlInputs(folder)


def _can(folder: Path) -> Target:
    from can_frames import CanFrames

    return CanFrames()


def _nodes(folder: Path) -> Target:
    from node_requests import NodeRequests

    return NodeRequests(folder)


def _state(folder: Path) -> Target:
    from kept_state import KeptState

    return KeptState(folder)


def _therapy(folder: Path) -> Target:
    from therapy_inputs import TherapyInputs

    return TherapyInputs()


TARGETS: dict[str, tuple[str, Callable[[Path], Target]]] = {
    "bags": ("recorders killed, bags cut, torn, flipped: session verify, info, recover", _bags),
    "yaml": ("settings, calibrations, parameter files, protocols, plants", _yaml),
    "can": ("frames into every driver", _can),
    "nodes": ("services and parameters of every node", _nodes),
    "state": ("what the supervisor left for its next start", _state),
    "therapy": ("samples and wishes into a therapy session", _therapy),
}


def fuzz(name: str, seed: int, folder: Path, numbers: range | None, seconds: float) -> list[str]:
    """Run one fuzzer and print what came out; return its failures."""
    target = TARGETS[name][1](folder)
    begun = time.monotonic()
    try:
        failures = run(
            target, name, seed, count() if numbers is None else numbers, begun + seconds
        )
    finally:
        target.close()
    print(f"{name}: {TARGETS[name][0]}; {time.monotonic() - begun:.0f} s")
    for kind, number in sorted(target.counts.items()):
        print(f"  {kind}: {number}")
    for failure in failures[:3]:
        print(failure, file=sys.stderr)
    return failures


def main(words: list[str] | None = None) -> int:
    """Run as a program; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--what", action="append", choices=[*TARGETS], help="by default all")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--seconds", type=float, default=60.0, help="for each fuzzer")
    parser.add_argument("--count", type=int, help="cases of each fuzzer, in place of --seconds")
    parser.add_argument("--only", type=int, help="number of the one case to run")
    options = parser.parse_args(words)
    numbers = None
    if options.only is not None:
        numbers = range(options.only, options.only + 1)
    elif options.count is not None:
        numbers = range(options.count)
    seconds = options.seconds if numbers is None else 1e9
    print(f"seed {options.seed}", flush=True)
    failed = 0
    for name in options.what or TARGETS:
        with tempfile.TemporaryDirectory(prefix="screw_module_fuzz-") as folder:
            failed += len(fuzz(name, options.seed, Path(folder), numbers, seconds))
    print(f"{failed} cases failed" if failed else "all well")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
