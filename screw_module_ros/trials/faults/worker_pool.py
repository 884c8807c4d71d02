# SPDX-License-Identifier: Apache-2.0
"""Parallel graphs, each with a worker process that carries out one row after the other.

A graph in lock step uses little more than one core, because its nodes wait for each other.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from screw_module_ros.nodes.support.runtime import StopFlag
from screw_module_ros.operator.robot import RobotError

from ..graph_run import Interrupted, recordings_in
from .catalogue import all_rows
from .judge import judge
from .row import Row, Verdict
from .testbed import Testbed

_POLL_S = 0.2


class WorkerPool:
    """Carries out rows on `jobs` parallel graphs.

    with WorkerPool(rows, 2) as pool:
        for verdict in pool.verdicts(): ...
    """

    def __init__(self, rows: Sequence[Row], jobs: int):
        self._waiting = list(rows)
        self._jobs = min(jobs, len(rows))
        self._apart: dict[Connection, bool] = {}  # kind of graph of each worker, see `Row.apart`
        self._workers: dict[Connection, BaseProcess] = {}
        self._stopping = StopFlag()

    def __enter__(self) -> WorkerPool:
        self._stopping.catch()
        context = multiprocessing.get_context("spawn")
        for number in range(self._jobs):
            ours, theirs = context.Pipe()
            worker = context.Process(target=_work, args=(theirs,))
            worker.start()
            theirs.close()
            self._workers[ours] = worker
            self._apart[ours] = bool(number % 2)
        return self

    def __exit__(self, kind: type | None, *_: object) -> None:
        for pipe, worker in self._workers.items():
            if kind is not None and worker.is_alive():
                worker.terminate()  # the worker shuts its graph down
            pipe.close()
        for worker in self._workers.values():
            worker.join()
        self._stopping.release()

    def verdicts(self) -> Iterator[Verdict]:
        """Yield the verdicts as they arrive.

        Raises Interrupted after Ctrl-C or SIGTERM, RobotError when a graph cannot be started.
        """
        busy = set(self._workers)
        for pipe in self._workers:
            self._send_next(pipe)
        while busy:
            for pipe in wait(list(busy), _POLL_S):
                yield self._received(pipe)
                if not self._send_next(pipe):
                    pipe.close()
                    busy.discard(pipe)
            if self._stopping:
                raise Interrupted

    def _send_next(self, pipe: Connection) -> bool:
        """Send the next row for the worker's kind of graph, else one for the other kind."""
        if not self._waiting:
            return False
        fitting = (row for row in self._waiting if row.apart == self._apart[pipe])
        row = next(fitting, self._waiting[0])
        self._waiting.remove(row)
        self._apart[pipe] = row.apart
        pipe.send(row.name)
        return True

    def _received(self, pipe: Connection) -> Verdict:
        try:
            answer = pipe.recv()
        except (EOFError, OSError):
            if self._stopping:
                raise Interrupted from None
            worker = self._workers[pipe]
            raise RobotError(f"{worker.name} ended, exit code {worker.exitcode}") from None
        if isinstance(answer, Verdict):
            return answer
        raise RobotError(answer)


def _work(pipe: Connection) -> None:
    """Carry out the rows whose names arrive until the pipe closes; runs in a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles it while no graph runs
    rows = {row.name: row for row in all_rows()}
    with tempfile.TemporaryDirectory(prefix="faults_") as folder:
        os.environ["ROS_LOG_DIR"] = folder
        try:
            _carry_out(pipe, rows, folder)
        except Interrupted:
            pass
        except (RobotError, OSError) as error:
            pipe.send(str(error))


def _carry_out(pipe: Connection, rows: dict[str, Row], folder: str) -> None:
    """Receive names and send verdicts; replace a graph that did not recover."""
    extra = ["--disable-stdout-logs", *recordings_in(Path(folder))]
    testbed: Testbed | None = None
    try:
        while (name := _next(pipe)) is not None:
            row = rows[name]
            if testbed is not None and testbed.composed == row.apart:
                testbed.__exit__(None, None, None)
                testbed = None
            testbed = testbed or Testbed(extra, not row.apart).__enter__()
            verdict = judge(testbed, row)
            if verdict.stuck:
                testbed.__exit__(None, None, None)
                testbed = None
            pipe.send(verdict)
    finally:
        if testbed is not None:
            testbed.__exit__(None, None, None)


def _next(pipe: Connection) -> str | None:
    """Return the next row's name, None after the last."""
    try:
        return pipe.recv()
    except EOFError:
        return None
