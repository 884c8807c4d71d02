# SPDX-License-Identifier: Apache-2.0
"""`demo`: the whole robot against the simulated rig: a table, two figures and a moving picture.

Every node runs as a process of its own. A simulated patient (the arm of the thesis's simulation,
6.4.3) moves the handle through a spring of 100 N/m about 0.18 m in three modes, and then holds it
still, while the plane makes a centre-out reach. All three modes have the same spring and damper.
The offset of figure, table and results.yaml is one: from the spring alone, the line of the figure.
The recorder writes all topics; the table uses only the bag.
"""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import yaml
from matplotlib.figure import Figure
from rich.table import Table
from screw_module_msgs.msg import ForceCommand

from screw_module_ros import graph
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.drawing import Path3D, Trace, force_position, path_views
from screw_module_ros.figure_style import save
from screw_module_ros.offset import (
    MOTION_THRESHOLD,
    Offsets,
    Spring,
    common_ticks,
    offset_held,
    offsets,
)
from screw_module_ros.recording.bag import BagError
from screw_module_ros.recording.counts import Counts
from screw_module_ros.recording.decoded import columns
from screw_module_ros.recording.records import notes

from ..nodes.bringup import shared_process
from ..operator.robot import Robot, arm
from ..plant.patient import HandPath, hand_point
from ..terminal import Console, output_option
from .moving_picture import moving_picture
from .patient import STILL, Hand, centre_out, ready, targets
from .runner import GraphRun, command, new_folder, recordings_in, running

SPRING = Spring(stiffness=100.0, centre=0.18)
COMMANDED = SPRING._replace(
    damping=float(math.ceil(VerticalSettings(stiffness=SPRING.stiffness).least_damping))
)
"""Spring and damper of all three modes. OBSERVER refuses a smaller damper; the thesis has none."""
ARM_MASS, ARM_STIFFNESS, ARM_DAMPING = 3.0, 300.0, 5.0  # [kg], [N/m], [Ns/m]
AMPLITUDE, OMEGA = 0.15, 0.8  # of the virtual hand [m], [rad/s]
CYCLE_S = 2.0 * math.pi / OMEGA
PLANE_STIFFNESS, PLANE_DAMPING = 100.0, 10.0  # [N/m], [Ns/m], typical for MANUS
IN_TIME = 0.99
_LEAVE = math.nan
_SETPOINT_PERIOD_S = 0.02  # period of a game that publishes 50 frames per second
_CHECK_EVERY = 12  # set points
_SETTLE_S, _RETURN_S = 0.8, 1.5
_STOP_S, _HOLD_S = 0.7, 1.0  # the hand comes to rest, and holds still
_ENCODER, _FORCE = f"/{graph.ENCODER}", f"/{graph.FORCE}"
_DRIVE, _ENDPOINT = f"/{graph.AMPLIFIER_STATE}", f"/{graph.ENDPOINT_STATE}"


class Mode(NamedTuple):
    """A control mode of the demo, and its acceptance.

    number: constant of ForceCommand; thesis: its figure; low, high: bounds of the mean offset from
    the spring in motion [N].
    """

    number: int
    thesis: str
    low: float
    high: float

    @property
    def wanted(self) -> str:
        """The bounds as text."""
        return f"{self.low:g} to {self.high:g} N" if self.low else f"below {self.high:g} N"


IMPEDANCE = "1 impedance"
FORCE_FEEDBACK = "3 force feedback"
OBSERVER = "5 observer"
MODES = {
    IMPEDANCE: Mode(ForceCommand.IMPEDANCE, "about 10 N (fig 6-1)", 7.0, 13.0),
    FORCE_FEEDBACK: Mode(ForceCommand.FORCE_FEEDBACK, "about 2 N (fig 6-10)", 0.0, 3.0),
    OBSERVER: Mode(ForceCommand.OBSERVER, "proposed (6.4.4)", 0.0, 1.0),
}


class Span(NamedTuple):
    """A stretch of a session: its name, begin and end on the system clock [ns since the epoch]."""

    name: str
    begin_ns: int
    end_ns: int


class Work(NamedTuple):
    """What the hand did in one mode: it moved, and then it held still.

    targets: of its movements in the plane, x, y [m].
    """

    moving: Span
    holding: Span
    targets: Sequence[tuple[float, float]]

    @property
    def name(self) -> str:
        """Name of the mode."""
        return self.moving.name

    @property
    def whole(self) -> Span:
        """Both, with the stop between them."""
        return self.moving._replace(end_ns=self.holding.end_ns)


class Timing(NamedTuple):
    """Commands to the vertical drive over one stretch of time.

    duration [s]; rate: commands written per second [1/s].
    commands: written; late: of these, written more than one period after their SYNC; lost: ticks
    without a command.
    p50, p99: latency SYNC -> drive write [s]: median over time of the percentiles of each second;
    worst_p99: largest p99 of a second [s].
    """

    duration: float
    rate: float
    commands: int
    late: int
    lost: int
    p50: float
    p99: float
    worst_p99: float

    @property
    def in_time(self) -> float:
        """Share of the ticks whose command was written within its deadline [0..1]."""
        ticks = self.commands + self.lost
        return (self.commands - self.late) / ticks if ticks else math.nan


class Results(NamedTuple):
    """Results of the demo; traces, offsets and paths are in the order of its parts.

    traces, offsets: in motion, from the spring; undamped: the same, from spring and damper; held:
    mean of |offset| while the hand holds still [N]. bag: folder of the recording, None if it was
    deleted. factor: simulated seconds per second, None for a run by wall clock.
    """

    parts: Sequence[Work]
    traces: list[Trace]
    offsets: list[Offsets]
    undamped: list[Offsets]
    held: list[float]
    paths: list[Path3D]
    timing: Timing
    counts: dict[str, Counts]
    bag: Path | None
    files: list[Path]
    factor: float | None = None

    @property
    def accepted(self) -> bool:
        """Whether every figure is within its limits."""
        met = [_met(part, found) for part, found in zip(self.parts, self.offsets, strict=True)]
        complete = self.factor is None or all(count.complete for count in self.counts.values())
        return all(met) and self.in_time and complete

    @property
    def in_time(self) -> bool:
        """Whether enough commands were in time."""
        return self.timing.in_time >= self.wanted_in_time

    @property
    def wanted_in_time(self) -> float:
        """Least share of commands in time; all of them in simulated time, which waits for each."""
        return IN_TIME if self.factor is None else 1.0


@command("demo")
@output_option("demo_output")
@click.option("--long/--quick", "long", default=False, help="2 cycles and 8 targets, or 1 and 4.")
@click.option("--keep-bag/--drop-bag", default=True, help="Keep the recording afterwards.")
@click.option("--params", type=click.Path(exists=True, dir_okay=False), help="Parameter file.")
@click.option("--node-logs", is_flag=True, help="Show the nodes' logs on the terminal too.")
@click.option("--composed", is_flag=True, help="Encoder to amplifier in one process.")
@click.option("--one-process", is_flag=True, help="All nodes in one process: the quickest.")
@click.option("--wall-clock", is_flag=True, help="The simulated rig runs in real time.")
@click.option("--devices", default="", metavar="NAME,...", help="Makes of the simulated devices.")
@click.option("--strict", is_flag=True, help="Exit with 3 if a figure is outside its limits.")
def demo(
    console: Console, folder: Path, long: bool, keep_bag: bool, params: str | None,
    node_logs: bool, composed: bool, one_process: bool, wall_clock: bool, devices: str,
    strict: bool,
) -> bool:  # fmt: skip
    """Run the therapy robot against its simulated rig: table, figures, moving picture, a bag."""
    begun = time.monotonic()
    run = new_folder(folder, console)
    extra = [*recordings_in(run), "-p", "session_recorder:name:=session"]
    extra += ["-p", "sim_rig:speed:=0.0"]  # as fast as this machine can
    extra += [] if node_logs else ["--disable-stdout-logs"]
    nodes = GraphRun(
        params, extra=extra, shared=shared_process(composed, one_process), wall_clock=wall_clock,
        devices=devices,
    )  # fmt: skip
    with running("demo", console, nodes) as (robot, _):
        make_ready(robot, console)
        bag = robot.start_recording()
        begun_s, begun_ns = time.monotonic(), robot.clock.now_ns()
        parts = work(robot, 2 if long else 1, console)
        factor = (robot.clock.now_ns() - begun_ns) * 1e-9 / (time.monotonic() - begun_s)
        with console.step("torque off, recording closed"):
            robot.enable_plane(False)
            robot.enable(False)
            robot.stop_recording()
    with console.step("reading the bag, drawing"):
        results = evaluated(bag, parts, run, keep_bag, None if wall_clock else factor)
    console.show(*tables(results), f"All in {time.monotonic() - begun:.0f} s.")
    return results.accepted


# Phases -------------------------------------------------------------------------------------------


def make_ready(robot: Robot, console: Console) -> Hand:
    """Bring the started robot to operation: homed, tared, hand on the handle, torque on."""
    takes = arm(kind="active", mass=ARM_MASS, stiffness=ARM_STIFFNESS, damping=ARM_DAMPING)
    vertical = COMMANDED.stiffness, COMMANDED.damping  # OBSERVER needs the damper
    return ready(robot, console, Hand(robot, takes), ForceCommand.IMPEDANCE, vertical,
                 (PLANE_STIFFNESS, PLANE_DAMPING))  # fmt: skip


def work(robot: Robot, cycles: int, console: Console) -> list[Work]:
    """Move the patient's hand in all modes, one after the other; return the intervals."""
    each = (cycles + 0.25) * CYCLE_S
    done, parts = 0.0, []
    for name in MODES:
        with console.progress(f"mode {name}", each * len(MODES), done) as passed:
            parts.append(one_mode(robot, name, cycles, passed))
        done += each
    return parts


def one_mode(robot: Robot, name: str, cycles: int, passed: Callable[[float], None]) -> Work:
    """Move the patient's hand in one mode; return the interval.

    The virtual hand starts at the spring's centre; it ends at its highest point, where it holds
    still.
    """
    robot.set_arm(arm((0.0, 0.0, SPRING.centre), _RETURN_S, amplitude=STILL, omega=STILL))
    robot.set_setpoint(0.0, 0.0, SPRING.centre)
    robot.pause(_RETURN_S)
    robot.set_mode(MODES[name].number)
    robot.pause(_SETTLE_S)
    duration = (cycles + 0.25) * CYCLE_S
    visited = targets()[:: 2 // cycles]
    ways = centre_out(cycles * CYCLE_S, visited)
    begin = robot.clock.stamp_ns()
    robot.set_arm(
        arm(
            target=(_LEAVE, _LEAVE, SPRING.centre),
            amplitude=(_LEAVE, _LEAVE, AMPLITUDE),
            omega=(_LEAVE, _LEAVE, OMEGA),
        )
    )
    play(robot, ways, duration, passed)
    moving = Span(name, begin, robot.clock.stamp_ns())
    top = (_LEAVE, _LEAVE, SPRING.centre + AMPLITUDE)
    robot.set_arm(arm(top, amplitude=(_LEAVE, _LEAVE, 0.0), omega=(_LEAVE, _LEAVE, 0.0)))
    robot.pause(_STOP_S)
    still = robot.clock.stamp_ns()
    robot.pause(_HOLD_S)
    return Work(moving, Span(name, still, robot.clock.stamp_ns()), visited)


def play(
    robot: Robot, ways: list[tuple[HandPath, HandPath]], duration: float,
    passed: Callable[[float], None],
) -> None:  # fmt: skip
    """Publish set points as a game does, for `duration` [s]; move the patient's hand with them."""
    begun_ns = robot.clock.now_ns()
    coming = list(ways)
    along_x, along_y = coming[0]
    count = 0
    while (now := (robot.clock.now_ns() - begun_ns) * 1e-9) < duration:
        if coming and now >= coming[0][0].begin:
            along_x, along_y = coming.pop(0)
            target = along_x.target, along_y.target, _LEAVE
            robot.send_arm(arm(target=target, duration=along_x.duration))
        (x, vx), (y, vy) = hand_point(along_x, now), hand_point(along_y, now)
        robot.set_setpoint(x, y, SPRING.centre, (vx, vy, 0.0))
        if count % _CHECK_EVERY == 0:
            robot.check_enabled()
        count += 1
        passed(now)
        robot.pause(_SETPOINT_PERIOD_S)


# From the bag to figures --------------------------------------------------------------------------


def evaluated(
    bag: Path, parts: Sequence[Work], folder: Path, keep_bag: bool = True,
    factor: float | None = None,
) -> Results:  # fmt: skip
    """Evaluate the bag; write figures and numbers into `folder`.

    factor: simulated seconds per second, None for a run by wall clock. Raises BagError naming the
    part that lacks samples, OSError if a file cannot be written.
    """
    topics = {topic: columns(bag, topic) for topic in (_ENCODER, _FORCE, _DRIVE, _ENDPOINT)}
    traces = [trace(topics, part.moving) for part in parts]
    found = [offsets(*one[1:], SPRING) for one in traces]
    undamped = [offsets(*one[1:], COMMANDED) for one in traces]
    still = [trace(topics, part.holding) for part in parts]
    held = [offset_held(*one[1:], SPRING) for one in still]
    paths = [path(topics, part.whole)._replace(targets=part.targets) for part in parts]
    whole = Span("the session", parts[0].moving.begin_ns, parts[-1].holding.end_ns)
    counts = {name: Counts(**yaml.safe_load(text)) for name, text in notes(bag)["audit"].items()}
    title = f"Simulated patient, vertical module; a damper of {COMMANDED.damping:g} Ns/m"
    told = [
        one._replace(name=f"{one.name}: {offset.mean:.1f} N off, moving")
        for one, offset in zip(traces, found, strict=True)
    ]
    drawn = {
        "force_position.png": with_held(force_position(told, SPRING, title), still),
        "path.png": path_views(paths, "Path of the handle"),
    }
    files = [save(figure, folder / name) for name, figure in drawn.items()]
    lasted = [1e-9 * (part.whole.end_ns - part.whole.begin_ns) for part in parts]
    files.append(moving_picture(paths, lasted, folder / "machine.html"))
    results = Results(
        parts, traces, found, undamped, held, paths, timing(topics, whole), counts,
        bag if keep_bag else None, files, factor,
    )  # fmt: skip
    text = yaml.safe_dump(_content(results), sort_keys=False)
    (folder / "results.yaml").write_text(text, encoding="utf-8")
    if not keep_bag:
        shutil.rmtree(bag)
    return results


Topics = Mapping[str, Mapping[str, np.ndarray]]
"""The columns of each topic, as `recording.decoded.columns` gives them."""


def trace(topics: Topics, part: Span) -> Trace:
    """Join the valid encoder and force samples of one part by their tick numbers.

    Raises BagError without a common tick.
    """
    encoder, force = _within(topics, _ENCODER, part), _within(topics, _FORCE, part)
    encoder = {name: values[encoder["homed"].astype(bool)] for name, values in encoder.items()}
    force = {name: values[force["status"] == 0] for name, values in force.items()}
    at, there = common_ticks(encoder["sequence"], force["sequence"])
    if not len(at):
        raise BagError(f"{part.name}: no tick has both a height and a force in the bag")
    return Trace(part.name, encoder["position"][at], encoder["velocity"][at], force["fz"][there])


def with_held(figure: Figure, still: Sequence[Trace]) -> Figure:
    """Mark where the hand held still in each mode; still: traces in the order of the lines."""
    axes = figure.axes[0]
    for one, line in zip(still, axes.get_lines()[::2], strict=False):
        at = float(np.median(one.position)), float(np.median(one.force))
        axes.plot(*at, "s", markersize=9, markeredgecolor="black", color=line.get_color(), zorder=6)
    axes.plot([], [], "s", markeredgecolor="black", color="none", label="hand holds still")
    axes.legend(loc="upper left")
    return figure


def path(topics: Topics, part: Span) -> Path3D:
    """Return the handle's path in one part, from the samples with three valid axes."""
    rows = _within(topics, _ENDPOINT, part)
    valid = rows["valid"].all(axis=1)
    return Path3D(part.name, np.column_stack([rows[f"position.{a}"][valid] for a in "xyz"]))


def timing(topics: Topics, part: Span) -> Timing:
    """Return the timing of the commands in one part, from the counters of the drive's node.

    Raises BagError for fewer than two states, or if a counter decreases because the node was
    restarted.
    """
    rows = _within(topics, _DRIVE, part)
    times = rows["log_time"]
    if len(times) < 2:
        raise BagError(f"{part.name}: the bag has {len(times)} states of the drive's node")
    grown = {}
    for name in ("commands", "late", "lost"):
        counts = np.asarray(rows[name], np.int64)  # unsigned ones would not fall
        if (np.diff(counts) < 0).any():
            raise BagError(f"{part.name}: the count of {name} decreases: the node was restarted")
        grown[name] = int(counts[-1] - counts[0])
    duration = int(times[-1] - times[0]) * 1e-9
    p50, p99 = rows["latency_p50"], rows["latency_p99"]
    return Timing(
        duration, grown["commands"] / duration if duration > 0 else math.nan, **grown,
        p50=float(np.median(p50)), p99=float(np.median(p99)), worst_p99=float(np.max(p99)),
    )  # fmt: skip


def _within(topics: Topics, topic: str, part: Span) -> dict[str, np.ndarray]:
    """Return the rows received in the part."""
    received = topics[topic]["log_time"]
    chosen = (received >= part.begin_ns) & (received <= part.end_ns)
    if not chosen.any():
        raise BagError(f"{part.name}: {topic} has no message in this part")
    return {name: values[chosen] for name, values in topics[topic].items()}


def _content(results: Results) -> dict[str, Any]:
    """Return the content of results.yaml."""
    return {
        "spring": COMMANDED._asdict(),
        "motion_threshold": MOTION_THRESHOLD,
        "modes": [
            {
                **part.whole._asdict(), "offset": found._asdict(),
                "offset_without_damper": undamped._asdict(), "held": held,
            }
            for part, found, undamped, held in zip(
                results.parts, results.offsets, results.undamped, results.held, strict=True
            )
        ],
        "real_time_factor": results.factor,
        "timing": {**results.timing._asdict(), "in_time": results.timing.in_time},
        "recorded": {name: count._asdict() for name, count in results.counts.items()},
    }


# Tables -------------------------------------------------------------------------------------------


def tables(results: Results) -> list[Table | str]:
    """Return the tables and lines to print."""
    bag = f"Bag: {_near(results.bag)}" if results.bag else "Bag: deleted (--drop-bag)"
    files = ", ".join(str(_near(file)) for file in results.files)
    return [
        _offset_table(results), _timing_table(results), *_gaps(results.counts), bag,
        f"Figures: {files}",
    ]  # fmt: skip


def _offset_table(results: Results) -> Table:
    table = Table(
        title=f"Offset from a spring of {SPRING.stiffness:g} N/m about {SPRING.centre:g} m",
        caption="mean of |force of the patient - spring|, moving: faster than "
        f"{MOTION_THRESHOLD * 1e3:g} mm/s\nAll modes have a damper of {COMMANDED.damping:g} Ns/m "
        "too, which mode 5 needs; the thesis has none. 'less damper': its force taken off.\n"
        "No mode here knows the screw's friction.",
    )
    numbers = ("up", "down", "moving", "less damper", "holding")
    for name in ("mode", *numbers, "thesis", "wanted moving", ""):
        table.add_column(name, justify="right" if name in numbers else "left")
    rows = zip(results.parts, results.offsets, results.undamped, results.held, strict=True)
    for part, found, undamped, held in rows:
        mode = MODES[part.name]
        told = (found.up, found.down, found.mean, undamped.mean)
        newtons = (*(f"{value:.1f} N" for value in told), f"{held:.2f} N")
        verdict = _verdict(_met(part, found))
        table.add_row(part.name, *newtons, mode.thesis, mode.wanted, verdict)
    return table


def _timing_table(results: Results) -> Table:
    t, ticks = results.timing, results.timing.commands + results.timing.lost
    table = Table(title=f"Commands to the vertical drive, {t.duration:.0f} s", show_header=False)
    if results.factor is not None:
        table.add_row("simulated time", f"{results.factor:.2f} of real time")
        table.add_row("answered", f"{t.commands} of {ticks} ticks")
    else:  # latencies exist only by wall clock
        table.add_row("rate", f"{t.rate:.1f} 1/s")
        table.add_row(
            "latency SYNC -> drive write",
            f"p50 {t.p50 * 1e6:.0f} us, p99 {t.p99 * 1e6:.0f} us "
            f"(of each second, the median; worst second's p99 {t.worst_p99 * 1e6:.0f} us)",
        )
    table.add_row("late", f"{t.late} of {t.commands} commands ({_percent(t.late, t.commands)})")
    table.add_row("lost", f"{t.lost} of {ticks} ticks ({_percent(t.lost, ticks)})")
    table.add_row(
        "inside the deadline of one period",
        f"{_percent(ticks - t.late - t.lost, ticks)}, wanted: at least "
        f"{100 * results.wanted_in_time:g} %: {_verdict(results.in_time)}",
    )
    return table


def _gaps(counts: Mapping[str, Counts]) -> list[Table | str]:
    messages = sum(count.messages for count in counts.values())
    line = f"Recorded: {messages} messages of {len(counts)} topics"
    holes = {name: count for name, count in counts.items() if not count.complete}
    if not holes:
        return [f"{line}, nothing missing."]
    table = Table(title="Topics with missing messages")
    for name in ("topic", "messages", "ticks lost", "not received", "not written"):
        table.add_column(name, justify="left" if name == "topic" else "right")
    for name, count in sorted(holes.items()):
        numbers = (count.messages, count.lost, max(0, count.missed), count.dropped)
        table.add_row(name, *map(str, numbers))
    return [f"{line}.", table]


def _met(part: Work, found: Offsets) -> bool:
    return MODES[part.name].low <= found.mean <= MODES[part.name].high


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / max(1, whole):.3f} %"


def _verdict(met: bool) -> str:
    return "[green]reached[/]" if met else "[bold red]MISSED[/]"


def _near(path: Path) -> Path:
    """Return the path relative to the current folder where it is below it."""
    here, path = Path.cwd(), path.resolve()
    return path.relative_to(here) if path.is_relative_to(here) else path

