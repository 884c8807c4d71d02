# SPDX-License-Identifier: Apache-2.0
"""Scheduling of a process with a hot loop: priority, cores, timers, garbage collection."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import struct
import sys
from typing import Annotated, NamedTuple

from screw_module_ros.settings import Setting

_PR_SET_TIMERSLACK = 29
_LOWEST = 1  # lowest priority of SCHED_FIFO
_SWITCH_INTERVAL = 50e-6  # s; longest delay of the loop by a service callback


class StartSettings(NamedTuple):
    """Start of the node."""

    autostart: Annotated[
        bool, Setting("configure and activate at start, and try again until it works")
    ] = True


class RealtimeSettings(NamedTuple):
    """Scheduling of the process."""

    priority: Annotated[
        int, Setting("SCHED_FIFO priority of the loop, 0 for the normal scheduler", "", 0, 90)
    ] = 0
    cores: Annotated[
        tuple, Setting("processor cores this process may use, -1 for all", "", -1, 1023)
    ] = (-1,)


def prepare(settings: RealtimeSettings) -> list[str]:
    """Prepare the process for a loop: cores, timers, no garbage collection.

    Call it from the loop's thread after creating the node. Returns a message for each setting that
    the system refused.
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
    """Give the threads of the process SCHED_FIFO, if the settings request it.

    Call it when the node is active, not before: configuring is half a second of work that must not
    delay the loops of other nodes. Returns a message for each setting that the system refused.

    The executor's thread gets the loop's priority: while it holds the interpreter's lock the loop
    polls for the lock, and with a lower priority that thread would never finish. Of Fast DDS's
    threads only those that receive samples get it, because discovery works in bursts that must not
    delay the loop. The discovery threads get the lowest real-time priority, because they hold locks
    that the loop needs to publish: as normal threads of a busy machine they delayed the loop by
    0.5 s.
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
    """Request no sleep states while this process lives, if permitted (Linux PM QoS).

    A processor that sleeps for the rest of a period wakes late and with cold caches.
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
