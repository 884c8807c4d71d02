# SPDX-License-Identifier: Apache-2.0
"""Keeps runs side by side apart: each has a ROS domain of its own, and its simulated buses.

A run holds a lock on its domain number, so that no other run on this machine takes it.
"""

from __future__ import annotations

import fcntl
import os
import random
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

DOMAINS = range(1, 101)  # 101 is the last one whose ports are not Linux's ephemeral ones
DDS_PORT_BASE, PORTS_PER_DOMAIN = 7400, 250  # DDSI-RTPS 2.5, section 9.6.2.3
DOMAIN_VARIABLE = "ROS_DOMAIN_ID"


def variables(domain: int) -> dict[str, str]:
    """Return the environment variables of a run with this domain."""
    return {DOMAIN_VARIABLE: str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def dds_ports(domain: int) -> range:
    """Return the UDP ports that DDS uses in a domain."""
    first = DDS_PORT_BASE + PORTS_PER_DOMAIN * domain
    return range(first, first + PORTS_PER_DOMAIN)


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a domain number that no other run on this machine uses; RuntimeError without one."""
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        lock = _locked(domain)
        if lock is None:
            continue
        with lock:
            if _is_quiet(domain):
                yield domain
                return
    raise RuntimeError("all ROS domains from 1 to 100 are in use on this machine: end some runs")


def _locked(domain: int) -> IO[str] | None:
    # One folder per user: another user's lock file could not be opened.
    folder = Path(tempfile.gettempdir()) / f"screw_module_ros-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    lock = (folder / f"domain_{domain}.lock").open("w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        return None
    return lock


def _is_quiet(domain: int) -> bool:
    # The first participant of a domain takes base + 10 for itself alone.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", dds_ports(domain)[10]))
        except OSError:
            return False
    return True
