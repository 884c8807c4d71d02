# SPDX-License-Identifier: Apache-2.0
"""Kept bags, damaged in many places: what is said of each, and what is recovered from it.

The sentences, but not those of the libraries, and counts are kept as digests. A change on purpose
is renewed with `make test ARGS="test/recording/test_kept_verdicts.py --write"`; the commit says
what changed.
"""

from __future__ import annotations

import hashlib
import random
import re
import shutil
from pathlib import Path

import pytest

from screw_module_ros.recording.bag import BagError
from screw_module_ros.recording.recover import recover
from screw_module_ros.recording.verify import verify

BAGS = sorted((Path(__file__).parents[1] / "data" / "bags").iterdir())


def flipped(data: bytes, chance: random.Random) -> bytes:
    place = chance.choice((chance.randrange(64), chance.randrange(len(data))))
    return data[:place] + bytes([data[place] ^ 1 << chance.randrange(8)]) + data[place + 1 :]


def cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.choice((len(data) - chance.randrange(1, 60), chance.randrange(len(data))))]


def zeroed(data: bytes, chance: random.Random) -> bytes:
    """Return it with the torn end that a crash leaves."""
    place = chance.randrange(len(data))
    return data[:place] + bytes(chance.choice((1, 8, 9, 4000)))


def left_out(data: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(data))
    return data[:place] + data[place + chance.choice((1, 9, 500)) :]


DAMAGES = (flipped, cut, zeroed, left_out, flipped, flipped)


def said(folder: Path) -> str:
    """Return the digest of the report, of the recovered copy, and of the copy's report."""
    report = verify(folder)
    found = [report.topics, report.gaps, report.problems, report.remarks, report.verdict]
    try:
        copy = recover(folder)
        again = verify(copy.folder)
        found += [copy.messages, copy.problems, again.topics, again.problems, again.remarks]
        shutil.rmtree(copy.folder)
    except BagError as error:
        found.append(str(error))
    text = re.sub(r"(is damaged: )[^'\"]*", r"\1", repr(found).replace(str(folder), "BAG"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@pytest.mark.parametrize("original", BAGS, ids=lambda path: path.name.partition("_")[0])
def test_what_is_said_of_a_damaged_bag_is_what_was_said(original, tmp_path, kept):
    shutil.copytree(original, tmp_path / "bag")
    file = tmp_path / "bag" / f"{original.name}_0.mcap"
    whole, chance, found = file.read_bytes(), random.Random(original.name), [said(tmp_path / "bag")]
    for number in range(20 if original.name.startswith("P-") else 2):
        file.write_bytes(DAMAGES[number % len(DAMAGES)](whole, chance))
        found.append(said(tmp_path / "bag"))
    kept(found)
