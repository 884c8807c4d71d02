# SPDX-License-Identifier: Apache-2.0
"""`session verify` counts anew and says complete, or what is missing and where."""

import pytest

from screw_module_ros.recording import BagWriter, Counts
from screw_module_ros.recording.cli import main
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
