# SPDX-License-Identifier: Apache-2.0
"""Every layout of MCAP and every way in which a bag may lie, over every command of `session`."""

from __future__ import annotations

import csv
import stat
from pathlib import Path

import pytest
from bag_counts import ticks
from mcap_features import FEATURES, PLACES, SHORT

from screw_module_ros.recording.verify import verify
from screw_module_ros.session_command import main

pytestmark = pytest.mark.long

SESSION = next((Path(__file__).parents[1] / "data" / "bags").glob("P-7K3QX_*"))
SOURCE = SESSION / f"{SESSION.name}_0.mcap"
MESSAGES = sum(count.messages for count in verify(SESSION).topics.values())
LAYOUTS = pytest.mark.parametrize("feature", FEATURES)
LYING = pytest.mark.parametrize("place", PLACES)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The trials of the session, exported from the bag as it was recorded."""
    return exported(SESSION, tmp_path_factory.mktemp("whole"))


@pytest.fixture
def bag(tmp_path):
    """Return a maker of the session's bag, as another recorder may have written it."""

    def make(feature="zstd", place="a bag") -> Path:
        FEATURES[feature](SOURCE, tmp_path / "written")
        return PLACES[place](tmp_path, tmp_path / "written")

    return make


def exported(bag: Path, out: Path) -> list[dict[str, str]]:
    assert main(["export", "--out", str(out), str(bag)]) == 0
    with (out / "P-7K3QX" / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    # The name of its folder alone dates a simulated session of an older version.
    return [{name: value for name, value in row.items() if name != "started"} for row in rows]


def judged(bag: Path, out: Path, whole: list[dict[str, str]], capsys, short: bool = False) -> None:
    """Check what every command says of a bag."""
    report = verify(bag)
    assert sum(count.messages for count in report.topics.values()) == MESSAGES
    assert main(["info", str(bag)]) == 0
    hands = report.topics["/endpoint_state"].messages
    assert ["/endpoint_state", str(hands)] in [
        line.split()[:2] for line in capsys.readouterr().out.splitlines()
    ]
    code = main(["recover", "--out", str(out / "copies"), str(bag)])
    said = capsys.readouterr().out
    assert (code, f": {MESSAGES} messages\n" in said) == (int(short), True)
    (copy,) = (out / "copies").iterdir()
    assert sum(count.messages for count in verify(copy).topics.values()) == MESSAGES
    for each in (bag, copy):
        assert main(["replay", str(each)]) == 0
        assert "bit for bit" in capsys.readouterr().out
        assert exported(each, out / each.name) == whole


@LAYOUTS
def test_every_layout_of_mcap_is_read_by_every_command(feature, bag, tmp_path, whole, capsys):
    made = bag(feature)
    judged(made, tmp_path / "out", whole, capsys, feature in SHORT)
    assert main(["verify", str(made)]) == (1 if feature.startswith("states") else 0)
    said = capsys.readouterr().out
    assert (" and holds " in said) == feature.startswith("states")


@LYING
def test_every_way_in_which_a_bag_may_lie_is_found_by_every_command(
    place, bag, tmp_path, whole, capsys
):
    made = bag(place=place)
    judged(made, tmp_path / "out", whole, capsys)
    assert main(["verify", str(made)]) == 0
    assert "complete; " in capsys.readouterr().out


def test_statistics_that_disagree_are_told_beside_the_export(bag, tmp_path, capsys):
    assert main(["export", "--out", str(tmp_path / "out"), str(bag("states too many"))]) == 0
    assert f"states {MESSAGES + 7} messages and holds {MESSAGES}" in capsys.readouterr().err


def test_a_bag_of_another_format_and_two_recordings_in_a_folder_are_sentences(
    bag, tmp_path, capsys
):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "old_0.db3").write_bytes(b"SQLite format 3\0")
    two = bag(place="no metadata.yaml, no number")
    (two / "other.mcap").write_bytes((two / "NAME.mcap").read_bytes())
    for command in ("verify", "info", "recover", "replay"):
        assert main([command, str(tmp_path / "old")]) == 1
        assert "convert it first (ros2 bag convert" in capsys.readouterr().err
        assert main([command, str(two)]) == 1
        assert "2 recordings (NAME.mcap, other.mcap): name one" in capsys.readouterr().err
        assert main([command, str(two / "other.mcap")]) == 0
        capsys.readouterr()


def test_a_compressed_file_that_was_cut_off_is_recovered_as_far_as_it_goes(bag, tmp_path, capsys):
    made = bag(place="a bare compressed file")
    content = made.read_bytes()
    made.write_bytes(content[: len(content) // 2])
    assert main(["verify", str(made)]) == 1
    assert "its compression is cut off" in capsys.readouterr().out
    main(["recover", str(made)])
    assert "session_recovered: " in capsys.readouterr().out
    copied = sum(c.messages for c in verify(tmp_path / "session_recovered").topics.values())
    assert 0 < copied < MESSAGES


def test_a_bag_in_an_archive_that_cannot_be_written_is_recovered_elsewhere(
    bag, tmp_path, capsys, monkeypatch
):
    made = bag(place="a bag")
    before = {path.name: path.read_bytes() for path in made.iterdir()}
    assert main(["recover", str(made), "--out", str(tmp_path / "new" / "place")]) == 0
    copy = tmp_path / "new" / "place" / "session_recovered"
    assert str(copy) in capsys.readouterr().out
    assert stat.S_IMODE(copy.stat().st_mode) == 0o700
    assert {path.name: path.read_bytes() for path in made.iterdir()} == before
    assert not made.with_name("session_recovered").exists()
    assert main(["recover", str(made), "--out", str(tmp_path / "new" / "place")]) == 1
    assert "never overwritten" in capsys.readouterr().err


def test_a_copy_of_what_is_outside_of_chunks_has_each_message(bag, tmp_path):
    """It was empty, with exit code 0."""
    made = bag("not chunked")
    assert main(["recover", str(made)]) == 0
    assert ticks(made.with_name("session_recovered"))
