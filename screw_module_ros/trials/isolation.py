# SPDX-License-Identifier: Apache-2.0
"""Separates runs on one machine: each has its own ROS domain and CAN ports.

Locks that end with this process reserve them. Nodes save the state for their next start in a folder
of the run, so that no node starts with the state of another run. A ROS_DOMAIN_ID that is already
set stays, so that a run can join others on purpose.
"""

from __future__ import annotations

import os
import random
import socket
import tempfile
from typing import NamedTuple

from screw_module_ros.can_io.bus import MULTICAST_ROUTE, BusSettings
from screw_module_ros.domain import domain_id
from screw_module_ros.graph import BUSES
from screw_module_ros.nodes.bringup import port_arguments
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
_FIRST_PORTS = range(65_050, 65_530, 10)
"""First CAN ports of runs: above Linux's ephemeral ones, of which any socket may get one, also the
middleware's of the same run: then a bus could not be opened. Tests have 61 000 to 65 039."""


class Place(NamedTuple):
    """Resources of a run: its ROS domain, the first of its four CAN ports, and their locks.

    own_domain: the domain was chosen for this run, not by the user. state: folder for the state of
    its nodes; state_before: that folder in the environment before, None for none.
    """

    domain: int
    first_port: int
    locks: tuple[Lock, ...]
    own_domain: bool
    state: tempfile.TemporaryDirectory
    state_before: str | None

    def release(self) -> None:
        """Release the domain and the ports."""
        if self.own_domain:
            os.environ.pop(DOMAIN_VARIABLE, None)
        os.environ.pop(STATE_VARIABLE, None)
        if self.state_before is not None:
            os.environ[STATE_VARIABLE] = self.state_before
        self.state.cleanup()
        for lock in self.locks:
            lock.release()

    def arguments(self) -> list[str]:
        """Return the --ros-args that put every node on this run's CAN ports."""
        return port_arguments(self.first_port)


def own_place() -> Place:
    """Reserve a domain and ports, and set the environment of this process and its children.

    Raises AlreadyRunning when all of them are in use, DomainError, OSError without multicast.
    """
    _check_multicast()
    os.environ[RANGE_VARIABLE] = "LOCALHOST"
    locks = []
    own_domain = not os.environ.get(DOMAIN_VARIABLE)
    if not own_domain:
        domain = domain_id()
    else:
        domain, lock = _first_free(
            random.sample(_DOMAINS, len(_DOMAINS)), "ROS domain", lambda d: [_first_dds_port(d)]
        )
        locks.append(lock)
        os.environ[DOMAIN_VARIABLE] = str(domain)
    port, lock = _first_free(
        _FIRST_PORTS,
        "CAN port",
        lambda first: range(first, first + len(BUSES)),
    )
    locks.append(lock)
    state = tempfile.TemporaryDirectory(prefix="screw_module_ros_", ignore_cleanup_errors=True)
    before, os.environ[STATE_VARIABLE] = os.environ.get(STATE_VARIABLE), state.name
    return Place(domain, port, tuple(locks), own_domain, state, before)


def _check_multicast() -> None:
    """Raise OSError if no interface carries multicast: each node would wait for the others."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        group = socket.inet_aton(BusSettings().channel) + socket.inet_aton("0.0.0.0")
        try:
            probe.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        except OSError as error:
            raise OSError(
                f"no network interface carries multicast ({error.strerror}), which the simulated "
                f"buses and the nodes' discovery need: {MULTICAST_ROUTE}"
            ) from None


def _first_free(numbers, what: str, ports_of) -> tuple[int, Lock]:
    for number in numbers:
        try:
            lock = Lock(f"place/{what}/{number}", f"{what} {number} is in use")
        except AlreadyRunning:
            continue
        if all(map(_is_quiet, ports_of(number))):
            return number, lock
        lock.release()
    raise AlreadyRunning(f"every {what} tried is in use on this machine: end some runs first")


def _first_dds_port(domain: int) -> int:
    return _DDS_PORT_BASE + _PORTS_PER_DOMAIN * domain + _FIRST_PARTICIPANT


def _is_quiet(port: int) -> bool:
    # Without SO_REUSEADDR this fails if any process listens there, multicast included.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
