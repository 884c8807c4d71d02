# SPDX-License-Identifier: Apache-2.0
"""A full disk ends the recording with a message; the bag stays whole."""

import errno
import os
import resource
import subprocess
import sys

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from screw_module_ros.recording import (
    BagFolderError,
    BagWriteError,
    BagWriter,
    Session,
    StorageSettings,
)
from screw_module_ros.recording import mcap_file as mcap_file_module

SECOND = 1_000_000_000


def numbers(folder):
    with AnyReader([folder]) as reader:
        return [reader.deserialize(d, c.msgtype).sequence for c, _, d in reader.messages()]


class SmallDisk:
    """A disk with room for `room` bytes more: writes what fits, then says ENOSPC, as Linux does."""

    def __init__(self, monkeypatch, room):
        self.end = None
        self.room = room
        self.write = os.pwrite
        monkeypatch.setattr(mcap_file_module.os, "pwrite", self.pwrite)

    def pwrite(self, descriptor, data, offset):
        if self.end is None:
            self.end = os.fstat(descriptor).st_size + self.room
        fits = max(0, self.end - offset)
        if fits == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.write(descriptor, data[:fits], offset)


@pytest.fixture
def writer(tmp_path, encoder_topic, samples):
    """A bag with 100 samples safe on the disk."""
    writer = BagWriter(tmp_path / "bag")
    writer.write(samples(writer.add_topic(encoder_topic), range(100)))
    writer.flush()
    yield writer
    writer.close()


@pytest.mark.parametrize("room", [0, 1, 100, 3000])
def test_bag_stays_whole_and_the_loss_is_told(writer, samples, monkeypatch, room):
    before = (writer.folder / "bag_0.mcap").read_bytes()
    SmallDisk(monkeypatch, room)
    writer.write(samples(1, range(100, 3000)))
    with pytest.raises(BagWriteError, match=r"No space left.* 2900 messages .* not in the bag"):
        writer.flush()
    assert (writer.folder / "bag_0.mcap").read_bytes() == before
    assert numbers(writer.folder) == list(range(100))
    assert writer.message_count == 100


def test_session_keeps_the_reason_and_counts_what_comes_after(writer, samples, monkeypatch):
    session = Session(writer, free_space=lambda: SECOND)
    SmallDisk(monkeypatch, 10)
    session.put(samples(1, range(100, 2000)))
    session.work(0)
    session.work(2 * SECOND)
    session.put(samples(1, range(2000, 2010)))
    status = session.close()
    assert "No space left" in status.error
    assert (status.messages, status.dropped) == (100, 10)
    assert status.audit["/screw/encoder"].dropped == 10
    assert numbers(writer.folder) == list(range(100))


def test_session_stops_in_good_order_before_the_disk_is_full(writer, samples):
    free = iter([10**9, 10**6])
    session = Session(writer, StorageSettings(), free_space=lambda: next(free))
    for turn in range(3):
        session.put(samples(1, range(100 + turn, 101 + turn)))
        session.work(turn * SECOND)
    session.put(samples(1, [103]))
    status = session.close()
    assert "1 MiB left" in status.error
    assert (status.messages, status.dropped) == (103, 1)
    assert numbers(writer.folder) == list(range(103))
    assert "closed" in (writer.folder / "metadata.yaml").read_text()


def test_disk_already_full_at_the_start(tmp_path, monkeypatch):
    SmallDisk(monkeypatch, 100)
    with pytest.raises(BagFolderError, match="cannot write a bag to .*No space left"):
        BagWriter(tmp_path / "bag")
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import signal, sys
from screw_module_ros.recording import BagWriteError, BagWriter, Definition, Topic
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
writer = BagWriter(sys.argv[1])
channel = writer.add_topic(Topic("/x", "own_msgs/msg/X", Definition("ros2msg", "uint8[64] x", "")))
noise = open("/dev/urandom", "rb")
try:
    for number in range(10_000):
        data = b"\\0\\1\\0\\0" + noise.read(64)
        writer.write([(channel, 10**18 + number, 10**18, number + 1, data)])
        if number % 50 == 49:
            writer.flush()
            print(number + 1, flush=True)
except BagWriteError as error:
    print(error)
"""


def test_limit_of_the_operating_system(tmp_path):
    """The kernel itself refuses in the middle of a write (here by RLIMIT_FSIZE)."""
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path / "bag")],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000)),
    )
    *flushed, sentence = done.stdout.splitlines()
    assert "are not in the bag" in sentence
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == int(flushed[-1]) > 100
