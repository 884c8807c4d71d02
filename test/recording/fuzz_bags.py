# SPDX-License-Identifier: Apache-2.0
"""Fuzzer for bags: `tools/run python test/recording/fuzz_bags.py --seed 1 --count 1000`.

Damages a bag at random, runs `session verify|info|recover` on it, and checks that each ends with a
sentence, that what `recover` keeps is never less than what the mcap library or a plain scan for
chunks finds, that nothing is invented, and that what was cut out lies beside. A seed and a number
give the same case again: `--only`. Exit code 1 when a case failed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import zstandard
from mcap.reader import make_reader
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

from screw_module_ros.recording import BagWriter, Definition, Message, StorageSettings, Topic
from screw_module_ros.recording.cli import main as session

START = 1_700_000_000_000_000_000
LIMIT_S = 20  # a case that takes longer hangs
TEXT = (
    "builtin_interfaces/Time stamp\nuint32 sequence\nint64 monotonic_ns\n"
    + "\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)  # fmt: skip
TYPES = ("screw_module_msgs/msg/EncoderSample", "screw_module_msgs/msg/ForceSample")
Damage = Callable[[random.Random, bytes], bytes]


def make_bag(folder: Path, compression: str, files: int = 1) -> Path:
    """Write a closed bag of two topics with 400 messages in each of `files` files."""
    settings = StorageSettings(2048, compression, max_file_duration=0.15 if files > 1 else 0.0)
    writer = BagWriter(folder, settings)
    for number, kind in enumerate(TYPES):
        writer.add_topic(Topic(f"/topic_{number}", kind, Definition("ros2msg", TEXT, "RIHS01_0")))
    writer.add_topic(Topic("/silent", "own_msgs/msg/X", Definition("ros2msg", TEXT, "RIHS01_0")))
    writer.add_metadata("parameters", {"/encoder": '{"rate": 1000.0}'})
    writer.add_metadata("configuration", {"a": "b"})
    rng = random.Random(0)
    for tick in range(0, 200 * files, 100):
        batch = []
        for number in range(tick, tick + 100):
            stamp = struct.pack("<BBHIIIxxxxQ", 0, 1, 0, 0, 0, number, number * 1_000_000)
            time = START + number * 1_000_000
            batch += [Message(c, time, time, number + 1, stamp + rng.randbytes(16)) for c in (1, 2)]
        writer.write(batch)
        writer.flush()
    writer.close()
    return folder


# What the others find.


def by_library(content: bytes) -> int:
    """Count the messages the mcap library reads up to its first error."""
    total = 0
    with contextlib.suppress(Exception):
        for record in StreamReader(io.BytesIO(content), validate_crcs=True).records:
            total += isinstance(record, Record)
    return total


def by_scan(content: bytes) -> list[tuple[int, bytes]]:
    """Return (channel, data) of the messages in every intact chunk, wherever it stands."""
    found: list[tuple[int, bytes]] = []
    place = content.find(b"\x06")
    while 0 <= place < len(content) - 49:
        end, messages = _intact(content, place)
        found += messages
        place = content.find(b"\x06", end or place + 1)
    return found


def _intact(content: bytes, place: int) -> tuple[int, list[tuple[int, bytes]]]:
    _, length, _, _, size, crc, name = struct.unpack_from("<BQQQQII", content, place)
    end = place + 9 + length
    if end > len(content) or name not in (0, 4) or length < 40 + name or size > 10**6:
        return 0, []
    data = content[place + 49 + name : end]
    if not name and content[place + 41 : place + 49] != struct.pack("<Q", len(data)):
        return 0, []
    if name:
        try:
            data = zstandard.decompress(data, size)
        except (zstandard.ZstdError, MemoryError):
            return 0, []
    if zlib.crc32(data) != crc or not data:
        return 0, []
    found, at = [], 0
    while at < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 5:
            channel = struct.unpack_from("<H", data, at + 9)[0]
            found.append((channel, data[at + 31 : at + 9 + length]))
        at += 9 + length
    return end, found


# Ways to damage a file.


def _somewhere(rng: random.Random, content: bytes) -> int:
    """Return a place: anywhere, or near an end where there is most to break."""
    if not content:
        return 0
    near = rng.choice((len(content), len(content), 200))
    place = rng.randrange(min(near, len(content)))
    return place if rng.random() < 0.7 else len(content) - 1 - place


def truncated(rng: random.Random, content: bytes) -> bytes:
    return content[: _somewhere(rng, content)]


def flipped(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    if changed:
        changed[_somewhere(rng, content)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def flipped_and_truncated(rng: random.Random, content: bytes) -> bytes:
    return flipped(rng, content)[: max(0, len(content) - rng.randrange(1, 300))]


def scattered(rng: random.Random, content: bytes) -> bytes:
    for _ in range(rng.randrange(2, 40)):
        content = flipped(rng, content)
    return content


def blanked(rng: random.Random, content: bytes) -> bytes:
    start, length = _somewhere(rng, content), rng.choice((8, 512, 4096))
    filling = rng.choice((b"\0", b"\xff", b"\x06", rng.randbytes(1))) * length
    return (content[:start] + filling + content[start + length :])[: len(content)]


def removed(rng: random.Random, content: bytes) -> bytes:
    start = _somewhere(rng, content)
    return content[:start] + content[start + rng.choice((1, 7, 512, 4096)) :]


def inserted(rng: random.Random, content: bytes) -> bytes:
    start = _somewhere(rng, content)
    return content[:start] + rng.randbytes(rng.choice((1, 7, 512))) + content[start:]


def huge(rng: random.Random, content: bytes) -> bytes:
    """Declare a length that nothing has."""
    place = rng.choice([n for n, byte in enumerate(content) if byte in (1, 3, 4, 6, 7, 8, 12)])
    value = rng.choice((2**64 - 1, 2**63, 2**40, len(content) - place - 9))
    return content[: place + 1] + struct.pack("<Q", value) + content[place + 9 :]


def resealed(rng: random.Random, content: bytes) -> bytes:
    """Damage the records of a chunk, or the index, and make the checksum fit."""
    chunks = [n for n in range(len(content) - 49) if content[n] == 6 and _intact(content, n)[0]]
    if not chunks or rng.random() < 0.2:
        return _resealed_index(rng, content)
    place = rng.choice(chunks[:3] + chunks)
    end, _ = _intact(content, place)
    head = list(struct.unpack_from("<BQQQQII", content, place))
    packed = content[place + 49 + head[6] : end]
    data = zstandard.decompress(packed, head[4]) if head[6] else packed
    data = rng.choice((flipped, scattered, removed, huge))(rng, data[:1500]) + data[1500:]
    new = zstandard.compress(data, 1) if head[6] else data
    head[1], head[4], head[5] = 40 + head[6] + len(new), len(data), zlib.crc32(data)
    name = b"zstd"[: head[6]]
    record = struct.pack("<BQQQQII", *head) + name + struct.pack("<Q", len(new)) + new
    return content[:place] + record + content[end:]


def _resealed_index(rng: random.Random, content: bytes) -> bytes:
    summary = struct.unpack_from("<Q", content, len(content) - 28)[0]
    if not 0 < summary < len(content) - 37:
        return flipped(rng, content)
    inner = flipped(rng, content[summary:-37])
    foot = content[-37:-12]
    crc = struct.pack("<I", zlib.crc32(inner + foot))
    return content[:summary] + inner + foot + crc + content[-8:]


_ODD = (
    "null", "[]", "{}", "-1", "1e400", "9" * 5000, ".nan", "2001-99-99", "true", "!!python/name:os",
    "*x", "&x [*x]", '"\\ud800"', '"{\\"a\\": 1}"', "[" * 3000, "'", "1" + "0" * 400,
)  # fmt: skip


def reworded(rng: random.Random, content: bytes) -> bytes:
    """Put an odd value in a line of a text."""
    lines = content.decode(errors="replace").split("\n")
    for _ in range(rng.randrange(1, 4)):
        number = rng.randrange(len(lines))
        key = lines[number].partition(":")[0]
        other = lines[rng.randrange(len(lines))]
        lines[number] = rng.choice((f"{key}: {rng.choice(_ODD)}", "", other))
    return "\n".join(lines).encode(errors="replace")


def renoted(rng: random.Random, content: bytes) -> bytes:
    """Put an odd value into the JSON of custom_data."""
    text = content.decode(errors="replace")
    odd = rng.choice(("null", "[]", "1e999", "9" * 400, '{"a": 1}', "true", '"\\ud800"', "-5"))
    values = [place for place in range(len(text)) if text.startswith('\\": ', place)]
    if not values:
        return content
    place = rng.choice(values) + 4
    end = min(text.find(mark, place) % 10**9 for mark in (",", "}"))
    return (text[:place] + json.dumps(odd)[1:-1] + text[end:]).encode(errors="replace")


PLAIN: tuple[Damage, ...] = (truncated, flipped)  # what the acceptance speaks of
ROUGH: tuple[Damage, ...] = (flipped_and_truncated, scattered, blanked, removed, inserted, huge)
CRAFTED: tuple[Damage, ...] = (resealed,)
NOTES: tuple[Damage, ...] = (truncated, flipped, blanked, reworded, renoted)


class Fuzzer:
    """Runs cases in a folder of its own; `counts` tells what came out."""

    def __init__(self, folder: Path, seed: int):
        self.folder, self.seed = folder, seed
        self.counts: Counter[str] = Counter()
        self.failures: list[str] = []
        self._bags = [
            make_bag(folder / "zstd", "zstd"),
            make_bag(folder / "none", "none"),
            make_bag(folder / "split", "zstd", files=3),
        ]
        self._messages = {
            bag: Counter(m for path in bag.glob("*.mcap") for m in by_scan(path.read_bytes()))
            for bag in self._bags
        }

    def run(self, numbers: range, plain: bool = False) -> bool:
        """Run cases by their numbers; return whether all went well. plain: truncate and flip."""
        for number in numbers:
            rng = random.Random(f"{self.seed} {number}")
            case = self.folder / "case"
            shutil.rmtree(case, ignore_errors=True)
            signal.signal(signal.SIGALRM, _hangs)
            signal.alarm(LIMIT_S)
            try:
                self._case(rng, case, plain)
            except Exception:
                self.counts["FAILED"] += 1
                self.failures.append(
                    f"case {number} of seed {self.seed}:\n{traceback.format_exc()}"
                )
            finally:
                signal.alarm(0)
            self.counts["cases"] += 1
        return not self.failures

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


def _hangs(number: int, frame: object) -> None:
    raise TimeoutError(f"longer than {LIMIT_S} s")


def main() -> int:
    """Run as a program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--only", type=int, help="number of the one case to run")
    parser.add_argument("--plain", action="store_true", help="one cut or one flipped bit only")
    options = parser.parse_args()
    numbers = range(options.count)
    if options.only is not None:
        numbers = range(options.only, options.only + 1)
    with tempfile.TemporaryDirectory() as folder:
        fuzzer = Fuzzer(Path(folder), options.seed)
        fuzzer.run(numbers, options.plain)
    for failure in fuzzer.failures[:5]:
        print(failure, file=sys.stderr)
    print(f"seed {options.seed}")
    for name, number in sorted(fuzzer.counts.items()):
        print(f"  {name}: {number}")
    return 1 if fuzzer.failures else 0


if __name__ == "__main__":
    os.umask(0o077)
    sys.exit(main())
