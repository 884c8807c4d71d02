# SPDX-License-Identifier: Apache-2.0
"""Small file with the state that a node needs again after its process has ended in any way.

It is in $XDG_STATE_HOME/screw_module_ros (else ~/.local/state), so each user has their own. Its
name is the one with which `single.lock_node` locks the node: ROS domain and full node name. The
spelling in the environment does not matter: a node that starts from another shell, from a service
manager without HOME or with domain 07 finds the file of domain 7.
"""

from __future__ import annotations

import contextlib
import json
import os
import pwd
from pathlib import Path
from typing import Any

from screw_module_ros.domain import domain_id

STATE_VARIABLE = "XDG_STATE_HOME"
_LARGEST = 64 * 1024  # bytes


class Kept:
    """The file of one node; written by the one process that holds the node's lock.

    path: of the file, None without a folder for it. place: the same as text for messages.
    """

    def __init__(self, full_name: str):
        """Use the file of the node `full_name` in the ROS domain of this process."""
        folder = state_folder()
        self.path: Path | None = None
        self.place = f"no place for it: {STATE_VARIABLE} and HOME are unset or no absolute paths"
        if folder is not None:
            name = f"{domain_id()}{full_name}.json"
            self.path = folder / "screw_module_ros" / "node" / name
            self.place = str(self.path)
        self._values: Any = None

    def read(self) -> Any:
        """Return the values written last, {} when there is no file.

        Raises OSError when the file cannot be read, or its folder cannot be written; ValueError
        when the content is not valid.
        """
        path = self._known_path()
        try:
            with path.open("rb") as file:
                content = file.read(_LARGEST + 1)
        except FileNotFoundError:
            _check_writable(path.parent)
            self._values = {}
            return self._values
        if len(content) > _LARGEST:
            raise ValueError(f"more than {_LARGEST} bytes")
        try:
            self._values = json.loads(content.decode("utf-8"))
        except RecursionError:
            raise ValueError("nested too deeply") from None
        if not self._values:  # `write` leaves no file then
            raise ValueError("it says nothing")
        return self._values

    def write(self, values: dict[str, Any]) -> None:
        """Replace the last values atomically; empty values remove the file.

        Writing the same values again costs nothing, also after a failure. Raises OSError.
        """
        if values == self._values:
            return
        self._values = values
        path = self._known_path()
        if not values:
            path.unlink(missing_ok=True)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_suffix(f".{os.getpid()}.tmp")
        try:
            # No fsync: it may take longer than the timeout of safety_state. After a power failure
            # a truncated file is unreadable, and `read` reports that.
            beside.write_text(json.dumps(values), "utf-8")
            beside.replace(path)
        finally:
            with contextlib.suppress(OSError):
                beside.unlink()

    def _known_path(self) -> Path:
        if self.path is None:
            raise FileNotFoundError("set HOME, or XDG_STATE_HOME, to an absolute path")
        return self.path


def state_folder() -> Path | None:
    """Return the folder for programs' state, None without an absolute path for it.

    A relative XDG_STATE_HOME counts as unset, as its specification requires (XDG Base Directory
    0.8): it would depend on the folder in which a node starts. The same holds for a relative HOME.
    """
    override = os.environ.get(STATE_VARIABLE, "")
    if os.path.isabs(override):
        return Path(override)
    home = os.environ.get("HOME", "")
    if not os.path.isabs(home):
        try:
            home = pwd.getpwuid(os.getuid()).pw_dir
        except KeyError:
            return None
    return Path(home) / ".local" / "state" if os.path.isabs(home) else None


def _check_writable(folder: Path) -> None:
    """Raise OSError when no file can be written into a folder, which need not exist yet."""
    there = next(each for each in (folder, *folder.parents) if each.exists())
    if not there.is_dir():
        raise NotADirectoryError(f"{there} is no folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PermissionError(f"nothing can be written into {there}")
