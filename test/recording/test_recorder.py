# SPDX-License-Identifier: Apache-2.0
"""Messages of the receiving thread reach the bag; the others are counted."""

import threading

import pytest
from bag_counts import by_library
from mcap.reader import make_reader

from screw_module_ros.recording.bag import Bag, StorageSettings
from screw_module_ros.recording.recorder import Recording, file_hashes
from screw_module_ros.recording.records import notes

SECOND = 1_000_000_000


@pytest.fixture
def session(tmp_path, encoder_topic):
    session = Recording(Bag(tmp_path / "bag"), free_space=lambda: 10 * SECOND)
    session.add_topic(encoder_topic)
    yield session
    session.close()


@pytest.fixture
def small(tmp_path, encoder_topic):
    """A recording whose cache holds some thousand messages."""
    settings = StorageSettings(max_cache=2**20)
    session = Recording(Bag(tmp_path / "bag"), settings, free_space=lambda: 10 * SECOND)
    session.add_topic(encoder_topic)
    return session


def stored(session):
    return by_library((session.folder / "bag_0.mcap").read_bytes())


def test_nothing_is_flushed_before_its_time_and_all_after(session, samples):
    session.put(samples(1, range(10)))
    session.work(5 * SECOND)
    session.work(5 * SECOND + 700_000_000)
    assert stored(session) == 0
    assert session.status().messages == 0
    session.work(5 * SECOND + 800_000_000)
    assert stored(session) == 10
    assert session.status().messages == 10


def test_messages_of_several_topics_are_stored_in_order_of_time(session, samples, encoder_topic):
    other = session.add_topic(encoder_topic._replace(name="/other"))
    session.put([*samples(1, range(0, 10, 2)), *samples(other, range(1, 10, 2))])
    session.close()
    with (session.folder / "bag_0.mcap").open("rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert len(times) == 10


def test_waiting_messages_are_told(session, samples):
    session.put(samples(1, range(7)))
    assert session.status().waiting == 7
    session.work(0)
    assert session.status().waiting == 0


def test_full_cache_drops_and_counts(small, samples):
    for start in range(0, 10_000, 1000):
        small.put(samples(1, range(start, start + 1000)))
    waiting = small.status().waiting
    assert 0 < waiting < 10_000
    status = small.close()
    assert (status.messages, status.dropped) == (waiting, 10_000 - waiting)
    assert status.audit["/screw/encoder"].dropped == 10_000 - waiting
    assert status.error == ""


def test_what_was_written_makes_room_in_the_cache(small, samples):
    for start in range(0, 20_000, 1000):
        small.put(samples(1, range(start, start + 1000)))
        small.work(start * 1_000_000)
    status = small.close()
    assert (status.messages, status.dropped) == (20_000, 0), "more than twice the cache in all"


def test_what_is_refused_counts_for_its_own_topic(small, samples, encoder_topic):
    other = small.add_topic(encoder_topic._replace(name="/other"))
    for start in range(0, 8000, 1000):
        small.put(samples(1, range(start, start + 1000)))
    kept = small.status().waiting
    small.put(samples(other, range(1000)))
    audit = small.close().audit
    assert audit["/screw/encoder"].dropped == 8000 - kept > 0
    assert audit["/other"].dropped == 1000


def test_closing_writes_what_waits(session, samples):
    session.put(samples(1, range(25)))
    status = session.close()
    assert (status.messages, status.error) == (25, "")
    assert stored(session) == 25


def test_thread_writes_all_that_another_hands_over(session, samples, wait_until):
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
