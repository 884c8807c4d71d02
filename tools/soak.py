# SPDX-License-Identifier: Apache-2.0
"""`make soak`: a long recorded run of the whole robot that checks for leaks and lost samples.

Every node runs as a process of its own against the simulated rig. The simulated patient moves and
the mode changes periodically. Every few seconds the program samples the resources of each process
and, by wall clock, the latency of the commands. At the end it audits the bag: no quantity may grow
(a robust slope against a bound), nothing may be lost. All durations are in the robot's time;
simulated time passes as fast as the machine allows.

With --protocol the processes are those of `therapy`, a therapy session runs to its end in place of
the modes, and the audit computes it again from the bag.
"""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from matplotlib.figure import Figure
from rich.table import Table
from scipy.stats import theilslopes
from screw_module_msgs.msg import AmplifierState, TherapyState
from screw_module_msgs.srv import StartTherapy

from bench import FiniteRange, PageReader, free_port
from screw_module_ros.bridge.rights import ROLES, SUBSCRIBE
from screw_module_ros.bridge.tokens import tokens_in
from screw_module_ros.clock import WallClock
from screw_module_ros.control.laws import names
from screw_module_ros.figure_style import COLOURS, save
from screw_module_ros.graph import WHOLE
from screw_module_ros.nodes.support import topics
from screw_module_ros.operator.bring_up import bring_up
from screw_module_ros.operator.robot import Robot, RobotError, arm
from screw_module_ros.recording.pseudonym import new_pseudonym
from screw_module_ros.recording.verify import Report, verify
from screw_module_ros.terminal import Console, output_option
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.trials import therapy
from screw_module_ros.trials.demo import AMPLITUDE, OMEGA, SPRING, make_ready
from screw_module_ros.trials.patient import Hand
from screw_module_ros.trials.runner import GraphRun, command, new_folder, recordings_in, running

WARM_UP_S = 60.0
_SHARE_OF_WARM_UP = 0.2  # share of a short run
_LEAST = 5  # samples for a slope
_PAGES = 2.0  # MiB; normal variation of a heap, also in a short run
_MODES = tuple(reversed(names()))
_QUICK_S, _QUICK_EVERY, _QUICK_CHANGE = 20.0, 1.0, 3.0
_STEP_S = 0.02
_PATH_S = 9.0  # once around in the plane
_RADIUS = 0.06  # [m]
_AS_FAST_AS_IT_GOES = ["-p", "sim_rig:speed:=0.0"]
_SHARED = "/dev/shm/"
_WALL = WallClock()


class Bound(NamedTuple):
    """Allowed growth of a quantity over the run: a share of its median, but at least `least`.

    per_hour: `least` is per hour of the wall clock, by which the recorder flushes, not per run.
    """

    unit: str
    share: float
    least: float
    per_hour: bool = False


# Memory: the recorder keeps an index of the open file, and Python's heap varies. Counts must not
# grow at all: a leak adds at least one. Latency depends on the machine's load.
BOUNDS = {
    "memory": Bound("MiB", 0.0, 12.0, per_hour=True),
    "handles": Bound("", 0.0, 0.5),
    "threads": Bound("", 0.0, 0.5),
    "shared": Bound("", 0.0, 0.5),
    "latency p50": Bound("us", 0.1, 50.0),
    "latency p99": Bound("us", 0.25, 200.0),
    "waiting": Bound("messages", 0.0, 1000.0),
}


class Sample(NamedTuple):
    """Sample at a time [s] since the start; values by (process or "robot", quantity)."""

    time: float
    values: dict[tuple[str, str], float]


class Trend(NamedTuple):
    """Trend of one quantity; growth: of the Theil-Sen line over the run.

    low, high: 95 % interval of the growth. bound: allowed growth. All in the quantity's unit.
    """

    of: str
    quantity: str
    first: float
    last: float
    growth: float
    low: float
    high: float
    bound: float

    @property
    def flat(self) -> bool:
        """Whether the growth is within the bound, or not significant."""
        return self.growth <= self.bound or self.low <= 0.0


class Line(NamedTuple):
    """One check: its name, whether it passed, and the figures."""

    text: str
    good: bool
    detail: str


@command("soak")
@click.option("--minutes", default=10.0, type=FiniteRange(0.1, 6000.0), help="Duration.")
@click.option("--protocol", default="", help="Instead a session of this protocol to its end.")
@click.option("--quick", is_flag=True, help=f"Run only {_QUICK_S:g} s.")
@click.option("--every", default=5.0, type=FiniteRange(0.5, 600.0), help="Sampling period [s].")
@click.option("--change", default=20.0, type=FiniteRange(2.0, 3600.0),
              help="Period of the mode changes [s].")  # fmt: skip
@output_option("soak_output")
@click.option("--keep-bag/--drop-bag", default=False, help="Keep the recording afterwards.")
@click.option("--params", type=click.Path(exists=True, dir_okay=False), help="Parameter file.")
@click.option("--wall-clock", is_flag=True, help="The simulated rig runs in real time.")
@click.option("--strict", is_flag=True, help="Exit with 3 if a check fails.")
def soak(
    console: Console, minutes: float, protocol: str, quick: bool, every: float, change: float,
    folder: Path, keep_bag: bool, params: str | None, wall_clock: bool, strict: bool,
) -> bool:  # fmt: skip
    """Run the robot for a long time; report leaks, growing latency and lost samples."""
    seconds = 60.0 * minutes
    if quick:
        seconds, every, change = _QUICK_S, min(every, _QUICK_EVERY), min(change, _QUICK_CHANGE)
    run = new_folder(folder, console)
    patient = new_pseudonym() if protocol else ""
    name = f"{patient}_{Path(protocol).stem}_{run.name}" if protocol else "session"
    extra = ["--disable-stdout-logs", "-p", f"session_recorder:name:={name}", *recordings_in(run)]
    extra += [] if wall_clock else _AS_FAST_AS_IT_GOES
    shared = WHOLE if protocol else None
    nodes = GraphRun(params, extra=extra, wall_clock=wall_clock, shared=shared)
    port = free_port()
    beside = therapy.with_pages(port) if protocol else lambda graph: None
    with ExitStack() as stack:
        robot, graph = stack.enter_context(running("soak", console, nodes, beside))
        ready = therapy.make_ready if protocol else make_ready
        work = Work(robot, graph, ready(robot, console))
        bag = robot.start_recording()
        begun_ns = _WALL.now_ns()
        if protocol:
            open_pages(graph, port, stack)
            with console.progress(f"session of {protocol}", 1.0) as passed:
                work.treat(protocol, patient, every, passed)
        else:
            with console.progress(f"working for {seconds:g} s", seconds) as passed:
                work.carry_out(seconds, every, change, passed)
        seconds = work.samples[-1].time
        factor = seconds / (1e-9 * (_WALL.now_ns() - begun_ns))
        with console.step("torque off, recording closed"):
            work.finish()
    with console.step("counting the bag anew"):
        audit = verify(bag)
    found = trends(work.samples, factor)
    lines = verdicts(found, audit, work.recorder, work.stops)
    for session in read_sessions(bag) if protocol else ():
        again = replayed(session)
        lines.append(Line("session computed again", not again.problems, again.verdict))
    figure = draw(work.samples, run / "soak.png")
    told = content(
        work.samples, found, lines,
        date=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        python=platform.python_version(), cores=len(os.sched_getaffinity(0)),
        seconds=seconds, wall_clock=wall_clock,
        real_time_factor=factor, modes_changed=work.changes, stops=work.stops,
        bag={name: count._asdict() for name, count in audit.topics.items()},
        bag_size=sum(path.stat().st_size for path in bag.glob("*")),
    )  # fmt: skip
    file = run / "soak.json"
    file.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    if not keep_bag:
        shutil.rmtree(bag)
    text = f"Real-time factor {factor:.2f}: {seconds:g} s of the robot's time."
    console.show(table(lines), text, f"Figure: {figure}", f"As JSON: {file}")
    return all(line.good for line in lines)


def open_pages(graph: GraphRun, port: int, stack: ExitStack) -> None:
    """Read what the patient's and the therapist's page read, until `stack` closes."""
    tokens = tokens_in(therapy.token_file(graph))
    for role, token in tokens.items():
        topics_of = ROLES[role][SUBSCRIBE]
        stack.enter_context(PageReader(f"http://127.0.0.1:{port}", token, topics_of))


class Work:
    """What happens during a soak. samples: of the resources; stops: times and reasons of
    torque-off events; recorder: losses that the recorder reports; changes: of the mode."""

    def __init__(self, robot: Robot, graph: GraphRun, hand: Hand):
        self.samples: list[Sample] = []
        self.stops: list[str] = []
        self.recorder: dict[str, int] = {}
        self.changes = 0
        self._robot, self._graph, self._hand = robot, graph, hand
        self._waiting = math.nan
        self._begun_ns = 0
        robot.node.create_subscription(
            DiagnosticStatus, "session_recorder/status", self._on_status, topics.STATE
        )

    def carry_out(
        self, seconds: float, every: float, change: float, passed: Callable[[float], None]
    ) -> None:
        """Let hand and game move for `seconds`; sample and change the mode periodically [s]."""
        robot = self._robot
        robot.set_arm(arm(target=(0.0, 0.0, SPRING.centre), duration=1.0,
                          amplitude=(0.03, 0.03, AMPLITUDE), omega=(0.5, 0.7, OMEGA)))  # fmt: skip
        change_due = 0.0
        for now in self._steps(every):
            if now >= seconds:
                return
            angle = math.tau * now / _PATH_S
            robot.set_setpoint(
                _RADIUS * math.cos(angle), _RADIUS * math.sin(angle), SPRING.centre
            )
            if now >= change_due:
                change_due += change
                self._change()
            passed(now)

    def treat(
        self, protocol: str, patient: str, every: float, passed: Callable[[float], None]
    ) -> None:
        """Carry out a session with a healthy patient until it ends, or pauses by itself."""
        states: list[TherapyState] = []
        self._robot.node.create_subscription(
            TherapyState, "therapy/state", states.append, topics.STATE
        )
        request = StartTherapy.Request(protocol=protocol, patient=patient)
        self._robot.ask(StartTherapy, f"{therapy.SESSION}/start", request)
        for _ in self._steps(every):
            state = states[-1] if states else TherapyState()
            del states[:-1]
            if state.state == TherapyState.IDLE:
                continue
            if state.state != TherapyState.RUNNING:
                self.stops += [state.reason] if state.reason else []
                return
            passed(state.trial / state.trials)

    def _steps(self, every: float) -> Iterator[float]:
        """Yield the time since the start of the run [s] in steps; sample the resources."""
        self._begun_ns = self._robot.clock.now_ns()
        look_due = 0.0
        while True:
            now = self._passed()
            if now >= look_due:
                look_due += every
                self._look(now)
            yield now
            self._robot.pause(_STEP_S)

    def finish(self) -> None:
        """Switch the torque off and close the bag; nodes without an answer do so on shutdown."""
        try:
            self._robot.stop_recording()
            self._robot.enable_plane(False)
            self._robot.enable(False)
        except RobotError as error:
            self._graph.watch()
            self.stops.append(f"at the end: {error}")

    def _passed(self) -> float:
        """Return the time since the start of the run, by the robot's clock [s]."""
        return 1e-9 * (self._robot.clock.now_ns() - self._begun_ns)

    def _look(self, now: float) -> None:
        values = {
            (name, quantity): value
            for name, pid in self._graph.pids.items()
            for quantity, value in usage(pid).items()
        }
        state = self._robot.state(AmplifierState)
        if state is not None and state.enabled and not self._robot.clock.simulated:
            values["robot", "latency p50"] = state.latency_p50 * 1e6
            values["robot", "latency p99"] = state.latency_p99 * 1e6
        values["session_recorder", "waiting"] = self._waiting
        self.samples.append(Sample(now, values))

    def _change(self) -> None:
        """Change the mode; if the torque is off, note the reason and bring the robot up again.

        A failure, which a busy machine can cause by wall clock, is noted; the next call retries.
        """
        mode = _MODES[self.changes % len(_MODES)]
        try:
            self._robot.set_mode(mode)
            self.changes += 1
            self._robot.check_enabled()
        except RobotError as error:
            self._note(error)
            try:
                bring_up(self._robot, mode, self._hand)
            except RobotError as again:
                self._note(again)

    def _note(self, error: RobotError) -> None:
        self._graph.watch()  # a retry cannot help if a node has ended
        self.stops.append(f"after {self._passed():.0f} s: {error}")

    def _on_status(self, status: DiagnosticStatus) -> None:
        values = {value.key: value.value for value in status.values}
        self._waiting = float(values.get("waiting", "nan"))
        counted = [json.loads(text) for name, text in values.items() if name.startswith("/")]
        self.recorder = {
            "messages": int(values.get("messages", 0)),
            "dropped": int(values.get("dropped", 0)),
            "missed": sum(max(0, counts.get("missed", 0)) for counts in counted),
            "lost": sum(counts.get("lost", 0) for counts in counted),
        }


def usage(pid: int) -> dict[str, float]:
    """Return the resources of a process, from /proc. Raises OSError if it has ended.

    memory: pages of its own in memory (RssAnon) [MiB]; handles: open files; threads; shared:
    distinct files of /dev/shm that it has mapped.
    """
    folder = Path(f"/proc/{pid}")
    status = dict(
        line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line
    )
    if "VmRSS" not in status:
        raise ProcessLookupError(f"process {pid} has ended")
    mapped = (folder / "maps").read_text().splitlines()
    return {
        "memory": int(status["RssAnon"].split()[0]) / 1024.0,
        "handles": sum(1 for _ in (folder / "fd").iterdir()),
        "threads": int(status["Threads"]),
        "shared": len({line[line.index(_SHARED) :] for line in mapped if _SHARED in line}),
    }


# Trends and checks --------------------------------------------------------------------------------


def trends(samples: Sequence[Sample], factor: float = 1.0) -> list[Trend]:
    """Return the trend of every quantity after the warm-up that has enough samples.

    factor: of real time, at which the robot's time passed.
    """
    if not samples:
        return []
    duration = samples[-1].time - samples[0].time
    begin = samples[0].time + min(WARM_UP_S, _SHARE_OF_WARM_UP * duration)
    kept = [sample for sample in samples if sample.time >= begin]
    names = dict.fromkeys(name for sample in kept for name in sample.values)
    return [found for name in names if (found := _trend(name, kept, factor)) is not None]


def _trend(name: tuple[str, str], samples: Sequence[Sample], factor: float) -> Trend | None:
    seen = [(sample.time, sample.values.get(name, math.nan)) for sample in samples]
    points = [point for point in seen if math.isfinite(point[1])]
    if len(points) < _LEAST:
        return None
    times, values = np.array(points).T
    span = float(times[-1] - times[0])
    fit = theilslopes(values, times, 0.95)
    bound = BOUNDS[name[1]]
    least = bound.least * span / (3600.0 * factor) if bound.per_hour else bound.least
    allowed = max(bound.share * float(np.median(values)), least)
    allowed = max(allowed, _PAGES) if bound.unit == "MiB" else allowed
    third = max(1, len(values) // 3)
    first, last = float(np.median(values[:third])), float(np.median(values[-third:]))
    growth, low, high = (float(slope) * span for slope in (fit[0], fit[2], fit[3]))
    return Trend(*name, first, last, growth, low, high, allowed)


def verdicts(
    found: Sequence[Trend], audit: Report, recorder: dict[str, int], stops: Sequence[str]
) -> list[Line]:
    """Return the checks of the soak; recorder: its last `dropped` and `missed` counts."""
    lines = []
    for quantity, bound in BOUNDS.items():
        these = [trend for trend in found if trend.quantity == quantity]
        if not these:
            continue
        worst = max(these, key=lambda trend: trend.growth - trend.bound)
        detail = (
            f"worst: {worst.of} {worst.first:.4g} to {worst.last:.4g} {bound.unit}, "
            f"grew {worst.growth:+.2g} (allowed {worst.bound:.2g})"
        )
        lines.append(Line(f"{quantity} flat", all(trend.flat for trend in these), detail))
    counts = audit.topics.values()
    messages = sum(count.messages for count in counts)
    missed = sum(max(0, count.missed) for count in counts)
    dropped = sum(count.dropped for count in counts)
    # The first check counts the gaps in the tick numbers that the recorder caused.
    skipped = {n: c.lost - max(0, c.missed) for n, c in audit.topics.items()}
    skipped = {name: number for name, number in skipped.items() if number > 0}
    lost = sum(skipped.values())
    reported = f"it reported {recorder.get('missed', 0)} and {recorder.get('dropped', 0)}"
    lines.append(
        Line("recorder lost nothing", not missed + dropped,
             f"of {messages} messages {missed} not received, {dropped} not written ({reported})")
    )  # fmt: skip
    share = lost / (messages + missed + lost) if lost else 0.0
    where = ", ".join(f"{name} {number}" for name, number in skipped.items())
    text = f"{lost} tick numbers ({share:.3%}) were skipped by the robot" if lost else "0 skipped"
    lines.append(Line("zero lost samples", not lost, f"{text}{': ' if where else ''}{where}"))
    other = [problem for problem in audit.problems if problem not in audit.losses]
    lines.append(Line("bag sound", not other, "; ".join(other[:3]) or "hashes and counts fit"))
    lines.append(Line("torque stayed on", not stops, "; ".join(stops[:3]) or "no stop"))
    return lines


def table(lines: Sequence[Line]) -> Table:
    """Return the checks as a table."""
    made = Table(title="Soak", title_justify="left")
    for column in ("wanted", "", "figures"):
        made.add_column(column)
    for line in lines:
        made.add_row(line.text, "yes" if line.good else "MISSED", line.detail)
    return made


def content(
    samples: Sequence[Sample], found: Sequence[Trend], lines: Sequence[Line], **more: Any
) -> dict[str, Any]:
    """Return the content of the JSON file."""
    return {
        **more,
        "verdicts": [line._asdict() for line in lines],
        "bounds": {name: bound._asdict() for name, bound in BOUNDS.items()},
        "trends": [{**trend._asdict(), "flat": trend.flat} for trend in found],
        "samples": [
            {"time": sample.time, **{" ".join(n): v for n, v in sample.values.items() if v == v}}
            for sample in samples
        ],
    }


def draw(samples: Sequence[Sample], file: Path) -> Path:
    """Draw memory, handles, latency if it was sampled, and the recorder's queue over time."""
    noted = {quantity for sample in samples for _, quantity in sample.values}
    panels = [panel for panel in (
        ("memory of each process [MiB]", ("memory",)),
        ("file handles of each process", ("handles",)),
        ("latency, SYNC to drive write [us]", ("latency p50", "latency p99")),
        ("messages waiting for the disk", ("waiting",)),
    ) if noted.intersection(panel[1])]  # fmt: skip
    figure = Figure(figsize=(8.0, 2.25 * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (title, quantities) in zip(axes, panels, strict=True):
        names = dict.fromkeys(n for s in samples for n in s.values if n[1] in quantities)
        for number, name in enumerate(names):
            style = "-" if number < len(COLOURS) else "--"
            axis.plot(
                [sample.time / 60.0 for sample in samples],
                [sample.values.get(name, math.nan) for sample in samples],
                style, color=COLOURS[number % len(COLOURS)],
                label=name[0] if len(quantities) == 1 else name[1],
            )  # fmt: skip
        axis.set_title(title)
        axis.set_ylim(bottom=0.0)
        if len(names) > 1:
            axis.legend(ncols=2, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlabel("time [min]")
    return save(figure, file)


if __name__ == "__main__":
    soak()
