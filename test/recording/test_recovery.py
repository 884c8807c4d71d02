# SPDX-License-Identifier: Apache-2.0
"""A torn file (power failure) is completed in place without losing a whole chunk."""

import errno
import fcntl
import os

import pytest
from bag_counts import sequences
from bag_damage import CHUNK, alter, old, place_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from screw_module_ros.recording import BagBusyError, BagFolderError, BagReadError, BagWriter
from screw_module_ros.recording.files import Source
from screw_module_ros.recording.reader import metadata
from screw_module_ros.recording.recovery import is_torn, recover, recover_all
from screw_module_ros.recording.survey import chunks, survey
from screw_module_ros.recording.verify import verify


def whole_chunks(path):
    """Return (end, messages up to there) of each chunk of a file."""
    found, total = [], 0
    with Source(path) as source:
        for chunk in chunks(source, survey(source, vouched=False)):
            total += len(chunk.messages)
            found.append((chunk.end, total))
    return found


def cut(folder, size):
    with (folder / "bag_0.mcap").open("r+b") as file:
        file.truncate(size)


@pytest.fixture
def content(bag):
    return (bag / "bag_0.mcap").read_bytes()


def test_complete_bag_is_not_torn(bag):
    assert not is_torn(bag)


@settings(
    max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(share=st.floats(0.01, 0.9999))
def test_cut_anywhere_every_whole_chunk_is_kept(bag, content, share):
    (bag / "bag_0.mcap").write_bytes(content)
    ends = whole_chunks(bag / "bag_0.mcap")
    size = int(len(content) * share)
    cut(bag, size)
    kept = max((total for end, total in ends if end <= size), default=0)
    assert is_torn(bag)
    done = recover(bag)
    assert (done.files, done.messages) == (1, kept)
    assert not is_torn(bag)
    assert sequences(bag) == list(range(kept))
    with (bag / "bag_0.mcap").open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == kept


def test_garbage_where_the_last_write_should_be(bag, content):
    """After a power failure the file may have its length and blocks of zeros."""
    ends = whole_chunks(bag / "bag_0.mcap")
    end, kept = ends[-2]
    torn = content[: end + 500] + bytes(len(content) - end - 500)
    (bag / "bag_0.mcap").write_bytes(torn)
    assert recover(bag).messages == kept
    assert sequences(bag) == list(range(kept))


def test_flipped_bit_ends_the_good_part(bag, content):
    end, kept = whole_chunks(bag / "bag_0.mcap")[3]
    torn = bytearray(content[: len(content) - 100])
    torn[end + 2000] ^= 0x40
    (bag / "bag_0.mcap").write_bytes(torn)
    recover(bag)
    assert 0 < len(sequences(bag)) <= 5000
    assert sequences(bag)[:kept] == list(range(kept))


def test_what_the_recorder_noted_survives(bag):
    cut(bag, os.path.getsize(bag / "bag_0.mcap") - 200)
    recover(bag)
    notes = metadata(bag)
    assert notes["state"] == "recovered"
    assert notes["configuration"] == {"sim.yaml": "sha256:0"}
    assert notes["audit"]["/screw/encoder"]["messages"] == 5000
    assert verify(bag).problems == ["the recording was not closed properly (state: recovered)"]


@pytest.mark.parametrize("content", ["", "nonsense: [", "rosbag2_bagfile_information: 3"])
def test_metadata_file_is_written_anew(bag, content):
    (bag / "metadata.yaml").write_text(content)
    recover(bag)
    assert sequences(bag) == list(range(5000))


def test_what_recovery_writes_is_the_owners_alone(bag):
    """With the umask of most shells the parts with a patient's movements were for all to read."""
    alter(bag, lambda data: data.__setitem__(place_of(data, CHUNK, 3) + 500, 0))
    for path in bag.iterdir():
        path.chmod(0o600)
    umask = os.umask(0o022)
    try:
        recover(bag)
    finally:
        os.umask(umask)
    assert len(list(bag.iterdir())) == 4  # also the part cut out, and the old metadata.yaml
    assert {path.stat().st_mode & 0o777 for path in bag.iterdir()} == {0o600}


def test_bag_without_metadata_file_is_torn(bag):
    (bag / "metadata.yaml").unlink()
    assert is_torn(bag)
    recover(bag)
    assert sequences(bag) == list(range(5000))


def test_recovering_twice_changes_nothing(bag):
    cut(bag, 30_000)
    recover(bag)
    before = (bag / "bag_0.mcap").read_bytes()
    assert recover(bag).files == 0
    assert (bag / "bag_0.mcap").read_bytes() == before


def without_locks(monkeypatch, number, can_write):
    """Play a file system on which a lock fails with this error; can_write: only of a reader."""
    flock = fcntl.flock

    def refused(descriptor, operation):
        if can_write and fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_RDWR:
            return flock(descriptor, operation)
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refused)


def test_a_bag_on_nfs_is_repaired(bag, monkeypatch):
    """There an exclusive lock needs a descriptor for writing, flock(2): it seemed in use."""
    without_locks(monkeypatch, errno.EBADF, can_write=True)
    cut(bag, 30_000)
    assert recover(bag).files == 1


def test_a_folder_without_locks_is_told_and_nothing_is_left(tmp_path, monkeypatch):
    """The answer was that another process writes a file that had just been made."""
    without_locks(monkeypatch, errno.ENOLCK, can_write=False)
    with pytest.raises(BagFolderError, match="cannot write a bag to .*: No locks available"):
        BagWriter(tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_bag_being_recorded_is_left_alone(tmp_path):
    writer = BagWriter(tmp_path / "live")
    with pytest.raises(BagBusyError, match="another process"):
        recover(tmp_path / "live")
    writer.close()


def test_all_torn_bags_of_a_folder(bag):
    cut(bag, 30_000)
    (bag.parent / "something else").mkdir()
    (bag.parent / "file").write_text("")
    old(bag)
    assert set(recover_all(bag.parent)) == {bag}
    assert recover_all(bag.parent) == {}


def test_file_of_another_recorder_is_refused(tmp_path):
    (tmp_path / "b").mkdir()
    with (tmp_path / "b" / "b_0.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "libmcap 1.3.0")
        writer.finish()
    with pytest.raises(BagReadError, match=r"libmcap 1.3.0.*mcap recover"):
        recover(tmp_path / "b")


def test_folder_without_bag(tmp_path):
    with pytest.raises(BagReadError, match="no bag folder"):
        recover(tmp_path)
    assert not is_torn(tmp_path)
    (tmp_path / "b_0.mcap").write_bytes(b"not an mcap file at all")
    with pytest.raises(BagReadError, match="not an MCAP file"):
        recover(tmp_path)
