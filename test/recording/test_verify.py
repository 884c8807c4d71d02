# SPDX-License-Identifier: Apache-2.0
"""`session verify` counts again and reports complete, or the gaps."""

import os

import pytest
from bag_counts import MS, START

from screw_module_ros.recording.bag import Bag, Message
from screw_module_ros.recording.counts import Counts, Gap
from screw_module_ros.recording.recorder import NO_ANSWER
from screw_module_ros.recording.verify import verify
from screw_module_ros.session_command import main


def test_complete_bag(bag, capsys):
    report = verify(bag)
    assert report.complete
    assert report.topics == {"/screw/encoder": Counts(messages=5000, stride=1)}
    assert main(["verify", str(bag)]) == 0
    out = capsys.readouterr().out
    assert out.endswith("\ncomplete; 1 topics: 1 counted by ticks and message numbers\n")
    assert "NOTE" not in out


def test_gaps_are_counted_and_placed(record, capsys):
    """3 samples are missing after the 100th and 1 after the 200th."""
    gappy = record(
        [*range(100), *range(103, 200), *range(201, 300)],
        notes={"audit": {"/screw/encoder": Counts(dropped=2).as_text()}},
    )
    report = verify(gappy)
    counts = report.topics["/screw/encoder"]
    assert (counts.gaps, counts.lost, counts.dropped) == (2, 4, 2)
    assert report.gaps["/screw/encoder"] == [Gap(START + 99 * MS, 3), Gap(START + 199 * MS, 1)]
    sentence = "/screw/encoder: of 296 messages 4 lost in 2 gaps, 2 not written"
    assert report.problems == report.losses == [sentence]
    assert main(["verify", str(gappy)]) == 1
    out = capsys.readouterr().out
    assert f"3 missing after {START + 99 * MS} ns" in out
    assert "\nNOT complete; 1 topics: 1 counted by ticks" in out


def test_what_another_system_adds_to_a_copy_is_no_file_of_the_bag(bag):
    """A stick that was in a Mac has a hidden companion of each file."""
    (bag / "._bag_0.mcap").write_bytes(b"\x00\x05\x16\x07" + bytes(4092))
    assert verify(bag).complete


def test_counts_that_differ_from_the_metadata_file(bag):
    path = bag / "metadata.yaml"
    path.write_text(path.read_text().replace("message_count: 5000", "message_count: 5001"))
    assert "metadata.yaml states 5001 messages, the files contain 5000" in verify(bag).problems[0]


def test_a_renamed_file_is_found(bag):
    """The bag was called complete, though no reader could open it."""
    (bag / "bag_0.mcap").rename(bag / "mine_0.mcap")
    assert verify(bag).problems == ["metadata.yaml lists bag_0.mcap, but there are mine_0.mcap"]


def test_a_bag_that_is_being_recorded_is_not_called_damaged_alone(tmp_path, encoder_topic, samples):
    writer = Bag(tmp_path / "live")
    writer.write(samples(writer.add_topic(encoder_topic), range(10)))
    writer.flush()
    report = verify(tmp_path / "live")
    assert report.topics["/screw/encoder"].messages == 10
    assert report.problems[-1].startswith("the recording goes on or was not closed (state: unfin")
    writer.close()
    assert verify(tmp_path / "live").complete


@pytest.fixture
def torn(bag):
    os.truncate(bag / "bag_0.mcap", 40_000)
    return bag


def test_torn_file(torn):
    problems = verify(torn).problems
    assert "bag_0.mcap has no whole index: cut off or damaged; run: session recover" in problems
    assert any(": cut off or damaged from byte " in problem for problem in problems)
    assert "bag_0.mcap was altered or damaged: its SHA-256 differs" in problems


@pytest.mark.parametrize("place", [1, 30])
def test_a_damaged_beginning_is_named_beside_the_hash(bag, place):
    """Readers refuse such a file, also one of an older version, which has no hash."""
    data = (bag / "bag_0.mcap").read_bytes()
    (bag / "bag_0.mcap").write_bytes(data[:place] + b"\xff" + data[place + 1 :])
    report = verify(bag)
    assert report.topics["/screw/encoder"].messages == 5000
    assert len(report.problems) == 2


@pytest.mark.parametrize("content", ["", "[", "3", "rosbag2_bagfile_information: 3"])
def test_a_metadata_file_of_another_content_is_a_sentence(bag, content, capsys):
    (bag / "metadata.yaml").write_text(content)
    assert main(["verify", str(bag)]) == 1
    assert "NOT complete" in capsys.readouterr().out
    assert "metadata.yaml cannot be read" in verify(bag).problems[0] or content != "["


def test_info_shows_what_was_noted(bag, capsys):
    assert main(["info", str(bag)]) == 0
    assert "sim.yaml: sha256:0" in capsys.readouterr().out


def test_recover_command(torn, capsys):
    before = (torn / "bag_0.mcap").read_bytes()
    assert main(["recover", str(torn)]) == 1, "metadata.yaml states more messages"
    out = capsys.readouterr().out
    assert "bag_recovered: " in out and "PROBLEM the bag states 5000 messages, the copy has" in out
    assert (torn / "bag_0.mcap").read_bytes() == before
    assert main(["info", f"{torn}_recovered"]) == 0
    assert main(["recover", str(torn)]) == 1
    assert "never overwritten" in capsys.readouterr().err


def test_a_thinned_topic_is_not_counted_by_the_ticks_of_the_full_one(record, encoder_topic):
    """With another `exclude` of the recorder they are in the bag: four fifths seemed lost."""
    thinned = encoder_topic._replace(name="/screw/encoder/decimated")
    assert verify(record(range(0, 500, 5), thinned)).problems == []


def test_what_was_noted_is_kept_and_an_altered_file_is_found(bag):
    assert verify(bag).notes["configuration"] == {"sim.yaml": "sha256:0"}
    path = bag / "bag_0.mcap"
    path.write_bytes(path.read_bytes().replace(b"sha256:0", b"sha256:1"))
    report = verify(bag)
    assert report.notes["configuration"] == {"sim.yaml": "sha256:1"}
    assert report.problems == ["bag_0.mcap was altered or damaged: its SHA-256 differs"]


# What the data alone do not tell: topics that are silent, halved, or cannot be counted.

OWN = "screw_module_msgs/msg/"
RATES = {
    "/encoder": '{"rate": 1000.0}',
    "/manus": '{"rate": 500.0, "state_every": 4}',
}
TICKED = ("EncoderSample", "PlanarState")


@pytest.fixture
def write(tmp_path, codec, topic):
    """Return a maker of bags: topics as (name, type, ticks of its messages, period [ms])."""

    def make(*topics, parameters=RATES, numbered=True, several="", **notes):
        writer = Bag(tmp_path / "made")
        for name, kind, ticks, period in topics:
            channel = writer.add_topic(topic(name, kind))
            for number, tick in enumerate(ticks, 1):
                since = round(tick * period * MS)
                values = {"sequence": tick, "monotonic_ns": since} if kind in TICKED else {}
                data, time = codec.encode(OWN + kind, values), START + since
                writer.write([Message(channel, time, time, number if numbered else 0, data)])
        if several:
            writer.note("audit", {several: Counts(missed=-1).as_text()})
        for title, note in ({"parameters": parameters} | notes).items():
            writer.note(title.replace("_", " "), note)
        writer.close()
        return tmp_path / "made"

    return make


def encoder(ticks, period=1.0):
    return ("/screw/encoder", "EncoderSample", ticks, period)


def plane(ticks, period=2.0):
    return ("/manus/state", "PlanarState", ticks, period)


SILENT = ("/screw/amplifier_state", "AmplifierState", [], 1.0)


def test_a_session_that_heard_nothing_for_a_while_has_told_all_its_states(
    tmp_path, codec, topic
):
    """Its `sequence` is that of the newest sample of the hand: it seemed to have lost messages."""
    writer = Bag(tmp_path / "told")
    channel = writer.add_topic(topic("/therapy/state", "TherapyState"))
    for n, heard in enumerate([*range(0, 1000, 50), *[950] * 20, *range(2000, 3000, 50)], 1):
        data = codec.encode(OWN + "TherapyState", {"sequence": heard})
        writer.write([Message(channel, START + n * MS, START, n, data)])
    writer.close()
    report = verify(tmp_path / "told")
    assert report.problems == []
    assert report.verdict.endswith("1 topics: 1 counted by message numbers")


def test_whole_bag_with_two_strides(write):
    report = verify(write(encoder(range(3000)), plane(range(0, 1500, 4))))
    assert (report.problems, report.remarks) == ([], [])
    assert [count.stride for count in report.topics.values()] == [4, 1]


def test_every_second_sample_gone_is_a_loss(write, capsys):
    bag = write(encoder(range(0, 3000, 2)), plane(range(0, 1500, 8)))
    assert verify(bag).problems == [
        "/manus/state: of 188 messages 187 lost in 187 gaps",
        "/screw/encoder: of 1500 messages 1499 lost in 1499 gaps",
    ]
    assert main(["verify", str(bag)]) == 1


@pytest.mark.parametrize("told", ["{}", "[]", "not JSON", '{"state_every": 0}'])
def test_a_stride_that_nobody_told_is_not_counted(write, told):
    parameters = {"/encoder": RATES["/encoder"], "/manus": told}
    report = verify(write(encoder(range(2000)), plane(range(0, 1000, 8)), parameters=parameters))
    assert report.complete
    assert report.verdict.endswith(
        "1 counted by ticks and message numbers, 1 counted by message numbers"
    )


PROBLEMS = {
    "a node that told nothing": (
        [encoder(range(10)), plane([0, 4])],
        {"parameters": RATES | {"/manus": NO_ANSWER}},
        "/manus: the node did not report its parameters",
    ),
    "nodes in a namespace": (
        [encoder(range(600)), plane(range(0, 300, 8))],
        {"parameters": {f"/left{name}": text for name, text in RATES.items()}},
        "/manus/state: of 38 messages 37 lost in 37 gaps",
    ),
    "a single lost sample": (
        [encoder([*range(300), *range(301, 600)]), plane(range(0, 300, 4))],
        {},
        "/screw/encoder: of 599 messages 1 lost in 1 gaps",
    ),
    "a jump of the sequence": (
        [encoder([0, 1, 200_000, 200_001], period=1e-4), plane([0, 4])],
        {},
        "/screw/encoder: its sequence jumped 1 times, too far to count losses",
    ),
    "late, and early silent": (
        [encoder(range(4000)), plane(range(600, 1000, 4))],
        {},
        "/manus/state: begins 1.2 s after the recording and ends 2.0 s before it",
    ),
    "a topic that is not there": (
        [plane([0, 4])],
        {},
        f"/encoder was there, but no topic of type {OWN}EncoderSample is in the bag",
    ),
    "a topic that the recorder refused": (
        [encoder(range(10)), plane([0, 4])],
        {"not_recorded": {"/odd": "its type is not installed here"}},
        "/odd: requested but not recorded: its type is not installed here",
    ),
}


@pytest.mark.parametrize(("topics", "notes", "problem"), PROBLEMS.values(), ids=PROBLEMS)
def test_what_is_wrong_is_named(write, topics, notes, problem):
    assert verify(write(*topics, **notes)).problems == [problem]


def test_a_silent_topic_is_named(write, capsys):
    bag = write(encoder([]), plane([0, 4]), SILENT)
    report = verify(bag)
    assert report.problems == ["/screw/encoder: subscribed to, but no message arrived"]
    assert report.remarks == ["no message at all: /screw/amplifier_state, /screw/encoder"]
    assert main(["verify", str(bag)]) == 1
    assert "2 without a message" in capsys.readouterr().out


def test_a_silent_topic_that_need_not_speak_is_no_problem(write):
    report = verify(write(encoder(range(10)), plane([0, 4]), SILENT))
    assert report.complete
    assert report.remarks == ["no message at all: /screw/amplifier_state"]


def test_topics_that_cannot_be_counted_are_named(write, capsys):
    state = ("/diagnostics", "AmplifierState", [1, 2, 3], 1.0)
    bag = write(encoder(range(10)), plane([0, 4]), state, several="/diagnostics")
    assert main(["verify", str(bag)]) == 0
    out = capsys.readouterr().out
    assert "NOTE /diagnostics: messages not received are not counted: several publishers" in out
    assert out.endswith(
        "complete; 3 topics: 2 counted by ticks and message numbers, 1 not counted\n"
    )


def test_messages_without_numbers_are_not_called_received(write, capsys):
    bag = write(encoder(range(10)), plane([0, 4]), numbered=False)
    assert main(["verify", str(bag)]) == 0
    out = capsys.readouterr().out
    assert "/screw/encoder: messages not received are not counted: they carry no number" in out
    assert out.endswith("complete; 2 topics: 2 counted by ticks\n")
    assert verify(bag).topics["/screw/encoder"].missed == -1
