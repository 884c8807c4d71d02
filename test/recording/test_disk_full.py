# SPDX-License-Identifier: Apache-2.0
"""A full disk ends the recording with a message; what was flushed stays readable."""

import errno
import io
import os
import shutil

import pytest

from screw_module_ros.recording import mcap_file
from screw_module_ros.recording.bag import Bag, BagError
from screw_module_ros.recording.recorder import Recording
from screw_module_ros.recording.records import File
from screw_module_ros.recording.recover import recover

SECOND = 1_000_000_000


def numbers(folder):
    file = File(folder / f"{folder.name}_0.mcap")
    return [int.from_bytes(m.data[12:16], "little") for _, m in file.messages()]


class SmallDisk(io.FileIO):
    """A file on a disk with little room: writes what fits, then says ENOSPC, as Linux does."""

    room = 0

    def write(self, data):
        fits = min(len(data), SmallDisk.room)
        if fits == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        SmallDisk.room -= fits
        return super().write(data[:fits])


@pytest.fixture
def fill(monkeypatch):
    """Return what leaves this room on the disk [B]; it has much before."""
    monkeypatch.setattr(SmallDisk, "room", 10**9)

    def opened(path, mode, opener=None, **options):
        return SmallDisk(path, mode, opener=opener) if "b" in mode else open(path, mode, **options)

    monkeypatch.setattr(mcap_file, "open", opened, raising=False)
    return lambda room: monkeypatch.setattr(SmallDisk, "room", room)


@pytest.fixture
def writer(tmp_path, encoder_topic, samples, fill):
    """A bag with 100 samples safe on the disk."""
    writer = Bag(tmp_path / "bag")
    writer.write(samples(writer.add_topic(encoder_topic), range(100)))
    writer.flush()
    return writer


@pytest.mark.parametrize("room", [0, 1, 100, 3000])
def test_bag_ends_with_the_last_flush_and_the_loss_is_told(writer, samples, fill, room):
    before = (writer.folder / "bag_0.mcap").read_bytes()
    fill(room)
    writer.write(samples(1, range(100, 3000)))
    with pytest.raises(BagError, match="writing the bag failed: No space left"):
        writer.flush()
    assert (writer.folder / "bag_0.mcap").read_bytes() == before
    assert numbers(writer.folder) == list(range(100))
    assert writer.message_count == 100
    with pytest.raises(BagError, match="the bag is closed"):
        writer.write(samples(1, [3000]))
    writer.close()
    assert not (writer.folder / "metadata.yaml").exists()
    fill(10**9)
    assert recover(writer.folder).messages == 100


def recording(writer, encoder_topic, **options):
    made = Recording(writer, **options)
    made.add_topic(encoder_topic)  # the writer has it
    return made


def test_recording_keeps_the_reason_and_counts_what_is_lost(writer, samples, fill, encoder_topic):
    """Also what was taken from the queue before the write that failed."""
    session = recording(writer, encoder_topic, free_space=lambda: SECOND)
    fill(10)
    session.put(samples(1, range(100, 2000)))
    session.work(0)
    session.work(2 * SECOND)
    session.put(samples(1, range(2000, 2010)))
    status = session.close()
    assert "No space left" in status.error
    assert (status.messages, status.dropped) == (100, 1910)
    assert status.audit["/screw/encoder"].dropped == 1910
    assert numbers(writer.folder) == list(range(100))


def test_recording_stops_in_good_order_before_the_disk_is_full(writer, samples, encoder_topic):
    free = iter([10**9, 10**6])
    session = recording(writer, encoder_topic, free_space=lambda: next(free))
    for turn in range(3):
        session.put(samples(1, range(100 + turn, 101 + turn)))
        session.work(turn * SECOND)
    session.put(samples(1, [103]))
    status = session.close()
    assert "1 MiB left" in status.error
    assert (status.messages, status.dropped) == (103, 1)
    assert numbers(writer.folder) == list(range(103))
    assert "closed" in (writer.folder / "metadata.yaml").read_text()


def test_a_deleted_folder_is_told_at_the_next_flush(writer, samples, encoder_topic):
    session = recording(writer, encoder_topic, free_space=lambda: SECOND)
    session.put(samples(1, range(100, 110)))
    session.work(0)
    shutil.rmtree(writer.folder)
    session.work(SECOND)
    status = session.status()
    assert "No such file or directory" in status.error
    assert status.dropped == 10
    session.close()


def test_disk_already_full_at_the_start(tmp_path, fill):
    fill(10)
    with pytest.raises(BagError, match="No space left"):
        Bag(tmp_path / "bag")
    assert list(tmp_path.iterdir()) == []
