# SPDX-License-Identifier: Apache-2.0
"""Damaged bags and killed recorders: `session verify`, `info` and `recover` on each.

Each command ends with a sentence; what it recovers was recorded, and a killed recorder loses
nothing that it had flushed.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import random
import shutil
import signal
import struct
from collections import Counter
from pathlib import Path

from screw_module_ros.recording.bag import Bag, Message, StorageSettings, Topic
from screw_module_ros.recording.definitions import Definition
from screw_module_ros.recording.records import File
from screw_module_ros.session_command import main as session

_LARGEST = 60_000  # bytes
_START = 1_700_000_000_000_000_000
_TEXT = (
    "builtin_interfaces/Time stamp\nuint32 sequence\nint64 monotonic_ns\n"
    + "\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)  # fmt: skip
_KIND = "screw_module_msgs/msg/EncoderSample"


class BagFiles:
    """Damages copies of a bag in `folder`, or kills its recorder; `counts` tells what came out."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.counts: Counter[str] = Counter()
        self._bag = folder / "whole"
        _record(self._bag, range(0, 400, 100)).close()
        self._recorded = set(_ticks(self._bag))

    def case(self, rng: random.Random) -> None:
        """Damage a bag or kill its recorder, look at it, recover it."""
        bag = self.folder / "case"
        for folder in (bag, bag.with_name("case_recovered")):
            shutil.rmtree(folder, ignore_errors=True)
        wanted: set[int] = set()
        killed = rng.random() < 0.3
        if killed:
            flushed = _killed(rng, bag)
            wanted = set(range(flushed))
        else:
            shutil.copytree(self._bag, bag)
            _damage(rng, rng.choice(sorted(bag.iterdir())))
        before = {path: path.read_bytes() for path in bag.iterdir()}
        for command in ("verify", "info", "recover"):
            self.counts[f"{command}: {_said(command, bag)}"] += 1
        assert {path: path.read_bytes() for path in bag.iterdir()} == before
        copy = bag.with_name("case_recovered")
        found = _ticks(copy) if copy.exists() else []
        assert len(found) == len(set(found))
        assert wanted <= set(found)
        assert killed or set(found) <= self._recorded, "messages that were never recorded"
        self.counts["messages recovered"] += len(found)

    def close(self) -> None:
        """Nothing is held."""


def _damage(rng: random.Random, path: Path) -> None:
    """Cut a file, flip bytes in it, or fill a part with zeros or noise."""
    data = bytearray(path.read_bytes())
    place, size = rng.randrange(len(data)), rng.randrange(1, 200)
    kind = rng.choice(("cut", "flip", "zeros", "noise"))
    if kind == "cut":
        del data[place:]
    elif kind == "flip":
        data[place] ^= rng.randrange(1, 256)
    else:
        part = data[place : place + size]
        data[place : place + size] = (
            bytes(len(part)) if kind == "zeros" else rng.randbytes(len(part))
        )
    path.write_bytes(data)


def _record(folder: Path, ticks: range | itertools.count) -> Bag:
    """Write 100 messages from each of `ticks` on and flush them, into a new bag."""
    bag = Bag(folder, StorageSettings(chunk_size=2048))
    bag.add_topic(Topic("/topic", _KIND, Definition("ros2msg", _TEXT, "RIHS01_0")))
    bag.note("parameters", {"/encoder": '{"rate": 1000.0}'})
    for first in ticks:
        for number in range(first, first + 100):
            stamp = struct.pack("<BBHIIIxxxxQ", 0, 1, 0, 0, 0, number, number * 1_000_000)
            time = _START + number * 1_000_000
            bag.write([Message(1, time, time, number + 1, stamp + bytes(16))])
        bag.flush()
        (folder / "flushed").write_text(str(first + 100))
    return bag


def _killed(rng: random.Random, bag: Path) -> int:
    """Let a child record into `bag` until its file has a random size; return what it flushed."""
    child = os.fork()
    if not child:
        try:
            _record(bag, itertools.count(0, 100))
        finally:
            os._exit(1)  # nothing of the parent's must run twice
    size = rng.randrange(_LARGEST)
    try:
        while sum(path.stat().st_size for path in bag.glob("*.mcap")) < size:
            ended, code = os.waitpid(child, os.WNOHANG)
            assert not ended, f"the recorder ended by itself: {code}"
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    told = bag / "flushed"
    return int(told.read_text() or 0) if told.exists() else 0


def _ticks(bag: Path) -> list[int]:
    file = File(bag / f"{bag.name}_0.mcap")
    return [int.from_bytes(message.data[12:16], "little") for _, message in file.messages()]


def _said(command: str, bag: Path) -> int:
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
