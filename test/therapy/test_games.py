# SPDX-License-Identifier: Apache-2.0
"""Games as choices: their files, the session that a choice becomes, and what is kept of it."""

from __future__ import annotations

import csv
import io
import math
import shutil
from contextlib import closing
from pathlib import Path

import pytest
import yaml
from simulated_patient import HEALTHY, Simulation
from small_bag import MARCH, small_bag

from screw_module_ros.settings import SettingError
from screw_module_ros.therapy.export import Mask, csv_text, tables
from screw_module_ros.therapy.line import NO_SLOT
from screw_module_ros.therapy.progress import progress_of
from screw_module_ros.therapy.protocol_file import (
    AssistanceLimits,
    allowed_protocol,
    load_protocol,
    parse_protocol,
    protocol_text,
    protocols_for_screens,
)
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.recorded import Act, read_sessions
from screw_module_ros.therapy.replay import replay
from screw_module_ros.therapy.report_content import other_tests
from screw_module_ros.therapy.session import Session, State
from screw_module_ros.therapy.wishes import WishLimits

EXAMPLES = Path(__file__).parents[2] / "examples" / "games"
GAME = {"name": "mine", "title": "Mine", "page": "fruit", "levels": ["a", "b"], "minutes": 2}


def chosen(level="", minutes=0):
    limits = AssistanceLimits(), WishLimits()
    return allowed_protocol(yaml.safe_dump(GAME), "mine", *limits, "left", level, minutes)


@pytest.mark.parametrize(("wrong", "told"), [
    ({"levels": []}, "levels: at least one is wanted, each with a name of its own"),
    ({"levels": ["a", "a"]}, "levels: at least one is wanted, each with a name of its own"),
    ({"levels": ["a", ""]}, "levels: at least one is wanted, each with a name of its own"),
    ({"page": "tetris"}, "page = 'tetris': fruit, a file beside this one like balloon.html"),
    ({"page": "../up.html"}, "page = '../up.html': fruit, a file beside"),
    ({"page": "https://a.b;script-src/x"}, "page = 'https://a.b;script-src/x': fruit, a file"),
    ({"picture": "/etc/passwd"}, "picture = '/etc/passwd': a file beside it like"),
    ({"minutes": 0}, "minutes = 0 min: below the smallest allowed, 1 min"),
    ({"minutes": 61}, "minutes = 61 min: above the largest allowed, 60 min"),
    ({"space": "air"}, "space = 'air': one of 'plane', 'vertical', 'space' is wanted"),
    ({"speed": 1}, "speed is unknown"),
])  # fmt: skip
def test_a_flaw_of_a_game_is_one_sentence_with_its_key(wrong, told):
    with pytest.raises(SettingError) as error:
        parse_protocol(yaml.safe_dump(GAME | wrong), "mine.yaml")
    assert str(error.value).startswith(f"protocol mine.yaml: {told}")


def test_a_choice_is_a_session_of_minutes_and_what_is_recorded_of_it_is_read_again():
    protocol, text = chosen("b", 3)
    (block,) = protocol.blocks
    assert (protocol.name, block.kind, block.title, block.circuits) == ("mine", "game", "b", 3)
    assert parse_protocol(text, "of a bag") == protocol
    usual, _ = chosen()
    assert (usual.blocks[0].title, usual.blocks[0].circuits) == ("a", 2)
    with pytest.raises(SettingError, match="level = 'c': one of a, b is wanted"):
        chosen("c")


def played(protocol, told=()):
    """Play all minutes; told: what the game tells, by the number of the sample."""
    session = Session(protocol)
    simulation, samples, wishes = Simulation(session, HEALTHY, 1), [], set()
    while session.state == State.RUNNING:
        simulation.step()
        simulation.step()
        samples.append(simulation.sample())
        session.take(samples[-1])
        wishes.add(session.wish._replace(hold=None, start_ns=None))
        for score in [score for count, score in told if count == len(samples)]:
            session.score(score)
    return session, samples, wishes


def test_a_game_has_no_walls_and_its_last_score_of_a_minute_counts():
    told = [(1, 0.9), (100, 0.25), (150, 1.5), (151, -0.1), (152, math.nan)]
    session, samples, wishes = played(chosen("a", 2)[0], told)
    assert wishes == {NO_SLOT}
    first, second = session.results
    assert first["score"] == 0.25 and math.isnan(second["score"])
    for row in (first, second):
        assert row["ended_ns"] - row["started_ns"] == pytest.approx(60e9, abs=1e7)
        assert math.isnan(row["pm2a"]) and math.isnan(row["sparc"])
    assert session.state == State.FINISHED and not session.plays
    begins = [Act(samples[0].sequence - 1, State.RUNNING, "")]
    assert replay(session.protocol, samples, begins, session.results).problems == []


def test_a_game_pulls_in_its_minutes_alone():
    session = Session(chosen()[0])
    assert session.plays
    session.pause("the therapist paused it")
    assert not session.plays
    session.score(0.5)
    assert math.isnan(session.trial.score)
    assert not Session(load_protocol("evaluation")).plays


def test_games_of_ones_own_are_offered_and_one_without_its_page_is_told(tmp_path):
    games = tmp_path / "games"
    shutil.copytree(EXAMPLES, games)
    (games / "lost.yaml").write_text(yaml.safe_dump(GAME | {"page": "lost.html"}))
    told = []
    offered = {each["name"]: each for each in protocols_for_screens(tmp_path, told.append)}
    assert told == ["game games/lost.yaml: lost.html is not beside it"]
    butterfly = offered["games/butterfly.yaml"]
    assert butterfly["levels"] == ("slow", "quick") and butterfly["trials"] == 3
    assert (butterfly["page"], butterfly["origin"]) == ("butterfly.html", "")
    assert offered["fruit"]["page"] == "fruit" and "levels" not in offered["lift"]
    elsewhere = GAME | {"page": "https://games.example:444/a?b"}
    (games / "elsewhere.yaml").write_text(yaml.safe_dump(elsewhere))
    found = {each["name"]: each for each in protocols_for_screens(tmp_path)}
    assert found["games/elsewhere.yaml"]["origin"] == "https://games.example:444"


def test_level_time_and_score_are_in_index_table_report_and_progress(tmp_path):
    _, text = chosen("b", 3)
    minute = {"kind": "game", "duration": 55.0, "mean_speed": 0.1, "reached": False}
    small_bag(tmp_path, begin_s=MARCH, reaches=[{}] * 7)
    minutes = [{**minute, "score": score} for score in (0.25, 0.5, math.nan)]
    bag = small_bag(tmp_path, begin_s=MARCH + 600, reaches=minutes, definition=text)
    with closing(Record(tmp_path)) as record:
        record.update()
        first, second = record.sessions("P-7K3QX")
        assert (second["protocol"], second["level"], first["level"]) == ("mine", "b", "")
        assert second["minutes"] == pytest.approx(3 / 60)
        found = tables(record, "P-7K3QX", Mask("P-7K3QX"), csv_text)
        rows = list(csv.DictReader(io.StringIO(found["trials.csv"])))
        assert [row["score"] for row in rows] == [""] * 7 + ["0.25", "0.5", ""]
        _, row = csv.DictReader(io.StringIO(found["sessions.csv"]))
        assert (row["level"], float(row["minutes"])) == ("b", pytest.approx(3 / 60))
        lines = {line.label: line for line in progress_of(record, "P-7K3QX").lines}
        assert lines["dose [min]"].points[1].text == "0 min, 3 min of play, score 38 %, 16.5 m"
        assert lines["duration [s]"].points[0].text != "–", "a game hides no figure of reaches"
    (session,) = read_sessions(bag)
    assert other_tests(session) == [("b", "score", 37.5), ("b", "mean_speed", 100.0)]


def test_the_text_of_a_shipped_game_is_found_by_its_name():
    assert parse_protocol(protocol_text("fruit"), "fruit").name == "fruit"
