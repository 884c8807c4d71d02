# SPDX-License-Identifier: Apache-2.0
"""What the commands of this room have in common: a place of their own, a run of the graph.

    @command("demo")
    @click.option("--quick", is_flag=True)
    def demo(console, quick):
        with running("demo", console, GraphRun(shared=MODULE)) as (robot, graph):
            ...
        return table.accepted

Ctrl-C and SIGTERM only set a flag; `watch` raises Interrupted at the next wait. So no start or stop
of a process is interrupted halfway.
"""

from __future__ import annotations

import functools
import json
import os
import random
import signal
import socket
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click

from screw_module_ros import terminal
from screw_module_ros.domain import domain_id, end_without_domain
from screw_module_ros.lockstep.page import sweep
from screw_module_ros.recording.bag import BagError
from screw_module_ros.recording.pseudonym import date_in_name

from ..files import STATE_VARIABLE
from ..locks import AlreadyRunning, Lock
from ..nodes import bringup
from ..nodes.bringup import network_option
from ..nodes.support.place import NETWORK_VARIABLE, RANGE_VARIABLE
from ..nodes.support.runtime import StopFlag
from ..operator.robot import Robot, RobotError
from ..terminal import Console

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
_DOMAINS = range(1, 101)  # 101 is the last one whose ports are not Linux's ephemeral ones
_DDS_PORT_BASE, _PORTS_PER_DOMAIN = 7400, 250  # DDSI-RTPS 2.5, section 9.6.2.3
_FIRST_PARTICIPANT = 10


class Interrupted(KeyboardInterrupt):
    """Raised after Ctrl-C or SIGTERM."""


def command(name: str) -> Callable[[Callable[..., bool | None]], click.Command]:
    """Make a command of the graph of a function of console and options, as `terminal.command`.

    It has --network as well, like `bringup`.
    """
    decorate = terminal.command(
        name, (RobotError, AlreadyRunning, BagError), partial(end_without_domain, name),
        "stopped; all nodes ended in order",
    )  # fmt: skip

    def made(work: Callable[..., bool | None]) -> click.Command:
        @functools.wraps(work)
        def run(console: Console, network: bool, **options: Any) -> bool | None:
            if network:
                os.environ[NETWORK_VARIABLE] = "1"  # for the nodes, and for the client here
            return work(console, **options)

        return network_option(decorate(run))

    return made


def new_folder(parent: Path, console: Console) -> Path:
    """Make this run's folder, also for its logs, and return it."""
    folder = parent / date_in_name()
    folder.mkdir(parents=True)
    console.folder = folder
    os.environ["ROS_LOG_DIR"] = str((folder / "log").resolve())
    return folder


# A place of its own -----------------------------------------------------------------------------


class Place(NamedTuple):
    """Resources of a run: its ROS domain and the lock on it, None if the user chose the domain.

    state: folder for the state of its nodes, so that none starts with that of another run;
    state_before: that folder in the environment before, None for none.
    """

    domain: int
    lock: Lock | None
    state: tempfile.TemporaryDirectory
    state_before: str | None

    def release(self) -> None:
        """Release the domain."""
        if self.lock is not None:
            os.environ.pop(DOMAIN_VARIABLE, None)
            self.lock.release()
        os.environ.pop(STATE_VARIABLE, None)
        if self.state_before is not None:
            os.environ[STATE_VARIABLE] = self.state_before
        self.state.cleanup()


def own_place() -> Place:
    """Reserve a ROS domain, and with it the simulated buses, for this process and its children.

    A lock that ends with this process reserves it. A ROS_DOMAIN_ID that is already set stays, so
    that a run can join others on purpose. Raises AlreadyRunning when all are in use, DomainError.
    """
    os.environ[RANGE_VARIABLE] = "LOCALHOST"
    if os.environ.get(DOMAIN_VARIABLE):
        domain, lock = domain_id(), None
    else:
        domain, lock = _free_domain()
        os.environ[DOMAIN_VARIABLE] = str(domain)
    state = tempfile.TemporaryDirectory(prefix="screw_module_ros_", ignore_cleanup_errors=True)
    before, os.environ[STATE_VARIABLE] = os.environ.get(STATE_VARIABLE), state.name
    return Place(domain, lock, state, before)


def _free_domain() -> tuple[int, Lock]:
    for domain in random.sample(_DOMAINS, len(_DOMAINS)):
        try:
            lock = Lock(f"place/ROS domain/{domain}", f"ROS domain {domain} is in use")
        except AlreadyRunning:
            continue
        if _is_quiet(_DDS_PORT_BASE + _PORTS_PER_DOMAIN * domain + _FIRST_PARTICIPANT):
            return domain, lock
        lock.release()
    raise AlreadyRunning("every ROS domain tried is in use on this machine: end some runs first")


def _is_quiet(port: int) -> bool:
    # Without SO_REUSEADDR this fails if any process listens there, multicast included.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True


# A run of the graph -----------------------------------------------------------------------------


def recordings_in(folder: Path) -> list[str]:
    """Return the --ros-args with which recorder and bridge have their bags in `folder`."""
    # As YAML. Not in ASCII: the parser of rcl refuses a letter that JSON escapes as two surrogates.
    text = json.dumps(str(folder.resolve()), ensure_ascii=False)
    return ["-p", f"session_recorder:folder:={text}", "-p", f"web_bridge:recordings:={text}"]


class GraphRun:
    """Runs the nodes of the graph as processes, from entering to leaving, isolated from other runs.

    codes: exit codes, after the stop. place: of this run, while it runs.
    """

    place: Place

    def __init__(self, params: str | None = None, **wishes: Any):
        """Prepare; `params` and `wishes`: as of `bringup.start`."""
        self._params, self._wishes = params, wishes
        self.wall_clock = wishes.get("wall_clock", False)
        self._stopping = StopFlag()
        self._processes: list[bringup.Process] = []
        self._may_end: set[str] = set()
        self.codes: dict[str, int] = {}

    def __enter__(self) -> GraphRun:
        self.place = own_place()
        self._stopping.catch()
        try:
            self._processes = bringup.start(True, self._params, **self._wishes)
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._leave()

    def _leave(self) -> None:
        self._stopping.release()
        sweep(str(self.place.domain))
        self.place.release()

    def add(self, name: str, *words: str) -> None:
        """Start one more executable with the same --ros-args and `words`; it may end by itself."""
        arguments = ["--ros-args", *self.arguments("endpoint_state"), *words]
        self._processes.append(bringup.Process(name, arguments))
        self._may_end.add(name)

    @property
    def names(self) -> list[str]:
        """The nodes, in the order they were started."""
        return [node for process in self._processes for node in process.nodes]

    def nodes_of(self, name: str) -> tuple[str, ...]:
        """Return the nodes of one executable."""
        return tuple(self._process(name).nodes)

    @property
    def pids(self) -> dict[str, int]:
        """The process id of each executable."""
        return {process.name: process.pid for process in self._processes}

    def watch(self) -> None:
        """Raise Interrupted after Ctrl-C, RobotError when a node has ended."""
        if self._stopping:
            raise Interrupted
        for process in self._processes:
            code = process.exit_code()
            if code is not None and process.name not in self._may_end:
                raise RobotError(f"{process.name} ended by itself with code {code}")

    def signal(self, name: str, number: signal.Signals, ends: bool = True) -> None:
        """Send a signal to one executable; `ends`: from now on `watch` accepts that it ended."""
        if ends:
            self._may_end.add(name)
        os.kill(self._process(name).pid, number)

    def exit_code(self, name: str) -> int | None:
        """Return the exit code of one executable, None while it runs."""
        return self._process(name).exit_code()

    def restart(self, name: str) -> None:
        """Start one executable again with the same arguments, once it has ended."""
        old = self._process(name)
        if old.exit_code() is None:
            raise RobotError(f"{name} still runs")
        self._processes[self._processes.index(old)] = old.again()
        self._may_end.discard(name)

    def arguments(self, name: str) -> list[str]:
        """Return the --ros-args of the executable that has a node, without that word."""
        found = [process for process in self._processes if name in process.nodes]
        return (found[0] if found else self._process(name)).arguments[1:]

    def _process(self, name: str) -> bringup.Process:
        for process in self._processes:
            if process.name == name:
                return process
        running = ", ".join(process.name for process in self._processes)
        raise RobotError(f"no executable {name} runs; there are {running or 'none'}")

    def wait_until_ready(
        self, robot: Robot, on_waiting: Callable[[list[str]], None] = lambda waiting: None
    ) -> None:
        """Wait until every node is active; `on_waiting` gets the names of the inactive ones."""
        robot.wait_until_ready(self.names, on_waiting=on_waiting)

    def stop(self) -> dict[str, int]:
        """Stop all nodes in reverse order, once; return their exit codes."""
        if not self.codes:
            self.codes = bringup.stop(self._processes)
        return self.codes

    def check_codes(self) -> None:
        """Raise Interrupted after Ctrl-C, RobotError naming the nodes that ended with an error."""
        if self._stopping:
            raise Interrupted
        if failed := [f"{name} (code {code})" for name, code in self.codes.items() if code]:
            raise RobotError(f"ended with an error: {', '.join(failed)}")


@contextmanager
def running(
    name: str,
    console: Console,
    graph: GraphRun,
    beside: Callable[[GraphRun], None] = lambda graph: None,
) -> Iterator[tuple[Robot, GraphRun]]:
    """Start the graph, wait until all nodes are active, and stop them in reverse order.

    name: of the operator's client. beside: adds further executables. Raises RobotError if a node
    does not become active, ends by itself or with an error; Interrupted after Ctrl-C.
    """
    with graph:
        try:
            beside(graph)
            with Robot(name, watch=graph.watch, simulated=not graph.wall_clock) as robot:
                with console.step(f"bring-up of {len(graph.names)} nodes") as detail:
                    graph.wait_until_ready(robot, lambda waiting: detail(", ".join(waiting)))
                yield robot, graph
        finally:
            with console.step("stopping all nodes"):
                graph.stop()
        graph.check_codes()
