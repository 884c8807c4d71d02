# SPDX-License-Identifier: Apache-2.0
"""How messages travel between our processes: on this machine alone, over UDP.

Every process that can send to the nodes can enable the drives, home them and record: ROS 2 does not
authenticate senders, and by default it talks to the whole subnet. So the default here is this
machine, for every node; `ROS_AUTOMATIC_DISCOVERY_RANGE` and `bringup --network` open it.

Not through shared memory: A process that is stopped (SIGSTOP, Ctrl-Z, a debugger), killed or just
slow while it holds the lock of its port in Fast DDS's shared memory keeps every process waiting
that sends to it: a spectator could stop the robot. Measured on two busy cores while the recorder
ended and started: gaps of up to 0.56 s between encoder samples, over UDP 0.1 s. A socket's buffer
only fills; the latency is the same, and a killed process leaves nothing in /dev/shm. Subscribers
may use any transport.
"""

from __future__ import annotations

import os

from rclpy.utilities import get_rmw_implementation_identifier

from screw_module_ros.resources import resource_path

from .isolation import RANGE_VARIABLE

BUILTIN_VARIABLE = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_LOCALHOST_PROFILE = "params/fastdds_localhost.xml"
# As large as the usual limit for sockets: the recorder may be kept from reading for a while. A full
# buffer loses a message, it does not keep the sender waiting.
_UDP = "UDPv4?sockets_size=4MB&non_blocking=true"
_WISHES = (
    BUILTIN_VARIABLE, PROFILES_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_STATIC_PEERS"
)  # fmt: skip


# Whoever sets one of these has chosen with whom the nodes talk.
_CHOICES = (
    RANGE_VARIABLE, "ROS_LOCALHOST_ONLY", PROFILES_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE"
)  # fmt: skip
_OPEN = (
    "the nodes listen to the whole subnet: whoever reaches it can enable the drives, move and "
    "home the axes, release and reset stops, change parameters and record; docs/security.md tells "
    "how to admit only whom you know"
)


def keep_to_this_machine() -> None:
    """Let this process and its children talk to this machine alone, unless the environment says
    otherwise.

    Call before a ROS context is made.
    """
    if not any(map(os.environ.get, _CHOICES)):
        os.environ[RANGE_VARIABLE] = "LOCALHOST"


def open_to_network() -> str:
    """Let this process and its children talk to the subnet; return what that makes possible."""
    if os.environ.get(RANGE_VARIABLE) in (None, "", "LOCALHOST", "OFF"):
        os.environ[RANGE_VARIABLE] = "SUBNET"
    return _OPEN


def choose_transport() -> None:
    """Let Fast DDS use UDP in this process and its children, unless something else is asked for.

    They keep to this machine, unless the environment says otherwise. Call before a ROS context is
    made. Other RMW implementations choose their transport themselves.
    """
    keep_to_this_machine()
    if any(map(os.environ.get, _WISHES)):
        return
    if not get_rmw_implementation_identifier().startswith("rmw_fastrtps"):
        return
    if os.environ.get(RANGE_VARIABLE) == "LOCALHOST":
        # For this range rmw_fastrtps makes transports of its own, shared memory first. The file
        # keeps to this machine as well, by the interface.
        os.environ[PROFILES_VARIABLE] = str(resource_path(_LOCALHOST_PROFILE))
        os.environ[RANGE_VARIABLE] = "SYSTEM_DEFAULT"
    else:
        os.environ[BUILTIN_VARIABLE] = _UDP
