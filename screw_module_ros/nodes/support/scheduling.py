# SPDX-License-Identifier: Apache-2.0
"""How the process of a hot loop is scheduled: priority, cores, timers, garbage collection."""

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
_LOWEST = 1  # of SCHED_FIFO
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
