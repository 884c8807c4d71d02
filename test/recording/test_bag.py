# SPDX-License-Identifier: Apache-2.0
"""Bags are what rosbag2 of Jazzy writes: read back by mcap and rosbags."""

import hashlib
import json
import os
from unittest.mock import Mock

import pytest
import yaml
from bag_counts import MS, START, ticks
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from screw_module_ros.recording import mcap_file
from screw_module_ros.recording.bag import Bag, BagError, BagExistsError, Topic
from screw_module_ros.recording.definitions import UNKNOWN, DefinitionError, Definitions, fields


def read_by_mcap(path):
    """Return (topic, sequence, log time, publish time, decoded) of every message, CRCs checked."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, message.sequence, message.log_time, message.publish_time, decoded)
            for _, channel, message, decoded in reader.iter_decoded_messages()
        ]


def read_by_rosbags(folder):
    with AnyReader([folder]) as reader:
        return [
            (connection.topic, log_time, reader.deserialize(data, connection.msgtype))
            for connection, log_time, data in reader.messages()
        ]


def information(folder):
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_mcap_reads_every_message_with_its_times_and_number(bag):
    found = read_by_mcap(bag / "bag_0.mcap")
    assert len(found) == 5000
    *told, message = found[1234]
    time = START + 1234 * MS
    assert told == ["/screw/encoder", 1235, time, time - 50_000]
    assert (message.sequence, message.count) == (1234, 3702)
    assert message.position == pytest.approx(1234e-6)


def test_rosbags_reads_every_message_and_agrees_on_the_type_hash(bag):
    found = read_by_rosbags(bag)
    assert [message.sequence for _, _, message in found] == list(range(5000))
    assert found[-1][1] == START + 4999 * MS


def test_header_and_channel_are_those_of_rosbag2(bag, codec):
    with (bag / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    (schema,) = summary.schemas.values()
    (channel,) = summary.channels.values()
    assert (schema.name, schema.encoding) == ("screw_module_msgs/msg/EncoderSample", "ros2msg")
    assert b"=" * 80 + b"\nMSG: builtin_interfaces/Time\n" in schema.data
    assert channel.message_encoding == "cdr"
    assert channel.metadata["topic_type_hash"] == codec.hash(schema.name)
    (offer,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert (offer["reliability"], offer["durability"]) == ("best_effort", "volatile")
    assert offer["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert len(summary.chunk_indexes) > 10
    assert {index.compression for index in summary.chunk_indexes} == {"zstd"}


def test_metadata_file_holds_the_keys_of_version_9_in_order(bag, codec):
    info = information(bag)
    (file,), (line,) = info.pop("files"), info.pop("topics_with_message_count")
    topic = line.pop("topic_metadata")
    (offer,) = topic["offered_qos_profiles"]
    assert list(information(bag)) == [
        "version", "storage_identifier", "duration", "starting_time", "message_count",
        "topics_with_message_count", "compression_format", "compression_mode",
        "relative_file_paths", "files", "custom_data", "ros_distro",
    ]  # fmt: skip
    del info["custom_data"]
    assert info == {
        "version": 9, "storage_identifier": "mcap", "ros_distro": "jazzy",
        "duration": {"nanoseconds": 4999 * MS},
        "starting_time": {"nanoseconds_since_epoch": START},
        "message_count": 5000, "relative_file_paths": ["bag_0.mcap"],
        "compression_format": "", "compression_mode": "",
    }  # fmt: skip
    assert (file["path"], file["message_count"], line) == (
        "bag_0.mcap", 5000, {"message_count": 5000}
    )  # fmt: skip
    assert list(topic) == [
        "name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash",
    ]  # fmt: skip
    assert topic["type_description_hash"] == codec.hash(topic["type"])
    assert list(offer) == [
        "history", "depth", "reliability", "durability", "deadline", "lifespan", "liveliness",
        "liveliness_lease_duration", "avoid_ros_namespace_conventions",
    ]  # fmt: skip


def test_rosbags_understands_the_metadata_file(bag):
    with Reader(bag) as reader:
        assert (reader.message_count, reader.duration) == (5000, 4999 * MS + 1)
        (connection,) = reader.connections
        assert connection.ext.offered_qos_profiles[0].reliability.name == "BEST_EFFORT"


def test_notes_are_in_the_file_and_its_hash_is_in_the_metadata_file(bag):
    with (bag / "bag_0.mcap").open("rb") as file:
        records = {record.name: record.metadata for record in make_reader(file).iter_metadata()}
    assert records == {"screw_module_ros/configuration": {"sim.yaml": "sha256:0"}}
    custom = information(bag)["custom_data"]
    assert custom["screw_module_ros/state"] == "closed"
    wanted = hashlib.sha256((bag / "bag_0.mcap").read_bytes()).hexdigest()
    assert json.loads(custom["screw_module_ros/sha256"]) == {"bag_0.mcap": wanted}


def test_what_was_flushed_can_be_read_without_an_end(tmp_path, encoder_topic, samples):
    writer = Bag(tmp_path / "b")
    channel = writer.add_topic(encoder_topic)
    for flushed in range(0, 50, 10):
        writer.write(samples(channel, range(flushed, flushed + 10)))
        writer.flush()
        assert ticks(tmp_path / "b") == list(range(flushed + 10))
        assert writer.message_count == flushed + 10
    assert not (tmp_path / "b" / "metadata.yaml").exists()
    writer.close()


def test_all_own_types_are_recorded_with_full_schemas(tmp_path, topic, codec, own_types):
    writer = Bag(tmp_path / "b")
    for name in own_types:
        kind = name.split("/")[-1]
        channel = writer.add_topic(topic(f"/{kind}", kind))
        writer.write([(channel, START, START, 1, codec.encode(name, {}))])
    writer.close()
    found = read_by_rosbags(tmp_path / "b")  # raises when a hash does not fit its definition
    assert len(found) == len(own_types) == len(read_by_mcap(tmp_path / "b" / "b_0.mcap")) >= 9


def test_topic_added_in_mid_recording(tmp_path, encoder_topic, samples):
    writer = Bag(tmp_path / "b")
    for name, sequences in (("/screw/encoder", range(10)), ("/late", range(10, 15))):
        channel = writer.add_topic(encoder_topic._replace(name=name, qos=()))
        writer.write(samples(channel, sequences))
        writer.flush()
    writer.close()
    assert [topic for topic, _, _ in read_by_rosbags(tmp_path / "b")] == (
        ["/screw/encoder"] * 10 + ["/late"] * 5
    )


def test_topic_without_definition_does_not_spoil_the_bag(tmp_path, encoder_topic, samples):
    writer = Bag(tmp_path / "b")
    channel = writer.add_topic(encoder_topic)
    odd = writer.add_topic(Topic("/odd", "odd_msgs/msg/Odd", UNKNOWN))
    writer.write([*samples(channel, range(3)), (odd, START, START, 0, b"\0\1\0\0abcd")])
    writer.close()
    with Reader(tmp_path / "b") as reader:
        found = {connection.topic: data for connection, _, data in reader.messages()}
    assert found["/odd"] == b"\0\1\0\0abcd"


def test_long_recording_continues_in_a_second_file(record):
    bag = record(range(2500), max_file_duration=0.9)
    info = information(bag)
    assert info["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap"]
    assert sum(file["message_count"] for file in info["files"]) == info["message_count"] == 2500
    assert info["files"][1]["starting_time"]["nanoseconds_since_epoch"] == START + 1000 * MS
    assert [message.sequence for *_, message in read_by_rosbags(bag)] == list(range(2500))


def test_bag_without_messages(record):
    bag = record([])
    assert information(bag)["starting_time"]["nanoseconds_since_epoch"] == 2**63 - 1
    assert read_by_rosbags(bag) == []


def test_existing_folder_is_refused_and_left_alone(bag):
    before = (bag / "bag_0.mcap").read_bytes()
    with pytest.raises(BagExistsError, match="never overwritten"):
        Bag(bag)
    assert (bag / "bag_0.mcap").read_bytes() == before


def test_a_folder_that_cannot_be_made_is_told_without_its_name(tmp_path):
    """The name may be a patient's, and the sentence reaches the log."""
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot make the bag's folder: Not a directory") as caught:
        Bag(tmp_path / "file" / "P-7K3QX")
    assert "P-7K3QX" not in str(caught.value)


def test_folder_without_permission(tmp_path, monkeypatch):
    refusal = Mock(side_effect=PermissionError(13, "Permission denied"))
    monkeypatch.setattr(mcap_file, "owner_only", refusal)
    with pytest.raises(BagError, match="Permission denied"):
        Bag(tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_a_bag_is_its_owners_alone(tmp_path):
    """With the umask of most shells a patient's movements were for all to read."""
    umask = os.umask(0o022)
    try:
        Bag(tmp_path / "b").close()
    finally:
        os.umask(umask)
    assert (tmp_path / "b").stat().st_mode & 0o777 == 0o700
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / "b").iterdir()} == {0o600}


def test_closing_twice_is_one_close(tmp_path):
    writer = Bag(tmp_path / "other")
    writer.close()
    writer.close()
    assert information(tmp_path / "other")["custom_data"]["screw_module_ros/state"] == "closed"


# Definitions are gathered as rosbag2 does, with everything they depend on.

LINE = "=" * 80


def test_dependencies_follow_once_and_in_rosbag2s_form(definitions):
    found = definitions.find("screw_module_msgs/msg/EndpointState")
    parts = found.text.split(f"\n{LINE}\n")
    assert [part.split("\n", 1)[0] for part in parts[1:]] == [
        "MSG: geometry_msgs/Point",
        "MSG: geometry_msgs/Vector3",
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
    ]
    assert found.encoding == "ros2msg"
    assert "bool vertical_locked" in parts[0]


def test_type_of_the_same_package_needs_no_prefix(tmp_path):
    folder = tmp_path / "own_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Outer.msg").write_text("# Inner in a comment\nInner[<=3] parts\nstring<=5 name\n")
    (folder / "Inner.msg").write_text("uint8 RED=1\nuint8 colour\n")
    text = Definitions({"own_msgs": folder.parent}).find("own_msgs/msg/Outer").text
    assert text.count("MSG: own_msgs/Inner\n") == 1
    assert text.endswith("uint8 RED=1\nuint8 colour\n")


@pytest.mark.parametrize("name", ["nowhere_msgs/msg/X", "screw_module_msgs/msg/X", "no type"])
def test_unknown_type_is_named(definitions, monkeypatch, name):
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    with pytest.raises(DefinitionError, match=name):
        definitions.find(name)


def test_fields_leave_out_constants_and_comments():
    own = "uint8 OFF=0  # x\n# float64 no\nint32 a  # b\n\nstring<=4 c\n"
    text = f"{own}\n{LINE}\nMSG: x/Y\nint8 z"
    assert fields(text) == [("int32", "a"), ("string<=4", "c")]


@pytest.mark.skipif(not os.environ.get("AMENT_PREFIX_PATH"), reason="needs installed messages")
@pytest.mark.parametrize(
    "name",
    [
        "screw_module_msgs/msg/EncoderSample",
        "screw_module_msgs/msg/SafetyState",
        "sensor_msgs/msg/JointState",
        "rcl_interfaces/msg/ParameterEvent",
        "diagnostic_msgs/msg/DiagnosticArray",
        "lifecycle_msgs/msg/TransitionEvent",
    ],
)
def test_installed_hash_is_that_of_the_definition(name):
    found = Definitions().find(name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(found.text, name))
    assert found.type_hash == store.hash_rihs01(name)
