# SPDX-License-Identifier: Apache-2.0
"""`bench`: how fast things run here, as tables and as JSON. Medians of several runs with ranges.

The graph against the simulated rig by wall clock, its vertical axis as separate processes and as
`module`, at 1 and 2 kHz, on request with `web_bridge` and a page besides; the same in lock step,
with and without the recorder; the Python calls of a tick, by room, of the whole robot in one
thread; and the in-process loop: simulated over real time. docs/performance.md has the figures.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import platform
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime, timezone
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import aiohttp
import click
from diagnostic_msgs.msg import DiagnosticArray
from rich.table import Table
from screw_module_msgs.msg import AmplifierState, ForceCommand

from screw_module_ros import graph as topics
from screw_module_ros.bridge.tokens import tokens_in
from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.bench import InProcessBench
from screw_module_ros.identification.lab import worker_pool
from screw_module_ros.identification.trials import MotionTrial, StageTrial
from screw_module_ros.nodes.support.states import histogram_key
from screw_module_ros.plant.settings import load_world
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.safety.timing import histogram_of, quantile

from ..operator.bring_up import DRIVES, bring_up
from ..operator.robot import Robot, RobotError, arm
from ..terminal import Console, FiniteRange, OutputFile
from .demo import make_ready
from .one_thread import PERIOD_NS, Bench
from .patient import Hand
from .runner import GraphRun, command, own_place, recordings_in, running
from .therapy import BRIDGE, bridge_words, token_file

SEPARATE, COMPOSED, LOOP, STEPS, CALLS = "separate", "composed", "loop", "steps", "calls"
TIMING = ("p50", "p99", "p99.9", "late", "lost")
PARTS = ("answer p50", "answer p99", "own p50", "own p99")
PAGE = "page"
UNITS = {"late": "%", "lost": "%", PAGE: "1/s"}  # microseconds otherwise
WANTED: dict[tuple[str, int], dict[str, float]] = {
    (SEPARATE, 1000): {"late": 0.5, "lost": 0.5},
    (COMPOSED, 1000): {"p99": 400.0, "late": 0.05, "lost": 0.05},
    (SEPARATE, 2000): {"p50": 200.0, "p99": 325.0, "late": 0.5, "lost": 0.1},
    (COMPOSED, 2000): {"p99": 60.0},
}
"""Of (processes, rate [Hz]) on two cores; latencies [us], shares [%]."""
WANTED_FACTOR = {1: 500.0, 2: 1000.0}
"""Simulated over real time of the in-process loop, by cores."""
WANTED_STEPS = {
    (SEPARATE, False): (math.nan, 1.6), (SEPARATE, True): (1.0, math.nan),
    (COMPOSED, True): (2.0, math.nan),
}  # fmt: skip
"""Least real-time factor and most processor time a tick [ms] of (processes, recorder)."""
WANTED_CALLS = 900.0
LEGEND = (
    "answer: SYNC to reception of the encoder's answer (bus and device). own: from there "
    "(composed), or from reception of the command (separate), to the drive write."
)
SUBSCRIBED = (topics.ENDPOINT_STATE, topics.THERAPY_STATE)
"""Topics of the patient's page, see bridge/pages/static/js/patient/main.js."""
LOOP_S = 60.0
LOOP_TRIALS: dict[str, MotionTrial | StageTrial] = {
    "closed loop, combined law, arm": MotionTrial(
        modes.COMBINED, VerticalSettings(), duration=LOOP_S
    ),
    "stage, no torque": StageTrial(0.3 / LOOP_S, 0.03, 0.33),
}
_SETTLE_S = 2.0
_ENTRY_S = 10.0  # the longest wait for diagnostics
_HEIGHT, _SPRING = 0.27, 400.0
_RECORDER = topics.TOPICS[topics.RECORDER_STATUS].publisher
_STROKE = ArmSettings(kind="active", amplitude=(0.05, 0.04, 0.08), omega=(3.0, 2.0, 4.0))
_HEARD_S, _LOOK_S, _END_S = 20.0, 0.2, 5.0
_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")
_SUM = "all"


class Case(NamedTuple):
    """What is measured: how the processes are cut, ticks per second, with or without a page."""

    processes: str
    rate: int
    page: bool = False

    @property
    def title(self) -> str:
        """The case without its rate, in words."""
        return f"{self.processes}, page" if self.page else self.processes

    @property
    def wanted(self) -> dict[str, float]:
        """The limits of its figures."""
        return WANTED.get((self.processes, self.rate), {})


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


class Run(NamedTuple):
    """One run: figures by name, processor time by executable [% of a core], conditions.

    load: the machine's load average (1 min) before the start; enabled: torque passed throughout.
    """

    figures: dict[str, float]
    processor: dict[str, float]
    load: float
    enabled: bool


class Spread(NamedTuple):
    """A figure over several runs."""

    median: float
    low: float
    high: float


class StepCase(NamedTuple):
    """What is measured in lock step: how the processes are cut, with or without the recorder."""

    processes: str
    recorder: bool

    @property
    def title(self) -> str:
        """The case in words."""
        return f"{self.processes}, recorder" if self.recorder else self.processes


class StepRun(NamedTuple):
    """One run in lock step, as fast as it goes: simulated over real time; by executable the
    processor time [ms] and the voluntary context switches of a tick of 1 ms."""

    factor: float
    processor: dict[str, float]
    switches: dict[str, float]


class Speed(NamedTuple):
    """Simulated over real time of each run, ascending; cores: number of parallel processes."""

    trial: str
    cores: int
    factors: tuple[float, ...]

    @property
    def median(self) -> float:
        """The median of the runs."""
        return median(self.factors)


Measured = Mapping[Case, Sequence[Run]]
Stepped = Mapping[StepCase, Sequence[StepRun]]


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
    wanted = only or (SEPARATE, COMPOSED, STEPS, CALLS, LOOP)
    steps = [StepCase(cut, recorder) for cut in (SEPARATE, COMPOSED) if STEPS in wanted
             for recorder in (False, True)]  # fmt: skip
    cases = [
        Case(cut, rate, page)
        for cut in (SEPARATE, COMPOSED) if cut in wanted
        for rate in rates for page in ((False, True) if bridge else (False,))
    ]  # fmt: skip
    measured: dict[Case, list[Run]] = {}
    stepped: dict[StepCase, list[StepRun]] = {}
    calls: dict[str, float] = {}
    loop: list[Speed] = []

    def save() -> None:
        write(content_of(measured, seconds, loop, stepped, calls), file)

    try:
        if CALLS in wanted:
            with console.step("Python calls of a tick"):
                calls = calls_by_room()
        # In turn, so that a change of the load affects all cases; saved after each run.
        with _one_domain():
            for number in range(1, runs + 1):
                which = f"run {number} of {runs}"
                for case in cases:
                    with _survived(f"{case.title} at {case.rate} Hz, {which}", console):
                        run = measure(case, seconds)
                        measured.setdefault(case, []).append(run)
                    save()
                for step in steps:
                    with _survived(f"{step.title} in lock step, {which}", console):
                        one = measure_steps(step, seconds)
                        stepped.setdefault(step, []).append(one)
                    save()
        if LOOP in wanted:
            cores = len(os.sched_getaffinity(0))
            with console.step(f"in-process loop, {runs} runs"), worker_pool(cores) as pool:
                loop = speeds(runs, pool, cores)
    finally:  # an interruption loses no finished run
        if measured:
            pages = page_table(measured)
            console.show(timing_table(measured), LEGEND, *([pages] if pages else []))
            console.show(processor_table(measured))
        if stepped:
            console.show(*step_tables(stepped))
        if calls:
            console.show(calls_table(calls))
        if loop:
            console.show(loop_table(loop))
        save()
        console.show(f"As JSON: {file}")
    return True


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


@contextmanager
def _survived(what: str, console: Console) -> Iterator[None]:
    """Show a step; if a node of the graph ended in it, show a message and go on."""
    try:
        with console.step(what):
            yield
    except (RobotError, ValueError) as error:
        console.fail(f"no figures of this run: {error}")


# The graph ----------------------------------------------------------------------------------------


def measure(case: Case, seconds: float) -> Run:
    """Start the whole graph, enable the vertical axis, measure for `seconds` [s], stop it.

    It runs in real time with the default limits of the guards. If the machine is too slow for
    them, the torque goes off, and the measurement continues with commands of zero force. Raises
    RobotError if the graph does not start or a node ends, Interrupted after Ctrl-C.
    """
    load = os.getloadavg()[0]
    extra = [word for node in topics.COMPOSED.parts
             for word in ("-p", f"{node}:rate:={float(case.rate)}")]  # fmt: skip
    extra.append("--disable-stdout-logs")
    nodes = GraphRun(extra=extra, composed=case.processes == COMPOSED, wall_clock=True)
    port = free_port()

    def beside(graph: GraphRun) -> None:
        if case.page:
            graph.add(BRIDGE, *bridge_words(graph, port, file_games=False))

    with ExitStack() as stack:
        robot, graph = stack.enter_context(running("bench", Console(quiet=True), nodes, beside))
        counters = _Counters(robot)
        enabled = _enable(robot)
        page = None
        if case.page:
            token = tokens_in(token_file(graph)).patient
            page = stack.enter_context(PageReader(f"http://127.0.0.1:{port}", token))
            robot.wait_until(lambda: page.received, _HEARD_S, "the page reads nothing")
        robot.pause(_SETTLE_S)
        begin = counters.read(graph.pids, page)
        robot.pause(seconds)
        end = counters.read(graph.pids, page)
        state = robot.state(AmplifierState)
        enabled = enabled and state is not None and state.enabled
    found = figures(begin, end)
    if case.page:
        found[PAGE] = (end.read - begin.read) / (end.seconds - begin.seconds)
    return Run(found, processor_shares(begin, end), load, enabled)


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

    def read(self, pids: dict[str, int], page: PageReader | None) -> Counts:
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


def measure_steps(case: StepCase, seconds: float) -> StepRun:
    """Start the whole graph in lock step, move the hand for `seconds` of simulated time, stop it.

    Raises RobotError if the graph does not start or a node ends, Interrupted after Ctrl-C.
    """
    quiet = Console(quiet=True)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="screw_module_bench-"))
        extra = [*recordings_in(Path(folder)), "-p", "sim_rig:speed:=0.0"]
        nodes = GraphRun(
            extra=[*extra, "--disable-stdout-logs"],
            composed=case.processes == COMPOSED,
            without=() if case.recorder else (_RECORDER,),
        )
        robot, run = stack.enter_context(running("bench", quiet, nodes))
        make_ready(robot, quiet)
        robot.set_arm(arm(amplitude=_STROKE.amplitude, omega=_STROKE.omega))
        if case.recorder:
            robot.start_recording()
        robot.pause(1.0)
        begin, begin_ns, begun_s = _used(run.pids), robot.clock.now_ns(), time.monotonic()
        robot.pause(seconds)
        simulated_s = (robot.clock.now_ns() - begin_ns) * 1e-9
        factor = simulated_s / (time.monotonic() - begun_s)
        end = _used(run.pids)
        if case.recorder:
            robot.stop_recording()
    each = {name: [(after - before) / (simulated_s * 1e3) for before, after in
                   zip(begin[name], end[name], strict=True)] for name in begin}  # fmt: skip
    return StepRun(
        factor,
        {name: 1e3 * spent for name, (spent, _) in each.items()},
        {name: count for name, (_, count) in each.items()},
    )


def _used(pids: Mapping[str, int]) -> dict[str, tuple[float, int]]:
    return {name: (processor_time(pid), switches(pid)) for name, pid in pids.items()}


# The whole robot in one thread --------------------------------------------------------------------


def calls_by_room(ticks: int = 1000) -> dict[str, float]:
    """Return the Python calls of a tick by room, of the whole robot enabled in one thread.

    Counted in simulated time, so the same at each run of one version of Python. `trials` is the
    harness, with its buses; what is not of this package stands under the name of its file.
    """
    bench = Bench(seed=3)
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
    rooms: Counter[str] = Counter()
    for file, count in files.items():
        within = file.rpartition("/screw_module_ros/")[2]
        rooms[within.partition("/")[0] if within != file else Path(file).name] += count
    return {room: count / ticks for room, count in rooms.most_common()}


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


def figures(begin: Counts, end: Counts) -> dict[str, float]:
    """Return the figures of the window between two counts: latencies [us], shares [%].

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
    shares = {"p50": 0.5, "p99": 0.99}
    return {
        **{name: quantile(latency, share) * 1e6 for name, share in shares.items()},
        "p99.9": quantile(latency, 0.999) * 1e6,
        "late": 100.0 * late / (written + lost),
        "lost": 100.0 * lost / (written + lost),
        **{f"answer {name}": quantile(answer, share) * 1e6 for name, share in shares.items()},
        **{f"own {name}": quantile(own, share) * 1e6 for name, share in shares.items()},
        "rate": written / (end.seconds - begin.seconds),
    }


def processor_shares(begin: Counts, end: Counts) -> dict[str, float]:
    """Return the processor time of each process [% of one core]."""
    elapsed = end.seconds - begin.seconds
    return {
        name: 100.0 * (end.processor[name] - used) / elapsed
        for name, used in begin.processor.items()
    }


# The in-process loop ------------------------------------------------------------------------------


def speeds(runs: int, pool: ProcessPoolExecutor, cores: int) -> list[Speed]:
    """Measure every trial on one core and on `cores` in parallel, `runs` times each."""
    found = []
    for name in LOOP_TRIALS:
        alone = [pool.submit(one_run, name).result() for _ in range(runs)]
        found.append(Speed(name, 1, tuple(sorted(alone))))
    for name in LOOP_TRIALS:
        together = []
        for _ in range(runs):
            futures = [pool.submit(one_run, name) for _ in range(cores)]
            together.append(sum(future.result() for future in futures))
        found.append(Speed(name, cores, tuple(sorted(together))))
    return found


def one_run(name: str) -> float:
    """Return simulated over real time of one run, after a short warm-up run.

    Compiled plant, drivers' scaling, law and arm at 2 kHz samples with the plant's substeps.
    """
    bench, trial = InProcessBench(load_world()), LOOP_TRIALS[name]
    if isinstance(trial, StageTrial):
        bench.record(trial._replace(end=trial.start + 0.001), lambda share: None)
    else:
        bench.record(trial._replace(duration=0.1), lambda share: None)
    begun = time.perf_counter()
    samples = bench.record(trial, lambda share: None)
    return float(samples.time[-1]) / (time.perf_counter() - begun)


# Tables and JSON ----------------------------------------------------------------------------------


def spreads(runs: Sequence[Mapping[str, float]]) -> dict[str, Spread]:
    """Return median, lowest and highest of each figure over runs."""
    found = {name: sorted(run[name] for run in runs) for name in runs[0]}
    return {name: Spread(median(all_), all_[0], all_[-1]) for name, all_ in found.items()}


def verdict(case: Case, figure: str, value: float) -> str:
    """Return `yes` or `MISSED` for a figure with a limit in this case, else an empty text."""
    if figure not in case.wanted:
        return ""
    return "yes" if value <= case.wanted[figure] else "MISSED"


def timing_table(measured: Measured) -> Table:
    """Return latencies and shares of each case: median (range) and limit."""
    table = _table("SYNC to drive write, median (range) of the runs", ("processes", "figure"),
                   "processes", "rate", "figure", "found", "wanted", "")  # fmt: skip
    for case, runs in measured.items():
        found = spreads([run.figures for run in runs])
        names = (*TIMING, *PARTS, *((PAGE,) if case.page else ()))
        for name in names:
            unit = UNITS.get(name, "us")
            limit = f"{case.wanted[name]:g} {unit}" if name in case.wanted else ""
            table.add_row(
                case.title, f"{case.rate} Hz", name, f"{_spread_text(found[name], unit)} {unit}",
                limit, verdict(case, name, found[name].median), end_section=name == names[-1],
            )  # fmt: skip
    return table


def page_table(measured: Measured) -> Table | None:
    """Return what bridge and page change, beside how much the runs without differ; None without."""
    table = _table(
        "web_bridge and one page: medians of runs in turn, (range) of those without",
        ("processes", "figure"),
        "processes", "rate", "figure", "without", "with", "difference", "within range",
    )  # fmt: skip
    for case, runs in measured.items():
        bare = measured.get(case._replace(page=False), ())
        if not (case.page and bare):
            continue
        without, found = (spreads([run.figures for run in each]) for each in (bare, runs))
        for name in TIMING:
            unit, before, after = UNITS.get(name, "us"), without[name], found[name].median
            table.add_row(
                case.processes, f"{case.rate} Hz", name,
                f"{_spread_text(before, unit)} {unit}", f"{_number_text(after, unit)} {unit}",
                f"{_number_text(after - before.median, unit, '+')} {unit}",
                "yes" if after <= before.high else "ABOVE", end_section=name == TIMING[-1],
            )  # fmt: skip
    return table if table.row_count else None


def processor_table(measured: Measured) -> Table:
    """Return the processor time of each process, and the machine's load before the runs."""
    titles = [f"{case.title} {case.rate} Hz" for case in measured]
    title = "Processor time, % of one core, median (range)"
    table = _table(title, ("process",), "process", *titles)
    shares = [spreads([_with_sum(run.processor) for run in runs]) for runs in measured.values()]
    names = dict.fromkeys(name for found in shares for name in found if name != _SUM)
    for name in (*names, _SUM):
        cells = (_spread_text(found[name], "cpu") if name in found else "" for found in shares)
        table.add_row(name, *cells)
    loads = (spreads([{"load": run.load} for run in runs])["load"] for runs in measured.values())
    table.add_row("load average before", *(_spread_text(load, "%") for load in loads))
    enabled = (f"{sum(run.enabled for run in runs)} of {len(runs)}" for runs in measured.values())
    table.add_row("runs enabled throughout", *enabled)
    return table


def step_tables(stepped: Stepped) -> list[Table]:
    """Return the tables of the runs in lock step: factor, processor time and switches."""
    title = "Lock step, as fast as it goes, median (range)"
    factors = _table(title, ("processes",), "processes", "x real time", "wanted", "",
                     "processor, ms a tick", "wanted", "")  # fmt: skip
    for case, runs in stepped.items():
        least, most = WANTED_STEPS.get(
            (case.processes, case.recorder), (math.nan, math.nan)
        )
        factor = spreads([{_SUM: run.factor} for run in runs])[_SUM]
        whole = spreads([_with_sum(run.processor) for run in runs])[_SUM]
        factors.add_row(
            case.title,
            _spread_text(factor, "%"), _limit(least), _met(factor.median >= least, least),
            _spread_text(whole, "%"), _limit(most), _met(whole.median <= most, most),
        )  # fmt: skip
    shares = _table(
        "A tick of 1 ms by process: processor time in ms, voluntary context switches; medians",
        ("process",), "process", *(case.title for case in stepped),
    )  # fmt: skip
    spent = {case: spreads([_with_sum(run.processor) for run in runs])
             for case, runs in stepped.items()}  # fmt: skip
    slept = {case: spreads([_with_sum(run.switches) for run in runs])
             for case, runs in stepped.items()}  # fmt: skip
    names = dict.fromkeys(name for found in spent.values() for name in found if name != _SUM)
    for name in (*names, _SUM):
        shares.add_row(name, *(
            f"{spent[case][name].median:.2f}, {slept[case][name].median:.1f}"
            if name in spent[case] else "" for case in stepped
        ))  # fmt: skip
    return [factors, shares]


def calls_table(calls: Mapping[str, float]) -> Table:
    """Return the table of Python calls."""
    total = sum(calls.values())
    title = f"Python calls of a tick of {PERIOD_NS * 1e-6:g} ms, the whole robot in one thread"
    table = _table(title, ("room",), "room", "calls", "wanted", "")
    for room, count in calls.items():
        table.add_row(room, f"{count:.1f}")
    table.add_row(_SUM, f"{total:.1f}", f"{WANTED_CALLS:g}", _met(total <= WANTED_CALLS, total))
    return table


def _limit(value: float) -> str:
    return "" if math.isnan(value) else f"{value:g}"


def _met(met: bool, wanted: float) -> str:
    return "" if math.isnan(wanted) else "yes" if met else "MISSED"


def loop_table(found: list[Speed]) -> Table:
    """Return the table of the in-process loop."""
    table = _table("In-process loop, 2 kHz samples, substeps of 50 us", ("trial",), "trial",
                   "cores", "x real time", "range", "wanted", "")  # fmt: skip
    for speed in found:
        low, high = speed.factors[0], speed.factors[-1]
        wanted = WANTED_FACTOR.get(speed.cores, math.nan)
        table.add_row(
            speed.trial, str(speed.cores), f"{speed.median:.0f}", f"{low:.0f}..{high:.0f}",
            _limit(wanted), _met(speed.median >= wanted, wanted),
        )  # fmt: skip
    return table


def write(content: Mapping[str, Any], file: Path) -> None:
    """Write what was measured so far."""
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def content_of(
    measured: Measured,
    seconds: float,
    loop: list[Speed],
    stepped: Stepped | None = None,
    calls: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Return the content of the JSON file; an infinite latency becomes null."""
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "cores": len(os.sched_getaffinity(0)),
        "graph": [
            {
                **case._asdict(),
                "seconds": seconds,
                "wanted": case.wanted,
                "median_low_high": {
                    name: [_finite(value) for value in spread]
                    for name, spread in spreads([run.figures for run in runs]).items()
                },
                "processor_median_low_high": spreads([_with_sum(run.processor) for run in runs]),
                "runs": [
                    {**run._asdict(), "figures": {n: _finite(v) for n, v in run.figures.items()}}
                    for run in runs
                ],
            }
            for case, runs in measured.items()
        ],
        "lock_step": [
            {**case._asdict(), "runs": [run._asdict() for run in runs]}
            for case, runs in (stepped or {}).items()
        ],
        "calls_by_room": dict(calls or {}),
        "in_process_loop": [{**speed._asdict(), "median": speed.median} for speed in loop],
    }


def _table(title: str, left: Sequence[str], *names: str) -> Table:
    """Return a table; left: columns of words, the others are of numbers."""
    table = Table(title=title, title_justify="left")
    for name in names:
        table.add_column(name, justify="left" if name in left else "right")
    return table


def _with_sum(processor: Mapping[str, float]) -> dict[str, float]:
    return {**processor, _SUM: sum(processor.values())}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _spread_text(spread: Spread, unit: str) -> str:
    middle, low, high = (_number_text(value, unit) for value in spread)
    return f"{middle} ({low}..{high})"


def _number_text(value: float, unit: str, sign: str = "") -> str:
    return f"{value:{sign}.{2 if unit == '%' else 0}f}"
