# SPDX-License-Identifier: Apache-2.0
"""Locks of this machine: one copy of each node, one client per device, one simulation per bus.

A lock is a bound abstract Unix socket. The kernel frees it at any end of the process, so a killed
node never blocks its successor, and no file remains on the disk.
"""

from __future__ import annotations

import socket

from .domain import domain_id


class AlreadyRunning(RuntimeError):
    """Another process holds the name; the message says which and what to do."""


class Lock:
    """A machine-wide name held by this process until `release` or its end."""

    def __init__(self, name: str, taken: str):
        """Lock `name`; raise AlreadyRunning with the message `taken` if another process has it."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind(b"\0screw_module_ros/" + name.encode())
        except OSError:
            self._socket.close()
            raise AlreadyRunning(taken) from None

    def release(self) -> None:
        """Release the name."""
        self._socket.close()


def runs(full_name: str) -> bool:
    """Return whether a node of this full name runs in our ROS domain on this machine."""
    try:
        lock_node(full_name).release()
    except AlreadyRunning:
        return True
    return False


def lock_node(full_name: str) -> Lock:
    """Lock the node name `full_name` within the ROS domain of this process."""
    domain = domain_id()
    return Lock(
        f"node/{domain}{full_name}",
        f"a node {full_name} already runs in ROS domain {domain}: stop it first, or start this "
        "one in another namespace (--ros-args -r __ns:=/second)",
    )


def lock_device(bus: str, device: str) -> Lock:
    """Lock one device of one bus: two SDO clients on a device would disturb each other.

    bus: its name, unique on this machine.
    """
    return Lock(
        f"device/{bus}/{device}",
        f"{device} on {bus} is already driven by another process of this machine: stop that one "
        "first",
    )


def lock_simulation(bus: str) -> Lock:
    """Lock the simulated devices of one bus: two simulations would both answer every request."""
    return Lock(
        f"rig/{bus}",
        f"the devices on {bus} are already simulated by another process of this machine: stop that "
        "one first, or start this one in another namespace or ROS domain",
    )
