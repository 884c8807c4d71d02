# SPDX-License-Identifier: Apache-2.0
"""`recover` copies every whole chunk before the first broken length, never touching the bag."""

import os
import shutil
import struct
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from screw_module_ros.recording import records
from screw_module_ros.recording.bag import Bag, BagError, StorageSettings
from screw_module_ros.recording.records import File
from screw_module_ros.recording.recover import recover
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


def ticks(folder):
    file = File(folder / f"{folder.name}_0.mcap")
    return [int.from_bytes(message.data[12:16], "little") for _, message in file.messages()]


def parts_of(content):
    """Return the records of a whole file by their lengths, without the recorder's own code."""
    found, place, seen = [], 8, 0
    sizes = []
    with_index = memoryview(content)
    while place < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", with_index, place)
        sizes.append((opcode, place, place + 9 + length))
        place += 9 + length
    for opcode, begin, end in sizes:
        number = 0
        if opcode == 6:
            following = [o for o, b, _ in sizes if b >= end]
            assert following[0] == 7
            index = content[end + 9 + 2 :]
            number = struct.unpack_from("<I", index)[0] // 16
        found.append(Part(begin, end, list(range(seen, seen + number))))
        seen += number
    return found


@pytest.fixture
def damaged(tmp_path, encoder_topic, samples):
    """Return what recovers a file with this content: the ticks found, checked by other readers."""
    bag = tmp_path / "bag"
    writer = Bag(bag, StorageSettings(chunk_size=3000))
    writer.write(samples(writer.add_topic(encoder_topic), range(TICKS)))
    writer.note("configuration", {"sim.yaml": "sha256:0"})
    writer.close()
    content = (bag / FILE).read_bytes()

    def recovered(changed):
        folder = tmp_path / "changed" / "bag"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(f"{folder}_recovered", ignore_errors=True)
        shutil.copytree(bag, folder)
        (folder / FILE).write_bytes(changed)
        try:
            found = recover(folder)
        except BagError:  # nothing can be read
            return []
        assert (folder / FILE).read_bytes() == changed
        with (found.folder / "bag_recovered_0.mcap").open("rb") as file:
            numbers = [
                int.from_bytes(message.data[12:16], "little")
                for _, _, message in make_reader(file, validate_crcs=True).iter_messages()
            ]
        assert len(numbers) == found.messages
        return numbers

    recovered.content, recovered.parts = content, parts_of(content)
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


def test_several_files_become_one_bag(tmp_path, encoder_topic, samples):
    writer = Bag(tmp_path / "b", StorageSettings(max_file_duration=1.0))
    channel = writer.add_topic(encoder_topic)
    for start in range(0, 2500, 100):
        writer.write(samples(channel, range(start, start + 100)))
        writer.flush()
    writer.close()
    assert len(list((tmp_path / "b").glob("*.mcap"))) == 3
    assert ticks(recover(tmp_path / "b").folder) == list(range(2500))


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
