# SPDX-License-Identifier: Apache-2.0
"""`bringup`: start every node of the graph as its own process, and stop them in order.

The same table serves `ros2 launch screw_module_ros therapy_robot.launch.py`; this executable is
for environments without the launch package.
"""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import click

from screw_module_ros.domain import domain_id, end_without_domain
from screw_module_ros.lockstep.page import sweep

from .support.plan import checked_values, plan
from .support.runtime import TELL_WHERE
from .support.stopping import stop_on_signals
from .support.transport import keep_to_this_machine, open_to_network

_POLITE_S = 8.0
_PR_SET_PDEATHSIG = 1


class Process:
    """One node's process."""

    def __init__(self, name: str, arguments: list[str]):
        self.name = name
        self.arguments = arguments
        # Its own session: Ctrl-C reaches only bringup, which then stops the nodes in order.
        self._process = subprocess.Popen(
            [executable_path(name), *arguments],
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def again(self) -> Process:
        """Return a new process of the same node with the same arguments."""
        return Process(self.name, self.arguments)

    def exit_code(self) -> int | None:
        """Return the exit code, None while it runs."""
        return self._process.poll()

    def stop(self) -> int:
        """Send SIGTERM, then SIGINT, then SIGKILL, with a wait after each; return the exit code.

        A node that finished its work and then hangs in Fast DDS counts as a normal end, and so does
        one that SIGTERM ends while it imports; SIGINT would print a traceback there, or get lost.
        """
        running = self._process.poll() is None
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGKILL):
            if self._process.poll() is None:
                self._process.send_signal(number)
            try:
                code = self._ended(self._process.wait(_POLITE_S))
                return 0 if running and code == -signal.SIGTERM else code
            except subprocess.TimeoutExpired:
                click.echo(f"bringup: {self.name} ignored {number.name}", err=True)
                self._process.send_signal(TELL_WHERE)
        return self._process.wait()

    def _ended(self, code: int) -> int:
        if code != -signal.SIGALRM:
            return code
        click.echo(f"bringup: {self.name} had finished but hung in Fast DDS", err=True)
        return 0


def executable_path(name: str) -> str:
    """Return the installed executable `name`, in the folder of this one.

    Raises FileNotFoundError saying how to install.
    """
    beside = Path(sys.argv[0]).resolve().parent / name
    if beside.is_file():
        return str(beside)
    try:
        from ament_index_python.packages import get_package_prefix

        path = Path(get_package_prefix("screw_module_ros")) / "lib" / "screw_module_ros" / name
    except (ImportError, LookupError):
        path = beside
    if not path.is_file():
        raise FileNotFoundError(f"no executable {name} at {path}: build and source the workspace")
    return str(path)


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def start(simulation: bool = True, params: str | None = None, **wishes) -> list[Process]:
    """Start the chosen nodes and return their processes, in the order of the table.

    Arguments and errors are those of `plan`; entries of a parameter file that no node reads are
    reported.
    """
    planned = plan(simulation, params, **wishes)
    for sentence in planned.warnings:
        click.echo(f"bringup: {sentence}", err=True)
    above = ["-r", f"__ns:={planned.namespace}"] if planned.namespace else []
    return [
        Process(entry.executable, ["--ros-args", *planned.arguments(entry), *above])
        for entry in planned.entries
    ]


def stop(processes: list[Process]) -> dict[str, int]:
    """Stop in reverse order, so that the drives go off while the rig still answers."""
    return {process.name: process.stop() for process in reversed(processes)}


@click.command()
@click.option("--bench", is_flag=True, help="Real hardware: no sim_rig, params/bench.yaml.")
@click.option(
    "--composed", is_flag=True,
    help="One process `module` in place of encoder, force_sensor, impedance_controller, amplifier.",
)
@click.option("--wall-clock", is_flag=True, help="The simulated rig runs in real time.")
@click.option("--params", type=click.Path(exists=True, dir_okay=False), help="Parameter file.")
@click.option("--namespace", default="", help="For a second robot, like /second.")
@click.option(
    "--first-port", type=click.IntRange(1024, 65532),
    help="First of the simulated rig's four CAN ports; a second robot needs its own.",
)
@click.option("--only", multiple=True, help="Start only this node (repeat for more).")
@click.option("--without", multiple=True, help="Leave this node out (repeat for more).")
@click.option(
    "-p", "--param", "values", multiple=True, metavar="NODE:NAME:=VALUE",
    help="Set a parameter, in place of the file's value (repeat for more).",
)
@click.option("--network", is_flag=True, help="Let other machines take part: docs/security.md.")
def command(bench: bool, network: bool, values: tuple[str, ...], **wishes) -> None:
    """Start the therapy robot: every node as a process of its own, until Ctrl-C."""
    end_without_domain("bringup")
    stopping = threading.Event()
    stop_on_signals(stopping)
    try:
        extra = [word for value in checked_values(values) for word in ("-p", value)]
        reach = open_to_network() if network else keep_to_this_machine()
        if reach:
            click.echo(f"bringup: {reach}", err=True)
        processes = start(not bench, extra=extra, **wishes)
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error
    codes = _watch(processes, stopping)
    failed = {name: code for name, code in codes.items() if code}
    if failed:
        raise click.ClickException(f"ended with an error: {failed}")


def _watch(processes: list[Process], stopping: threading.Event) -> dict[str, int]:
    reported: set[str] = set()
    try:
        while not stopping.wait(0.2) and len(reported) < len(processes):
            for process in processes:
                if process.exit_code() is not None and process.name not in reported:
                    reported.add(process.name)
                    click.echo(
                        f"bringup: {process.name} ended with code {process.exit_code()}; it is "
                        "not restarted by itself",
                        err=True,
                    )
    finally:
        begun = time.monotonic()
        codes = stop(processes)
        sweep(str(domain_id()))
        click.echo(f"bringup: all stopped in {time.monotonic() - begun:.1f} s", err=True)
    return codes


def main() -> None:
    """Console entry point."""
    command()
