# SPDX-License-Identifier: Apache-2.0
"""Messages of the receiving thread reach the bag; the others are counted, also on a full disk."""

import errno
import io
import os
import shutil
import threading
from unittest.mock import Mock

import pytest
from bag_counts import SECOND, ticks

from screw_module_ros.recording import mcap_file
from screw_module_ros.recording.bag import Bag, BagError, BagFullError, StorageSettings
from screw_module_ros.recording.bag_files import files_of
from screw_module_ros.recording.recorder import Recording, file_hashes
from screw_module_ros.recording.records import notes
from screw_module_ros.recording.recover import recover
from screw_module_ros.recording.verify import verify


@pytest.fixture
def recording(tmp_path, encoder_topic):
    """Return a maker of recordings, into a new bag or one that has the topic already."""

    def make(writer=None, free_space=lambda: 10 * SECOND, **storage):
        writer = writer or Bag(tmp_path / "bag")
        made = Recording(writer, StorageSettings(**storage), free_space=free_space)
        made.add_topic(encoder_topic)
        return made

    return make


@pytest.fixture
def session(recording):
    session = recording()
    yield session
    session.close()


@pytest.fixture
def small(recording):
    """A recording whose cache holds some thousand messages."""
    return recording(max_cache=2**20)


def test_nothing_is_flushed_before_its_time_and_all_after(session, samples):
    session.put(samples(1, range(10)))
    for later, stored in ((0, 0), (SECOND * 7 // 10, 0), (SECOND * 8 // 10, 10)):
        session.work(5 * SECOND + later)
        assert len(ticks(session.folder)) == session.status().messages == stored


def test_messages_of_several_topics_are_stored_in_order_of_time(session, samples, encoder_topic):
    other = session.add_topic(encoder_topic._replace(name="/other"))
    session.put([*samples(1, range(0, 10, 2)), *samples(other, range(1, 10, 2))])
    session.close()
    assert ticks(session.folder) == list(range(10))


def test_waiting_messages_are_told(session, samples):
    session.put(samples(1, range(7)))
    assert session.status().waiting == 7
    session.work(0)
    assert session.status().waiting == 0


def test_full_cache_drops_and_counts(small, samples, encoder_topic):
    """Each for its own topic."""
    other = small.add_topic(encoder_topic._replace(name="/other"))
    for start in range(0, 10_000, 1000):
        small.put(samples(1, range(start, start + 1000)))
    waiting = small.status().waiting
    small.put(samples(other, range(1000)))
    status = small.close()
    assert (status.messages, status.dropped, status.error) == (waiting, 11_000 - waiting, "")
    assert status.audit["/screw/encoder"].dropped == 10_000 - waiting > 0
    assert status.audit["/other"].dropped == 1000


def test_what_was_written_makes_room_in_the_cache(small, samples):
    for start in range(0, 20_000, 1000):
        small.put(samples(1, range(start, start + 1000)))
        small.work(start * 1_000_000)
    status = small.close()
    assert (status.messages, status.dropped) == (20_000, 0), "more than twice the cache in all"


def test_closing_writes_what_waits(session, samples):
    session.put(samples(1, range(25)))
    status = session.close()
    assert (status.messages, status.error) == (25, "")
    assert ticks(session.folder) == list(range(25))


def test_thread_writes_all_that_another_hands_over(session, samples):
    session.start()
    batches = [samples(1, range(start, start + 50)) for start in range(0, 2000, 50)]

    def hand_over():
        for batch in batches:
            session.put(batch)

    giver = threading.Thread(target=hand_over)
    giver.start()
    giver.join()
    status = session.close()
    assert (status.messages, status.dropped, status.waiting) == (2000, 0, 0)
    assert status.audit["/screw/encoder"].complete


def test_defect_in_the_thread_is_told(session, samples, monkeypatch, wait_until):
    def fail(messages):
        raise RuntimeError("a defect")

    monkeypatch.setattr(session._bag, "write", fail)
    session.start()
    session.put(samples(1, range(5)))
    wait_until(lambda: session.status().error)
    assert "RuntimeError: a defect" in session.status().error
    monkeypatch.undo()


def test_notes_and_publishers_reach_the_bag(session, samples):
    session.note("parameters", {"/encoder": "{}"})
    session.several_publishers(1)
    session.put(samples(1, [1, 5]))
    status = session.close()
    assert status.audit["/screw/encoder"].missed == -1
    found = notes(session.folder)
    assert found["parameters"] == {"/encoder": "{}"}
    assert found["audit"] == {"/screw/encoder": status.audit["/screw/encoder"].as_text()}


def test_the_recorder_itself_knows_the_stride(session, samples):
    session.put(samples(1, range(0, 300, 2)))
    assert session.close().audit["/screw/encoder"].lost == 149


def test_hashes_of_configuration_files(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"abc")
    found = file_hashes([str(tmp_path / "a.yaml"), "", str(tmp_path / "none")])
    # FIPS 180-2, appendix B.1.
    wanted = "sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert list(found.values()) == [wanted, "unreadable: No such file or directory"]


def test_a_folder_or_an_unknown_home_is_no_configuration(tmp_path):
    found = file_hashes([str(tmp_path), "~nosuchuser/x"])
    assert all(text.startswith("unreadable: ") for text in found.values())
    assert len(found) == 2


# A disk that is full.


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


ROOMS = pytest.mark.parametrize("room", [0, 1, 100, 3000])


@ROOMS
def test_bag_on_a_full_disk_ends_with_the_last_flush_and_the_loss_is_told(
    writer, samples, fill, room
):
    before = (writer.folder / "bag_0.mcap").read_bytes()
    fill(room)
    writer.write(samples(1, range(100, 3000)))
    with pytest.raises(BagFullError, match="waits for room on the disk: No space left"):
        writer.flush()
    assert ticks(writer.folder) == list(range(100))
    assert writer.message_count == 100
    with pytest.raises(BagError, match="No space left"):
        writer.close()
    assert (writer.folder / "bag_0.mcap").read_bytes() == before
    with pytest.raises(BagError, match="the bag is closed"):
        writer.write(samples(1, [3000]))
    writer.close()
    assert not (writer.folder / "metadata.yaml").exists()
    fill(10**9)
    assert recover(writer.folder).messages == 100


@ROOMS
def test_bag_goes_on_where_it_was_when_the_full_disk_has_room(writer, samples, fill, room):
    fill(room)
    writer.write(samples(1, range(100, 3000)))
    with pytest.raises(BagFullError):
        writer.flush()
    with pytest.raises(BagFullError):
        writer.flush()
    fill(10**9)
    writer.flush()
    writer.write(samples(1, range(3000, 3100)))
    writer.close()
    assert ticks(writer.folder) == list(range(3100))


def test_bag_whose_index_had_no_room_is_closed_when_there_is(writer, fill):
    fill(100)
    with pytest.raises(BagFullError):
        writer.rest()
    fill(10**9)
    writer.flush()
    assert writer.rests and ticks(writer.folder) == list(range(100))
    writer.close()
    assert verify(writer.folder).problems == []


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_bag_whose_metadata_had_no_room_goes_on_when_there_is(
    writer, samples, recording, monkeypatch
):
    free = [10**6]
    session = recording(writer, lambda: free[0])
    session.work(0)
    with monkeypatch.context() as full:
        full.setattr("screw_module_ros.recording.bag.replace", Mock(side_effect=FULL))
        for second in (1, 2):
            session.work(second * SECOND)
            assert "waits for room" in session.status().held
            assert not session.status().error
    session.work(3 * SECOND)
    assert verify(writer.folder).problems == []
    free[0] = 10**9
    session.put(samples(1, range(100, 110)))
    session.work(4 * SECOND)
    assert session.close().messages == 110
    report = verify(writer.folder)
    assert report.problems == [] and report.topics["/screw/encoder"].messages == 110


def test_a_bag_that_is_stopped_while_its_metadata_has_no_room_is_unfinished(
    writer, samples, recording, monkeypatch
):
    session = recording(writer, lambda: 10**6)
    session.work(0)
    with monkeypatch.context() as full:
        full.setattr("screw_module_ros.recording.bag.replace", Mock(side_effect=FULL))
        session.work(SECOND)
        session.put(samples(1, range(100, 110)))
        status = session.close()
    assert "No space left" in status.error and (status.messages, status.dropped) == (100, 10)
    assert "(state: unfinished)" in verify(writer.folder).problems[0]
    assert recover(writer.folder).messages == 100


@pytest.mark.parametrize("why", ["duration", "reserve"])
def test_a_next_file_that_had_no_room_is_made_when_there_is(
    writer, samples, fill, recording, monkeypatch, why
):
    """A bag at rest lost its metadata before; it stays closed and complete meanwhile."""
    writer._settings = StorageSettings(max_file_duration=0.15 if why == "duration" else 0.0)
    free = [10**9 if why == "duration" else 10**6]
    session = recording(writer, lambda: free[0])
    session.work(0)
    session.put(samples(1, range(100, 200)))
    with monkeypatch.context() as full:
        full.setattr(mcap_file, "open", Mock(side_effect=FULL))
        session.work(SECOND)
        free[0] = 10**9
        session.work(2 * SECOND)
        assert "No space left" in session.status().held and not session.status().error
        if why == "reserve":
            assert verify(writer.folder).problems == []
    session.put(samples(1, range(200, 210)))
    session.work(3 * SECOND)
    status = session.close()
    assert (status.error, status.messages, status.dropped) == ("", 210, 0)
    report = verify(writer.folder)
    assert report.problems == [] and report.topics["/screw/encoder"].messages == 210


def test_a_bag_that_is_stopped_without_room_for_its_next_file_is_unfinished(
    writer, samples, fill, recording, monkeypatch
):
    writer._settings = StorageSettings(max_file_duration=0.05)
    session = recording(writer)
    session.work(0)
    monkeypatch.setattr(mcap_file, "open", Mock(side_effect=FULL))
    session.work(SECOND)
    session.put(samples(1, range(100, 110)))
    status = session.close()
    assert "No space left" in status.error and (status.messages, status.dropped) == (100, 10)
    assert "(state: unfinished)" in verify(writer.folder).problems[0]


def test_a_bag_at_rest_that_cannot_go_on_states_what_it_lacks(
    writer, samples, fill, recording, monkeypatch
):
    free = [10**6]
    session = recording(writer, lambda: free[0])
    session.work(0)
    session.work(SECOND)
    free[0] = 10**9
    session.put(samples(1, range(100, 110)))
    monkeypatch.setattr(mcap_file, "open", Mock(side_effect=PermissionError(13, "not allowed")))
    session.work(2 * SECOND)
    monkeypatch.undo()
    status = session.close()
    assert "not allowed" in status.error and (status.messages, status.dropped) == (100, 10)
    (problem,) = verify(writer.folder).problems
    assert "10 messages that were received are not in the bag" in problem


def test_a_full_disk_for_seconds_ends_no_recording_and_loses_nothing(
    writer, samples, fill, recording
):
    session = recording(writer)
    for second in range(8):
        fill(10 if 2 <= second < 5 else 10**9)
        session.put(samples(1, range(100 + 10 * second, 110 + 10 * second)))
        session.work(second * SECOND)
        assert bool(session.status().held) == (2 <= second < 5)
        assert session.status().records == (not session.status().held)
    status = session.close()
    assert (status.error, status.messages, status.dropped) == ("", 180, 0)
    assert ticks(writer.folder) == list(range(180))
    assert verify(writer.folder).problems == []


def test_what_a_disk_that_was_full_for_long_has_cost_is_told(writer, samples, fill, recording):
    session = recording(writer, max_cache=2**20)
    fill(10)
    for second in range(20):
        session.put(samples(1, range(100 + 500 * second, 600 + 500 * second)))
        session.work(second * SECOND)
    lost = session.status().dropped
    fill(10**9)
    session.work(30 * SECOND)
    session.put(samples(1, range(20_000, 20_010)))
    status = session.close()
    assert 0 < lost == status.dropped
    assert (status.error, status.messages) == ("", 100 + 20 * 500 + 10 - lost)
    assert any(f"{lost} not written" in each for each in verify(writer.folder).problems)


def test_a_disk_below_its_reserve_closes_the_bag_which_goes_on_with_room(
    writer, samples, recording
):
    """What came meanwhile is in a new file of the bag; a kill in between costs no earlier file."""
    free = [10**9, 10**6, 10**6, 60 * 2**20, 10**9]
    session = recording(writer, lambda: free[0] if len(free) == 1 else free.pop(0))
    for turn in range(6):
        session.put(samples(1, range(100 + turn, 101 + turn)))
        session.work(turn * SECOND)
        closed = (writer.folder / "metadata.yaml").is_file()
        assert closed == bool(session.status().held) == (2 <= turn < 5), turn
        if closed:
            assert verify(writer.folder).problems == []
    status = session.close()
    assert (status.error, status.messages, status.dropped) == ("", 106, 0)
    assert [path.name for path in files_of(writer.folder)] == ["bag_0.mcap", "bag_1.mcap"]
    report = verify(writer.folder)
    assert report.problems == [] and report.topics["/screw/encoder"].messages == 106


def _without_room_for_the_index(fill, monkeypatch):
    """The next index finds 10 B; the disk had room for all before it."""
    finish = mcap_file.McapFile.finish

    def full(file):
        fill(10)
        finish(file)

    monkeypatch.setattr(mcap_file.McapFile, "finish", full)
    return lambda: monkeypatch.setattr(mcap_file.McapFile, "finish", finish)


@pytest.mark.parametrize("why", ["duration", "reserve"])
def test_a_recording_whose_index_had_no_room_goes_on_and_counts_each_message_once(
    writer, samples, fill, recording, monkeypatch, why
):
    """It died of a write to the closed file, and its bag was called complete."""
    writer._settings = StorageSettings(max_file_duration=0.15 if why == "duration" else 0.0)
    free = [10**9]
    session = recording(writer, lambda: free[0])
    session.put(samples(1, range(100, 110)))
    session.work(0)
    session.put(samples(1, range(110, 200)))
    mended = _without_room_for_the_index(fill, monkeypatch)
    free[0] = 10**9 if why == "duration" else 10**6
    session.work(SECOND)
    assert "waits for room" in session.status().held
    mended()
    fill(10**9)
    session.put(samples(1, range(200, 210)))
    session.work(2 * SECOND)
    assert bool(session.status().held) == (why == "reserve")
    free[0] = 10**9
    session.put(samples(1, range(210, 220)))
    session.work(3 * SECOND)
    status = session.close()
    assert (status.error, status.messages, status.dropped) == ("", 220, 0)
    assert [path.name for path in files_of(writer.folder)] == ["bag_0.mcap", "bag_1.mcap"]
    report = verify(writer.folder)
    assert report.problems == [] and report.topics["/screw/encoder"].messages == 220


def test_what_was_safe_before_its_index_had_no_room_is_not_counted_as_lost(
    writer, samples, fill, recording, monkeypatch
):
    writer._settings = StorageSettings(max_file_duration=0.15)
    session = recording(writer)
    session.work(0)
    session.put(samples(1, range(100, 200)))
    _without_room_for_the_index(fill, monkeypatch)
    session.work(SECOND)
    session.put(samples(1, range(200, 210)))
    status = session.close()
    assert "No space left" in status.error
    assert (status.messages, status.dropped) == (200, 10)
    assert ticks(writer.folder) == list(range(200))
    assert not (writer.folder / "metadata.yaml").exists()


def test_recording_keeps_the_reason_and_counts_what_is_lost(writer, samples, fill, recording):
    """Also what was taken from the queue before the write that failed."""
    session = recording(writer)
    fill(10)
    session.put(samples(1, range(100, 2000)))
    session.work(0)
    session.work(2 * SECOND)
    session.put(samples(1, range(2000, 2010)))
    status = session.close()
    assert "No space left" in status.error
    assert (status.messages, status.dropped) == (100, 1910)
    assert status.audit["/screw/encoder"].dropped == 1910
    assert ticks(writer.folder) == list(range(100))


def test_recording_stops_in_good_order_before_the_disk_is_full(writer, samples, recording):
    free = iter([10**9, 10**6])
    session = recording(writer, lambda: next(free))
    for turn in range(3):
        session.put(samples(1, range(100 + turn, 101 + turn)))
        session.work(turn * SECOND)
    session.put(samples(1, [103]))
    status = session.close()
    assert "1 MiB left" in status.error
    assert (status.messages, status.dropped) == (103, 1)
    assert ticks(writer.folder) == list(range(103))
    assert "ended early" in (writer.folder / "metadata.yaml").read_text()


@pytest.mark.parametrize("can_write", [True, False])
def test_what_came_after_a_bag_was_closed_for_want_of_room_is_told_by_verify(
    writer, samples, recording, monkeypatch, can_write
):
    """Dropped after the last count in the bag, they were nowhere: it was called complete."""
    session = recording(writer, lambda: 10**6, max_cache=2**20)
    session.work(0)
    session.work(SECOND)
    assert verify(writer.folder).problems == []
    for start in range(100, 20_100, 1000):
        session.put(samples(1, range(start, start + 1000)))
    if not can_write:
        full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        monkeypatch.setattr("screw_module_ros.recording.bag.replace", Mock(side_effect=full))
    status = session.close()
    assert "1 MiB left" in status.error
    assert (status.messages, status.dropped) == (100, 20_000)
    (problem,) = verify(writer.folder).problems
    if can_write:
        assert "ended early" in problem
        assert "20000 messages that were received are not in the bag" in problem
    else:
        assert "was not closed (state: unfinished)" in problem
    assert ticks(writer.folder) == list(range(100))


def test_a_recording_that_ended_at_rest_and_lost_nothing_is_complete(writer, recording):
    session = recording(writer, lambda: 10**6)
    session.work(0)
    session.work(SECOND)
    assert "1 MiB left" in session.close().error
    assert verify(writer.folder).problems == []


def test_a_deleted_folder_is_told_at_the_next_flush(writer, samples, recording):
    session = recording(writer)
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
