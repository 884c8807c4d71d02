# SPDX-License-Identifier: Apache-2.0
"""Transport of messages between our processes: on this machine only, over UDP.

ROS 2 does not authenticate senders. Every process that can send to the nodes can enable the drives,
home them and record. So the nodes keep to this machine, whatever the discovery range of the
environment says: the `setup.bash` of a ROS installation sets it to the subnet by itself. Only a
word of our own opens them: `SCREW_MODULE_NETWORK=1`, `bringup --network` or `network:=true`. A
Fast DDS profile of the user's is his choice and stays.

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

NETWORK_VARIABLE = "SCREW_MODULE_NETWORK"
BUILTIN_VARIABLE = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_PROFILES = (PROFILES_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE")
_PEERS_VARIABLE = "ROS_STATIC_PEERS"
_LOCALHOST_ONLY_VARIABLE = "ROS_LOCALHOST_ONLY"  # deprecated; would bring shared memory back
_LOCALHOST_PROFILE = "params/fastdds_localhost.xml"
# The usual limit for sockets: the recorder may be unable to read for a while. A full buffer loses
# messages but does not block the sender.
_UDP = "UDPv4?sockets_size=4MB&non_blocking=true"
_OPEN = (
    "the nodes listen to the whole subnet: whoever reaches it can enable the drives, move and "
    "home the axes, release and reset stops, change parameters and record; docs/security.md tells "
    "how to admit only whom you know"
)


def keep_to_this_machine() -> str:
    """Restrict this process and its children to this machine, unless a word of ours opened them.

    Call before a ROS context is made. Returns a sentence if the environment asked for more.
    """
    if _is_open() or any(map(os.environ.get, _PROFILES)):
        return ""
    os.environ.pop(_LOCALHOST_ONLY_VARIABLE, None)
    wider = [
        f"{name}={value}"
        for name in (RANGE_VARIABLE, _PEERS_VARIABLE)
        if (value := os.environ.pop(name, "")) not in ("", "LOCALHOST")
    ]
    os.environ[RANGE_VARIABLE] = "LOCALHOST"
    if not wider:
        return ""
    return (
        f"keeps to this machine although {' and '.join(wider)}: {NETWORK_VARIABLE}=1, bringup "
        "--network or network:=true opens the robot to the network, see docs/security.md"
    )


def open_to_network() -> str:
    """Open this process and its children to the subnet; return a warning about the risks."""
    os.environ[NETWORK_VARIABLE] = "1"
    if os.environ.get(RANGE_VARIABLE) in (None, "", "LOCALHOST", "OFF"):
        os.environ[RANGE_VARIABLE] = "SUBNET"
    return _OPEN


def choose_transport() -> str:
    """Make Fast DDS use UDP in this process and its children, unless the environment overrides it.

    They stay on this machine unless opened. Call it before a ROS context is created. Other RMW
    implementations choose their own transport. Returns a sentence for the log where the reach of
    the process is not what the environment suggests, otherwise nothing.
    """
    told = f"open to the network: {open_to_network()}" if _is_open() else keep_to_this_machine()
    if any(map(os.environ.get, (BUILTIN_VARIABLE, *_PROFILES, _PEERS_VARIABLE))):
        return told
    if not get_rmw_implementation_identifier().startswith("rmw_fastrtps"):
        return told
    if _is_open():
        os.environ[BUILTIN_VARIABLE] = _UDP
    else:
        # For this range rmw_fastrtps creates its own transports, shared memory first. The file
        # also restricts to this machine, by the interface.
        os.environ[PROFILES_VARIABLE] = str(resource_path(_LOCALHOST_PROFILE))
        os.environ[RANGE_VARIABLE] = "SYSTEM_DEFAULT"
    return told


def _is_open() -> bool:
    return os.environ.get(NETWORK_VARIABLE) == "1"
