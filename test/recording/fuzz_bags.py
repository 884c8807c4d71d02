# SPDX-License-Identifier: Apache-2.0
"""Damaged bags for `make fuzz ARGS="--what bags"` and for test_fuzz_bags.py.

Damages a bag at random, runs `session verify|info|recover` on it, and checks that each ends with a
sentence, that what `recover` keeps is never less than what the mcap library or a plain scan for
chunks finds, that nothing is invented, and that what was cut out lies beside.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import random
import shutil
import struct
from collections import Counter
from pathlib import Path
from unittest.mock import patch

from bag_counts import by_library, by_scan
from bag_damage import CRAFTED, NOTES, PLAIN, ROUGH
from mcap.reader import make_reader

from screw_module_ros.recording import BagWriter, Definition, Message, StorageSettings, Topic
from screw_module_ros.session_command import main as session

START = 1_700_000_000_000_000_000
TEXT = (
    "builtin_interfaces/Time stamp\nuint32 sequence\nint64 monotonic_ns\n"
    + "\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)  # fmt: skip
TYPES = ("screw_module_msgs/msg/EncoderSample", "screw_module_msgs/msg/ForceSample")


def make_bag(folder: Path, compression: str, files: int = 1) -> Path:
    """Write a closed bag of two topics with 400 messages in each of `files` files."""
    writer = _begun(folder, compression, 0.15 if files > 1 else 0.0)
    rng = random.Random(0)
    for tick in range(0, 200 * files, 100):
        _write(writer, rng, tick)
    writer.close()
    return folder


def endless_bag(folder: Path, compression: str) -> None:
    """Write a bag as `make_bag` does, until this process is killed."""
    writer = _begun(folder, compression, 0.5)
    for tick in itertools.count(0, 100):
        _write(writer, random.Random(tick), tick)


def _begun(folder: Path, compression: str, file_duration: float) -> BagWriter:
    writer = BagWriter(folder, StorageSettings(2048, compression, max_file_duration=file_duration))
    for number, kind in enumerate(TYPES):
        writer.add_topic(Topic(f"/topic_{number}", kind, Definition("ros2msg", TEXT, "RIHS01_0")))
    writer.add_topic(Topic("/silent", "own_msgs/msg/X", Definition("ros2msg", TEXT, "RIHS01_0")))
    writer.add_metadata("parameters", {"/encoder": '{"rate": 1000.0}'})
    writer.add_metadata("configuration", {"a": "b"})
    return writer


def _write(writer: BagWriter, rng: random.Random, tick: int) -> None:
    """Write 100 messages in each topic, from the number `tick` on, and flush."""
    batch = []
    for number in range(tick, tick + 100):
        stamp = struct.pack("<BBHIIIxxxxQ", 0, 1, 0, 0, 0, number, number * 1_000_000)
        time = START + number * 1_000_000
        batch += [Message(c, time, time, number + 1, stamp + rng.randbytes(16)) for c in (1, 2)]
    writer.write(batch)
    writer.flush()


class Fuzzer:
    """Damages copies of three bags that it keeps in `folder`; `counts` tells what came out."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.counts: Counter[str] = Counter()
        self._bags = [
            make_bag(folder / "zstd", "zstd"),
            make_bag(folder / "none", "none"),
            make_bag(folder / "split", "zstd", files=3),
        ]
        self._messages = {
            bag: Counter(m for path in bag.glob("*.mcap") for m in by_scan(path.read_bytes()))
            for bag in self._bags
        }

    def damaged(self, rng: random.Random, case: Path, plain: bool) -> None:
        """Carry out one case in the folder `case`, not there yet. plain: truncate, tear, flip."""
        with patch.multiple(os, fsync=_not_now, fdatasync=_not_now):
            self._case(rng, case, plain)

    def _case(self, rng: random.Random, case: Path, plain: bool) -> None:
        origin = rng.choice(self._bags)
        shutil.copytree(origin, case)
        files = sorted(case.glob("*.mcap"))
        path = rng.choice(files)
        damage = rng.choice(PLAIN if plain else PLAIN + ROUGH + CRAFTED)
        path.write_bytes(damage(rng, path.read_bytes()))
        self.counts[damage.__name__] += 1
        notes = case / "metadata.yaml"
        lost_notes = not plain and rng.random() < 0.3
        if lost_notes:
            alter = rng.choice(NOTES)
            notes.write_bytes(alter(rng, notes.read_bytes()))
            self.counts[f"metadata.yaml {alter.__name__}"] += 1
        before = {path: path.read_bytes() for path in case.iterdir()}
        wanted = 0
        if damage not in CRAFTED:
            wanted = sum(max(len(by_scan(before[f])), by_library(before[f])) for f in files)
        codes = {command: said(command, case) for command in ("verify", "info")}
        self.counts.update(f"{command}: {code}" for command, code in codes.items())
        if damage not in CRAFTED and codes["verify"] == 0:
            assert wanted == self._messages[origin].total(), "called complete and is not"
        assert {path: path.read_bytes() for path in case.iterdir()} == before
        code = said("recover", case)
        self.counts[f"recover: {code}"] += 1
        if code:
            assert {path: path.read_bytes() for path in case.iterdir()} == before
            assert lost_notes or damage in CRAFTED + ROUGH, "a damaged bag was refused"
        elif damage not in CRAFTED:
            self._check(case, wanted, self._messages[origin])
            self._check_kept(case, before)
        if not code:
            after = {path: path.read_bytes() for path in case.iterdir()}
            assert said("recover", case) == 0
            assert {path: path.read_bytes() for path in case.iterdir()} == after, "not stable"

    def _check(self, case: Path, wanted: int, original: Counter) -> None:
        found: Counter = Counter()
        for path in case.glob("*.mcap"):
            with path.open("rb") as file:
                reader = make_reader(file, validate_crcs=True)
                for _, channel, message in reader.iter_messages():
                    found[channel.id, message.data] += 1
            assert by_library(path.read_bytes()) == len(by_scan(path.read_bytes()))
        assert found.total() >= wanted, f"{found.total()} of {wanted} messages kept"
        assert not found - original, "messages that were never recorded"
        self.counts["messages kept"] += found.total()
        self.counts["messages others find"] += wanted

    def _check_kept(self, case: Path, before: dict[Path, bytes]) -> None:
        """What was cut out must lie beside, byte by byte."""
        for path in case.iterdir():
            name, cut, span = path.name.partition(".cut_")
            if cut:
                start, end = map(int, span.split("_"))
                assert path.read_bytes() == before[case / name][start:end]
                self.counts["pieces beside"] += 1


def said(command: str, bag: Path) -> int:
    """Run `session` in this process; return its exit code."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "ascii", newline="") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = session([command, str(bag)])
    err.flush()
    told = err.buffer.getvalue()
    assert code in (0, 1), f"session {command}: exit code {code}"
    assert len(told) < 1000, f"session {command}: {len(told)} bytes of complaint"
    assert code == 0 or command == "verify" or told.startswith(b"session: ")
    return code


def _not_now(descriptor: int) -> None:
    """Stand in for waiting for the disk: what these bags hold need not outlive the run."""
