# SPDX-License-Identifier: Apache-2.0
"""The place of a process on its machine: who reaches it, saved state, its folder.

Reach: ROS 2 does not authenticate senders. Every process that can send to the nodes can enable the
drives, home them and record. So the nodes keep to this machine, whatever the discovery range of the
environment says: the `setup.bash` of a ROS installation sets it to the subnet by itself. Only a
word of our own opens them: `SCREW_MODULE_NETWORK=1`, `--network` or `network:=true`. A
Fast DDS profile of the user's is his choice and stays.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier

from screw_module_ros.domain import domain_id
from screw_module_ros.files import state_folder
from screw_module_ros.resources import resource_path

RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
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
        f"keeps to this machine although {' and '.join(wider)}: {NETWORK_VARIABLE}=1, "
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

    Shared memory is not used. A process that is stopped (SIGSTOP, Ctrl-Z, a debugger), killed or
    slow while it holds the lock of its port in Fast DDS's shared memory blocks every process that
    sends to it: an observer could stop the robot. Measured on two busy cores while the recorder
    ended and started: gaps of up to 0.56 s between encoder samples, with UDP 0.1 s. With UDP only a
    socket buffer fills; the latency is the same, and a killed process leaves nothing in /dev/shm.
    Subscribers may use any transport.
    """
    own = str(resource_path(_LOCALHOST_PROFILE))
    if os.environ.get(PROFILES_VARIABLE) == own:  # of a process of ours that started this one
        del os.environ[PROFILES_VARIABLE]
        if os.environ.get(RANGE_VARIABLE) == "SYSTEM_DEFAULT":
            del os.environ[RANGE_VARIABLE]
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
        os.environ[PROFILES_VARIABLE] = own
        os.environ[RANGE_VARIABLE] = "SYSTEM_DEFAULT"
    return told


def _is_open() -> bool:
    return os.environ.get(NETWORK_VARIABLE) == "1"


class SavedState:
    """A small file with the state that a node needs again after its process has ended in any way.

    It is in the user's state folder. Its name is the one with which `lock_node` locks the node: ROS
    domain and full node name. The one process that holds the node's lock writes it.

    path: of the file.
    """

    def __init__(self, full_name: str):
        """Use the file of the node `full_name` in the ROS domain of this process."""
        self.path = state_folder() / "node" / f"{domain_id()}{full_name}.json"
        self._values: Any = None

    def read(self) -> Any:
        """Return the values written last, {} when there is no file.

        Raises OSError when the file cannot be read, or its folder cannot be written: nothing could
        be kept there then. ValueError when the content is not valid.
        """
        try:
            self._values = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            self._values = {}
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not os.access(self.path.parent, os.W_OK):
                raise PermissionError("nothing can be written into its folder") from None
            return self._values
        if not self._values:  # `write` leaves no file then
            raise ValueError("it is empty")
        return self._values

    def write(self, values: dict[str, Any]) -> None:
        """Replace the last values atomically; empty values remove the file.

        Writing the same values again costs nothing. Raises OSError.
        """
        if values == self._values:
            return
        if not values:
            self.path.unlink(missing_ok=True)
            self._values = values
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        # No fsync: it may take longer than the timeout of safety_state. After a power failure
        # a truncated file is unreadable, and `read` reports that; the newest values may be gone.
        beside = self.path.with_suffix(".tmp")
        beside.write_text(json.dumps(values), "utf-8")
        beside.replace(self.path)
        self._values = values


def root_folder(text: str) -> Path:
    """Return the folder that the parameter `folder` names, ~ and links followed.

    Raises ValueError for a home folder of no user, or an impossible one.
    """
    try:
        return Path(text).expanduser().resolve()
    except (RuntimeError, OSError, ValueError) as error:
        raise ValueError(f"cannot use folder {text[:80]!r}: {error}") from None


def below(root: Path, name: str, what: str) -> Path:
    """Return the real path of `name` below `root`, the folder that was set at start.

    Any sender of a message can choose such a name, and the process may have many rights.

    name: relative to `root`, or absolute and within it; links are resolved. what: description of
    the name in the error. Raises ValueError for a name outside of `root`, or one that is no path.
    """
    try:
        path = (root / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise ValueError(f"{what} {name[:80]!r} is no path: {error}") from None
    if path != root and root not in path.parents:
        raise ValueError(
            f"{what} {name[:80]!r} lies outside of {root}: give one below that folder, or start "
            "the node with another `folder`"
        )
    return path


def one_name(name: str, what: str) -> str:
    """Return `name` when it is a plain name of a file or folder. Raises ValueError otherwise."""
    if not name or name in (".", "..") or "/" in name or not name.isprintable():
        raise ValueError(f"{what} {name[:80]!r} is no plain name: no /, not . or .., no signs that "
                         "cannot be seen")
    return name
