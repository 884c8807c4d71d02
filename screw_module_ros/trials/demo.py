# SPDX-License-Identifier: Apache-2.0
"""`demo`: the whole robot against the simulated rig, from bring-up to a table and two figures.

Every node runs as a process of its own. A simulated patient (the arm of the thesis's simulation,
6.4.3) moves the handle through a spring of 100 N/m about 0.18 m in three modes while the plane
makes a centre-out reach. The recorder writes all topics; the table uses only the bag.
"""

from __future__ import annotations

import math
import os
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import click
from screw_module_msgs.msg import ForceCommand

from screw_module_ros.domain import end_without_domain
from screw_module_ros.identification.force_position import Spring
from screw_module_ros.identification.recorded_session import Part
from screw_module_ros.recording.bag import BagError

from ..nodes.support.place import AlreadyRunning
from ..operator.robot import Robot, RobotError, arm
from .console import Console
from .demo_report import FORCE_FEEDBACK, FRICTION_COMPENSATION, IMPEDANCE, evaluated
from .graph_run import GraphRun, Interrupted, recordings_in
from .reach import Way, centre_out, on_way, targets

SPRING = Spring(stiffness=100.0, centre=0.18)
FORCE_GAIN = 5.0
ARM_MASS, ARM_STIFFNESS, ARM_DAMPING = 3.0, 300.0, 5.0  # [kg], [N/m], [Ns/m]
AMPLITUDE, OMEGA = 0.15, 0.8  # of the virtual hand [m], [rad/s]
CYCLE_S = 2.0 * math.pi / OMEGA
PLANE_STIFFNESS, PLANE_DAMPING = 100.0, 10.0  # [N/m], [Ns/m], typical for MANUS
MODES = {
    IMPEDANCE: ForceCommand.IMPEDANCE,
    FRICTION_COMPENSATION: ForceCommand.FRICTION_COMPENSATION,
    FORCE_FEEDBACK: ForceCommand.FORCE_FEEDBACK,
}
_LEAVE = math.nan
_SETPOINT_PERIOD_S = 0.02  # as a game at 50 frames per second publishes
_CHECK_EVERY = 12  # set points
_SETTLE_S = 0.8
_RETURN_S = 1.5


class Options(NamedTuple):
    """Command line options; see `demo --help`."""

    folder: Path
    quick: bool
    keep_bag: bool
    params: str | None
    node_logs: bool
    strict: bool
    composed: bool
    wall_clock: bool


@click.command(context_settings={"show_default": True})
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo_output"),
    help="Each run makes a folder of its own in here.",
)
@click.option("--quick", is_flag=True, help="One cycle and 4 targets per mode; else 2 and 8.")
@click.option("--keep-bag/--drop-bag", default=True, help="Keep the recording afterwards.")
@click.option("--params", type=click.Path(exists=True, dir_okay=False), help="Parameter file.")
@click.option("--node-logs", is_flag=True, help="Show the nodes' logs on the terminal too.")
@click.option("--composed", is_flag=True, help="Encoder to amplifier in one process.")
@click.option("--wall-clock", is_flag=True, help="The simulated rig runs in real time.")
@click.option("--strict", is_flag=True, help="Exit with 3 if a figure is outside its limits.")
def command(**values) -> None:
    """Run the therapy robot against its simulated rig: table, figures and a bag."""
    end_without_domain("demo")
    options = Options(**values)
    console, begun = Console(), time.monotonic()
    run = options.folder / datetime.now().strftime("%Y_%m_%d-%H_%M_%S")
    try:
        run.mkdir(parents=True)
        bag, parts, factor = record_session(run, options, console)
        with console.step("reading the bag, drawing"):
            results = evaluated(bag, parts, SPRING, targets(), run, options.keep_bag, factor)
    except (Interrupted, KeyboardInterrupt):
        console.fail("stopped; all nodes ended in order")
        sys.exit(130)
    except (RobotError, AlreadyRunning, BagError, OSError, ValueError) as error:
        rest = f"\nThe output so far is in {run}" if run.is_dir() else ""
        console.fail(f"the demo failed: {error}{rest}")
        sys.exit(1)
    console.show(*results.tables(), f"All in {time.monotonic() - begun:.0f} s.")
    if options.strict and not results.accepted:
        sys.exit(3)


def record_session(
    run: Path, options: Options, console: Console
) -> tuple[Path, list[Part], float | None]:
    """Start the robot, run the patient's work in each mode, stop all nodes.

    Returns bag, parts, and simulated seconds per second (None with --wall-clock). Raises
    RobotError if a step fails, Interrupted after Ctrl-C; all nodes are stopped in either case.
    """
    os.environ["ROS_LOG_DIR"] = str((run / "log").resolve())
    extra = [*recordings_in(run), "-p", "session_recorder:name:=session"]
    if not options.node_logs:
        extra.append("--disable-stdout-logs")
    with GraphRun(
        options.params, extra, composed=options.composed, wall_clock=options.wall_clock
    ) as graph:
        try:
            with Robot("demo", watch=graph.watch, simulated=not options.wall_clock) as robot:
                make_ready(robot, graph, console)
                bag = robot.start_recording()
                cycles = 1 if options.quick else 2
                begun_s, begun_ns = time.monotonic(), robot.clock.now_ns()
                parts = [work(robot, name, cycles, console) for name in MODES]
                passed_s = (robot.clock.now_ns() - begun_ns) * 1e-9
                factor = passed_s / (time.monotonic() - begun_s)
                with console.step("torque off, recording closed"):
                    robot.enable_plane(False)
                    robot.enable(False)
                    robot.stop_recording()
        finally:
            with console.step("stopping all nodes"):
                graph.stop()
        graph.check_codes()
    return bag, parts, None if options.wall_clock else factor


def make_ready(robot: Robot, graph: GraphRun, console: Console) -> None:
    """Prepare the started robot: homed, tared, hand on the handle, torque on."""
    with console.step(f"bring-up of {len(graph.names)} nodes") as detail:
        graph.wait_until_ready(robot, lambda waiting: detail(", ".join(waiting)))
    with console.step("homing and taring, nobody holds the handle"):
        robot.set_fixture("free")
        robot.clear_faults()  # a drive stops after 20 ms without a frame, as during a slow start
        robot.home()
        robot.tare()
    with console.step("patient takes hold, torque on"):
        robot.set_fixture("human_arm")
        robot.set_arm(
            arm(kind="active", mass=ARM_MASS, stiffness=ARM_STIFFNESS, damping=ARM_DAMPING)
        )
        robot.set_parameter("impedance_controller", "force_gain", FORCE_GAIN)
        robot.set_impedance(SPRING.stiffness, 0.0)
        robot.set_impedance(PLANE_STIFFNESS, PLANE_DAMPING, node="manus")
        robot.set_mode(ForceCommand.IMPEDANCE)
        robot.permit()
        robot.enable()
        robot.enable_plane()


def work(robot: Robot, name: str, cycles: int, console: Console) -> Part:
    """Move the patient's hand in one mode; return the interval.

    The virtual hand starts at the spring's centre and ends at rest at its highest point.
    """
    still = (0.0, 0.0, 0.0)
    robot.set_arm(arm((0.0, 0.0, SPRING.centre), _RETURN_S, amplitude=still, omega=still))
    robot.set_setpoint(0.0, 0.0, SPRING.centre)
    robot.set_mode(MODES[name])
    robot.pause(_RETURN_S + _SETTLE_S)
    duration = (cycles + 0.25) * CYCLE_S
    ways = centre_out(cycles * CYCLE_S, targets()[:: 2 // cycles])
    begin = robot.clock.stamp_ns()
    robot.set_arm(
        arm(
            target=(_LEAVE, _LEAVE, SPRING.centre),
            amplitude=(_LEAVE, _LEAVE, AMPLITUDE),
            omega=(_LEAVE, _LEAVE, OMEGA),
        )
    )
    with console.progress(name, duration) as passed:
        play(robot, ways, duration, passed)
    return Part(name, begin, robot.clock.stamp_ns())


def play(robot: Robot, ways: list[Way], duration: float, passed) -> None:
    """Publish set points as a game does, for `duration` [s]; move the patient's hand with them."""
    begun_ns = robot.clock.now_ns()
    coming = list(ways)
    way = coming[0]
    count = 0
    while (now := (robot.clock.now_ns() - begun_ns) * 1e-9) < duration:
        if coming and now >= coming[0].begin:
            way = coming.pop(0)
            robot.send_arm(arm(target=(*way.end, _LEAVE), duration=way.duration))
        (x, y), (vx, vy) = on_way(way, now)
        robot.set_setpoint(x, y, SPRING.centre, (vx, vy, 0.0))
        if count % _CHECK_EVERY == 0:
            robot.check_enabled()
        count += 1
        passed(now)
        robot.pause(_SETPOINT_PERIOD_S)


def main() -> None:
    """Console entry point."""
    command()
