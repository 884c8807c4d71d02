# SPDX-License-Identifier: Apache-2.0
"""`bench`: differences of counts, medians with ranges, verdicts, tables, JSON; its page."""

from __future__ import annotations

import gc
import json
import math
import os
import time

import pytest
from click.testing import CliRunner
from fake_gateway import TOKENS, FakeGateway, Served, make_server
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

import bench
from bench import (
    ALL,
    CALLS,
    COMPOSED,
    FACTOR,
    GRAPH,
    LOOP,
    NODES,
    ONE,
    OVER,
    SEPARATE,
    SPENT,
    STEPS,
    SUBSCRIBED,
    THREAD,
    WANTED,
    WANTED_CALLS,
    WITH_RECORDER,
    Case,
    Counts,
    PageReader,
    calls_by_room,
    calls_of_nodes,
    cases_of,
    compare,
    content_of,
    figures,
    histogram_of,
    limit,
    missed,
    processor_time,
    switches,
    table,
)
from screw_module_ros.clock import WallClock
from screw_module_ros.resources import resource_path
from screw_module_ros.safety.timing import BIN_NS, empty_histogram, histogram_text, note_latency
from screw_module_ros.trials.runner import own_place

BIN = BIN_NS * 1e-3  # us
DEADLINE_S = 20.0


def counts(latencies_us, late=0, lost=0, seconds=0.0, processor=None):
    """Counts with these latencies to the write, half of them to the answer, a tenth of our own."""
    histograms = []
    for factor in (1.0, 0.5, 0.1):
        histogram = empty_histogram()
        for latency in latencies_us:
            note_latency(histogram, round(latency * factor * 1e3))
        histograms.append(histogram)
    return Counts(*histograms, late, lost, processor or {"module": 0.0}, seconds)


def run(p99=50.0, **processor):
    """The figures of a run with every latency `p99`."""
    used = processor or {"module": 0.4, "sim_rig": 0.5}
    nothing = dict.fromkeys(used, 0.0)
    return figures(counts([], processor=nothing), counts([p99] * 100, seconds=1.0, processor=used))


@given(st.lists(st.integers(0, 8_000_000), max_size=50))
def test_a_histogram_survives_its_text(latencies_ns):
    histogram = empty_histogram()
    for latency_ns in latencies_ns:
        note_latency(histogram, latency_ns)
    assert histogram_of(histogram_text(histogram)) == histogram


@pytest.mark.parametrize("text", ["1000:1", "-1:1", "1:-1", "1", "a:b"])
def test_what_is_no_histogram_is_refused(text):
    with pytest.raises(ValueError):
        histogram_of(text)


def case(section, title, bare=""):
    return Case(section, title, dict, bare)


def test_only_the_window_counts():
    before = [900.0] * 50
    begin = counts(before, late=50, lost=7, seconds=10.0)
    end = counts(before + [100.0] * 980 + [300.0] * 15 + [700.0] * 5, 55, 10, 12.0)
    found = figures(begin, end)
    assert found["p50 [us]"] == pytest.approx(100.0, abs=1.01 * BIN)
    assert found["p99 [us]"] == pytest.approx(300.0, abs=1.01 * BIN)
    assert found["p99.9 [us]"] == pytest.approx(700.0, abs=1.01 * BIN)
    assert found["late [%]"] == pytest.approx(100 * 5 / 1003)
    assert found["lost [%]"] == pytest.approx(100 * 3 / 1003)
    assert found["answer p50 [us]"] == pytest.approx(50.0, abs=1.01 * BIN)
    assert found["own p99 [us]"] == pytest.approx(30.0, abs=1.01 * BIN)
    assert found["rate [1/s]"] == pytest.approx(500.0)


def test_a_window_without_a_write_is_refused():
    same = counts([100.0] * 10)
    with pytest.raises(ValueError, match="no command"):
        figures(same, same)


def test_processor_shares_are_of_one_core():
    begin = counts([], processor={"module": 1.0, "sim_rig": 5.0}, seconds=100.0)
    end = counts([100.0], processor={"module": 3.0, "sim_rig": 15.0}, seconds=110.0)
    found = figures(begin, end)
    shares = [found[f"{name} [%]"] for name in ("module", "sim_rig", ALL)]
    assert shares == pytest.approx([20.0, 100.0, 120.0])


def test_every_case_is_measured_once_and_every_wish_has_its_case(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    cases = cases_of((SEPARATE, COMPOSED, STEPS, CALLS, LOOP), (1000, 2000), True, 5.0, None)
    titles = [one.title for one in cases]
    assert len(titles) == len(set(titles)) == 4 + 4 + 6 + 2 + 4
    assert set(titles) >= WANTED.keys()
    assert {one.bare for one in cases} - {""} == {
        one.title for one in cases if one.section == GRAPH and not one.bare
    }
    assert [one.section for one in cases_of((CALLS,), (1000,), True, 5.0, None)] == [CALLS] * 2


def test_what_is_wanted_is_judged_and_nothing_else():
    slow, fast = case(GRAPH, "separate 2000 Hz"), case(GRAPH, "separate 1000 Hz")
    assert limit(slow, "p50 [us]", {}) == 200.0
    assert math.isnan(limit(slow, "p99.9 [us]", {})) and math.isnan(limit(fast, "p50 [us]", {}))
    assert not missed("p50 [us]", 200.0, 200.0) and missed("p50 [us]", 200.1, 200.0)
    assert missed("p99 [us]", math.inf, 60.0) and not missed("p99 [us]", math.inf, math.nan)
    assert missed(FACTOR, 499.0, 500.0) and not missed(FACTOR, 501.0, 500.0)


def shown(section, measured) -> str:
    """The table of a section as text; measured: runs of each case."""
    console = Console(width=250)
    with console.capture() as capture:
        console.print(table(section, list(measured), {c.title: r for c, r in measured.items()}))
    return capture.get()


def line(text, name):
    return next(row for row in text.splitlines() if f" {name} " in row)


def test_the_table_shows_median_and_range_and_says_what_was_missed():
    composed = case(GRAPH, "composed 2000 Hz")
    told = shown(GRAPH, {composed: [run(50.0), run(450.0), run(400.0)],
                         case(GRAPH, "another"): [run(50.0, encoder=0.12)]})  # fmt: skip
    assert "405 (55..455), wanted 60: MISSED" in line(told, "p99 [us]")  # upper edges of bins
    assert "90 (90..90)" in line(told, "all [%]")  # module and rig together
    assert "12" in line(told, "encoder [%]")
    assert "3 runs" in told and "1 run " in told
    assert table(STEPS, [composed], {"composed 2000 Hz": [run()]}) is None


def test_the_page_is_judged_by_the_spread_of_the_runs_without():
    bare, page = case(GRAPH, "bare"), case(GRAPH, "page", bare="bare")
    without = [run(50.0), run(80.0), run(60.0)]
    told = shown(GRAPH, {bare: without, page: [run(70.0, web_bridge=0.05)] * 3})
    assert "75 (75..75), wanted 85: reached" in line(told, "p99 [us]")
    assert "wanted" not in line(told, "own p99 [us]")
    assert "wanted 85: MISSED" in line(shown(GRAPH, {bare: without, page: [run(90.0)]}), "p99 [us]")
    assert "wanted" not in shown(GRAPH, {page: without})  # nothing to compare with


def test_lock_step_and_loop_are_judged_by_case():
    lock = {case(STEPS, "separate"): [{FACTOR: 0.9, SPENT: 1.5}],
            case(STEPS, "composed, recorder"): [{FACTOR: 1.9, SPENT: 2.5}]}  # fmt: skip
    told = shown(STEPS, lock)
    assert "1.9, wanted 2: MISSED" in line(told, FACTOR) and told.count("wanted") == 2
    assert "1.5, wanted 1.6: reached" in line(told, SPENT)
    assert "processor time [ms]" in " ".join(told.split("┏")[0].split())
    stage = "stage, no torque"
    loops = {case(LOOP, f"{stage}, 1 core"): [{FACTOR: 490.0}],
             case(LOOP, f"{stage}, 3 cores"): [{FACTOR: 1.0}]}  # fmt: skip
    assert shown(LOOP, loops).count("MISSED") == 1


def test_one_process_is_compared_with_the_runs_of_its_turn_and_the_median_is_judged():
    separate, composed, one, recorded = (
        case(STEPS, title) for title in (SEPARATE, COMPOSED, ONE, COMPOSED + WITH_RECORDER)
    )
    measured = {separate: [], composed: [], one: [], recorded: []}
    for spent in ((3.0, 1.2, 0.5), (6.0, 1.0, 1.0), (4.0, 2.2, 1.0), (2.0, 9.9)):
        turn = {c: {SPENT: ms} for c, ms in zip((separate, composed, one), spent, strict=False)}
        compare({c.title: run for c, run in turn.items()})  # the last without one process
        for c, run in turn.items():
            measured[c].append(run)
    recorded_run = {SPENT: 2.0}
    compare({ONE: {SPENT: 0.5}, recorded.title: recorded_run})  # what has no recorder is no measure
    measured[recorded].append(recorded_run)
    row = line(shown(STEPS, measured), OVER)
    assert "6 (4..6)" in row and "2.2 (1..2.4), wanted 2: reached" in row
    assert row.count("wanted") == 1
    cases = list(measured)
    content = content_of(cases, {c.title: runs for c, runs in measured.items()}, 1.0)
    assert content["cases"][1]["figures"][OVER]["runs"] == pytest.approx([2.4, 1.0, 2.2])


@pytest.fixture
def uncollected():
    """No garbage collection: where hypothesis ran before, each one calls it."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("uncollected")
def test_a_tick_keeps_to_its_budget_of_calls_and_each_count_is_the_same():
    counts = [calls_by_room(50) for _ in range(2)]
    assert counts[0] == counts[1]
    assert {"rig", "devices", "control", "safety", "loop", "plant"} <= counts[0].keys()
    total = counts[0].pop(ALL)
    assert total == pytest.approx(sum(counts[0].values())) and total <= WANTED_CALLS[THREAD]


@pytest.mark.long
@pytest.mark.graph
def test_the_nodes_in_one_process_keep_to_their_budget_of_calls():
    place = own_place()
    try:
        counts = calls_of_nodes()
    finally:
        place.release()
    assert {"rig", "devices", "control", "safety", "loop", "nodes", "lockstep"} <= counts.keys()
    total = counts.pop(ALL)
    assert total == pytest.approx(sum(counts.values())) and total <= WANTED_CALLS[NODES]


def test_sleeping_is_a_voluntary_switch():
    before = switches(os.getpid())
    WallClock().sleep(0.001)  # gives its core away
    assert switches(os.getpid()) > before


def test_json_holds_every_run_and_no_infinity():
    one, none = case(GRAPH, "separate 1000 Hz"), case(GRAPH, "not run")
    content = content_of([one, none], {one.title: [run(9000.0), run(100.0)], none.title: []}, 15.0)
    read = json.loads(json.dumps(content, allow_nan=False))
    (found,) = read["cases"]
    assert (found["case"], read["seconds"]) == ("separate 1000 Hz", 15.0)
    assert found["figures"]["p99 [us]"]["runs"] == [None, pytest.approx(105.0)]
    assert found["figures"]["late [%]"]["wanted"] == 0.5


def test_processor_time_of_this_process_grows():
    before = processor_time(os.getpid())
    end = time.process_time() + 0.1
    while time.process_time() < end:
        pass
    assert 0.0 < processor_time(os.getpid()) - before


def test_a_full_disk_does_not_take_the_figures_with_it(monkeypatch, tmp_path):
    def full(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(bench, "loop", lambda *_: {FACTOR: 321.0})
    monkeypatch.setattr(bench, "write", full)
    given = ["--only", bench.LOOP, "--json", str(tmp_path / "x.json")]
    result = CliRunner().invoke(bench.bench, given)
    assert result.exit_code == 1
    assert "321" in result.output and "the disk is full" in result.output


def test_a_run_that_failed_is_told_and_the_others_count(monkeypatch, tmp_path):
    """The first run of two fails; an interruption after the second loses nothing."""
    answers = [bench.RobotError("encoder ended"), run(50.0), KeyboardInterrupt()]

    def measured(*_: object) -> dict[str, float]:
        answer = answers.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    monkeypatch.setattr(bench, "measure", measured)
    file = tmp_path / "x.json"
    given = ["--only", SEPARATE, "--rate", "1000", "--runs", "3", "--json", str(file)]
    result = CliRunner().invoke(bench.bench, given)
    assert result.exit_code == 130
    assert "no figures of this run: encoder ended" in result.output and "1 run" in result.output
    (found,) = json.loads(file.read_text())["cases"]
    assert len(found["figures"]["rate [1/s]"]["runs"]) == 1


# The page beside the graph, against the real server -----------------------------------------------


@pytest.fixture
def serving():
    robot = FakeGateway()
    with Served(make_server(robot)) as server:
        yield server, robot


def test_it_reads_what_the_robot_tells(serving, wait_until):
    server, robot = serving
    with PageReader(server.address, TOKENS["patient"]) as page:

        def heard():
            robot.tell("/endpoint_state", {"x": page.received})
            return page.received >= 5

        wait_until(heard, DEADLINE_S)
        assert page.error is None


@pytest.mark.parametrize(
    ("token", "topics", "why"),
    [("x" * 32, SUBSCRIBED, "403"), (TOKENS["patient"], ("safety_state",), "may not subscribe")],
)
def test_it_tells_why_it_reads_nothing(serving, wait_until, token, topics, why):
    server, _ = serving
    with PageReader(server.address, token, topics) as page:
        wait_until(lambda: page.error is not None, DEADLINE_S)
    assert why in str(page.error)


def test_it_reads_the_topics_of_the_patients_page():
    script = resource_path("screw_module_ros/bridge/pages/static/js/patient/main.js")
    for topic in SUBSCRIBED:
        assert f'bridge.subscribe(named(robot, "{topic}")' in script.read_text()
