# SPDX-License-Identifier: Apache-2.0
"""`session verify` counts anew and says complete, or what is missing and where."""

import json

import pytest
import yaml

from screw_module_ros.recording import BagWriter, Counts, Message, Topic
from screw_module_ros.recording.cli import main
from screw_module_ros.recording.seal import NO_ANSWER, sealed
from screw_module_ros.recording.verify import Gap, verify

START = 1_700_000_000_000_000_000
MS = 1_000_000


@pytest.fixture
def gappy(tmp_path, encoder_topic, samples):
    """A bag with 3 samples missing after the 100th and 1 after the 200th."""
    writer = BagWriter(tmp_path / "gappy")
    channel = writer.add_topic(encoder_topic)
    writer.write(samples(channel, [*range(100), *range(103, 200), *range(201, 300)]))
    writer.dropped(channel, 2)
    writer.close()
    return tmp_path / "gappy"


def test_complete_bag(bag, capsys):
    report = verify(bag)
    assert report.complete
    assert report.topics == {"/screw/encoder": Counts(messages=5000, stride=1)}
    assert main(["verify", str(bag)]) == 0
    assert capsys.readouterr().out.endswith("complete\n")


def test_gaps_are_counted_and_placed(gappy, capsys):
    report = verify(gappy)
    counts = report.topics["/screw/encoder"]
    assert (counts.gaps, counts.lost, counts.dropped) == (2, 4, 2)
    assert report.gaps["/screw/encoder"] == [Gap(START + 99 * MS, 3), Gap(START + 199 * MS, 1)]
    (problem,) = report.problems
    assert problem == "/screw/encoder: of 296 messages 4 lost in 2 gaps, 2 not written"
    assert main(["verify", str(gappy)]) == 1
    out = capsys.readouterr().out
    assert f"3 missing after {START + 99 * MS} ns" in out
    assert out.endswith("NOT complete\n")


def test_counts_that_differ_from_the_metadata_file(bag):
    path = bag / "metadata.yaml"
    path.write_text(path.read_text().replace("message_count: 5000", "message_count: 5001"))
    assert "metadata.yaml tells 5001 messages, the files hold 5000" in verify(bag).problems[0]


def test_torn_file(bag):
    with (bag / "bag_0.mcap").open("r+b") as file:
        file.truncate(40_000)
    assert any("cut off; run: session recover" in problem for problem in verify(bag).problems)


def test_unreadable_metadata_file(bag):
    (bag / "metadata.yaml").write_text("[")
    assert "metadata.yaml cannot be read" in verify(bag).problems[0]


def test_info_shows_what_was_noted(bag, capsys):
    assert main(["info", str(bag)]) == 0
    assert "sim.yaml: sha256:0" in capsys.readouterr().out


def test_recover_command(bag, capsys):
    with (bag / "bag_0.mcap").open("r+b") as file:
        file.truncate(40_000)
    assert main(["recover", str(bag)]) == 0
    assert "1 files completed" in capsys.readouterr().out
    assert main(["info", str(bag)]) == 0


def test_path_that_is_no_bag(tmp_path, capsys):
    assert main(["verify", str(tmp_path)]) == 1
    assert "no bag folder" in capsys.readouterr().err


NODES = {"/amplifier": '{"rate": 1000.0}', "/manus": '{"rate": 500.0}'}


@pytest.fixture
def noted(tmp_path, codec, definitions, samples, encoder_topic):
    """A bag with parameters of two nodes and the calibration that its messages tell."""
    kind = "screw_module_msgs/msg/AmplifierState"
    writer = BagWriter(tmp_path / "noted")
    topic = Topic("/amplifier_state", kind, definitions.find(kind), codec.hash(kind))
    state, encoder = writer.add_topic(topic), writer.add_topic(encoder_topic)
    writer.write(samples(encoder, range(10)))
    data = codec.encode(kind, {"calibration": "SIM-0001 sha256:12"})
    writer.write([Message(state, START, START, 1, data)])
    writer.add_metadata("parameters", NODES)
    writer.add_metadata("calibration", {"/amplifier_state": "SIM-0001 sha256:12"})
    writer.close()
    return tmp_path / "noted"


def alter(folder, before, after):
    path = folder / "metadata.yaml"
    text = path.read_text()
    assert text.count(before) == 1
    path.write_text(text.replace(before, after))


def test_what_was_noted_is_checked_and_complete(noted):
    report = verify(noted)
    assert report.complete, report.problems
    assert report.notes["parameters"] == NODES
    assert set(report.notes["hashes"]) == {
        "parameters: /amplifier", "parameters: /manus", "calibration: /amplifier_state"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("before", "after", "wanted"),
    [
        ("1000.0", "2000.0", "parameters: /amplifier: was altered"),
        (r"\"/manus\"", r"\"/menus\"", "parameters: /manus: was noted"),
        (r"\"/manus\"", r"\"/menus\"", "parameters: /menus: has no hash"),
        (r'\": \"SIM-0001', r'\": \"SIM-0002', "calibration: /amplifier_state: was altered"),
        (r'\": \"SIM-0001', r'\": \"SIM-0002', "its messages name another one than 'SIM-0002"),
        (r"\"parameters: /manus\": \"sha256:", r"\"parameters: /manus\": \"sha256:0", "manus: was"),
        (r"\"/manus\"", r"\"/manus", "parameters: metadata.yaml and the last file"),
    ],
)
def test_altered_notes_are_found_and_named(noted, before, after, wanted, capsys):
    alter(noted, before, after)
    assert main(["verify", str(noted)]) == 1
    assert wanted in capsys.readouterr().out


def test_notes_altered_with_their_hash_still_differ_from_the_file(noted):
    path = noted / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    custom = content["rosbag2_bagfile_information"]["custom_data"]
    changed = {**NODES, "/manus": '{"rate": 250.0}'}
    notes = {"parameters": changed, "calibration": {"/amplifier_state": "SIM-0001 sha256:12"}}
    custom["screw_module_ros/parameters"] = json.dumps(changed)
    custom["screw_module_ros/hashes"] = json.dumps(sealed(notes))
    path.write_text(yaml.safe_dump(content))
    assert verify(noted).problems == [
        "hashes: metadata.yaml and the last file of the bag differ",
        "parameters: metadata.yaml and the last file of the bag differ",
    ]


def test_a_node_that_told_nothing_is_named(tmp_path, encoder_topic, samples):
    writer = BagWriter(tmp_path / "silent")
    writer.write(samples(writer.add_topic(encoder_topic), range(10)))
    writer.add_metadata("parameters", {"/manus": NO_ANSWER})
    writer.close()
    assert verify(tmp_path / "silent").problems == [
        "parameters: /manus: it did not tell its parameters"
    ]
