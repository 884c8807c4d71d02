# SPDX-License-Identifier: Apache-2.0
"""`recover` copies every whole chunk before the first broken length, never touching the bag."""

import errno
import io
import os
import shutil
import signal
import struct
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest
from bag_counts import ticks
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from screw_module_ros.recording import mcap_file, records
from screw_module_ros.recording.bag import Bag, BagError, StorageSettings
from screw_module_ros.recording.recover import recover, unfinished
from screw_module_ros.recording.verify import verify
from screw_module_ros.session_command import main

BAGS = Path(__file__).parents[1] / "data" / "bags"
FILE = "bag_0.mcap"
TICKS = 800  # of the bags that are damaged anywhere


class Part(NamedTuple):
    """A record outside of chunks: its place in the file, and the tick numbers in a chunk."""

    begin: int
    end: int
    ticks: list[int]


def parts_of(content):
    """Return the records of a whole file by their lengths, without the recorder's own code."""
    found, place, seen = [], 8, 0
    while place < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, place)
        end, number = place + 9 + length, 0
        if opcode == 6:
            following, _, _, size = struct.unpack_from("<BQHI", content, end)
            assert following == 7  # the index of the chunk tells how many messages it holds
            number = size // 16
        found.append(Part(place, end, list(range(seen, seen + number))))
        place, seen = end, seen + number
    return found


@pytest.fixture
def damaged(tmp_path, record):
    """Return what recovers a file with this content: the ticks found, checked by another reader."""
    bag = record(range(TICKS), notes={"configuration": {"sim.yaml": "sha256:0"}}, chunk_size=3000)

    def recovered(changed):
        shutil.rmtree(tmp_path / "changed", ignore_errors=True)
        folder = shutil.copytree(bag, tmp_path / "changed" / "bag")
        (folder / FILE).write_bytes(changed)
        try:
            found = recover(folder)
        except BagError:  # nothing can be read
            return []
        assert (folder / FILE).read_bytes() == changed
        numbers = ticks(found.folder)
        assert len(numbers) == found.messages
        return numbers

    recovered.content = (bag / FILE).read_bytes()
    recovered.parts = parts_of(recovered.content)
    assert sum(len(part.ticks) for part in recovered.parts) == TICKS
    return recovered


ANYWHERE = settings(
    max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)


@ANYWHERE
@given(share=st.floats(0.0, 1.0))
def test_cut_anywhere_every_whole_chunk_is_kept(damaged, share):
    size = int(len(damaged.content) * share)
    kept = [n for part in damaged.parts if part.end <= size for n in part.ticks]
    assert damaged(damaged.content[:size]) == kept


@ANYWHERE
@given(share=st.floats(0.0, 1.0, exclude_max=True), mask=st.integers(1, 255))
@example(share=0.0, mask=255)
def test_flip_anywhere_every_whole_chunk_before_a_broken_length_is_kept(damaged, share, mask):
    place = int(len(damaged.content) * share)
    changed = bytearray(damaged.content)
    changed[place] ^= mask
    (hit,) = [part for part in damaged.parts if part.begin <= place < part.end] or [
        Part(place, place, [])
    ]
    if hit.begin < place < hit.begin + 9:  # its length
        wanted = {n for part in damaged.parts if part.end <= hit.begin for n in part.ticks}
    else:
        wanted = set(range(TICKS)) - set(hit.ticks)
    found = damaged(bytes(changed))
    assert wanted <= set(found) <= set(range(TICKS))
    assert len(found) == len(set(found))


def test_five_damaged_bytes_in_the_name_of_the_recorder_lose_nothing(damaged):
    changed = damaged.content.replace(b"screw_module_ros", b"\xff\xfe\xfd\xfc\xfb_module_ros", 1)
    assert damaged(changed) == list(range(TICKS))


def test_blocks_of_zeros_where_the_last_write_should_be(damaged):
    """After a power failure the file may have its length and blocks of zeros."""
    part = [part for part in damaged.parts if part.ticks][-2]
    torn = damaged.content[: part.end] + bytes(len(damaged.content) - part.end)
    assert damaged(torn) == list(range(part.ticks[-1] + 1))


def test_what_was_noted_survives_and_verify_says_what_it_is(bag):
    os.truncate(bag / FILE, os.path.getsize(bag / FILE) - 200)
    found = recover(bag)
    report = verify(found.folder)
    assert report.notes["configuration"] == {"sim.yaml": "sha256:0"}
    assert report.problems == ["the bag is a recovered copy: what was lost before is not known"]


def test_a_damaged_chunk_is_told(bag):
    data = (bag / FILE).read_bytes()
    place = len(data) // 2
    (bag / FILE).write_bytes(data[:place] + bytes([data[place] ^ 255]) + data[place + 1 :])
    found = recover(bag)
    assert found.messages < 5000
    assert found.problems and all("damaged" in each for each in found.problems[:-1])
    assert found.problems[-1] == f"the bag states 5000 messages, the copy has {found.messages}"


@pytest.mark.parametrize("content", [None, "", "nonsense: [", "rosbag2_bagfile_information: 3"])
def test_the_metadata_file_is_not_needed(bag, content):
    (bag / "metadata.yaml").unlink()
    if content is not None:
        (bag / "metadata.yaml").write_text(content)
    assert ticks(recover(bag).folder) == list(range(5000))


def test_an_earlier_copy_is_kept(bag):
    copy = recover(bag).folder
    before = {path: path.read_bytes() for path in copy.iterdir()}
    with pytest.raises(BagError, match="never overwritten"):
        recover(bag)
    assert {path: path.read_bytes() for path in copy.iterdir()} == before


@pytest.mark.parametrize("content", [b"", b"not an mcap file at all", bytes(5000)])
def test_a_file_without_anything_is_told_and_leaves_no_copy(tmp_path, content):
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "b_0.mcap").write_bytes(content)
    with pytest.raises(BagError, match="can be read"):
        recover(tmp_path / "b")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_a_full_disk_ends_the_copy_at_once_and_leaves_none(record, monkeypatch):
    """The rest of the bag went into memory, all of it, before the disk was said to be full."""
    bag = record(range(3000), chunk_size=2000)
    waiting = []

    class FullDisk(io.FileIO):
        room = 10_000

        def write(self, data):
            waiting.append(len(data))
            if FullDisk.room < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            FullDisk.room -= len(data)
            return super().write(data)

    monkeypatch.setattr(
        mcap_file, "open", lambda path, mode, **_: FullDisk(path, mode), raising=False
    )
    small = partial(Bag, settings=StorageSettings(chunk_size=2000))
    monkeypatch.setattr("screw_module_ros.recording.recover.Bag", small)
    with pytest.raises(BagError, match="No space left"):
        recover(bag)
    assert max(waiting) < 5000
    assert [path.name for path in bag.parent.iterdir()] == ["bag"]


def test_several_files_become_one_bag(record):
    bag = record(range(2500), max_file_duration=0.9)
    assert len(list(bag.glob("*.mcap"))) == 3
    assert ticks(recover(bag).folder) == list(range(2500))


@pytest.mark.parametrize(("largest", "kept"), [(2**20, 10), (100, 0)])
def test_without_checksums_and_with_chunks_that_are_too_large(tmp_path, monkeypatch, largest, kept):
    """A checksum of zero means that none was given."""
    monkeypatch.setattr(records, "LARGEST", largest)
    (tmp_path / "b").mkdir()
    with (tmp_path / "b" / "b_0.mcap").open("wb") as file:
        writer = Writer(file, enable_crcs=False)
        writer.start("ros2", "another recorder")
        schema = writer.register_schema("own_msgs/msg/X", "ros2msg", b"uint32 x")
        channel = writer.register_channel("/x", "cdr", schema)
        for number in range(10):
            writer.add_message(channel, number, bytes(12) + number.to_bytes(4, "little"), number)
        writer.finish()
    if kept:
        found = recover(tmp_path / "b")
        assert (ticks(found.folder), found.problems) == (list(range(kept)), [])
    else:
        with pytest.raises(BagError, match="can be read"):
            recover(tmp_path / "b")


@pytest.mark.parametrize("name", [path.name for path in sorted(BAGS.iterdir())])
def test_a_bag_of_an_older_version_is_complete_and_recovered(name, tmp_path):
    report = verify(BAGS / name)
    assert report.complete, report.problems
    assert "an older version recorded it, without a hash of its files" in report.remarks
    assert report.notes["parameters"]
    shutil.copytree(BAGS / name, tmp_path / name)
    found = recover(tmp_path / name)
    assert found.problems == []
    copied = verify(found.folder)
    assert copied.topics == report.topics
    assert copied.notes["parameters"] == report.notes["parameters"]


def test_a_session_of_an_older_version_is_replayed_bit_for_bit(capsys):
    (session,) = BAGS.glob("P-7K3QX_*")
    assert main(["replay", str(session)]) == 0
    assert "equal: 4 trials from 774 samples, bit for bit" in capsys.readouterr().out


WRITER = """
import sys
from screw_module_ros.recording.bag import Bag, StorageSettings, Topic
from screw_module_ros.recording.definitions import Definition
TEXT = (
    "builtin_interfaces/Time stamp\\nuint32 sequence\\n" + "\\n" + "=" * 80
    + "\\nMSG: builtin_interfaces/Time\\nint32 sec\\nuint32 nanosec\\n"
)
writer = Bag(sys.argv[1], StorageSettings(chunk_size=4096))
topic = Topic("/x", "own_msgs/msg/X", Definition("ros2msg", TEXT, ""))
channel = writer.add_topic(topic)
writer.note("configuration", {"a": "b"})
number = 0
while True:
    batch = []
    for _ in range(100):
        data = b"\\0\\1\\0\\0" + bytes(8) + number.to_bytes(4, "little")
        batch.append((channel, 10**18 + number * 10**6, 10**18, number + 1, data))
        number += 1
    writer.write(batch)
    writer.flush()
    print(number, flush=True)
"""


@pytest.fixture(params=[1, 7, 60])
def killed(tmp_path, wait_until, request):
    """Return the bag and the number of messages its writer had flushed when it was killed."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path / "bag")],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    flushed = 0
    for _ in range(request.param):
        flushed = int(process.stdout.readline())
    process.send_signal(signal.SIGSTOP)
    state = Path(f"/proc/{process.pid}/stat")
    wait_until(lambda: state.read_text().rpartition(")")[2].split()[0] == "T")
    process.send_signal(signal.SIGKILL)
    process.wait()
    rest = process.stdout.read().split()
    process.stdout.close()
    return tmp_path / "bag", int(rest[-1]) if rest else flushed


def test_what_a_killed_recorder_flushed_is_recovered(killed):
    bag, flushed = killed
    assert any("(state: unfinished)" in problem for problem in verify(bag).problems)
    assert unfinished(bag.parent) == [bag]
    found = recover(bag)
    assert found.folder == bag.with_name("bag_recovered")
    assert found.messages >= flushed
    assert ticks(found.folder) == list(range(found.messages))
    assert unfinished(bag.parent) == []
    report = verify(found.folder)
    assert report.problems == ["the bag is a recovered copy: what was lost before is not known"]
    assert report.notes["configuration"] == {"a": "b"}
