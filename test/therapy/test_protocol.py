# SPDX-License-Identifier: Apache-2.0
"""Protocols: those of the package hold what is published; a wrong file is refused by its key."""

from __future__ import annotations

import copy
import json
import math

import pytest
import yaml

from screw_module_ros.resources import resource_path
from screw_module_ros.settings import SettingError, read
from screw_module_ros.therapy.protocol import HOLD, Protocol, Rest, plan, points, ways
from screw_module_ros.therapy.protocol_file import (
    GAMES,
    SHIPPED,
    expected,
    load_protocol,
    parse_protocol,
    protocol_text,
    protocols_for_screens,
)


def content(name="clock_adaptive"):
    return copy.deepcopy(yaml.safe_load(resource_path(f"params/therapy/{name}.yaml").read_text()))


@pytest.mark.parametrize(
    ("name", "trials"),
    [
        ("clock_adaptive", 1024), ("evaluation", 137), ("elevator", 688), ("reach_3d", 304),
        ("lift", 63),
    ],
)
def test_protocols_of_the_package(name, trials):
    protocol = load_protocol(name)
    assert name in SHIPPED and protocol.name == name
    plans = list(plan(protocol))
    assert [p.number for p in plans] == list(range(1, trials + 1))


def test_the_clock_session_is_the_published_one():
    protocol = load_protocol("clock_adaptive")
    assisted = [b.circuits * len(ways(protocol, b)) for b in protocol.blocks if b.assisted]
    other = [b.circuits * len(ways(protocol, b)) for b in protocol.blocks if not b.assisted]
    assert (assisted, other) == ([320] * 3, [16] * 4)
    targets = points(protocol, protocol.blocks[0])
    assert targets[0] == pytest.approx((0.0, 0.14, 0.18)), "the far one first"
    assert targets[2] == pytest.approx((0.14, 0.0, 0.18)), "then clockwise"
    assert all(math.hypot(x, y) == pytest.approx(0.14) for x, y, _ in targets)
    out, back = ways(protocol, protocol.blocks[0])[:2]
    assert back == out[::-1]
    assert (protocol.guidance.duration, protocol.guidance.damping) == (1.4, 5.0)
    assert protocol.rules.hit_radius == 0.01
    assert protocol.rules.start_share == 0.4


def test_evaluation_counts():
    protocol = load_protocol("evaluation")
    counts = [b.circuits * len(ways(protocol, b)) for b in protocol.blocks]
    assert counts == [80, 20, 1, 16, 20]
    assert not any(block.assisted for block in protocol.blocks)
    hold = next(block for block in protocol.blocks if block.kind == HOLD)
    assert ways(protocol, hold) == [(protocol.centre, protocol.centre)]


def test_elevator_and_space_stay_in_reach():
    column = points(load_protocol("elevator"), load_protocol("elevator").blocks[1])
    assert [z for _, _, z in column] == pytest.approx([0.32, 0.04])
    space = load_protocol("reach_3d")
    heights = {round(z, 6) for _, _, z in points(space, space.blocks[0])}
    assert heights == {0.26, 0.10}


def change(values, path, value):
    *keys, last = path
    for key in keys:
        values = values[key]
    if value is None:
        del values[last]
    else:
        values[last] = value


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("guidance", "duration"), None, "guidance.duration is missing"),
        (("guidance", "duration"), 0.0, "guidance.duration = 0.0 s: below"),
        (("guidance", "duration"), "quick", "guidance.duration = 'quick': a finite number"),
        (("guidance", "duration"), True, "guidance.duration = True: a finite number"),
        (("guidance", "duration"), math.nan, "guidance.duration = nan: a finite"),
        (("guidance", "durations"), 1.0, "guidance.durations is unknown"),
        (("guidance", "end_half_width"), 0.05, "end_half_width"),
        (("space",), "sideways", "space = 'sideways'"),
        (("centre",), [0.0, 0.0], "centre = [0.0, 0.0]: a list of 3"),
        (("centre",), [0.1, 0.0, 0.18], "outside what the robot reaches"),
        (("centre",), [0.0, 0.0, 0.4], "outside what the robot reaches"),
        (("blocks",), [], "blocks: at least one is wanted"),
        (("blocks", 0, "targets", "layout"), "spiral", "blocks[0].targets.layout = 'spiral'"),
        (("blocks", 0, "circuits"), 1.5, "blocks[0].circuits = 1.5: int"),
        (("adaptation", "longest"), 1.0, "outside what adaptation allows"),
        (("adaptation", "softest"), 300.0, "softest = 300 must be less"),
    ],
)
def test_a_wrong_file_is_refused_by_its_key(path, value, words):
    values = content()
    change(values, path, value)
    with pytest.raises(ValueError) as caught:
        read(Protocol, values)
    assert words in str(caught.value)


def test_a_trial_that_takes_time_needs_some():
    values = content("evaluation")
    change(values, ("blocks", 1, "duration"), None)
    with pytest.raises(ValueError, match="needs some time"):
        read(Protocol, values)


def test_files(tmp_path):
    with pytest.raises(SettingError, match="no protocol 'nothing'"):
        load_protocol("nothing")
    broken = tmp_path / "broken.yaml"
    broken.write_text("a: [")
    with pytest.raises(SettingError, match="broken.yaml: it is no YAML"):
        load_protocol(broken)
    broken.write_text("- 1")
    with pytest.raises(SettingError, match="a mapping"):
        load_protocol(broken)
    own = tmp_path / "own.yaml"
    own.write_text(yaml.safe_dump(content("elevator")))
    assert load_protocol(own) == load_protocol("elevator")


def test_circuits_that_repeat_themselves_may_be_written_once():
    """A file may have aliases for parts that are the same."""
    text = yaml.safe_dump(content("evaluation"))
    block = content("evaluation")["blocks"][0]
    repeated = content("evaluation")
    repeated["blocks"] += [block, block]
    aliased = yaml.safe_dump(repeated)
    assert "*id001" in aliased and "*id001" not in text
    blocks = parse_protocol(aliased, "own").blocks
    assert blocks[-1] == blocks[-2] == parse_protocol(text, "own").blocks[0]


@pytest.mark.parametrize("kind", ["reach", "circle", "resisted", "strength"])
@pytest.mark.parametrize(
    ("space", "targets"),
    [
        ("plane", {"layout": "centre"}),
        ("plane", {"layout": "column", "distance": 0.1}),
        ("vertical", {"layout": "clock"}),
        ("space", {"layout": "clock", "count": 2, "distance": 0.01}),
    ],
)
def test_a_trial_without_a_way_on_its_axes_is_refused(kind, space, targets):
    wrong = content()
    wrong["space"] = space
    wrong["blocks"] = [{
        "kind": kind, "title": "Nowhere", "assisted": False, "circuits": 1, "targets": targets,
        "duration": 1.0,
    }]  # fmt: skip
    with pytest.raises(SettingError, match="'Nowhere': a .* needs a way"):
        parse_protocol(yaml.safe_dump(wrong), "own")


@pytest.mark.parametrize(("block", "kind"), [(1, "circle"), (2, "hold"), (4, "strength")])
def test_only_a_reach_is_assisted(block, kind):
    """A circle was pushed to its begin, and holding changed the assistance of the reaches."""
    wrong = content("evaluation")
    change(wrong, ("blocks", block, "assisted"), True)
    with pytest.raises(SettingError, match=f"assisted: only a reach is, a {kind} is not"):
        parse_protocol(yaml.safe_dump(wrong), "own")


def test_a_hand_may_be_held_where_it_is():
    own = content()
    own["blocks"] = [{
        "kind": "hold", "title": "Hold", "assisted": False, "circuits": 1, "duration": 1.0,
        "targets": {"layout": "centre"},
    }]  # fmt: skip
    assert parse_protocol(yaml.safe_dump(own), "own").blocks[0].kind == HOLD


def test_the_package_protocols_are_offered_with_their_targets():
    offered = {each["name"]: each for each in protocols_for_screens()}
    assert list(offered) == [*SHIPPED, *GAMES]
    assert offered["clock_adaptive"]["trials"] == 1024
    assert len(offered["clock_adaptive"]["targets"]) == 8
    assert offered["elevator"]["targets"] == [
        pytest.approx((0.0, 0.0, 0.04)), pytest.approx((0.0, 0.0, 0.32))
    ]  # fmt: skip
    evaluation = offered["evaluation"]
    assert max(map(len, evaluation["blocks"].values())) < len(evaluation["targets"])
    together = {point for points in evaluation["blocks"].values() for point in points}
    assert sorted(together) == evaluation["targets"]
    json.dumps(offered, allow_nan=False)


def test_protocols_of_ones_own_are_offered_and_bad_ones_told(tmp_path):
    mine = protocol_text("elevator").replace("name: elevator", "name: mine")
    (tmp_path / "mine.yaml").write_text(mine)
    (tmp_path / "bad.yaml").write_text("dance: true")
    told = []
    names = [each["name"] for each in protocols_for_screens(tmp_path, told.append)]
    assert names == [*SHIPPED, *GAMES, "mine.yaml"]
    assert len(told) == 1 and "bad.yaml" in told[0]
    assert len(protocols_for_screens(tmp_path / "nowhere")) == len(names) - 1


def test_about_how_long_a_session_takes_is_told():
    clock = load_protocol("clock_adaptive")
    block = clock.blocks[0]._replace(circuits=2, rest=Rest(10, 60.0))  # 32 reaches
    rules = clock.rules._replace(hold=0.3, settle_time=0.3)
    short = clock._replace(blocks=(block,), rules=rules)
    assert expected(short) == pytest.approx(32 * (1.4 + 0.6) + 3 * 60.0)
    held = block._replace(kind="hold", duration=5.0, rest=Rest(32, 60.0))
    assert expected(short._replace(blocks=(held,))) == pytest.approx(16 * 5.6)
    assert next(each for each in protocols_for_screens() if each["name"] == "lift")["minutes"] > 3


def test_a_copy_that_kept_its_name_is_told_and_not_offered(tmp_path):
    """The patient's screen showed another protocol's picture: that of the first with the name."""
    copy = protocol_text("elevator").replace("name: elevator", "name: clock_adaptive")
    (tmp_path / "mine.yaml").write_text(copy)
    told = []
    assert len(protocols_for_screens(tmp_path, told.append)) == len(SHIPPED) + len(GAMES)
    (sentence,) = told
    assert "mine.yaml" in sentence and "'clock_adaptive'" in sentence
