# SPDX-License-Identifier: Apache-2.0
"""Recovery never destroys readable data."""

import errno
import os

import pytest
from bag_counts import sequences
from bag_damage import CHUNK, FILE, alter, old, place_of
from mcap.writer import Writer

from screw_module_ros.recording import BagBusyError, BagError, BagReadError, BagWriter
from screw_module_ros.recording.reader import metadata, raw_messages, read_bag
from screw_module_ros.recording.recovery import recover, recover_all
from screw_module_ros.recording.verify import verify

INDEX = 7


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def flip(opcode, number, offset):
    """Return a change of one bit in a record."""

    def change(data):
        data[place_of(data, opcode, number) + offset] ^= 0x10

    return change


def test_a_bit_in_a_message_index_costs_no_message(bag):
    def change(data):
        flip(INDEX, 2, 20)(data)
        del data[-5:]

    alter(bag, change)
    assert recover(bag).messages == 5000
    assert sequences(bag) == list(range(5000))
    assert verify(bag).problems == ["the recording was not closed properly (state: recovered)"]


@pytest.mark.parametrize("read", [read_bag, raw_messages])
def test_who_reads_a_damaged_chunk_is_told_the_way_out(bag, read):
    alter(bag, flip(CHUNK, 1, 3000))
    with pytest.raises(BagReadError, match=f"damaged: .*; run: session recover {bag}$"):
        list(read(bag))
    recover(bag)
    assert list(read(bag))


def test_a_bit_near_the_start_costs_one_chunk(bag):
    """The first chunk declares the topic, and so does the undamaged index at the end."""
    alter(bag, flip(CHUNK, 0, 3000))
    problems = verify(bag).problems
    assert problems[0].startswith(f"{FILE} is damaged: ")
    done = recover(bag)
    kept = sequences(bag)
    assert done.messages == len(kept) > 4500
    assert kept == list(range(kept[0], 5000))
    report = verify(bag)
    assert report.topics["/screw/encoder"].messages == len(kept)
    assert not any("damaged" in problem for problem in report.problems)


def test_first_chunk_and_index_lost_the_topic_is_known_from_the_notes(bag):
    def change(data):
        flip(CHUNK, 0, 3000)(data)
        del data[place_of(data, CHUNK, 10) :]

    alter(bag, change)
    done = recover(bag)
    assert done.messages > 1000
    assert verify(bag).topics["/screw/encoder"].messages == done.messages


def test_notes_first_chunk_and_index_lost_the_messages_are_kept(bag):
    def change(data):
        flip(CHUNK, 0, 3000)(data)
        del data[place_of(data, CHUNK, 10) :]

    alter(bag, change)
    (bag / "metadata.yaml").unlink()
    done = recover(bag)
    assert done.messages > 1000
    assert verify(bag).topics["/unknown/channel_1"].messages == done.messages


@pytest.mark.parametrize("offset", [0, 1, 10, 18, 26, 38, 42, 47])
def test_a_bit_in_the_head_of_a_chunk_costs_nothing(bag, offset):
    """Opcode, lengths, times, size and compression follow from the records."""
    alter(bag, flip(CHUNK, 5, offset))
    assert recover(bag).messages == 5000
    assert sequences(bag) == list(range(5000))


@pytest.mark.parametrize("offset", [0, 3, 9, 20, 30])
def test_a_bit_in_the_first_bytes_costs_nothing(bag, offset):
    def change(data):
        data[offset] ^= 1

    alter(bag, change)
    assert recover(bag).messages == 5000
    assert sequences(bag) == list(range(5000))


def test_what_is_cut_out_is_kept_beside(bag):
    def change(data):
        flip(CHUNK, 3, 500)(data)
        del data[-300:]

    alter(bag, change)
    damaged = (bag / FILE).read_bytes()
    notes = (bag / "metadata.yaml").read_bytes()
    done = recover(bag)
    pieces = sorted(bag.glob("*.cut_*"), key=lambda path: int(path.name.split("_")[-2]))
    assert len(pieces) == 2
    assert sum(piece.stat().st_size for piece in pieces) == done.cut
    for piece in pieces:
        start, end = map(int, piece.name.split("_")[-2:])
        assert piece.read_bytes() == damaged[start:end]
    assert (bag / "metadata.yaml.before_recover").read_bytes() == notes


def test_a_complete_bag_is_left_alone(bag):
    before = content(bag)
    assert recover(bag).messages == 5000
    assert content(bag) == before
    assert verify(bag).complete


def test_lost_notes_of_a_complete_bag_come_back(bag):
    before = content(bag)
    (bag / "metadata.yaml").unlink()
    recover(bag)
    assert content(bag) == before


def test_no_room_for_what_is_cut_leaves_the_bag_as_it_is(bag, monkeypatch):
    alter(bag, flip(CHUNK, 3, 500))
    before = content(bag)

    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BagError, match="No space left"):
        recover(bag)
    assert content(bag) == before


def test_a_bag_that_is_open_for_writing_is_left_alone(bag):
    os.truncate(bag / FILE, 40_000)
    old(bag)
    before = content(bag)
    with (bag / FILE).open("ab"):
        with pytest.raises(BagBusyError, match="by another process"):
            recover(bag)
        assert isinstance(recover_all(bag.parent)[bag], BagBusyError)
    assert content(bag) == before


def test_a_bag_that_changed_a_moment_ago_is_left_alone_by_the_recorder(bag):
    os.truncate(bag / FILE, 40_000)
    before = content(bag)
    assert isinstance(recover_all(bag.parent)[bag], BagBusyError)
    assert content(bag) == before
    old(bag)
    assert recover_all(bag.parent)[bag].messages > 500


def test_a_torn_bag_of_another_recorder_is_not_touched(bag, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    with (other / "other_0.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "libmcap 1.3.0")
        schema = writer.register_schema("x", "ros2msg", b"")
        channel = writer.register_channel("/x", "cdr", schema)
        for number in range(100):
            writer.add_message(channel, number, bytes(100), number)
        writer.finish()
    (other / "empty_1.mcap").write_bytes(b"")
    os.truncate(other / "other_0.mcap", (other / "other_0.mcap").stat().st_size - 50)
    old(other)
    before = content(other)
    recover_all(tmp_path)
    with pytest.raises(BagReadError):
        recover(other)
    assert content(other) == before


def test_state_of_a_killed_recording_is_noted(tmp_path, encoder_topic, samples):
    writer = BagWriter(tmp_path / "killed")
    writer.write(samples(writer.add_topic(encoder_topic), range(100)))
    writer.flush()
    writer._file.close()  # what is left of it when its process is gone
    before = (tmp_path / "killed" / "killed_0.mcap").read_bytes()
    recover(tmp_path / "killed")
    assert metadata(tmp_path / "killed")["state"] == "recovered"
    assert (tmp_path / "killed" / "killed_0.mcap").read_bytes() == before
