# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, lifecycle, hot loop, orderly end.

Two threads share the work. The executor's thread serves services, parameters, lifecycle transitions
and diagnostics. The main thread only repeats `Node.step` while the node is active (the hot
loop), so that no callback delays a command.
"""

from __future__ import annotations

import faulthandler
import logging
import queue
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from screw_module_ros.clock import WallClock
from screw_module_ros.domain import DomainError, domain_id
from screw_module_ros.loop.ticker import BACK_OFF_S

from .command_line import Arguments, arguments, asks_for_help, check_others, usage
from .node import ACTIVE, FINALIZED, INACTIVE, UNCONFIGURED, Node
from .parameter_files import ParameterFile, notices, read_file
from .parameters import ParameterError
from .place import AlreadyRunning, Lock, choose_transport, lock_node
from .scheduling import RealtimeSettings, StartSettings, prepare, take_priority

RCLError = rclpy_implementation.RCLError  # exported nowhere else
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_END_S = 2.0
_TEARDOWN_S = 6  # bringup sends the next signal after 8
_ACTIVE_POLL_S = 0.005
_RETRY_S = 1.0
_NO_TIME = (
    "waiting for sim_rig: nobody moves simulated time in ROS domain {} yet (or set use_sim_time to "
    "false)"
)
TELL_WHERE = signal.SIGUSR2
"""A node that receives this signal writes the stacks of its threads to stderr."""


def main(factory: Callable[[], Node]) -> int:
    """Run the node `factory` makes until SIGINT or SIGTERM; return the exit code.

    0 after a signal, 1 after an error of the loop or the executor's thread, 2 when a parameter or
    the start was refused.
    """
    return run_together(factory.__name__, lambda: [factory()], lambda nodes: nodes[0].run())


def run_together(
    name: str,
    make: Callable[[], list[Node]],
    loop: Callable[[list[Node]], None],
) -> int:
    """Run the nodes that `make` returns in this process, with one hot loop; like `main`.

    loop: runs until the common event `stopping` of the nodes is set. Each node has its own
    services, parameters, lifecycle and diagnostics, and its own thread for them. The process gets
    the highest priority among the nodes and the cores of the first. name: prefix of the message of
    a refused start.
    """
    found = arguments()
    if asks_for_help(found):
        print(usage(Path(sys.argv[0]).name))
        return 0
    stopping = threading.Event()
    stop_on_signals(stopping)
    faulthandler.register(TELL_WHERE)  # also when the interpreter itself hangs
    # Our errors replace the libraries' log messages, with the node id and the way out.
    for library in ("canopen", "can"):
        logging.getLogger(library).setLevel(logging.CRITICAL)
    reach = choose_transport()
    nodes: list[Node] = []
    locks: list[Lock] = []
    try:
        files = _begin(found)
        nodes += make()
        for node in nodes:
            node.stopping = stopping
            _finish(node, files)
            locks.append(lock_node(node.get_fully_qualified_name()))
        if reach:
            nodes[0].get_logger().warning(reach)
        return 0 if _live(nodes, loop) else 1
    except (ParameterError, DomainError, AlreadyRunning, RCLError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    finally:
        for node in nodes:
            node.destroy_node()
            node.clock.close()
        rclpy.try_shutdown()
        for lock in locks:
            lock.release()
        stopped()


def _begin(args: Arguments) -> list[ParameterFile]:
    """Begin with ROS; return the parameter files.

    Raises DomainError, ParameterError for what rcl refuses.
    """
    domain_id()
    check_others(args)
    files = [read_file(path) for path in args.files]
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:
        raise ParameterError(f"the ROS arguments are refused: {error}") from None
    return files


def _finish(node: Node, files: list[ParameterFile]) -> None:
    """Refuse parameters that the node does not have; report entries that it does not read."""
    name = node.get_fully_qualified_name()
    shared = set().union(*(file.shared(name) for file in files))
    for sentence in (*node.parameters.finish(shared), *notices(files, name)):
        node.get_logger().warning(sentence)


def _live(nodes: list[Node], loop: Callable[[list[Node]], None]) -> bool:
    """Run until the end; return whether requests were served until then."""
    ended = threading.Event()
    served = [_Served(node, ended) for node in nodes]
    first = nodes[0]
    try:
        for one in served:
            one.executor.create_task(one.start)
        scheduling = _scheduling(nodes)
        refused = prepare(scheduling)
        while not (first.stopping.is_set() or any(node.active for node in nodes)):
            first.stopping.wait(_ACTIVE_POLL_S)
        for sentence in refused + take_priority(scheduling):
            first.get_logger().warning(sentence)
        loop(nodes)
    except Exception as error:
        first.get_logger().fatal(f"the loop failed: {type(error).__name__}: {error}")
        raise
    finally:
        ended.set()
        for one in served:
            one.join()
        for node in reversed(nodes):  # the drive goes off while its controller still runs
            signal.alarm(0)
            node.close(_end_if_locked_up)
        for one in served:
            one.executor.shutdown(timeout_sec=0.0)
    return not any(one.failed for one in served)


def _end_if_locked_up() -> None:
    """Make sure that the process ends: Fast DDS can lock up while it removes a topic.

    The torque is off by then. The signal's default action works even when Python cannot run.
    """
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(_TEARDOWN_S)


def _scheduling(nodes: list[Node]) -> RealtimeSettings:
    if nodes[0].clock.simulated:  # time waits for every process: none needs priority
        return RealtimeSettings()
    asked = [node.parameters.read(RealtimeSettings, "realtime") for node in nodes]
    return asked[0]._replace(priority=max(settings.priority for settings in asked))


class _Served:
    """A node with the thread that serves its services, timers and parameters.

    failed: whether that thread ended with an error, which ends the node.
    """

    def __init__(self, node: Node, ended: threading.Event):
        self.node = node
        self.failed = False
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(node)
        self._runs = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(ended,), daemon=True)
        self._thread.start()
        self._runs.wait(_END_S)  # from then on the loop may hold simulated time for this thread

    def start(self) -> None:
        """Configure and activate if `autostart` is set; try again each second until it works."""
        if self.node.parameters.read(StartSettings).autostart:
            self._timer = self.node.periodic.every(WallClock(), _RETRY_S, self._try_start)
            self._try_start()

    def _try_start(self) -> None:
        node = self.node
        if node.phase == UNCONFIGURED and not self._time_moves():
            return
        if node.phase == UNCONFIGURED:
            node.trigger_configure()
        if node.phase == INACTIVE:
            node.trigger_activate()
        if node.phase in (ACTIVE, FINALIZED):
            node.periodic.cancel(self._timer)

    def _time_moves(self) -> bool:
        """Return whether the clock runs; report it if not."""
        node = self.node
        if node.moves_time or not node.clock.simulated or node.clock.page.conductor:
            return True
        text = _NO_TIME.format(domain_id())
        if node.failure != text:
            node.failure = text
            node.get_logger().info(text)
        return False

    def _run(self, ended: threading.Event) -> None:
        try:
            self.node.service.make_calls()
            self._runs.set()
            _serve(self.executor, self.node, ended)
        except Exception as error:
            self.failed = True
            self.node.get_logger().fatal(
                f"the node ends, what serves its requests failed: {type(error).__name__}: {error}"
            )

    def join(self) -> None:
        """Wait until the thread has ended."""
        self.node.service.wake()
        self._thread.join(timeout=_END_S)


def _serve(executor: SingleThreadedExecutor, node: Node, ended: threading.Event) -> None:
    # Not `spin`: an executor that is shut down while it spins fails on its own guard condition.
    try:
        while not ended.is_set():
            try:
                executor.spin_once(timeout_sec=node.periodic.left_s())
                if node.periodic.due():
                    node.service.make_calls()
            except InvalidHandle:  # another thread destroyed what rclpy was about to wait for
                ended.wait(BACK_OFF_S)
    finally:
        node.stopping.set()  # without services and diagnostics the node is useless


def stop_on_signals(stopping: threading.Event) -> None:
    """Set `stopping` when SIGINT or SIGTERM comes; call from the main thread.

    A separate thread sets the event. The signal handler must not: it interrupts the main thread,
    which may be in `stopping.wait` and hold the event's lock. Then `set` would wait for ever.
    """
    caught: queue.SimpleQueue[int] = queue.SimpleQueue()  # made to be put into by handlers

    def wait() -> None:
        caught.get()
        stopping.set()

    threading.Thread(target=wait, name="signals", daemon=True).start()
    for number in _SIGNALS:
        signal.signal(number, lambda received, _: caught.put(received))


def stopped() -> None:
    """Ignore further signals: the process ends, and the interpreter removes the handlers first.

    Otherwise a second Ctrl-C would kill a process that has finished its work.
    """
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class StopFlag:
    """True once SIGINT or SIGTERM came between `catch` and `release`; both from the main thread.

    Not an Event: a handler that interrupts another one in `set` would wait for ever.
    """

    def __init__(self) -> None:
        self._came = False
        self._before: dict[signal.Signals, Any] = {}

    def __bool__(self) -> bool:
        return self._came

    def catch(self) -> None:
        """Handle the signals from now on."""
        for number in _SIGNALS:
            self._before[number] = signal.signal(number, self._note)

    def release(self) -> None:
        """Restore the previous handlers."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def _note(self, *_: object) -> None:
        self._came = True
