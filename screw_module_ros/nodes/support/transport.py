# SPDX-License-Identifier: Apache-2.0
"""Transport of messages between our processes: on this machine only, over UDP.

ROS 2 does not authenticate senders, and by default it communicates with the whole subnet. Every
process that can send to the nodes can enable the drives, home them and record. So the default here
is this machine only, for every node; `ROS_AUTOMATIC_DISCOVERY_RANGE` and `bringup --network` open
it.

Shared memory is not used. A process that is stopped (SIGSTOP, Ctrl-Z, a debugger), killed or slow
while it holds the lock of its port in Fast DDS's shared memory blocks every process that sends to
it: an observer could stop the robot. Measured on two busy cores while the recorder ended and
started: gaps of up to 0.56 s between encoder samples, with UDP 0.1 s. With UDP only a socket buffer
fills; the latency is the same, and a killed process leaves nothing in /dev/shm. Subscribers may use
any transport.
"""

from __future__ import annotations

import os

from rclpy.utilities import get_rmw_implementation_identifier

from screw_module_ros.resources import resource_path

from .isolation import RANGE_VARIABLE

BUILTIN_VARIABLE = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_LOCALHOST_PROFILE = "params/fastdds_localhost.xml"
# The usual limit for sockets: the recorder may be unable to read for a while. A full buffer loses
# messages but does not block the sender.
_UDP = "UDPv4?sockets_size=4MB&non_blocking=true"
_WISHES = (
    BUILTIN_VARIABLE, PROFILES_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_STATIC_PEERS"
)  # fmt: skip


# If one of these is set, the user has chosen the reach of the nodes.
_CHOICES = (
    RANGE_VARIABLE, "ROS_LOCALHOST_ONLY", PROFILES_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE"
)  # fmt: skip
_OPEN = (
    "the nodes listen to the whole subnet: whoever reaches it can enable the drives, move and "
    "home the axes, release and reset stops, change parameters and record; docs/security.md tells "
    "how to admit only whom you know"
)


def keep_to_this_machine() -> None:
    """Restrict this process and its children to this machine, unless the environment overrides it.

    Call before a ROS context is made.
    """
    if not any(map(os.environ.get, _CHOICES)):
        os.environ[RANGE_VARIABLE] = "LOCALHOST"


def open_to_network() -> str:
    """Open this process and its children to the subnet; return a warning about the risks."""
    if os.environ.get(RANGE_VARIABLE) in (None, "", "LOCALHOST", "OFF"):
        os.environ[RANGE_VARIABLE] = "SUBNET"
    return _OPEN


def choose_transport() -> None:
    """Make Fast DDS use UDP in this process and its children, unless the environment overrides it.

    They stay on this machine, with the same exception. Call it before a ROS context is created.
    Other RMW implementations choose their own transport.
    """
    keep_to_this_machine()
    if any(map(os.environ.get, _WISHES)):
        return
    if not get_rmw_implementation_identifier().startswith("rmw_fastrtps"):
        return
    if os.environ.get(RANGE_VARIABLE) == "LOCALHOST":
        # For this range rmw_fastrtps creates its own transports, shared memory first. The file
        # also restricts to this machine, by the interface.
        os.environ[PROFILES_VARIABLE] = str(resource_path(_LOCALHOST_PROFILE))
        os.environ[RANGE_VARIABLE] = "SYSTEM_DEFAULT"
    else:
        os.environ[BUILTIN_VARIABLE] = _UDP
