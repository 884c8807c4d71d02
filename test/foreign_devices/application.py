# SPDX-License-Identifier: Apache-2.0
"""What a device's application and a CANopen stack see of each other.

The applications are ours; object dictionary, SDO, PDO, NMT, heartbeat and EMCY are the stack's,
which nobody here wrote.
Nothing on this side of the bus imports this project: `test_independence.py` looks.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import canopen
from canopen.objectdictionary import ODVariable

#: NMT states (CiA 301, 7.3.2).
INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
ROOT = Path(__file__).parents[2]
#: The EDS files that a user gets for the simulated devices (CiA 306): text, no code of the rig.
EDS = ROOT / "screw_module_ros/rig/eds"


class Stack(Protocol):
    """What a stack does for an application; called by the stack's own thread alone."""

    def get(self, index: int, subindex: int = 0) -> int:
        """Return an object; KeyError for one that is not there."""

    def optional(self, index: int, subindex: int = 0) -> int | None:
        """Return an object, None for one that is not there."""

    def put(self, index: int, subindex: int, value: int) -> None:
        """Set an object from inside the device, if it is there."""

    def emergency(self, code: int, register: int) -> None:
        """Send an EMCY object, also one that says that no error is left."""

    def listen(self, can_id: int, call: Callable[[], None]) -> None:
        """Call for each frame with this identifier; both stacks lack a heartbeat consumer."""

    def alarm(self, name: str, delay_s: float, call: Callable[[], None]) -> None:
        """Call once after a delay [s]; an alarm of the same name is put off."""

    def disarm(self, name: str) -> None:
        """Drop an alarm, if there is one."""


class Application:
    """What a device does; each method is called by the stack's own thread."""

    def restart(self) -> None:
        """The device has been switched on, or NMT has reset it."""

    def written(self, index: int, subindex: int, value: int) -> None:
        """The master has written an object, by SDO or RPDO."""

    def commanded(self) -> None:
        """An RPDO has been taken."""

    def entered(self, state: int) -> None:
        """The NMT state has changed."""

    def sampled(self) -> None:
        """SYNC has come: measure, the TPDOs follow."""


def variables(dictionary: canopen.ObjectDictionary) -> list[ODVariable]:
    """Return all entries of an object dictionary."""
    return [
        variable
        for entry in dictionary.values()
        for variable in ([entry] if isinstance(entry, ODVariable) else entry.values())
    ]
