# SPDX-License-Identifier: Apache-2.0
"""`soak`: a long recorded run of the whole robot that checks for leaks and lost samples.

Every node runs as a process of its own against the simulated rig. The simulated patient moves and
the mode changes periodically. Every few seconds the program samples the resources of each process
and, by wall clock, the latency of the commands. At the end it audits the bag. All durations are
in the robot's time; simulated time passes as fast as the machine allows.
"""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
import sys
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

import click
from diagnostic_msgs.msg import DiagnosticStatus
from screw_module_msgs.msg import AmplifierState, ForceCommand

from screw_module_ros.clock import WallClock
from screw_module_ros.domain import end_without_domain
from screw_module_ros.recording.bag import BagError
from screw_module_ros.recording.verify import verify

from ..nodes.support import topics
from ..nodes.support.place import AlreadyRunning
from ..operator.robot import Robot, RobotError, arm
from . import soak_report as report
from .console import Console
from .demo import AMPLITUDE, OMEGA, SPRING, make_ready
from .graph_run import GraphRun, Interrupted, recordings_in
from .options import FiniteRange
from .processes import usage

_MODES = (
    ForceCommand.IMPEDANCE,
    ForceCommand.FRICTION_COMPENSATION,
    ForceCommand.FORCE_FEEDBACK,
    ForceCommand.COMBINED,
    ForceCommand.OFF,
)
_QUICK_S = 20.0
_SETPOINT_PERIOD_S = 0.02
_PATH_S = 9.0  # once around in the plane
_RADIUS = 0.06  # [m]
_AS_FAST_AS_IT_GOES = ["-p", "sim_rig:speed:=0.0"]
_WALL = WallClock()


class Options(NamedTuple):
    """Command line options; see `soak --help`."""

    minutes: float
    quick: bool
    every: float
    change: float
    folder: Path
    keep_bag: bool
    params: str | None
    strict: bool
    wall_clock: bool

    @property
    def seconds(self) -> float:
        """Duration of the run by the robot's clock [s]."""
        return _QUICK_S if self.quick else 60.0 * self.minutes


@click.command(context_settings={"show_default": True})
@click.option("--minutes", default=10.0, type=FiniteRange(0.1, 6000.0), help="Duration.")
@click.option("--quick", is_flag=True, help=f"Run only {_QUICK_S:g} s.")
@click.option("--every", default=5.0, type=FiniteRange(0.5, 600.0), help="Sampling period [s].")
@click.option("--change", default=20.0, type=FiniteRange(2.0, 3600.0),
              help="Period of the mode changes [s].")  # fmt: skip
@click.option("--folder", type=click.Path(file_okay=False, path_type=Path),
              default=Path("soak_output"), help="Each run makes a folder of its own in here.",
)  # fmt: skip
@click.option("--keep-bag/--drop-bag", default=False, help="Keep the recording afterwards.")
@click.option("--params", type=click.Path(exists=True, dir_okay=False), help="Parameter file.")
@click.option("--wall-clock", is_flag=True, help="The simulated rig runs in real time.")
@click.option("--strict", is_flag=True, help="Exit with 3 if a check fails.")
def command(**chosen) -> None:
    """Run the robot for a long time; report leaks, growing latency and lost samples."""
    end_without_domain("soak")
    options = Options(**chosen)
    if options.quick:
        options = options._replace(every=min(options.every, 1.0), change=min(options.change, 3.0))
    console = Console()
    run = options.folder / datetime.now().strftime("%Y_%m_%d-%H_%M_%S")
    try:
        run.mkdir(parents=True)
        soak = Soak(options, console)
        bag = soak.record(run)
        with console.step("counting the bag anew"):
            audit = verify(bag)
        found = report.trends(soak.samples)
        lines = report.verdicts(found, audit, soak.recorder, soak.stops)
        figure = report.draw(soak.samples, run / "soak.png")
        file = run / "soak.json"
        content = report.content(
            soak.samples, found, lines,
            date=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            python=platform.python_version(), cores=len(os.sched_getaffinity(0)),
            seconds=options.seconds, wall_clock=options.wall_clock,
            real_time_factor=soak.factor, modes_changed=soak.changes, stops=soak.stops,
            bag={name: count._asdict() for name, count in audit.topics.items()},
            bag_size=sum(path.stat().st_size for path in bag.glob("*")),
        )  # fmt: skip
        file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        if not options.keep_bag:
            shutil.rmtree(bag)
    except (Interrupted, KeyboardInterrupt):
        console.fail("stopped; all nodes ended in order")
        sys.exit(130)
    except (RobotError, AlreadyRunning, BagError, OSError, ValueError) as error:
        console.fail(f"the soak failed: {error}\nThe output so far is in {run}")
        sys.exit(1)
    factor = f"Real-time factor {soak.factor:.2f}: {options.seconds:g} s of the robot's time."
    console.show(report.table(lines), factor, f"Figure: {figure}", f"As JSON: {file}")
    if options.strict and not all(line.good for line in lines):
        sys.exit(3)


class Soak:
    """One soak run. samples: of the resources; stops: times and reasons of torque-off events.

    recorder: losses that the recorder reports; changes: number of mode changes; factor: seconds of
    the robot's time per second of wall clock.
    """

    def __init__(self, options: Options, console: Console):
        self.samples: list[report.Sample] = []
        self.stops: list[str] = []
        self.recorder: dict[str, int] = {}
        self.changes = 0
        self.factor = math.nan
        self._options = options
        self._console = console
        self._waiting = math.nan
        self._begun_ns = 0

    def record(self, run: Path) -> Path:
        """Start the robot, run it, stop it; return the bag's folder."""
        os.environ["ROS_LOG_DIR"] = str((run / "log").resolve())
        options, console = self._options, self._console
        extra = ["--disable-stdout-logs", "-p", "session_recorder:name:=session"]
        extra += recordings_in(run)
        extra += [] if options.wall_clock else _AS_FAST_AS_IT_GOES
        with GraphRun(options.params, extra, wall_clock=options.wall_clock) as graph:
            try:
                with Robot("soak", watch=graph.watch, simulated=not options.wall_clock) as robot:
                    make_ready(robot, graph, console)
                    robot.node.create_subscription(
                        DiagnosticStatus, "session_recorder/status", self._on_status, topics.STATE
                    )
                    bag = Path(robot.trigger("session_recorder/start", deadline_s=30.0))
                    seconds = options.seconds
                    with console.progress(f"working for {seconds:g} s", seconds) as passed:
                        begun_ns = _WALL.now_ns()
                        self._work(robot, graph, passed)
                        self.factor = seconds / (1e-9 * (_WALL.now_ns() - begun_ns))
                    self._finish(robot, graph)
            finally:
                with console.step("stopping all nodes"):
                    graph.stop()
            graph.check_codes()
        return bag

    def _finish(self, robot: Robot, graph: GraphRun) -> None:
        """Switch the torque off and close the bag; nodes without an answer do so on shutdown."""
        with self._console.step("torque off, recording closed"):
            try:
                robot.stop_recording()
                robot.enable_plane(False)
                robot.enable(False)
            except RobotError as error:
                graph.watch()
                self.stops.append(f"at the end: {error}")

    def _work(self, robot: Robot, graph: GraphRun, passed) -> None:
        robot.set_arm(arm(target=(0.0, 0.0, SPRING.centre), duration=1.0,
                          amplitude=(0.03, 0.03, AMPLITUDE), omega=(0.5, 0.7, OMEGA)))  # fmt: skip
        options, pids = self._options, graph.pids
        self._begun_ns = robot.clock.now_ns()
        look_due = change_due = 0.0
        while (now := self._passed(robot)) < options.seconds:
            angle = math.tau * now / _PATH_S
            robot.set_setpoint(
                _RADIUS * math.cos(angle), _RADIUS * math.sin(angle), SPRING.centre
            )
            if now >= change_due:
                change_due += options.change
                self._go_on(robot, graph)
            if now >= look_due:
                look_due += options.every
                self._look(robot, pids, now)
            passed(now)
            robot.pause(_SETPOINT_PERIOD_S)

    def _passed(self, robot: Robot) -> float:
        """Return the time since the start of the run, by the robot's clock [s]."""
        return 1e-9 * (robot.clock.now_ns() - self._begun_ns)

    def _look(self, robot: Robot, pids: dict[str, int], now: float) -> None:
        values: dict[tuple[str, str], float] = {}
        for name, pid in pids.items():
            held = usage(pid)
            values[name, "memory"] = held.memory
            values[name, "handles"] = held.handles
            values[name, "threads"] = held.threads
            values[name, "shared"] = held.shared
        state = robot.state(AmplifierState)
        if state is not None and state.enabled and self._options.wall_clock:
            values["robot", "latency p50"] = state.latency_p50 * 1e6
            values["robot", "latency p99"] = state.latency_p99 * 1e6
        values["session_recorder", "waiting"] = self._waiting
        self.samples.append(report.Sample(now, values))

    def _go_on(self, robot: Robot, graph: GraphRun) -> None:
        """Change the mode; if the torque is off, note the reason and enable it again.

        A failure, which a busy machine can cause by wall clock, is noted; the next call retries.
        """
        try:
            robot.set_mode(_MODES[self.changes % len(_MODES)])
            self.changes += 1
            robot.check_enabled()
        except RobotError as error:
            graph.watch()  # a retry cannot help if a node has ended
            self.stops.append(f"after {self._passed(robot):.0f} s: {error}")
            try:
                robot.clear_faults()
                robot.permit()
                robot.enable()
                robot.enable_plane()
            except RobotError as again:
                self.stops.append(f"after {self._passed(robot):.0f} s: {again}")

    def _on_status(self, status: DiagnosticStatus) -> None:
        values = {value.key: value.value for value in status.values}
        self._waiting = float(values.get("waiting", "nan"))
        topics = [json.loads(text) for name, text in values.items() if name.startswith("/")]
        self.recorder = {
            "messages": int(values.get("messages", 0)),
            "dropped": int(values.get("dropped", 0)),
            "missed": sum(max(0, counts.get("missed", 0)) for counts in topics),
            "lost": sum(counts.get("lost", 0) for counts in topics),
        }


def main() -> None:
    """Console entry point."""
    command()
