# SPDX-License-Identifier: Apache-2.0
"""What a node must know again after its process has ended, however it ended: a small file.

It lies in $XDG_STATE_HOME/screw_module_ros (else ~/.local/state), so each user has their own, under
the name by which `single.lock_node` locks the node: ROS domain and full node name.
"""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

STATE_VARIABLE = "XDG_STATE_HOME"


class Kept:
    """The file of one node; written by the one process that holds the node's lock."""

    def __init__(self, full_name: str):
        """Name the file of the node `full_name` in the ROS domain of this process."""
        home = os.environ.get(STATE_VARIABLE) or os.path.expanduser("~/.local/state")
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        self.path = Path(home) / "screw_module_ros" / "node" / f"{domain}{full_name}.json"
        self._values: Any = None

    def read(self) -> Any:
        """Return what was written last, {} when there is no file.

        Raises OSError when it cannot be read, ValueError when it is no JSON.
        """
        try:
            self._values = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            self._values = {}
        except RecursionError:
            raise ValueError("nested too deeply") from None
        return self._values

    def write(self, values: dict[str, Any]) -> None:
        """Write values in place of the last ones, at once or not at all; without any, no file.

        The same values again cost nothing, also after a failure. Raises OSError.
        """
        if values == self._values:
            return
        self._values = values
        if not values:
            self.path.unlink(missing_ok=True)
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        beside = self.path.with_suffix(f".{os.getpid()}.tmp")
        try:
            # Not synced: that may take longer than safety_state may be silent. A power failure
            # that cuts the file short leaves one that cannot be read.
            beside.write_text(json.dumps(values), "utf-8")
            beside.replace(self.path)
        finally:
            with contextlib.suppress(OSError):
                beside.unlink()
