# SPDX-License-Identifier: Apache-2.0
"""`bringup`: start every node of the graph as its own process, and stop them in order.

The same plan serves `ros2 launch screw_module_ros therapy_robot.launch.py`; this executable is
for environments without the launch package.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click

from screw_module_ros.devices.makes import node_parameters
from screw_module_ros.domain import domain_id, end_without_domain
from screw_module_ros.graph import (
    BESIDE,
    COMPOSED_LATENCY,
    MODULE,
    ONE_PROCESS_SIMULATES,
    PATIENTS,
    SEPARATE_LATENCY,
    WHOLE,
    Entry,
    chosen,
    table,
)
from screw_module_ros.lockstep.page import sweep
from screw_module_ros.parameter_files import above, unread_sections
from screw_module_ros.profiles import DRIVE, ENCODER, FORCE_SENSOR, by_kind
from screw_module_ros.resources import resource_path

from .support.arguments import NETWORK, PARTS, arguments
from .support.place import keep_to_this_machine, open_to_network
from .support.runtime import DUMP_STACKS, stop_on_signals

ENCLAVES = "/therapy_robot"
"""Prefix of the enclaves of security/policy.xml."""
_SECURITY_VARIABLE = "ROS_SECURITY_ENABLE"
PLANE_RATE_ON_TWO_CORES = 250.0
SIMULATION_PARAMETERS = "params/sim.yaml"
HARDWARE_PARAMETERS = "params/hardware.yaml"
OLD_WORD = (
    f"is {{}} now: the real robot, with {HARDWARE_PARAMETERS} (make bench tells how fast it runs)"
)
_IN_RIG = {DRIVE: "drive_profile", ENCODER: "encoder_profile", FORCE_SENSOR: "sensor_profile"}
_POLITE_S = 8.0
_PR_SET_PDEATHSIG = 1


class Plan(NamedTuple):
    """Executables to start.

    entries: the executables, in order. common: arguments for each, after --ros-args. namespace: of
    all nodes, with leading /, empty for none. warnings: entries of the parameter file that no node
    reads.
    """

    entries: list[Entry]
    common: list[str]
    namespace: str
    warnings: list[str]

    def arguments(self, entry: Entry) -> list[str]:
        """Return the arguments of one executable, with its enclave if SROS2 is in use."""
        if os.environ.get(_SECURITY_VARIABLE, "").lower() != "true":
            return self.common
        return [*self.common, "--enclave", f"{ENCLAVES}/{entry.executable}"]


def own_words(entry: Entry) -> list[str]:
    """Return the arguments of an executable that are not for ROS: the nodes that it has."""
    chosen = entry.executable == WHOLE.executable and entry.parts != WHOLE.parts
    return [PARTS, ",".join(entry.parts)] if chosen else []


def plan(
    simulation: bool = True,
    params: str | None = None,
    namespace: str = "",
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    extra: Sequence[str] = (),
    shared: Entry | None = None,
    apart: Sequence[str] = (),
    wall_clock: bool = False,
    devices: str = "",
    patient: str | None = None,
) -> Plan:
    """Return the plan that starts the robot.

    simulation: with the simulated rig. params: a file that replaces the packaged one. only,
    without: names of the table. extra: arguments for every node. shared: `graph.MODULE` or
    `graph.WHOLE`, a process in place of its parts; apart: those of them that keep their own.
    wall_clock: the simulated rig runs in real time. devices: profiles of the devices,
    by comma (`profiles.NAMES`, or paths). patient: who holds the simulated handle, one of
    `graph.PATIENTS`.

    Raises SettingError for a file that cannot be read, ValueError for a name that is not in the
    table, and for a patient who is unknown or has no simulated rig.
    """
    default = SIMULATION_PARAMETERS if simulation else HARDWARE_PARAMETERS
    path = params or str(resource_path(default))
    within = above(namespace)
    entries = chosen(simulation, only, without, shared, apart)
    if wall_clock and any(entry.executable == WHOLE.executable for entry in entries):
        raise ValueError(f"{WHOLE.executable}: {ONE_PROCESS_SIMULATES}")
    known = [node for entry in table() for node in entry.nodes]
    words = ["--params-file", path, *device_arguments(devices, simulation)]
    if simulation:
        words += simulated_arguments(shared, wall_clock)
    if patient:
        words += _held_by(patient, simulation)
    return Plan(
        entries,
        [*words, *extra],
        within,
        unread_sections(path, [*known, *BESIDE], within),
    )


def shared_process(composed: bool, one_process: bool) -> Entry | None:
    """Return the process that the words --composed or --one-process ask for, None for neither.

    Raises ValueError for both.
    """
    if composed and one_process:
        raise ValueError("--composed and --one-process: one of them")
    return MODULE if composed else WHOLE if one_process else None


def _held_by(patient: str, simulation: bool) -> list[str]:
    """Return the --ros-args that let a simulated patient hold the handle. Raises ValueError."""
    if not simulation:
        raise ValueError(f"patient {patient}: the real robot has no simulated one, leave it out")
    if patient not in PATIENTS:
        raise ValueError(f"patient {patient}: there are {', '.join(PATIENTS)}")
    return ["-p", f"sim_rig:patient:={patient}"]


def device_arguments(devices: str, simulation: bool) -> list[str]:
    """Return the --ros-args that give drivers and simulated rig the profiles of these devices.

    devices: names or paths, by comma, one for each kind at most. Raises SettingError for one that
    does not exist, or for two of a kind.
    """
    nodes = node_parameters(devices, simulation)
    if simulation:
        makes = by_kind(devices)
        nodes["sim_rig"] = {f"devices.{_IN_RIG[kind]}": name for kind, name in makes.items()}
    return [
        word
        for node, values in nodes.items()
        for parameter, value in values.items()
        for word in ("-p", f"{node}:{parameter}:={value}")
    ]


def checked_values(values: Sequence[str]) -> list[str]:
    """Return the rules of -p unchanged.

    Raises ValueError for a rule of another form, or with an unknown node.
    """
    known = {node for entry in table() for node in entry.nodes}
    for value in values:
        rules = arguments(["--ros-args", "-p", value]).rules
        if not rules:
            raise ValueError(f"-p {value}: NODE:NAME:=VALUE is wanted")
        if rules[0].node and rules[0].node not in known:
            raise ValueError(
                f"-p {value}: no node {rules[0].node!r}; there are {', '.join(sorted(known))}"
            )
    return list(values)


def simulated_arguments(shared: Entry | None = None, wall_clock: bool = False) -> list[str]:
    """Return the --ros-args of a robot with the simulated rig."""
    latency = COMPOSED_LATENCY if shared else SEPARATE_LATENCY
    words = ["-p", f"sim_rig:devices.command_latency:={latency}"]
    if wall_clock:
        words += ["-p", "use_sim_time:=false", *placement(len(os.sched_getaffinity(0)), shared)]
    return words


def placement(cores: int, shared: Entry | None = None) -> list[str]:
    """Return the --ros-args that adapt a real-time simulation to a machine with `cores` cores.

    Two cores are too slow for rig and robot in real time. Then the plane runs at 250 Hz (otherwise
    500 Hz; the original robot had 200 Hz), and the nodes from encoder to amplifier have their own
    core. With more cores the scheduler finds a free one.
    """
    if cores > 2:
        return []
    words = ["-p", f"manus:rate:={PLANE_RATE_ON_TWO_CORES}"]
    for entry in table(shared):
        if entry.core is not None and entry.core < cores:
            for node in entry.nodes:
                words += ["-p", f"{node}:realtime.cores:=[{entry.core}]"]
    return words


class Process:
    """One process of the graph.

    nodes: their names, by default that of the executable. own: arguments before `arguments`.
    """

    def __init__(
        self, name: str, arguments: list[str], nodes: Sequence[str] = (), own: Sequence[str] = ()
    ):
        self.name = name
        self.nodes = nodes or (name,)
        self.own = own
        self.arguments = arguments
        # Its own session: Ctrl-C reaches only bringup, which then stops the nodes in order.
        self._process = subprocess.Popen(
            [executable_path(name), *own, *arguments],
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def again(self) -> Process:
        """Return a new process of the same node with the same arguments."""
        return Process(self.name, self.arguments, self.nodes, self.own)

    def exit_code(self) -> int | None:
        """Return the exit code, None while it runs."""
        return self._process.poll()

    def stop(self) -> int:
        """Send SIGTERM, then SIGINT, then SIGKILL, with a wait after each; return the exit code.

        One that SIGTERM ends while it imports counts as a normal end; SIGINT would print a
        traceback there, or get lost.
        """
        running = self._process.poll() is None
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGKILL):
            if self._process.poll() is None:
                self._process.send_signal(number)
            try:
                code = self._process.wait(_POLITE_S)
                return 0 if running and code == -signal.SIGTERM else code
            except subprocess.TimeoutExpired:
                click.echo(f"bringup: {self.name} ignored {number.name}", err=True)
                self._process.send_signal(DUMP_STACKS)
        return self._process.wait()


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


def start(simulation: bool = True, params: str | None = None, **wishes: Any) -> list[Process]:
    """Start the chosen nodes and return their processes, in the order of the table.

    Arguments and errors are those of `plan`; entries of a parameter file that no node reads are
    reported.
    """
    planned = plan(simulation, params, **wishes)
    for sentence in planned.warnings:
        click.echo(f"bringup: {sentence}", err=True)
    placed = ["-r", f"__ns:={planned.namespace}"] if planned.namespace else []
    return [
        Process(
            entry.executable, ["--ros-args", *planned.arguments(entry), *placed], entry.nodes,
            own_words(entry),
        )
        for entry in planned.entries
    ]


def stop(processes: list[Process]) -> dict[str, int]:
    """Stop in reverse order, so that the drives go off while the rig still answers."""
    return {process.name: process.stop() for process in reversed(processes)}


network_option = click.option(
    NETWORK, is_flag=True, help="Let other machines take part: docs/security.md."
)


def _old_word(context: click.Context, option: click.Parameter, given: bool) -> None:
    """Refuse the word of earlier versions, which could be taken for `make bench`."""
    if given:
        refused = click.ClickException(f"--bench {OLD_WORD.format('--hardware')}")
        refused.exit_code = 2
        raise refused


@click.command()
@click.option(
    "--hardware", is_flag=True, help=f"The real robot: no sim_rig, {HARDWARE_PARAMETERS}."
)
@click.option("--bench", is_flag=True, hidden=True, expose_value=False, callback=_old_word)
@click.option(
    "--composed", is_flag=True,
    help="One process `module` in place of encoder, force_sensor, impedance_controller, amplifier.",
)
@click.option(
    "--one-process", is_flag=True,
    help="One process `whole` with all nodes: simulated time passes several times as fast.",
)
@click.option(
    "--apart", multiple=True, metavar="NODE",
    help="With --one-process: this node keeps its own process (repeat for more).",
)
@click.option("--wall-clock", is_flag=True, help="The simulated rig runs in real time.")
@click.option("--params", type=click.Path(exists=True, dir_okay=False), help="Parameter file.")
@click.option(
    "--devices", default="", metavar="NAME,...",
    help="Makes of the devices, like epos4,sick_ahm36,ati_net (params/devices).",
)
@click.option(
    "--patient", type=click.Choice(PATIENTS),
    help="Simulated patient who follows what the robot is asked for; else the arm stays in place.",
)
@click.option("--namespace", default="", help="For a second robot, like /second.")
@click.option("--only", multiple=True, help="Start only this node (repeat for more).")
@click.option("--without", multiple=True, help="Leave this node out (repeat for more).")
@click.option(
    "-p", "--param", "values", multiple=True, metavar="NODE:NAME:=VALUE",
    help="Set a parameter, in place of the file's value (repeat for more).",
)
@network_option
def command(
    hardware: bool, network: bool, values: tuple[str, ...], composed: bool, one_process: bool,
    **wishes: Any,
) -> None:
    """Start the therapy robot: every node as a process of its own, until Ctrl-C."""
    end_without_domain("bringup")
    stopping = threading.Event()
    stop_on_signals(stopping)
    try:
        extra = [word for value in checked_values(values) for word in ("-p", value)]
        reach = open_to_network() if network else keep_to_this_machine()
        if reach:
            click.echo(f"bringup: {reach}", err=True)
        shared = shared_process(composed, one_process)
        processes = start(not hardware, extra=extra, shared=shared, **wishes)
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
