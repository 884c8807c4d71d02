# SPDX-License-Identifier: Apache-2.0
"""All fuzzers: `make fuzz ARGS="--seconds 60 --seed 1 --what yaml --what can"`.

Feeds the program what nobody should send and checks that it ends in sentences: no traceback, no
hang, no node ended, no torque without its guards, no message lost that could be read. Prints
counts; exits with 1 when a case failed and says how to run it again.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
import time
from itertools import count
from pathlib import Path

from runner import Target, run

# As a program; pytest knows these folders from pyproject.toml.
for _folder in ("devices", "nodes", "recording"):
    sys.path.insert(0, str(Path(__file__).parents[1] / _folder))


TARGETS = {
    "bags": ("recorders killed, bags cut, torn, flipped: session verify, info, recover",
             "bag_files", "BagFiles"),
    "yaml": ("settings, calibrations, parameter files, protocols, plants",
             "yaml_inputs", "YamlInputs"),
    "can": ("frames into every driver", "can_frames", "CanFrames"),
    "nodes": ("services and parameters of every node", "node_requests", "NodeRequests"),
    "state": ("what the supervisor left for its next start", "kept_state", "KeptState"),
    "therapy": ("samples and wishes into a therapy session", "therapy_inputs", "TherapyInputs"),
}  # fmt: skip
"""Name -> what is fuzzed, and the module and class, which is imported where it is wanted."""


def fuzz(name: str, seed: int, folder: Path, numbers: range | None, seconds: float) -> list[str]:
    """Run one fuzzer and print what came out; return its failures."""
    what, module, kind = TARGETS[name]
    target: Target = getattr(importlib.import_module(module), kind)(folder)
    begun = time.monotonic()
    try:
        failures = run(
            target, name, seed, count() if numbers is None else numbers, begun + seconds
        )
    finally:
        target.close()
    print(f"{name}: {what}; {time.monotonic() - begun:.0f} s")
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
