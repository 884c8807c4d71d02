# SPDX-License-Identifier: Apache-2.0
"""Runs the whole graph against the rig, isolated from other runs, and always shuts it down.

    with GraphRun() as graph, Robot("demo", watch=graph.watch) as robot:
        graph.wait_until_ready(robot)

Ctrl-C and SIGTERM only set a flag; `watch` raises Interrupted at the next wait. So no start or stop
of a process is interrupted halfway.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

from screw_module_ros.lockstep.page import sweep
from screw_module_ros.trials.isolation import Place, own_place

from ..graph import nodes_of
from ..nodes import bringup
from ..nodes.support.runtime import StopFlag
from ..operator.robot import Robot, RobotError


class Interrupted(Exception):
    """Raised after Ctrl-C or SIGTERM."""


def recordings_in(folder: Path) -> list[str]:
    """Return the --ros-args that let the recorder write its bags into `folder`."""
    # As YAML. Not in ASCII: the parser of rcl refuses a letter that JSON escapes as two surrogates.
    text = json.dumps(str(folder.resolve()), ensure_ascii=False)
    return ["-p", f"session_recorder:folder:={text}"]


class GraphRun:
    """Context manager that runs the nodes of the graph as processes."""

    def __init__(
        self,
        params: str | None = None,
        extra: Sequence[str] = (),
        only: Sequence[str] = (),
        without: Sequence[str] = (),
        composed: bool = False,
        wall_clock: bool = False,
    ):
        """Prepare; `params`, `extra`, `composed`, `wall_clock`: as of `bringup.start`."""
        self._params, self._extra, self._composed = params, list(extra), composed
        self.wall_clock = wall_clock
        self._only, self._without = list(only), list(without)
        self._stopping = StopFlag()
        self._processes: list[bringup.Process] = []
        self._place: Place | None = None
        self._may_end: set[str] = set()
        self.codes: dict[str, int] = {}

    def __enter__(self) -> GraphRun:
        self._place = own_place()
        self._stopping.catch()
        try:
            self._processes = bringup.start(
                True,
                self._params,
                only=self._only,
                without=self._without,
                extra=self._extra,
                composed=self._composed,
                wall_clock=self.wall_clock,
            )
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._leave()

    def _leave(self) -> None:
        self._stopping.release()
        if self._place is not None:
            sweep(str(self._place.domain))
            self._place.release()

    @property
    def names(self) -> list[str]:
        """The nodes, in the order they were started."""
        return [node for process in self._processes for node in nodes_of(process.name)]

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

    @property
    def place(self) -> Place:
        """The ROS domain of this run."""
        return self._place

    def signal(self, name: str, number: signal.Signals, ends: bool = True) -> None:
        """Send a signal to one executable; `ends`: from now on `watch` accepts that it ended."""
        if ends:
            self._may_end.add(name)
        os.kill(self._process(name).pid, number)

    def exit_code(self, name: str) -> int | None:
        """Return the exit code of one executable, None while it runs."""
        return self._process(name).exit_code()

    def pid(self, name: str) -> int:
        """Return the process id of one executable."""
        return self._process(name).pid

    def restart(self, name: str) -> None:
        """Start one executable again with the same arguments, once it has ended."""
        old = self._process(name)
        if old.exit_code() is None:
            raise RobotError(f"{name} still runs")
        self._processes[self._processes.index(old)] = old.again()
        self._may_end.discard(name)

    def arguments(self, name: str) -> list[str]:
        """Return the --ros-args of one executable, without that word."""
        return self._process(name).arguments[1:]

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
        """Stop all nodes in order, once; return their exit codes."""
        if not self.codes:
            self.codes = bringup.stop(self._processes)
        return self.codes

    def check_codes(self) -> None:
        """Raise Interrupted after Ctrl-C, RobotError naming the nodes that ended with an error."""
        if self._stopping:
            raise Interrupted
        if failed := [f"{name} (code {code})" for name, code in self.codes.items() if code]:
            raise RobotError(f"ended with an error: {', '.join(failed)}")
