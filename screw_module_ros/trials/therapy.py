# SPDX-License-Identifier: Apache-2.0
"""`therapy`: the simulated robot with session, web bridge, pages and a simulated patient.

Prints two addresses, one for the patient's screen and one for the therapist's. Ctrl-C ends all
nodes in order: bridge and session first, then the drives, then the rig.
"""

from __future__ import annotations

import select
import sys
from pathlib import Path

import click
from screw_module_msgs.msg import ForceCommand, SafetyState

from screw_module_ros.bridge.tokens import Tokens, tokens_in

from ..nodes import bringup
from ..nodes.support.place import AlreadyRunning
from ..operator.robot import Robot, RobotError
from .console import Console
from .graph_run import GraphRun, Interrupted, recordings_in
from .simulated_player import HEALTHY, PEOPLE, Person, SimulatedPlayer

SESSION, BRIDGE = "therapy_session", "web_bridge"
_FORCE_GAIN = 5.0
_STIFFNESS, _DAMPING = 100.0, 5.0  # of the spring to a game's set point [N/m], [Ns/m]
_LOOK_S = 0.05


@click.command(context_settings={"show_default": True})
@click.option(
    "--patient", type=click.Choice(sorted(PEOPLE)), default=HEALTHY, help="Simulated patient."
)
@click.option("--port", type=click.IntRange(1, 65535), default=8090, help="Port of the pages.")
@click.option(
    "--file-games", is_flag=True, help="Accept connections of pages opened from a file (games)."
)
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), default=None,
    help="Folder of the recordings; default ~/sessions.",
)
@click.option("--node-logs", is_flag=True, help="Show the nodes' logs.")
def command(
    patient: str, port: int, file_games: bool, folder: Path | None, node_logs: bool
) -> None:
    """Run a therapy session on the simulated robot, in the browser."""
    console = Console()
    extra = [] if node_logs else ["--disable-stdout-logs"]
    if folder is not None:
        extra += recordings_in(folder)
    try:
        with GraphRun(extra=extra, composed=True) as graph:
            ours: list[bringup.Process] = []
            try:
                bridge = bridge_arguments(graph, port, file_games)
                ours.append(bringup.Process(SESSION, session_arguments(graph)))
                ours.append(bringup.Process(BRIDGE, bridge))
                with Robot("therapy", watch=graph.watch, simulated=True) as robot:
                    serve(robot, graph, PEOPLE[patient], port, console)
            finally:
                with console.step("stopping all nodes"):
                    bringup.stop(ours)
                    graph.stop()
    except (Interrupted, KeyboardInterrupt):
        console.fail("stopped; all nodes ended in order")
        sys.exit(130)
    except (RobotError, AlreadyRunning, OSError, ValueError) as error:
        console.fail(f"therapy failed: {error}")
        sys.exit(1)


def session_arguments(graph: GraphRun) -> list[str]:
    """Return the arguments of the session's node."""
    return ["--ros-args", *graph.arguments("endpoint_state")]


def bridge_arguments(graph: GraphRun, port: int, file_games: bool) -> list[str]:
    """Return the arguments of the bridge; the patient's screen may publish `therapy/wish`."""
    options = ["-p", f"port:={port}", "-p", "wishes:=true"]
    options += ["-p", f"token_file:={token_file(graph)}"]
    if file_games:
        options += ["-p", 'origins:=["null"]']
    return ["--ros-args", *graph.arguments("endpoint_state"), *options]


def token_file(graph: GraphRun) -> Path:
    """Return the path of this run's tokens, which are deleted with it."""
    return Path(graph.place.state.name) / "web_bridge" / "tokens.json"


def serve(robot: Robot, graph: GraphRun, person: Person, port: int, console: Console) -> None:
    """Prepare the robot, print the addresses, and move the patient's hand until Ctrl-C."""
    with console.step(f"bring-up of {len(graph.names) + 2} nodes") as detail:
        graph.wait_until_ready(robot, lambda waiting: detail(", ".join(waiting)))
        robot.wait_until_ready(
            (SESSION, BRIDGE), on_waiting=lambda waiting: detail(", ".join(waiting))
        )
    player = SimulatedPlayer(robot, person)
    with console.step("homing and taring, patient takes hold, torque on"):
        make_ready(robot, player)
    tell(port, tokens_in(token_file(graph)))
    stopped = False
    while True:
        player.look()
        safety = robot.state(SafetyState)
        if safety is not None and safety.level == SafetyState.STOPPED:
            if not stopped:
                way_out = " Enter resets and enables the drives." if sys.stdin.isatty() else ""
                console.show(f"Stopped: {', '.join(safety.reasons)}.{way_out}")
            stopped = True
            if _enter():
                with console.step("torque on again"):
                    switch_on(robot)
                stopped = False
        robot.pause(_LOOK_S)


def make_ready(robot: Robot, player: SimulatedPlayer) -> None:
    """Prepare the started robot: homed, tared, hand on the handle, torque on."""
    robot.set_fixture("free")
    robot.clear_faults()
    robot.home()
    robot.tare()
    robot.set_fixture("human_arm")
    player.take_hold()
    robot.set_parameter("impedance_controller", "force_gain", _FORCE_GAIN)
    robot.set_impedance(_STIFFNESS, _DAMPING)
    robot.set_impedance(_STIFFNESS, _DAMPING, node="manus")
    robot.set_mode(ForceCommand.FORCE_FEEDBACK)
    switch_on(robot)


def switch_on(robot: Robot) -> None:
    """Reset the stop, clear the drives' faults and switch the torque on."""
    robot.permit()
    robot.clear_faults()
    robot.enable()
    robot.enable_plane()


def tell(port: int, tokens: Tokens) -> None:
    """Print both addresses."""
    click.echo("Open in a browser; Ctrl-C here ends everything.")
    for role, token in tokens._asdict().items():
        click.echo(f"  {role:9}  http://127.0.0.1:{port}/{role}#token={token}")


def _enter() -> bool:
    """Return whether the user has pressed Enter at this terminal."""
    if not sys.stdin.isatty() or not select.select([sys.stdin], [], [], 0.0)[0]:
        return False
    sys.stdin.readline()
    return True


def main() -> None:
    """Console entry point."""
    command()
