# SPDX-License-Identifier: Apache-2.0
"""The hot loop's tools: ticks on CLOCK_MONOTONIC, a wait set of our own, thread settings.

rclpy's executor spends about 60 us per callback. The hot subscriptions of a node are therefore
kept out of its executor (`HotGroup`) and taken by hand from a wait set.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import struct
import sys
import time
from collections.abc import Collection
from typing import Annotated, Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from screw_module_ros.settings import Setting

_PR_SET_TIMERSLACK = 29
_LOWEST = 1  # of SCHED_FIFO
BREATH_NS = 100_000
"""A hot loop that was woken for nothing sleeps so long before it waits again [ns]: a wait set that
is always ready would else make it spin, at a priority at which nobody else on its core runs."""
_SWITCH_INTERVAL = 50e-6  # s; a service callback keeps the loop waiting at most this long


class RealtimeSettings(NamedTuple):
    """How the process is scheduled."""

    priority: Annotated[
        int, Setting("SCHED_FIFO priority of the loop, 0 for the normal scheduler", "", 0, 90)
    ] = 0
    cores: Annotated[
        tuple, Setting("processor cores this process may use, -1 for all", "", -1, 1023)
    ] = (-1,)


def prepare(settings: RealtimeSettings) -> list[str]:
    """Make the process fit for a loop: cores, timers, no garbage to collect later.

    Call from the loop's thread when the node is made. Returns what could not be had, as sentences.
    """
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    sys.setswitchinterval(_SWITCH_INTERVAL)
    if settings.priority:
        _keep_processor_awake()
    gc.collect()
    gc.freeze()
    wanted = {core for core in settings.cores if core >= 0}
    missing = wanted - set(range(os.cpu_count() or 1))
    if missing:
        return [f"realtime.cores names {sorted(missing)}, which this machine does not have"]
    try:
        for thread in _threads() if wanted else ():
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(thread, wanted)
    except OSError as error:  # of a sandbox, or of cores that somebody has set aside
        return [f"realtime.cores {sorted(wanted)} cannot be had: {error.strerror}"]
    return []


def take_priority(settings: RealtimeSettings) -> list[str]:
    """Give the threads of the process SCHED_FIFO, where that is asked for.

    Call when the node is active, not before: to configure is half a second of work that must not
    keep the loops of other nodes waiting. The executor's thread gets the loop's priority: while it
    holds the interpreter's lock the loop waits for it in short naps, and with less it would never
    be let finish. Of Fast DDS's threads only those that bring samples get it: discovery is a burst
    of work and must not come first. It gets the lowest, because it holds locks that the loop needs
    when it publishes: left among the ordinary threads of a busy machine, it keeps the loop waiting
    for 0.5 s. Returns what could not be had, as sentences.
    """
    if not settings.priority:
        return []
    for thread in _threads():
        try:
            first = _in_the_way_of_samples(thread)
            priority = os.sched_param(settings.priority if first else _LOWEST)
            os.sched_setscheduler(thread, os.SCHED_FIFO, priority)
        except PermissionError:
            return [
                f"no permission for SCHED_FIFO {settings.priority}: running with the normal "
                "scheduler (grant rtprio in limits.conf to have it)"
            ]
        except (ProcessLookupError, FileNotFoundError):
            continue
    return []


def _threads() -> list[int]:
    return [int(thread) for thread in os.listdir("/proc/self/task")]


def _keep_processor_awake() -> None:
    """Ask for no sleep states while this process lives, where that is permitted (Linux PM QoS).

    A processor that slept through the rest of a period wakes late and with cold caches.
    """
    with contextlib.suppress(OSError):
        request = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
        os.write(request, struct.pack("i", 0))  # held until the descriptor goes with the process


def _in_the_way_of_samples(thread: int) -> bool:
    """Return whether samples pass through `thread`: Python's own, and Fast DDS's odd ports.

    By the RTPS port numbers (DDSI-RTPS 2.5, 9.6.2.3) discovery has even ones, user traffic odd.
    """
    with open(f"/proc/self/task/{thread}/comm") as file:
        name = file.read().strip()
    if not name.startswith("dds."):
        return True
    port = name.rpartition(".")[2]
    return name.startswith(("dds.udp.", "dds.shm.")) and port.isdigit() and int(port) % 2 == 1


class Tick(NamedTuple):
    """One multiple of the period on CLOCK_MONOTONIC."""

    sequence: int
    monotonic_ns: int
    stamp_ns: int
    skipped: int


class Ticker:
    """Whole multiples of `period_ns` of CLOCK_MONOTONIC; an overrun skips ticks, never bursts."""

    def __init__(self, period_ns: int):
        self.period_ns = period_ns
        self._last = time.monotonic_ns() // period_ns

    def due_ns(self) -> int:
        """Return the time of the next tick, CLOCK_MONOTONIC in ns."""
        return (self._last + 1) * self.period_ns

    def sleep(self) -> Tick:
        """Sleep until the next tick."""
        wait = self.due_ns() - time.monotonic_ns()
        if wait > 0:
            time.sleep(wait * 1e-9)
        return self.take()

    def take(self) -> Tick:
        """Return the tick of now; the caller has seen to it that it is due."""
        now = time.monotonic_ns()
        number = max(now // self.period_ns, self._last + 1)
        skipped = number - self._last - 1
        self._last = number
        return Tick(number & 0xFFFFFFFF, now, time.time_ns(), skipped)


class HotGroup(CallbackGroup):
    """A group no executor ever serves: its subscriptions are taken by the hot loop."""

    def can_execute(self, entity) -> bool:
        """Return False: the executor leaves the entity alone."""
        return False

    def beginning_execution(self, entity) -> bool:
        """Return False: never executed."""
        return False

    def ending_execution(self, entity) -> None:
        """Do nothing: never executed."""


class Inbox:
    """Subscriptions of the hot loop, waited for together and taken one by one.

    direct: topics whose content another part of this process hands over by calls; they are not
    subscribed to, and taking from them gives None.
    """

    def __init__(self, node: Node, direct: Collection[str] = ()):
        self._node = node
        self._direct = direct
        self._group = HotGroup()
        self._subscriptions: list[Subscription] = []
        self._waking: list[Any] = []
        self._wait_set: Any = None

    def subscribe(self, kind: type, topic: str, qos: QoSProfile, wakes: bool = False):
        """Subscribe; return a function that takes the newest message or None.

        `wakes`: `wait` returns when a message of this subscription is there.
        """
        if topic in self._direct:
            return _nothing
        subscription = self._node.create_subscription(
            kind, topic, _never, qos, callback_group=self._group
        )
        self._subscriptions.append(subscription)
        if wakes:
            self._waking.append(subscription.handle)
        raw_take = subscription.handle.take_message

        def take():
            taken = raw_take(kind, False)
            return taken[0] if taken is not None else None

        return take

    def publishers(self, topic: str) -> int:
        """Return how many publishers there are on `topic` for the subscription made to it."""
        return self._node.count_publishers(topic)

    def wait(self, timeout_ns: int) -> None:
        """Wait at most `timeout_ns` for a message of a waking subscription."""
        if self._wait_set is None:
            context = self._node.context
            with context.handle:
                self._wait_set = _rclpy.WaitSet(len(self._waking), 0, 0, 0, 0, 0, context.handle)
        wait_set = self._wait_set
        wait_set.clear_entities()
        for handle in self._waking:
            wait_set.add_subscription(handle)
        wait_set.wait(max(0, timeout_ns))

    def close(self) -> None:
        """Destroy the subscriptions."""
        self._wait_set, self._waking = None, []
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []


def _nothing() -> None:
    return None


def _never(message) -> None:
    raise AssertionError("a hot subscription is never served by the executor")


def breathe() -> None:
    """Sleep for BREATH_NS."""
    time.sleep(BREATH_NS * 1e-9)


def fill_stamp(message: Any, stamp_ns: int) -> None:
    """Write `stamp_ns` (ns since the epoch) into the flat message's stamp."""
    message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
