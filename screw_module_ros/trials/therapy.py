# SPDX-License-Identifier: Apache-2.0
"""`therapy`: the simulated robot with session, web bridge, pages and a simulated patient.

Prints two addresses, one for the patient's screen and one for the therapist's. Ctrl-C ends all
nodes in order: bridge and session first, then the drives, then the rig.
"""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import click
from screw_module_msgs.msg import ForceCommand, SafetyState
from screw_module_msgs.srv import SetArm

from screw_module_ros.bridge.tokens import tokens_in

from ..graph import PATIENTS, WHOLE
from ..operator.bring_up import bring_up
from ..operator.robot import Robot, arm
from ..plant.patient import trait_flaw
from ..terminal import Console
from .patient import STILL, Hand, ready
from .runner import GraphRun, command, recordings_in, running

SESSION, BRIDGE = "therapy_session", "web_bridge"
_SPRING = 100.0, 5.0  # stiffness and damping to a game's set point [N/m], [Ns/m]
_CENTRE, _TO_CENTRE_S = (0.0, 0.0, 0.18), 0.5
_LOOK_S = 0.05
_BRAKES = "-p", "amplifier:stop_reaction:=brake"  # else no more than 8 N of an arm may be carried
_LETS_GO = "Enter: the patient lets go of the handle, as for weighing, or takes hold."
_WITHOUT_TERMINAL = (
    "No terminal here: the patient lets go of the handle, as for weighing, when "
    "/sim_rig/set_fixture is called with {fixture: free}, and takes hold with {fixture: human_arm}."
)
HEALTHY = "healthy"


class _Trait(click.ParamType):
    """A trait of the simulated arm on the command line, NAME=VALUE."""

    name = "trait"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Return name and value; fails with a sentence as SetArm's."""
        trait, _, number = value.partition("=")
        try:
            found = float(number)
        except ValueError:
            self.fail(f"{value!r}: NAME=NUMBER is wanted, such as carried=0", param, ctx)
        if wrong := trait_flaw(trait, found):
            self.fail(wrong, param, ctx)
        return trait, found


@command("therapy")
@click.option(
    "--patient", type=click.Choice(PATIENTS), default=HEALTHY, help="Simulated patient."
)
@click.option(
    "--trait", "traits", type=_Trait(), multiple=True, metavar="NAME=VALUE",
    help="Another value of a trait of his arm, as in SetArm.srv: carried=0. Repeatable.",
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
def therapy(
    console: Console, patient: str, traits: tuple[tuple[str, float], ...], port: int,
    file_games: bool, folder: Path | None, node_logs: bool,
) -> None:  # fmt: skip
    """Run a therapy session on the simulated robot, in the browser."""
    extra = [*_BRAKES, *([] if node_logs else ["--disable-stdout-logs"])]
    if folder is not None:
        extra += recordings_in(folder)
    nodes = GraphRun(extra=extra, shared=WHOLE)
    with running("therapy", console, nodes, with_pages(port, file_games)) as (robot, graph):
        takes = arm(patient=patient, traits=dict(traits))  # of two of a name the last counts
        serve(robot, takes, port, tokens_in(token_file(graph)), console)


def with_pages(port: int, file_games: bool = False) -> Callable[[GraphRun], None]:
    """Return what adds session and bridge to a run; port: 0 = any that is free."""

    def beside(graph: GraphRun) -> None:
        graph.add(SESSION)
        graph.add(BRIDGE, *bridge_words(graph, port, file_games))

    return beside


def bridge_words(graph: GraphRun, port: int, file_games: bool) -> list[str]:
    """Return the --ros-args of the bridge; the patient's screen may publish `therapy/wish`."""
    words = ["-p", f"port:={port}", "-p", "wishes:=true", "-p", f"token_file:={token_file(graph)}"]
    return [*words, "-p", 'origins:=["null"]'] if file_games else words


def token_file(graph: GraphRun) -> Path:
    """Return the path of this run's tokens, which are deleted with it."""
    return Path(graph.place.state.name) / "web_bridge" / "tokens.json"


def serve(
    robot: Robot, takes: SetArm.Request, port: int, tokens: Mapping[str, str], console: Console
) -> None:
    """Bring the robot up and print the addresses, until Ctrl-C; Enter resets a stop, or lets go.

    takes: who takes hold of the handle.
    """
    hand = make_ready(robot, console, takes)
    click.echo("Open in a browser; Ctrl-C here ends everything.")
    click.echo(_LETS_GO if sys.stdin.isatty() else _WITHOUT_TERMINAL)
    for role, token in tokens.items():
        click.echo(f"  {role:9}  http://127.0.0.1:{port}/{role}#token={token}")
    told = False
    while True:
        safety = robot.state(SafetyState)
        if safety is not None and safety.level == SafetyState.STOPPED:
            if not told:
                way_out = " Enter resets and enables the drives." if sys.stdin.isatty() else ""
                console.show(f"Stopped: {', '.join(safety.reasons)}.{way_out}")
            told = True
            if _enter():
                with console.step("torque on again"):
                    bring_up(robot, ForceCommand.FORCE_FEEDBACK, hand)
                told = False
        elif _enter():
            hand.change()
            console.show(f"The patient {'holds' if hand.holds else 'has let go'} the handle.")
        robot.pause(_LOOK_S)


def make_ready(robot: Robot, console: Console, takes: SetArm.Request | None = None) -> Hand:
    """Bring the started robot to operation: homed, tared, hand on the handle, torque on.

    takes: who takes hold of the handle, a healthy patient by default; he goes to the centre.
    """
    to_centre = arm(_CENTRE, _TO_CENTRE_S, STILL, STILL)
    hand = Hand(robot, takes or arm(patient=HEALTHY), to_centre)
    return ready(robot, console, hand, ForceCommand.FORCE_FEEDBACK, _SPRING, _SPRING)


def _enter() -> bool:
    """Return whether the user has pressed Enter at this terminal."""
    if not sys.stdin.isatty() or not select.select([sys.stdin], [], [], 0.0)[0]:
        return False
    sys.stdin.readline()
    return True
