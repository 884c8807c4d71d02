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
from fake_gateway import FakeGateway, Served
from rich.console import Console

from screw_module_ros.bridge.rights import Rights
from screw_module_ros.bridge.server import Server
from screw_module_ros.bridge.settings import Limits, Listening
from screw_module_ros.bridge.tokens import Tokens
from screw_module_ros.clock import WallClock
from screw_module_ros.resources import resource_path
from screw_module_ros.safety.timing import BIN_NS, empty_histogram, note_latency
from screw_module_ros.trials import bench
from screw_module_ros.trials.bench import (
    COMPOSED,
    SEPARATE,
    SUBSCRIBED,
    WANTED,
    WANTED_CALLS,
    Case,
    Counts,
    PageReader,
    Run,
    Speed,
    StepCase,
    StepRun,
    calls_by_room,
    calls_table,
    content_of,
    figures,
    loop_table,
    page_table,
    processor_shares,
    processor_table,
    processor_time,
    spreads,
    step_tables,
    switches,
    timing_table,
    verdict,
)

BIN = BIN_NS * 1e-3  # us
TOKENS = Tokens("p" * 32, "t" * 32)
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


def run(p99=50.0, load=1.0, enabled=True, **processor):
    """A run with every latency `p99`."""
    found = figures(counts([]), counts([p99] * 100, seconds=1.0))
    return Run(found, processor or {"module": 40.0, "sim_rig": 50.0}, load, enabled)


def test_only_the_window_counts():
    before = [900.0] * 50
    begin = counts(before, late=50, lost=7, seconds=10.0)
    end = counts(before + [100.0] * 980 + [300.0] * 15 + [700.0] * 5, 55, 10, 12.0)
    found = figures(begin, end)
    assert found["p50"] == pytest.approx(100.0, abs=1.01 * BIN)
    assert found["p99"] == pytest.approx(300.0, abs=1.01 * BIN)
    assert found["p99.9"] == pytest.approx(700.0, abs=1.01 * BIN)
    assert found["late"] == pytest.approx(100 * 5 / 1003)
    assert found["lost"] == pytest.approx(100 * 3 / 1003)
    assert found["answer p50"] == pytest.approx(50.0, abs=1.01 * BIN)
    assert found["own p99"] == pytest.approx(30.0, abs=1.01 * BIN)
    assert found["rate"] == pytest.approx(500.0)


def test_a_window_without_a_write_is_refused():
    same = counts([100.0] * 10)
    with pytest.raises(ValueError, match="no command"):
        figures(same, same)


def test_processor_shares_are_of_one_core():
    begin = counts([], processor={"module": 1.0, "sim_rig": 5.0}, seconds=100.0)
    end = counts([], processor={"module": 3.0, "sim_rig": 15.0}, seconds=110.0)
    assert processor_shares(begin, end) == pytest.approx({"module": 20.0, "sim_rig": 100.0})


def test_median_and_range_of_runs():
    assert spreads([{"p99": value} for value in (30.0, 10.0, 500.0, 20.0, 40.0)]) == {
        "p99": (30.0, 10.0, 500.0)
    }


def test_what_is_wanted_is_judged_and_nothing_else():
    case = Case(SEPARATE, 2000)
    assert verdict(case, "p50", 200.0) == "yes"
    assert verdict(case, "p50", 200.1) == "MISSED"
    assert verdict(case, "p99.9", 1e6) == ""
    assert verdict(Case(SEPARATE, 1000), "p50", 1e6) == ""
    assert verdict(Case(COMPOSED, 2000), "p99", math.inf) == "MISSED"
    assert WANTED[SEPARATE, 2000] == {"p50": 200.0, "p99": 325.0, "late": 0.5, "lost": 0.1}
    assert WANTED[COMPOSED, 2000] == {"p99": 60.0}


def shown(table) -> str:
    """The table as text."""
    console = Console(width=200)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_the_tables_say_what_was_missed():
    measured = {
        Case(COMPOSED, 2000): [run(50.0), run(400.0), run(450.0, enabled=False)],
        Case(SEPARATE, 2000): [run(50.0, encoder=12.0)],
    }
    told = shown(timing_table(measured))
    line = next(row for row in told.splitlines() if "p99 " in row and "composed" in row)
    assert "60 us" in line and "MISSED" in line
    used = shown(processor_table(measured))
    assert "90 (90..90)" in used  # module and rig together
    assert "2 of 3" in used and "1 of 1" in used


def test_the_page_is_judged_by_the_spread_of_the_runs_without():
    bare, page = Case(COMPOSED, 1000), Case(COMPOSED, 1000, page=True)
    without = [run(50.0), run(80.0), run(60.0)]
    told = shown(page_table({bare: without, page: [run(70.0, web_bridge=5.0)] * 3}))
    p99 = next(row for row in told.splitlines() if "p99 " in row)
    assert all(each in p99 for each in ("65 (55..85) us", " 75 us", "+10 us", "yes"))  # of bins
    assert "ABOVE" not in told
    assert "ABOVE" in shown(page_table({bare: without, page: [run(90.0)]}))
    assert page_table({bare: without}) is None
    assert page_table({page: without}) is None  # nothing to compare with
    read = content_of({bare: without, page: [run(70.0)]}, 15.0, [])
    assert [case["page"] for case in read["graph"]] == [False, True]


def test_the_loop_is_judged_by_its_cores():
    found = [Speed("x", 1, (450.0, 490.0, 650.0)), Speed("x", 2, (1000.0,)), Speed("x", 3, (1.0,))]
    told = shown(loop_table(found))
    assert told.count("MISSED") == 1
    assert told.count("yes") == 1


def test_lock_step_is_judged_by_case():
    bare = StepRun(0.9, {"sim_rig": 0.5, "module": 1.0}, {"sim_rig": 3.0, "module": 4.0})
    slow = StepRun(1.9, {"sim_rig": 0.5, "module": 2.0}, {"sim_rig": 3.0, "module": 4.5})
    measured = {StepCase(SEPARATE, False): [bare, bare], StepCase(COMPOSED, True): [slow]}
    factors, processes = (shown(table) for table in step_tables(measured))
    apart, composed = (next(row for row in factors.splitlines() if word in row) for word in
                       ("separate ", "composed, recorder"))  # fmt: skip
    assert "1.50" in apart and "yes" in apart and "MISSED" not in apart
    assert "1.90" in composed and "MISSED" in composed
    total = next(row for row in processes.splitlines() if "all" in row)
    assert "1.50, 7.0" in total and "2.50, 7.5" in total
    read = content_of({}, 5.0, [], measured)
    assert [case["recorder"] for case in read["lock_step"]] == [False, True]


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
    assert sum(counts[0].values()) <= WANTED_CALLS
    assert "yes" in shown(calls_table(counts[0]))
    assert "MISSED" in shown(calls_table({"rig": WANTED_CALLS, "loop": 1.0}))


def test_sleeping_is_a_voluntary_switch():
    before = switches(os.getpid())
    WallClock().sleep(0.001)  # gives its core away
    assert switches(os.getpid()) > before


def test_json_holds_every_run_and_no_infinity():
    content = content_of({Case(SEPARATE, 1000): [run(9000.0), run(100.0)]}, 15.0, [])
    read = json.loads(json.dumps(content, allow_nan=False))
    (case,) = read["graph"]
    assert (case["processes"], case["rate"], case["seconds"]) == ("separate", 1000, 15.0)
    assert len(case["runs"]) == 2
    assert case["runs"][0]["figures"]["p99"] is None


def test_processor_time_of_this_process_grows():
    before = processor_time(os.getpid())
    end = time.process_time() + 0.1
    while time.process_time() < end:
        pass
    assert 0.0 < processor_time(os.getpid()) - before


def test_a_full_disk_does_not_take_the_figures_with_it(monkeypatch, tmp_path):
    def full(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(bench, "speeds", lambda *_: [Speed("one", 1, (321.0,))])
    monkeypatch.setattr(bench, "write", full)
    given = ["--only", bench.LOOP, "--json", str(tmp_path / "x.json")]
    result = CliRunner().invoke(bench.bench, given)
    assert result.exit_code == 1
    assert "321" in result.output and "the disk is full" in result.output


def test_a_run_that_failed_is_told_and_the_others_count(monkeypatch, tmp_path):
    """The first run of two fails; an interruption after the second loses nothing."""
    answers = [bench.RobotError("encoder ended"), run(50.0), KeyboardInterrupt()]

    def measured(*_: object) -> Run:
        answer = answers.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    monkeypatch.setattr(bench, "measure", measured)
    file = tmp_path / "x.json"
    given = ["--only", SEPARATE, "--rate", "1000", "--runs", "3", "--json", str(file)]
    result = CliRunner().invoke(bench.bench, given)
    assert result.exit_code == 130
    assert "no figures of this run: encoder ended" in result.output and "1 of 1" in result.output
    (case,) = json.loads(file.read_text())["graph"]
    assert len(case["runs"]) == 1


# The page beside the graph, against the real server -----------------------------------------------


@pytest.fixture
def serving():
    robot = FakeGateway()
    made = Server(Listening(port=0), Limits(), TOKENS, Rights(("/",)), robot, WallClock(), {})
    with Served(made) as server:
        yield server, robot


def test_it_reads_what_the_robot_tells(serving, wait_until):
    server, robot = serving
    with PageReader(server.address, TOKENS.patient) as page:

        def heard():
            robot.tell("/endpoint_state", {"x": page.received})
            return page.received >= 5

        wait_until(heard, DEADLINE_S)
        assert page.error is None


@pytest.mark.parametrize(
    ("token", "topics", "why"),
    [("x" * 32, SUBSCRIBED, "403"), (TOKENS.patient, ("safety_state",), "may not subscribe")],
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
