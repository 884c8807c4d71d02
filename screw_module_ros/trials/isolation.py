# SPDX-License-Identifier: Apache-2.0
"""Separates runs on one machine: each has its own ROS domain, and with it its simulated buses.

A lock that ends with this process reserves it. Nodes save the state for their next start in a
folder of the run, so that no node starts with the state of another run. A ROS_DOMAIN_ID that is
already set stays, so that a run can join others on purpose.
"""

from __future__ import annotations

import os
import random
import socket
import tempfile
from typing import NamedTuple

from screw_module_ros.domain import domain_id
from screw_module_ros.nodes.support.place import (
    RANGE_VARIABLE,
    STATE_VARIABLE,
    AlreadyRunning,
    Lock,
)

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
_DOMAINS = range(1, 101)  # 101 is the last one whose ports are not Linux's ephemeral ones
_DDS_PORT_BASE, _PORTS_PER_DOMAIN = 7400, 250  # DDSI-RTPS 2.5, section 9.6.2.3
_FIRST_PARTICIPANT = 10


class Place(NamedTuple):
    """Resources of a run: its ROS domain and the lock on it, None if the user chose the domain.

    state: folder for the state of its nodes; state_before: that folder in the environment before,
    None for none.
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
    """Reserve a domain, and set the environment of this process and its children.

    Raises AlreadyRunning when all of them are in use, DomainError.
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
