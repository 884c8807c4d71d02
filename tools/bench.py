# SPDX-License-Identifier: Apache-2.0
"""`make bench`: how fast things run here, in tables and as JSON; medians of several runs.

The graph against the simulated rig by wall clock, its vertical axis as separate processes and as
`module`, at 1 and 2 kHz, on request with `web_bridge` and a page besides; in lock step the same
and the whole robot in one process, with and without the recorder; the Python calls of a tick, by
room, of the whole robot in one thread, without ROS and as its nodes; and the in-process loop:
simulated over real time. docs/performance.md has the figures.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import os
import platform
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import aiohttp
import click
from diagnostic_msgs.msg import DiagnosticArray
from rich.markup import escape
from rich.table import Column, Table
from screw_module_msgs.msg import AmplifierState, ForceCommand

from screw_module_ros import graph as topics
from screw_module_ros.bridge.tokens import tokens_in
from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.lab import worker_pool
from screw_module_ros.identification.stand import SimulatedStand
from screw_module_ros.identification.trials import MotionTrial, StageTrial
from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.support.states import histogram_key
from screw_module_ros.operator.bring_up import DRIVES, bring_up
from screw_module_ros.operator.robot import Robot, RobotError, arm
from screw_module_ros.plant.settings import load_world
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.safety.timing import empty_histogram, quantile
from screw_module_ros.terminal import Console
from screw_module_ros.trials.demo import make_ready
from screw_module_ros.trials.one_thread import PERIOD_NS, OneThreadRobot
from screw_module_ros.trials.patient import Hand
from screw_module_ros.trials.runner import GraphRun, command, own_place, recordings_in, running
from screw_module_ros.trials.therapy import BRIDGE, bridge_words, token_file

SEPARATE, COMPOSED, ONE = "separate", "composed", "one process"
LOOP, STEPS, CALLS = "loop", "steps", "calls"
WITH_RECORDER = ", recorder"
SHARED = {SEPARATE: None, COMPOSED: topics.MODULE, ONE: topics.WHOLE}
GRAPH = "graph"
SECTIONS = {
    GRAPH: "By wall clock. Latencies from SYNC to the drive write; answer: from SYNC to reception "
    "of the encoder's answer (bus and device); own: from there (composed), or from reception of "
    "the command (separate), to the drive write. Of a process: processor time, % of one core",
    STEPS: "Lock step, as fast as it goes. Of a process: processor time [ms] and voluntary context "
    "switches of a tick of 1 ms. Over one process: ratio of processor times of the same turn",
    CALLS: f"Python calls of a tick of {PERIOD_NS * 1e-6:g} ms, the whole robot in one thread: "
    "without ROS, and its nodes with topics and lock step",
    LOOP: "In-process loop, 2 kHz samples, substeps of 50 us",
}
TIMING = ("p50 [us]", "p99 [us]", "p99.9 [us]", "late [%]", "lost [%]")
FACTOR, ALL, SPENT = "x real time", "all", "all [ms]"
OVER = "over one process"
AT_LEAST = (FACTOR, OVER)
"""Figures that are wanted large."""
THREAD, NODES = "one thread", "nodes in one process"
WANTED_CALLS = {THREAD: 825.0, NODES: 848.0}
LOOP_S = 60.0
LOOP_TRIALS: dict[str, MotionTrial | StageTrial] = {
    "closed loop, combined law, arm": MotionTrial(
        modes.COMBINED, VerticalSettings(), duration=LOOP_S
    ),
    "stage, no torque": StageTrial(0.3 / LOOP_S, 0.03, 0.33),
}
WANTED: dict[str, dict[str, float]] = {
    "separate 1000 Hz": {"late [%]": 0.5, "lost [%]": 0.5},
    "composed 1000 Hz": {"p99 [us]": 400.0, "late [%]": 0.05, "lost [%]": 0.05},
    "separate 2000 Hz": {"p50 [us]": 200.0, "p99 [us]": 325.0, "late [%]": 0.5, "lost [%]": 0.1},
    "composed 2000 Hz": {"p99 [us]": 60.0},
    "separate": {SPENT: 1.6},
    "separate, recorder": {FACTOR: 1.0},
    "composed": {OVER: 2.0},
    "composed, recorder": {FACTOR: 2.0, OVER: 1.8},
    "one process, recorder": {FACTOR: 1.5},
    **{title: {ALL: most} for title, most in WANTED_CALLS.items()},
    **{f"{trial}, 1 core": {FACTOR: 500.0} for trial in LOOP_TRIALS},
    **{f"{trial}, 2 cores": {FACTOR: 1000.0} for trial in LOOP_TRIALS},
}
"""Of a case, by its title: the most of a figure, the least of `AT_LEAST`. On two cores."""
SUBSCRIBED = (topics.ENDPOINT_STATE, topics.THERAPY_STATE)
"""Topics of the patient's page, see bridge/pages/static/js/patient/main.js."""
_SETTLE_S = 2.0
_ENTRY_S = 10.0  # the longest wait for diagnostics
_HEIGHT, _SPRING = 0.27, 400.0
_RECORDER = topics.TOPICS[topics.RECORDER_STATUS].publisher
_STROKE = ArmSettings(kind="active", amplitude=(0.05, 0.04, 0.08), omega=(3.0, 2.0, 4.0))
_HEARD_S, _LOOK_S, _END_S = 20.0, 0.2, 5.0
_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")

Figures = dict[str, float]
"""What one run came to: value by name with unit."""


class Case(NamedTuple):
    """What is measured: one column of its section's table.

    measure: does one run. bare: title of the same case without a page, whose runs bound its
    latencies and shares in place of `WANTED`.
    """

    section: str
    title: str
    measure: Callable[[], Figures]
    bare: str = ""


Measured = Mapping[str, Sequence[Figures]]
"""The runs of each case, by title."""


class Counts(NamedTuple):
    """Readings of the counters at one time; all only increase.

    latency: SYNC to drive write; answer: SYNC to reception of the encoder's answer; own: from
    reception of the input (separate: the command, composed: the samples) to the drive write; all
    histograms of safety/timing. late, lost: commands. processor: time used by each process [s].
    seconds: clock. read: publications that the page has read.
    """

    latency: list[int]
    answer: list[int]
    own: list[int]
    late: int
    lost: int
    processor: dict[str, float]
    seconds: float
    read: int = 0


class FiniteRange(click.FloatRange):
    """A finite number in a range; `click.FloatRange` accepts nan."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the number; exit with a message that names the option if it is not finite."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number", param, ctx)
        return number


class OutputFile(click.Path):
    """A file to write; what prevents it is said before the work, not after it."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False, writable=True, path_type=Path)

    def convert(self, value: Any, param: Any, ctx: Any) -> Path:
        """Return the path; exit with a message that names the option if it cannot be written."""
        file = super().convert(value, param, ctx)
        assert isinstance(file, Path)
        if not file.parent.is_dir():
            self.fail(f"{file}: there is no folder {file.parent}", param, ctx)
        if not file.exists() and not os.access(file.parent, os.W_OK | os.X_OK):
            self.fail(f"{file}: no permission to write into {file.parent}", param, ctx)
        return file


@command("bench")
@click.option("--runs", default=5, type=click.IntRange(1, 100), help="Of each measurement.")
@click.option("--seconds", default=15.0, type=FiniteRange(2.0, 3600.0), help="Of a run.")
@click.option("--quick", is_flag=True, help="One run of 5 s each.")
@click.option(
    "--only", multiple=True, type=click.Choice([SEPARATE, COMPOSED, STEPS, CALLS, LOOP]),
    help="Measure only this (repeat for more).",
)
@click.option(
    "--rate", "rates", multiple=True, type=click.IntRange(50, 4000), default=(1000, 2000),
    help="Ticks per second of the graph (repeat for more).",
)
@click.option(
    "--bridge", is_flag=True,
    help="The graph also with web_bridge and a page connected, in turn with the runs without.",
)
@click.option(
    "--json", "file", default="bench_output.json", type=OutputFile(), help="Output file.",
)  # fmt: skip
def bench(
    console: Console, runs: int, seconds: float, quick: bool, only: tuple[str, ...],
    rates: tuple[int, ...], bridge: bool, file: Path,
) -> bool:  # fmt: skip
    """Measure and say."""
    if quick:
        runs, seconds = 1, 5.0
    with worker_pool() as pool:
        cases = cases_of(only or (SEPARATE, COMPOSED, STEPS, CALLS, LOOP), rates, bridge, seconds,
                         pool)  # fmt: skip
        measured: dict[str, list[Figures]] = {case.title: [] for case in cases}
        try:
            with _one_domain():
                # In turn, so that a change of the load affects all cases; saved after each run.
                for number in range(1, runs + 1):
                    turn: dict[str, Figures] = {}
                    for case in cases:
                        if case.section != CALLS or not measured[case.title]:
                            _run(case, f"run {number} of {runs}", measured, turn, console)
                            write(content_of(cases, measured, seconds), file)
                    compare(turn)
        finally:  # an interruption loses no finished run
            for section in SECTIONS:
                if found := table(section, cases, measured):
                    console.show(found)
            write(content_of(cases, measured, seconds), file)
            console.show(f"As JSON: {file}")
    return True


def cases_of(
    only: Sequence[str], rates: Sequence[int], bridge: bool, seconds: float,
    pool: ProcessPoolExecutor,
) -> list[Case]:  # fmt: skip
    """Return the cases that are asked for."""
    cases = []
    for cut, rate in itertools.product((SEPARATE, COMPOSED), rates):
        title, run = f"{cut} {rate} Hz", partial(measure, cut, rate, seconds)
        if cut in only:
            cases.append(Case(GRAPH, title, run))
        if cut in only and bridge:
            cases.append(Case(GRAPH, f"{title}, page", partial(run, page=True), title))
    for cut in SHARED if STEPS in only else ():
        for beside in ("", WITH_RECORDER):
            run = partial(steps, cut, bool(beside), seconds)
            cases.append(Case(STEPS, cut + beside, run))
    if CALLS in only:
        cases += [Case(CALLS, THREAD, calls_by_room), Case(CALLS, NODES, calls_of_nodes)]
    cores = len(os.sched_getaffinity(0))
    for name in LOOP_TRIALS if LOOP in only else ():
        for count in sorted({1, cores}):
            title = f"{name}, {count} core{'s' if count > 1 else ''}"
            cases.append(Case(LOOP, title, partial(loop, name, count, pool)))
    return cases


def _run(
    case: Case, which: str, measured: dict[str, list[Figures]], turn: dict[str, Figures],
    console: Console,
) -> None:  # fmt: skip
    """Do one run; if a node of the graph ended in it, show a message and go on.

    turn: the runs of all cases with this number, by title.
    """
    try:
        with console.step(f"{case.title}, {which}"):
            turn[case.title] = case.measure()
            measured[case.title].append(turn[case.title])
    except (RobotError, ValueError) as error:
        console.fail(f"no figures of this run: {error}")


def compare(turn: Mapping[str, Figures]) -> None:
    """Add to the runs of a turn in lock step their processor time over that of one process."""
    for recorder in ("", WITH_RECORDER):
        one = turn.get(ONE + recorder)
        for cut in (SEPARATE, COMPOSED):
            if one is not None and (run := turn.get(cut + recorder)) is not None:
                run[OVER] = run[SPENT] / one[SPENT]


@contextmanager
def _one_domain() -> Iterator[None]:
    """Keep one ROS domain for all runs."""
    with tempfile.TemporaryDirectory(prefix="screw_module_bench-") as folder:
        os.environ.setdefault("ROS_LOG_DIR", folder)
        place = own_place()
        try:
            yield
        finally:
            place.release()


# The graph ----------------------------------------------------------------------------------------


def measure(cut: str, rate: int, seconds: float, page: bool = False) -> Figures:
    """Start the whole graph, enable the vertical axis, measure for `seconds` [s], stop it.

    It runs in real time with the default limits of the guards. If the machine is too slow for
    them, the torque goes off, and the measurement continues with commands of zero force. Raises
    RobotError if the graph does not start or a node ends, Interrupted after Ctrl-C.
    """
    load = os.getloadavg()[0]
    extra = [word for node in topics.MODULE.parts
             for word in ("-p", f"{node}:rate:={float(rate)}")]  # fmt: skip
    extra.append("--disable-stdout-logs")
    nodes = GraphRun(extra=extra, shared=SHARED[cut], wall_clock=True)
    port = free_port()

    def beside(graph: GraphRun) -> None:
        if page:
            graph.add(BRIDGE, *bridge_words(graph, port, file_games=False))

    with ExitStack() as stack:
        robot, graph = stack.enter_context(running("bench", Console(quiet=True), nodes, beside))
        counters = _Counters(robot)
        enabled = _enable(robot)
        reader = None
        if page:
            token = tokens_in(token_file(graph))["patient"]
            reader = stack.enter_context(PageReader(f"http://127.0.0.1:{port}", token))
            robot.wait_until(lambda: reader.received, _HEARD_S, "the page reads nothing")
        robot.pause(_SETTLE_S)
        begin = counters.read(graph.pids, reader)
        robot.pause(seconds)
        end = counters.read(graph.pids, reader)
        state = robot.state(AmplifierState)
        enabled = enabled and state is not None and state.enabled
    return {
        **figures(begin, end),
        "torque on throughout": float(enabled),
        "load average before": load,
    }


def _enable(robot: Robot) -> bool:
    """Enable the axis with a spring and a relaxed hand; return whether that succeeded."""
    try:
        robot.set_impedance(_SPRING, 0.0)
        robot.set_setpoint(z=_HEIGHT)
        bring_up(robot, ForceCommand.IMPEDANCE, Hand(robot, arm(kind="relaxed")), DRIVES[:1])
    except RobotError:
        return False  # commands of zero force take the same time
    return True


class _Counters:
    """Subscribes to the diagnostics of encoder and amplifier: once a second, with histograms."""

    def __init__(self, robot: Robot):
        self._robot = robot
        self._values: dict[str, dict[str, str]] = {}
        robot.node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, self._hear, 50)

    def _hear(self, array: DiagnosticArray) -> None:
        for status in array.status:
            node = status.name.rpartition("/")[2]
            self._values[node] = {value.key: value.value for value in status.values}

    def read(self, pids: Mapping[str, int], page: PageReader | None) -> Counts:
        """Return the counts of the next diagnostics. Raises RobotError if none arrive."""
        self._values.clear()
        self._robot.wait_until(
            lambda: all("rate [1/s]" in self._values.get(n, {}) for n in ("encoder", "amplifier")),
            _ENTRY_S,
            "no diagnostics of encoder and amplifier",
        )
        encoder, amplifier = self._values["encoder"], self._values["amplifier"]
        if page is not None and page.error is not None:
            raise RobotError(f"the page beside the graph: {page.error}")
        return Counts(
            histogram_of(amplifier[histogram_key("latency")]),
            histogram_of(encoder[histogram_key("answer")]),
            histogram_of(amplifier[histogram_key("own")]),
            int(amplifier["late"]),
            int(amplifier["lost"]),
            {name: processor_time(pid) for name, pid in pids.items()},
            self._robot.clock.now_ns() * 1e-9,
            page.received if page is not None else 0,
        )


def histogram_of(text: str) -> list[int]:
    """Return the histogram from a text of `histogram_text`. Raises ValueError for other texts."""
    histogram = empty_histogram()
    for entry in text.split():
        number, count = map(int, entry.split(":"))
        if not 0 <= number < len(histogram) or count < 0:
            raise ValueError(f"{entry!r} is not a bin of a latency histogram")
        histogram[number] = count
    return histogram


def figures(begin: Counts, end: Counts) -> Figures:
    """Return the figures of the window between two counts.

    Raises ValueError if the window has no drive write.
    """
    latency, answer, own = (
        [after - before for before, after in zip(one, two, strict=True)]
        for one, two in zip(begin[:3], end[:3], strict=True)
    )
    written = sum(latency)
    if not written:
        raise ValueError("no command reached the drive")
    late, lost = end.late - begin.late, end.lost - begin.lost
    elapsed = end.seconds - begin.seconds
    found = {f"p{100 * share:g} [us]": quantile(latency, share) * 1e6
             for share in (0.5, 0.99, 0.999)}  # fmt: skip
    found["late [%]"] = 100.0 * late / (written + lost)
    found["lost [%]"] = 100.0 * lost / (written + lost)
    for name, part in (("answer", answer), ("own", own)):
        found |= {f"{name} p{100 * share:g} [us]": quantile(part, share) * 1e6
                  for share in (0.5, 0.99)}  # fmt: skip
    found["rate [1/s]"] = written / elapsed
    if end.read:
        found["page [1/s]"] = (end.read - begin.read) / elapsed
    used = {name: end.processor[name] - before for name, before in begin.processor.items()}
    return found | _with_sum("{} [%]", used, 100.0 / elapsed)


# In lock step -------------------------------------------------------------------------------------


def steps(cut: str, recorder: bool, seconds: float) -> Figures:
    """Start the whole graph in lock step, move the hand for `seconds` of simulated time, stop it.

    Raises RobotError if the graph does not start or a node ends, Interrupted after Ctrl-C.
    """
    quiet = Console(quiet=True)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="screw_module_bench-"))
        extra = [*recordings_in(Path(folder)), "-p", "sim_rig:speed:=0.0"]
        nodes = GraphRun(
            extra=[*extra, "--disable-stdout-logs"],
            shared=SHARED[cut],
            without=() if recorder else (_RECORDER,),
        )
        robot, run = stack.enter_context(running("bench", quiet, nodes))
        make_ready(robot, quiet)
        robot.set_arm(arm(amplitude=_STROKE.amplitude, omega=_STROKE.omega))
        if recorder:
            robot.start_recording()
        robot.pause(1.0)
        begin, begin_ns, begun_s = _used(run.pids), robot.clock.now_ns(), time.monotonic()
        robot.pause(seconds)
        simulated_s = (robot.clock.now_ns() - begin_ns) * 1e-9
        factor = simulated_s / (time.monotonic() - begun_s)
        end = _used(run.pids)
        if recorder:
            robot.stop_recording()
    spent, slept = ({name: end[name][k] - begin[name][k] for name in begin} for k in (0, 1))
    return {
        FACTOR: factor,
        **_with_sum("{} [ms]", spent, 1.0 / simulated_s),
        **_with_sum("{} [switches]", slept, 1e-3 / simulated_s),
    }


def _used(pids: Mapping[str, int]) -> dict[str, tuple[float, int]]:
    return {name: (processor_time(pid), switches(pid)) for name, pid in pids.items()}


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far [s], from /proc."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_SECOND


def switches(pid: int) -> int:
    """Return the voluntary context switches of a process's threads so far, from /proc."""
    total = 0
    for status in Path(f"/proc/{pid}/task").glob("*/status"):
        with suppress(OSError):  # a thread that has ended meanwhile
            text = status.read_text("ascii")
            total += int(text.partition("\nvoluntary_ctxt_switches:")[2].split(None, 1)[0])
    return total


def _with_sum(name: str, values: Mapping[str, float], factor: float) -> Figures:
    """Return a figure for each process and for all of them."""
    each = {name.format(process): factor * value for process, value in values.items()}
    return {**each, name.format(ALL): sum(each.values())}


# The whole robot in one thread --------------------------------------------------------------------


def calls_by_room(ticks: int = 1000) -> Figures:
    """Return the Python calls of a tick by room, of the whole robot enabled in one thread.

    Counted in simulated time, so the same at each run of one version of Python. `trials` is the
    harness; what is not of this package stands under the name of its file.
    """
    bench = OneThreadRobot(seed=3)
    try:
        bench.ready()
        bench.controller.mode = modes.COMBINED
        for refused in (bench.enable(), bench.enable_plane()):
            if refused:
                raise RobotError(refused)
        bench.setpoint, bench.planar_setpoint = (_HEIGHT, 0.0), (0.06, -0.05, 0.02, 0.0)
        bench.world.set_arm(_STROKE)
        bench.ticks(500)
        files: Counter[str] = Counter()

        def note(frame: Any, event: str, _argument: Any) -> None:
            if event == "call":
                files[frame.f_code.co_filename] += 1

        sys.setprofile(note)
        try:
            bench.ticks(ticks)
        finally:
            sys.setprofile(None)
    finally:
        bench.close()
    return _by_room(files, ticks)


def calls_of_nodes(seconds: float = 1.0) -> Figures:
    """Return the Python calls of a tick by room, of the nodes in one process, without recorder.

    Those of the thread of all loops, with topics and lock step, while the hand moves for `seconds`
    of simulated time. The service threads come in at moments of wall clock, which changes the count
    by less than one call in a hundred. Raises RobotError if the nodes do not start or end.
    """
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="screw_module_bench-"))
        counts = Path(folder) / "counts.json"
        process = stack.enter_context(_counted_nodes(counts))

        def watch() -> None:
            if process.poll() is not None:
                raise RobotError(f"{topics.WHOLE.executable} ended, code {process.returncode}")

        robot = stack.enter_context(Robot("bench", watch=watch, simulated=True))
        quiet = Console(quiet=True)
        robot.wait_until_ready([name for name in topics.WHOLE.parts if name != _RECORDER])
        make_ready(robot, quiet)
        robot.set_arm(arm(amplitude=_STROKE.amplitude, omega=_STROKE.omega))
        robot.pause(0.5)
        process.send_signal(signal.SIGUSR1)
        robot.pause(seconds)
        process.send_signal(signal.SIGUSR1)
        robot.wait_until(counts.is_file, _END_S, "the calls were not counted")
        found = json.loads(counts.read_text(encoding="utf-8"))
    return _by_room(found["files"], found["ticks"])


@contextmanager
def _counted_nodes(counts: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run the nodes in one process by tools/counted.py, which writes `counts`."""
    extra = ["-p", "sim_rig:speed:=0.0", "--disable-stdout-logs"]
    planned = bringup.plan(extra=extra, shared=topics.WHOLE, without=[_RECORDER])
    (entry,) = planned.entries
    program = [sys.executable, str(Path(__file__).with_name("counted.py")), str(counts)]
    words = [*bringup.own_words(entry), "--ros-args", *planned.arguments(entry)]
    with subprocess.Popen([*program, *words]) as process:
        try:
            yield process
        finally:
            process.terminate()


def _by_room(files: Mapping[str, int], ticks: float) -> Figures:
    """Return the calls of a tick by room, from those of each file."""
    rooms: Counter[str] = Counter()
    for file, count in files.items():
        within = file.rpartition("/screw_module_ros/")[2]
        room = within.partition("/")[0] if within != file else Path(file).name
        rooms["messages" if "/msg/_" in file else room] += count
    return _with_sum("{}", dict(rooms.most_common()), 1.0 / ticks)


# The in-process loop ------------------------------------------------------------------------------


def loop(name: str, count: int, pool: ProcessPoolExecutor) -> Figures:
    """Return the simulated over real time of `count` runs in parallel, of all of them together."""
    futures = [pool.submit(one_run, name) for _ in range(count)]
    return {FACTOR: sum(future.result() for future in futures)}


def one_run(name: str) -> float:
    """Return simulated over real time of one run, after a short warm-up run.

    Compiled plant, drivers' scaling, law and arm at 2 kHz samples with the plant's substeps.
    """
    bench, trial = SimulatedStand(load_world()), LOOP_TRIALS[name]
    if isinstance(trial, StageTrial):
        bench.record(trial._replace(end=trial.start + 0.001), lambda share: None)
    else:
        bench.record(trial._replace(duration=0.1), lambda share: None)
    begun = time.perf_counter()
    samples = bench.record(trial, lambda share: None)
    return float(samples.time[-1]) / (time.perf_counter() - begun)


# A page besides -----------------------------------------------------------------------------------


class PageReader:
    """Reads the patient's topics in a thread, from entering to leaving, as the patient's page does.

    A browser would take more of the processor. received: publications read so far. error: what
    ended the connection early, None without.
    """

    def __init__(self, address: str, token: str, subscribed: Sequence[str] = SUBSCRIBED):
        """Prepare; address: of the bridge, like http://127.0.0.1:8090."""
        self.received = 0
        self.error: Exception | None = None
        self._address, self._token, self._subscribed = address, token, subscribed
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def __enter__(self) -> PageReader:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join(_END_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._read())
        except (aiohttp.ClientError, OSError) as error:
            self.error = error

    async def _read(self) -> None:
        headers = {"Authorization": f"Bearer {self._token}"}
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{self._address}/ws", headers=headers) as connection,
        ):
            for topic in self._subscribed:
                await connection.send_json({"op": "subscribe", "topic": topic})
            while not self._ends.is_set():
                try:
                    message = await connection.receive(timeout=_LOOK_S)
                except asyncio.TimeoutError:
                    continue
                if message.type is not aiohttp.WSMsgType.TEXT:
                    raise ConnectionError("the bridge closed the page's connection")
                content = json.loads(message.data)
                if content["op"] == "status":
                    raise ConnectionError(f"the bridge refused the page: {content['msg']}")
                self.received += content["op"] == "publish"


def free_port() -> int:
    """Return a TCP port of this machine that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


# Tables and JSON ----------------------------------------------------------------------------------


def limit(case: Case, name: str, measured: Measured) -> float:
    """Return what is wanted of a figure, NaN without a wish.

    Beside a page a latency or share is to be within those of the runs without.
    """
    if case.bare:
        bare = [run[name] for run in measured.get(case.bare, ())] if name in TIMING else []
        return max(bare, default=math.nan)
    return WANTED.get(case.title, {}).get(name, math.nan)


def missed(name: str, value: float, limit: float) -> bool:
    """Return whether a figure is worse than wanted; NaN: nothing is wanted."""
    return value < limit if name in AT_LEAST else value > limit


def table(section: str, cases: Sequence[Case], measured: Measured) -> Table | None:
    """Return the figures of a section: median (lowest..highest) of the runs, and what is wanted."""
    shown = [case for case in cases if case.section == section and measured[case.title]]
    if not shown:
        return None
    made = Table(
        Column("figure", no_wrap=True), title=escape(SECTIONS[section]), title_justify="left"
    )
    for case in shown:
        runs = len(measured[case.title])
        made.add_column(f"{case.title}, {runs} run{'s' if runs > 1 else ''}", justify="right")
    for name in dict.fromkeys(
        name for case in shown for run in measured[case.title] for name in run
    ):
        made.add_row(escape(name), *(_cell(case, name, measured) for case in shown))
    return made


def _cell(case: Case, name: str, measured: Measured) -> str:
    values = sorted(run[name] for run in measured[case.title] if name in run)
    if not values:
        return ""
    middle, wanted = median(values), limit(case, name, measured)
    text = _number(middle)
    if len(values) > 1:
        text += f" ({_number(values[0])}..{_number(values[-1])})"
    if math.isnan(wanted):
        return text
    verdict = "MISSED" if missed(name, middle, wanted) else "reached"
    return f"{text}, wanted {_number(wanted)}: {verdict}"


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def write(content: Mapping[str, Any], file: Path) -> None:
    """Write what was measured so far."""
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def content_of(cases: Sequence[Case], measured: Measured, seconds: float) -> dict[str, Any]:
    """Return the content of the JSON file; an infinite latency, and no wish, become null."""
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "cores": len(os.sched_getaffinity(0)),
        "seconds": seconds,
        "cases": [
            {
                "section": case.section,
                "case": case.title,
                "figures": {
                    name: {
                        "runs": [_finite(value) for value in values],
                        "median": _finite(median(values)),
                        "wanted": _finite(limit(case, name, measured)),
                    }
                    for name in dict.fromkeys(name for run in runs for name in run)
                    if (values := [run[name] for run in runs if name in run])
                },
            }
            for case in cases
            if (runs := measured[case.title])
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


if __name__ == "__main__":
    bench()
