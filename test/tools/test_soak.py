# SPDX-License-Identifier: Apache-2.0
"""The soak's checks: growth is found, variation is not."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from screw_module_ros.recording.counts import Counts
from screw_module_ros.recording.verify import Report
from screw_module_ros.resources import resource_path
from soak import (
    BOUNDS,
    Sample,
    content,
    draw,
    table,
    trends,
    usage,
    verdicts,
)

MINUTES = 10
SOAK = Path(__file__).parents[2] / "tools/soak.py"
LEVELS = {"memory": 80.0, "handles": 40.0, "threads": 12.0, "shared": 9.0,
          "latency p50": 550.0, "latency p99": 900.0, "waiting": 20.0}  # fmt: skip


def samples(seed=1, minutes=MINUTES, **growth):
    """Return samples each 5 s whose quantities grow by so much over the run, with noise."""
    noise = np.random.default_rng(seed)
    count = round(minutes * 12)
    made = []
    for number in range(count):
        values = {}
        for quantity, level in LEVELS.items():
            rise = growth.get(quantity.replace(" ", "_"), 0.0) * number / count
            spread = 0.0 if BOUNDS[quantity].least == 0.5 else 0.01 * level
            values["node", quantity] = round(level + rise + spread * noise.normal(), 3)
        made.append(Sample(5.0 * number, values))
    return made


def audit(**counts):
    return Report({"/screw/encoder": Counts(messages=600_000, stride=1, **counts)}, {}, [], [], {})


def missed(lines):
    return [line.text for line in lines if not line.good]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("minutes", [0.5, MINUTES, 60])
def test_what_only_breathes_is_flat(seed, minutes):
    assert missed(verdicts(trends(samples(seed, minutes)), audit(), {}, [])) == []


@pytest.mark.parametrize(
    ("quantity", "growth"),
    [("memory", 8.0), ("handles", 3.0), ("threads", 2.0), ("shared", 4.0),
     ("latency p50", 150.0), ("latency p99", 500.0), ("waiting", 5000.0)],
)  # fmt: skip
def test_what_grows_is_found_and_named(quantity, growth):
    found = trends(samples(**{quantity.replace(" ", "_"): growth}))
    (line,) = [x for x in verdicts(found, audit(), {}, []) if not x.good]
    assert line.text == f"{quantity} flat"
    assert "worst: node" in line.detail


def test_what_grows_with_each_flush_is_judged_by_the_wall_clock():
    """The recorder's index of the open file: 7 MiB in 15 min of the robot that took an hour."""
    made = samples(minutes=15, memory=7.0)
    assert missed(verdicts(trends(made), audit(), {}, [])) == ["memory flat"]
    assert missed(verdicts(trends(made, 0.25), audit(), {}, [])) == []


def test_a_single_outlier_is_no_trend():
    made = samples()
    made[-1].values["node", "memory"] = 1000.0
    assert missed(verdicts(trends(made), audit(), {}, [])) == []


def test_growth_while_warming_up_does_not_count():
    made = samples()
    for sample in made[:11]:
        sample.values["node", "memory"] -= 30.0
    assert missed(verdicts(trends(made), audit(), {}, [])) == []


def test_too_few_samples_make_no_trend():
    assert trends([]) == []
    assert trends(samples()[:4]) == []
    assert verdicts([], audit(), {}, [])[0].text == "recorder lost nothing"


@pytest.mark.parametrize(
    ("counts", "wanted"),
    [
        ({"missed": 3}, ["recorder lost nothing"]),
        ({"dropped": 1}, ["recorder lost nothing"]),
        ({"lost": 2, "gaps": 1}, ["zero lost samples"]),
        ({"missed": 3, "lost": 3, "gaps": 1}, ["recorder lost nothing"]),
        ({"missed": -1}, []),  # two publishers: unknown
    ],
)
def test_who_lost_something_is_told_apart(counts, wanted):
    assert missed(verdicts([], audit(**counts), {}, [])) == wanted


def test_stops_and_an_unsound_bag_are_told():
    lost, altered = "/screw/encoder: of 600000 messages 2 lost in 1 gaps", "bag_0.mcap was altered"
    report = audit()._replace(problems=[lost, altered], losses=[lost])
    lines = verdicts([], report, {}, ["after 3 s: amplifier took the torque off"])
    assert missed(lines) == ["bag sound", "torque stayed on"]
    assert altered in [line.detail for line in lines]


def test_output(tmp_path):
    made = samples(minutes=1)
    made[3].values["node", "latency p50"] = math.nan
    found = trends(made)
    lines = verdicts(found, audit(), {"missed": 0, "dropped": 0}, [])
    assert draw(made, tmp_path / "soak.png").stat().st_size > 10_000
    told = json.loads(json.dumps(content(made, found, lines, seconds=60.0)))
    assert told["seconds"] == 60.0
    assert len(told["samples"]) == 12
    assert all(trend["flat"] for trend in told["trends"])
    assert table(lines).row_count == len(lines)


@pytest.mark.graph
@pytest.mark.long
def test_a_session_runs_to_its_end_and_is_computed_again(tmp_path):
    text = resource_path("params/therapy/clock_adaptive.yaml").read_text("utf-8")
    protocol = yaml.safe_load(text) | {"name": "two"}
    targets = {"layout": "clock", "count": 1, "distance": 0.14}
    protocol["blocks"] = [protocol["blocks"][0] | {"targets": targets}]
    (tmp_path / "protocols").mkdir()
    (tmp_path / "protocols" / "two.yaml").write_text(yaml.safe_dump(protocol))
    ended = subprocess.run(
        [sys.executable, str(SOAK), "--protocol", "two.yaml", "--folder", str(tmp_path / "out")],
        env={**os.environ, "HOME": str(tmp_path)}, check=False, capture_output=True, text=True,
        timeout=850,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    (file,) = (tmp_path / "out").glob("*/soak.json")
    lines = {line["text"]: line for line in json.loads(file.read_text())["verdicts"]}
    assert lines["session computed again"]["good"]
    assert lines["session computed again"]["detail"].startswith("equal: 2 trials from ")
    assert lines["zero lost samples"]["good"] and lines["torque stayed on"]["good"]


def test_usage_of_this_process():
    with open(os.devnull):
        more = usage(os.getpid())
    less = usage(os.getpid())
    assert more["handles"] == less["handles"] + 1
    assert less["memory"] > 1.0
    assert less["threads"] >= 1


def test_usage_of_a_process_that_ended():
    with pytest.raises(OSError):
        usage(2**22 + 1)
