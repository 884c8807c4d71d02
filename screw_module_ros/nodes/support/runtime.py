# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, lifecycle, hot loop, orderly end.

Two threads share the work. The executor's thread serves services, parameters, lifecycle transitions
and diagnostics. The main thread only repeats `Node.step` while the node is active (the hot
loop), so that no callback delays a command.
"""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from screw_module_ros import graph
from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.domain import DomainError, domain_id
from screw_module_ros.locks import AlreadyRunning, Lock, lock_node
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.page import NoMemory
from screw_module_ros.parameter_files import Sections, only_for_all, sections
from screw_module_ros.settings import SettingError

from .arguments import NETWORK, Arguments, arguments
from .node import ACTIVE, FINALIZED, INACTIVE, UNCONFIGURED, Node
from .place import NETWORK_VARIABLE, choose_transport
from .scheduling import RealtimeSettings, StartSettings, prepare, take_priority

RCLError = rclpy_implementation.RCLError  # exported nowhere else
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_TEARDOWN_S = 6  # bringup sends the next signal after 8
_RETRY_S, _LOOK_S = 1.0, 0.05
_WALL = WallClock()
_NO_TIME = (
    "waiting for sim_rig: nobody moves simulated time in ROS domain {} yet (or set use_sim_time to "
    "false)"
)
_TIME_ELSEWHERE = (
    "waiting for sim_rig: {} comes from another machine or container, and only programs of that "
    "one take part in its simulated time; start this node there, or here by wall clock: "
    "--ros-args -p use_sim_time:=false"
)
DUMP_STACKS = signal.SIGUSR2
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
    stopping = threading.Event()
    stop_on_signals(stopping)
    faulthandler.enable()  # who dies in a library says where
    faulthandler.register(DUMP_STACKS)  # also when the interpreter itself hangs
    # Our errors replace the libraries' log messages, with the node id and the way out.
    for library in ("canopen", "can"):
        logging.getLogger(library).setLevel(logging.CRITICAL)
    given = arguments()
    if given.network:
        os.environ[NETWORK_VARIABLE] = "1"
    reach = choose_transport()
    nodes: list[Node] = []
    locks: list[Lock] = []
    try:
        files = _begin(given)
        nodes += make()
        for node in nodes:
            node.stopping = stopping
            full_name = node.get_fully_qualified_name()
            for sentence in node.parameters.finish(only_for_all(files, full_name)):
                node.get_logger().warning(sentence)
            locks.append(lock_node(full_name))
        if reach:
            nodes[0].get_logger().warning(reach)
        return 0 if _live(nodes, loop) else 1
    except (SettingError, DomainError, AlreadyRunning, NoMemory, RCLError) as error:
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


def _begin(given: Arguments) -> list[Sections]:
    """Begin with ROS; return the sections of the parameter files.

    Raises DomainError, SettingError also for what rcl refuses.
    """
    domain_id()
    if given.others:
        raise SettingError(
            f"unknown arguments: {' '.join(given.others)}; a node takes ROS arguments alone, like "
            f"--ros-args -p NAME:=VALUE --params-file FILE, and {NETWORK}"
        )
    files = [sections(path) for path in given.files]
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:
        raise SettingError(f"the ROS arguments are refused: {error}") from None
    return files


def _live(nodes: list[Node], loop: Callable[[list[Node]], None]) -> bool:
    """Run until the end; return whether requests were served until then."""
    first = nodes[0]
    for node in nodes:
        node.service.start(partial(autostart, node))
    worked = False
    try:
        scheduling = _scheduling(nodes)
        refused = prepare(scheduling)
        while not (first.stopping.is_set() or any(node.active for node in nodes)):
            first.wait_for_activation()
        for sentence in refused + take_priority(scheduling):
            first.get_logger().warning(sentence)
        loop(nodes)
        worked = not any(node.service.failed for node in nodes)
    except Exception as error:
        first.get_logger().fatal(f"the loop failed: {type(error).__name__}: {error}")
        raise
    finally:
        for node in nodes:
            node.service.end()
            node.in_order = worked
        last_resort = LastResort(code=0 if worked else 1)
        for node in reversed(nodes):  # the drive goes off while its controller still runs
            last_resort.disarm()
            node.close(last_resort.arm)
    return worked


class LastResort:
    """Ends a process whose work is done with its code, should the middleware lock up.

    Fast DDS can deadlock while it removes a topic (its issues 6193 and 6502), and rclpy holds the
    interpreter's lock meanwhile. So a timer of the C library calls `_exit`, in a thread of its own.
    Where the system has none left, nothing ends it: no error may keep the drives from their exit.
    """

    def __init__(self, code: int, after_s: int = _TEARDOWN_S) -> None:
        self._after_s = after_s
        self._timer, event = ctypes.c_void_p(), _TimerEvent(value=code, notify=_SIGEV_THREAD)
        event.function = ctypes.cast(ctypes.CDLL(None)._exit, ctypes.c_void_p)  # of `value`
        _RT.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(self._timer))

    def arm(self) -> None:
        """End after that time; the stacks are written to stderr a second before."""
        faulthandler.dump_traceback_later(self._after_s - 1)
        self._set(self._after_s)

    def disarm(self) -> None:
        """Do not end."""
        faulthandler.cancel_dump_traceback_later()
        self._set(0)

    def _set(self, seconds: int) -> None:
        setting = (ctypes.c_long * 4)(0, 0, seconds, 0)  # struct itimerspec: interval, value
        _RT.timer_settime(self._timer, 0, setting, None)


_RT = ctypes.CDLL("librt.so.1")  # library of the timers; since glibc 2.34 it is part of libc
_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _TimerEvent(ctypes.Structure):
    """`struct sigevent` of Linux, 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_void_p), ("signal", ctypes.c_int), ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p), ("attributes", ctypes.c_void_p), ("rest", ctypes.c_long * 4),
    )  # fmt: skip


def _scheduling(nodes: list[Node]) -> RealtimeSettings:
    if nodes[0].clock.simulated:  # time waits for every process: none needs priority
        return RealtimeSettings()
    asked = [node.parameters.read(RealtimeSettings, "realtime") for node in nodes]
    return asked[0]._replace(priority=max(settings.priority for settings in asked))


def autostart(node: Node, wall: Clock = _WALL) -> None:
    """Configure and activate if `autostart` is set; try again each second until it works.

    A node that came before the rig looks for it more often, and begins as soon as it moves time.
    Call it from the node's service thread. wall: clock of the waits.
    """
    if not node.parameters.read(StartSettings).autostart:
        return
    timer = node.periodic.every(wall, _LOOK_S, lambda: attempt())

    def attempt() -> None:
        nonlocal timer
        if node.phase == UNCONFIGURED and not _time_moves(node):
            return
        node.periodic.cancel(timer)  # an attempt may take longer than the time to the next one
        if node.phase == UNCONFIGURED:
            node.trigger_configure()
        if node.phase == INACTIVE:
            node.trigger_activate()
        if node.phase not in (ACTIVE, FINALIZED):
            timer = node.periodic.every(wall, _RETRY_S, attempt)

    attempt()


def _time_moves(node: Node) -> bool:
    """Return whether the clock runs; report it if not."""
    clock = node.clock
    if node.moves_time or not isinstance(clock, SimulatedClock) or clock.page.conductor:
        return True
    heard = node.count_publishers(graph.CLOCK)  # of a rig whose page of time is not here
    text = _TIME_ELSEWHERE.format(node.resolve_topic_name(graph.CLOCK)) if heard else (
        _NO_TIME.format(domain_id())
    )  # fmt: skip
    if node.failure != text:
        node.failure = text
        node.get_logger().info(text)
    return False


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
