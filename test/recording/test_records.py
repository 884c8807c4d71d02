# SPDX-License-Identifier: Apache-2.0
"""Bags come back as arrays for figures and as messages for everything else."""

import mcap.writer
import numpy as np
import pytest
from bag_counts import MS, START
from mcap.reader import make_reader
from mcap_ros2.writer import Writer

from screw_module_ros.recording.bag import Bag, BagError, Message
from screw_module_ros.recording.bag_files import information
from screw_module_ros.recording.decoded import calibrations, columns, read_bag, topics
from screw_module_ros.recording.records import File, notes


def test_columns_of_a_flat_message(bag):
    found = columns(bag, "/screw/encoder")
    assert list(found)[:4] == ["log_time", "stamp.sec", "stamp.nanosec", "sequence"]
    np.testing.assert_array_equal(found["log_time"], START + MS * np.arange(5000))
    np.testing.assert_array_equal(found["count"], 3 * np.arange(5000))
    np.testing.assert_allclose(found["position"], 1e-6 * np.arange(5000))
    assert found["homed"].dtype == bool


@pytest.fixture
def written(tmp_path, topic, codec):
    """Return a maker of bags: topics as name, kind, values of each message."""

    def make(*topics):
        writer = Bag(tmp_path / "b")
        for name, kind, messages in topics:
            channel = writer.add_topic(topic(name, kind))
            for number, values in enumerate(messages):
                data = codec.encode(f"screw_module_msgs/msg/{kind}", values)
                writer.write([Message(channel, START + number, START, 1, data)])
        writer.close()
        return writer.folder

    return make


def test_columns_of_nested_fields_arrays_and_texts(written):
    places = [{"position": {"z": z}, "header": {"frame_id": "manus"}} for z in (0.0, 0.1, 0.2)]
    bag = written(
        ("/endpoint", "EndpointState", places),
        ("/plane", "PlanarState", [{"joint_position": [number, 2.0]} for number in range(3)]),
        ("/safety", "SafetyState", [{"reasons": ["x"] * number} for number in range(3)]),
    )
    state, plane = columns(bag, "/endpoint"), columns(bag, "/plane")
    np.testing.assert_allclose(state["position.z"], [0.0, 0.1, 0.2])
    assert list(state["header.frame_id"]) == ["manus"] * 3
    np.testing.assert_allclose(plane["joint_position"], [[0, 2], [1, 2], [2, 2]])
    assert [len(texts) for texts in columns(bag, "/safety")["reasons"]] == [0, 1, 2]
    assert not any(name.isupper() for name in plane)


def test_messages_one_by_one_raw_types_and_notes(bag):
    first = next(read_bag(bag, ["/screw/encoder"]))
    assert (first.topic, first.log_time) == ("/screw/encoder", START)
    assert first.type == "screw_module_msgs/msg/EncoderSample"
    assert first.message.stamp.sec == 0
    assert sum(1 for _ in read_bag(bag)) == 5000
    found = [(topic.name, m) for topic, m in File(bag / "bag_0.mcap").messages()]
    assert {name for name, _ in found} == {"/screw/encoder"}
    assert [int.from_bytes(m.data[12:16], "little") for _, m in found] == list(range(5000))
    assert topics(bag) == {"/screw/encoder": "screw_module_msgs/msg/EncoderSample"}
    assert notes(bag)["configuration"] == {"sim.yaml": "sha256:0"}


def test_calibrations_are_those_of_the_last_messages(written):
    """Of texts of that name only: a number in a message of somebody else is another thing."""
    told = [{"calibration": "old"}, {"calibration": "new"}]
    assert calibrations(written(("/a", "AmplifierState", told))) == {"/a": "new"}


def test_topic_that_is_not_there_is_named_with_those_that_are(bag):
    with pytest.raises(BagError, match=r"holds no /nowhere; it holds: /screw/encoder"):
        columns(bag, "/nowhere")


def test_topic_without_messages(record):
    assert columns(record([]), "/screw/encoder")["log_time"].size == 0


def test_path_that_is_no_bag(tmp_path):
    with pytest.raises(BagError, match="there is no bag"):
        columns(tmp_path / "nothing", "/x")
    with pytest.raises(BagError, match="no bag folder"):
        notes(tmp_path)
    assert information(tmp_path) == {}


def test_a_file_that_cannot_be_opened_is_named(tmp_path):
    with pytest.raises(BagError, match="gone.mcap cannot be read: No such file"):
        File(tmp_path / "gone.mcap").notes()


def test_torn_bag_says_how_to_repair_it(bag):
    with (bag / "bag_0.mcap").open("r+b") as file:
        file.truncate(40_000)
    with pytest.raises(BagError, match="session recover"):
        columns(bag, "/screw/encoder")


def test_messages_that_no_declaration_belongs_to_are_counted(tmp_path):
    path = tmp_path / "b_0.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file, enable_crcs=False)
        writer.start("ros2", "another recorder")
        schema = writer.register_schema("own_msgs/msg/X", "ros2msg", b"uint32 x")
        known = writer.register_channel("/x", "cdr", schema)
        for channel in (known, 99, known, 99):
            writer.add_message(channel, 1, bytes(8), 1)
        writer.finish()
    file = File(path)
    assert [message.channel for _, message in file.messages()] == [known, known]
    assert "2 messages of topics whose declaration is damaged" in file.problems[-1]


def test_file_of_another_recorder(tmp_path):
    with (tmp_path / "other.mcap").open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef("geometry_msgs/msg/Point", "float64 x\nfloat64 y")
        for number in range(4):
            writer.write_message("/p", schema, {"x": number, "y": 0.5}, log_time=number)
    found = columns(tmp_path / "other.mcap", "/p")
    np.testing.assert_array_equal(found["x"], range(4))


def chunks_without(path, topic):
    """Return the places of the chunks that hold no message of a topic, with their ends."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    (channel,) = (n for n, found in summary.channels.items() if found.topic == topic)
    return [
        (chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length)
        for chunk in summary.chunk_indexes if channel not in chunk.message_index_offsets
    ]  # fmt: skip


@pytest.fixture
def rare(tmp_path, topic, codec):
    """A bag with a chunk of each: samples, a trial, samples, and notes behind them."""
    writer = Bag(tmp_path / "rare")
    samples, trials = (writer.add_topic(topic(name, kind)) for name, kind in (
        ("/screw/encoder", "EncoderSample"), ("/therapy/trial", "TrialResult")))  # fmt: skip
    for number, channel in enumerate((samples, trials, samples, trials)):
        kind = "EncoderSample" if channel == samples else "TrialResult"
        for more in range(3):
            data = codec.encode(f"screw_module_msgs/msg/{kind}", {})
            at = START + 10 * number + more
            writer.write([Message(channel, at, at, number * 3 + more + 1, data)])
        writer.flush()
    writer.note("clock", {"begun": "2026-03-03T13:05:00+01:00"})
    writer.close()
    return writer.folder


def test_the_index_gives_the_messages_of_a_topic_and_nothing_else_is_read(rare):
    """A session's record took as long as its 200 MB of samples; half a minute."""
    whole = [found.log_time for found in read_bag(rare, ["/therapy/trial"])]
    assert len(whole) == 6
    path = rare / "rare_0.mcap"
    data = bytearray(path.read_bytes())
    for begin, end in chunks_without(path, "/therapy/trial"):
        data[begin + 9 : end] = b"\xa5" * (end - begin - 9)
    path.write_bytes(data)
    found = list(read_bag(rare, ["/therapy/trial"], by_index=True))
    assert [each.log_time for each in found] == whole
    assert set(topics(rare)) == {"/screw/encoder", "/therapy/trial"}
    assert notes(rare)["clock"] == {"begun": "2026-03-03T13:05:00+01:00"}
    with pytest.raises(BagError, match="session recover"):
        list(read_bag(rare, ["/screw/encoder"], by_index=True))


def test_a_damaged_chunk_is_noticed_by_the_index_too(rare):
    path = rare / "rare_0.mcap"
    data, (spared, *_) = bytearray(path.read_bytes()), chunks_without(path, "/screw/encoder")
    data[spared[1] - 20] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(BagError, match="is damaged: .*session recover"):
        list(read_bag(rare, ["/therapy/trial"], by_index=True))


def test_an_unfinished_bag_is_refused_by_the_index(rare):
    path = rare / "rare_0.mcap"
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(BagError, match="has no whole index.*session recover"):
        list(read_bag(rare, ["/therapy/trial"], by_index=True))
