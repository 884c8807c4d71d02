# SPDX-License-Identifier: Apache-2.0
"""`session verify` counts again and reports complete, or the gaps."""

import pytest

from screw_module_ros.recording.bag import Bag, Message, Topic
from screw_module_ros.recording.counts import Counts, Gap
from screw_module_ros.recording.recorder import NO_ANSWER
from screw_module_ros.recording.verify import verify
from screw_module_ros.session_command import main

START = 1_700_000_000_000_000_000
MS = 1_000_000


@pytest.fixture
def gappy(tmp_path, encoder_topic, samples):
    """A bag with 3 samples missing after the 100th and 1 after the 200th."""
    writer = Bag(tmp_path / "gappy")
    channel = writer.add_topic(encoder_topic)
    writer.write(samples(channel, [*range(100), *range(103, 200), *range(201, 300)]))
    writer.note("audit", {"/screw/encoder": Counts(dropped=2).as_text()})
    writer.close()
    return tmp_path / "gappy"


def test_complete_bag(bag, capsys):
    report = verify(bag)
    assert report.complete
    assert report.topics == {"/screw/encoder": Counts(messages=5000, stride=1)}
    assert main(["verify", str(bag)]) == 0
    out = capsys.readouterr().out
    assert out.endswith("\ncomplete; 1 topics: 1 counted by ticks and message numbers\n")
    assert "NOTE" not in out


def test_gaps_are_counted_and_placed(gappy, capsys):
    report = verify(gappy)
    counts = report.topics["/screw/encoder"]
    assert (counts.gaps, counts.lost, counts.dropped) == (2, 4, 2)
    assert report.gaps["/screw/encoder"] == [Gap(START + 99 * MS, 3), Gap(START + 199 * MS, 1)]
    (problem,) = report.problems
    assert problem == "/screw/encoder: of 296 messages 4 lost in 2 gaps, 2 not written"
    assert report.losses == [problem]
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
    (problem,) = verify(bag).problems
    assert problem == "metadata.yaml lists bag_0.mcap, but there are mine_0.mcap"


def test_a_bag_that_is_being_recorded_is_not_called_damaged_alone(tmp_path, encoder_topic, samples):
    writer = Bag(tmp_path / "live")
    writer.write(samples(writer.add_topic(encoder_topic), range(10)))
    writer.flush()
    report = verify(tmp_path / "live")
    assert report.topics["/screw/encoder"].messages == 10
    assert report.problems[-1].startswith("the recording goes on or was not closed (state: unfin")
    writer.close()
    assert verify(tmp_path / "live").complete


def test_torn_file(bag):
    with (bag / "bag_0.mcap").open("r+b") as file:
        file.truncate(40_000)
    problems = verify(bag).problems
    assert "bag_0.mcap has no whole index: cut off or damaged; run: session recover" in problems
    assert any(": cut off or damaged from byte " in problem for problem in problems)
    assert "bag_0.mcap was altered or damaged: its SHA-256 differs" in problems


@pytest.mark.parametrize("place", [1, 30])
def test_a_damaged_beginning_is_named_beside_the_hash(bag, place):
    """Readers refuse such a file, also one of an older version, which has no hash."""
    data = bytearray((bag / "bag_0.mcap").read_bytes())
    data[place] = 0xFF
    (bag / "bag_0.mcap").write_bytes(data)
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


def test_recover_command(bag, capsys):
    with (bag / "bag_0.mcap").open("r+b") as file:
        file.truncate(40_000)
    before = (bag / "bag_0.mcap").read_bytes()
    assert main(["recover", str(bag)]) == 0
    assert "bag_recovered: " in capsys.readouterr().out
    assert (bag / "bag_0.mcap").read_bytes() == before
    assert main(["info", f"{bag}_recovered"]) == 0
    capsys.readouterr()
    assert main(["recover", str(bag)]) == 1
    assert "never overwritten" in capsys.readouterr().err


def test_a_thinned_topic_is_not_counted_by_the_ticks_of_the_full_one(
    tmp_path, encoder_topic, samples
):
    """With another `exclude` of the recorder they are in the bag: four fifths seemed lost."""
    writer = Bag(tmp_path / "thinned")
    name = "/screw/encoder/decimated"
    channel = writer.add_topic(encoder_topic._replace(name=name))
    writer.write(samples(channel, range(0, 500, 5)))
    writer.close()
    assert verify(tmp_path / "thinned").problems == []


def test_a_session_that_heard_nothing_for_a_while_has_told_all_its_states(
    tmp_path, codec, definitions
):
    """Its `sequence` is that of the newest sample of the hand: it seemed to have lost messages."""
    kind = "screw_module_msgs/msg/TherapyState"
    writer = Bag(tmp_path / "told")
    channel = writer.add_topic(Topic("/therapy/state", kind, definitions.find(kind)))
    heard = [*range(0, 1000, 50), *[950] * 20, *range(2000, 3000, 50)]
    writer.write(
        Message(channel, START + n * MS, START, n + 1, codec.encode(kind, {"sequence": number}))
        for n, number in enumerate(heard)
    )
    writer.close()
    report = verify(tmp_path / "told")
    assert report.problems == []
    assert report.verdict.endswith("1 topics: 1 counted by message numbers")


def test_what_was_noted_is_kept_and_an_altered_file_is_found(bag):
    assert verify(bag).notes["configuration"] == {"sim.yaml": "sha256:0"}
    path = bag / "bag_0.mcap"
    path.write_bytes(path.read_bytes().replace(b"sha256:0", b"sha256:1"))
    report = verify(bag)
    assert report.notes["configuration"] == {"sim.yaml": "sha256:1"}
    assert report.problems == ["bag_0.mcap was altered or damaged: its SHA-256 differs"]


# What the data alone do not tell: topics that are silent, halved, or cannot be counted.

OWN = "screw_module_msgs/msg/"
ENCODER, PLANE = OWN + "EncoderSample", OWN + "PlanarState"
RATES = {
    "/encoder": '{"rate": 1000.0}',
    "/manus": '{"rate": 500.0, "state_every": 4}',
}


@pytest.fixture
def write(tmp_path, codec, definitions):
    """Return a maker of bags: topics as (name, type, ticks of its messages, period [ms])."""

    def make(*topics, parameters=RATES, numbered=True, **notes):
        writer = Bag(tmp_path / "made")
        for name, kind, ticks, period in topics:
            topic = Topic(name, kind, definitions.find(kind), codec.hash(kind))
            channel = writer.add_topic(topic)
            for number, tick in enumerate(ticks, 1):
                values = {}
                if kind in (ENCODER, PLANE):
                    values = {"sequence": tick, "monotonic_ns": round(tick * period * MS)}
                data = codec.encode(kind, values)
                log_time = START + round(tick * period * MS)
                writer.write(
                    [Message(channel, log_time, log_time, number if numbered else 0, data)]
                )
            if notes.get("several") == name:
                writer.note("audit", {name: Counts(missed=-1).as_text()})
        writer.note("parameters", parameters)
        if "refused" in notes:
            writer.note("not recorded", notes["refused"])
        writer.close()
        return tmp_path / "made"

    return make


def encoder(ticks, period=1.0):
    return ("/screw/encoder", ENCODER, ticks, period)


def plane(ticks, period=2.0):
    return ("/manus/state", PLANE, ticks, period)


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


def test_a_node_that_told_nothing_is_named(write):
    bag = write(encoder(range(10)), plane([0, 4]), parameters={**RATES, "/manus": NO_ANSWER})
    assert verify(bag).problems == ["/manus: the node did not report its parameters"]


def test_nodes_in_a_namespace_are_found(write):
    parameters = {f"/left{name}": text for name, text in RATES.items()}
    bag = write(encoder(range(10)), plane(range(0, 3000, 8)), parameters=parameters)
    assert "374 lost" in verify(bag).problems[0]


def test_a_jump_of_the_sequence_is_no_clean_bill(write):
    bag = write(encoder([0, 1, 200_000, 200_001], period=1e-4), plane([0, 4]))
    assert verify(bag).problems == [
        "/screw/encoder: its sequence jumped 1 times, too far to count losses"
    ]


def test_a_topic_that_begins_late_or_ends_early_is_named(write):
    report = verify(write(encoder(range(4000)), plane(range(600, 1000, 4))))
    assert report.problems == [
        "/manus/state: begins 1.2 s after the recording and ends 2.0 s before it"
    ]


def test_a_silent_topic_is_named(write, capsys):
    state = ("/screw/amplifier_state", OWN + "AmplifierState", [], 1.0)
    bag = write(encoder([]), plane([0, 4]), state)
    report = verify(bag)
    assert report.problems == ["/screw/encoder: subscribed to, but no message arrived"]
    assert report.remarks == ["no message at all: /screw/amplifier_state, /screw/encoder"]
    assert main(["verify", str(bag)]) == 1
    assert "2 without a message" in capsys.readouterr().out


def test_a_silent_topic_that_need_not_speak_is_no_problem(write):
    state = ("/screw/amplifier_state", OWN + "AmplifierState", [], 1.0)
    report = verify(write(encoder(range(10)), plane([0, 4]), state))
    assert report.complete
    assert report.remarks == ["no message at all: /screw/amplifier_state"]


def test_a_topic_that_is_not_there_at_all_is_named(write):
    report = verify(write(plane([0, 4])))
    assert report.problems == [f"/encoder was there, but no topic of type {ENCODER} is in the bag"]


def test_a_topic_the_recorder_refused_is_a_problem(write):
    refused = {"/odd": "its type odd_msgs/msg/Odd is not installed here"}
    report = verify(write(encoder(range(10)), plane([0, 4]), refused=refused))
    assert report.problems == [f"/odd: requested but not recorded: {refused['/odd']}"]


def test_topics_that_cannot_be_counted_are_named(write, capsys):
    state = ("/diagnostics", OWN + "AmplifierState", [1, 2, 3], 1.0)
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
