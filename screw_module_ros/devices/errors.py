# SPDX-License-Identifier: Apache-2.0
"""Errors of a device; the text of each exception is a message for the user::

    DeviceError
     +-- BusError        the bus cannot be opened, or failed while in use (`can_io/port.py`)
     +-- BusOverload     the configured frames do not fit on the bus (`can_io/load.py`)
     +-- Occupied        another process already drives this device or this bus
     +-- NotAnswering    a device does not answer
     +-- Refused         a device answered with an SDO abort
     +-- WrongDevice     another profile, vendor, product or rating than expected
     +-- NotConfigured   a value written is not the value read back, or a mode is missing
     +-- NotNow          enabling, homing or taring is not allowed in the present state

Values that are out of range raise ValueError at construction instead.
"""

from __future__ import annotations

from ..can_io.errors import BusError as BusError
from ..can_io.errors import DeviceError as DeviceError


class Occupied(DeviceError):
    """Another process already drives the device. Example: a second copy of a node."""


class NotAnswering(DeviceError):
    """A device did not answer within its time limit. Example: power off, wrong node id."""


class Refused(DeviceError):
    """A device answered an SDO request with an abort code (CiA 301, 7.2.4.3.17).

    code: the abort code, to distinguish a missing object from a refused value.
    """

    #: Abort codes for an object that does not exist.
    ABSENT = frozenset({0x06020000, 0x06090011})
    #: Abort codes for an object that cannot be written.
    READ_ONLY = frozenset({0x06010000, 0x06010002})
    TOO_HIGH, TOO_LOW = 0x06090031, 0x06090032
    #: Abort codes for a value that an existing object does not take.
    VALUE = frozenset({0x06040043, 0x06090030, TOO_HIGH, TOO_LOW, 0x06090036})

    def __init__(self, text: str, code: int):
        super().__init__(text)
        self.code = code

    @property
    def absent(self) -> bool:
        """Whether the device has no such object or sub-index."""
        return self.code in self.ABSENT

    @property
    def read_only(self) -> bool:
        """Whether the device does not let the object be written."""
        return self.code in self.READ_ONLY


    @property
    def of_value(self) -> bool:
        """Whether the device has the object and refuses only this value."""
        return self.code in self.VALUE


class WrongDevice(DeviceError):
    """The device is not the one the settings describe. Example: a drive where an encoder is."""


class NotConfigured(DeviceError):
    """The device did not accept its configuration. Example: another value read back."""


class NotNow(DeviceError):
    """Enabling, homing or taring is refused now. Example: a latched fault, a nut that moves."""


def cure(error: DeviceError, parameter: str) -> str:
    """Return what to do where a device has an object and does not take our value, else nothing.

    parameter: ROS parameter that the value comes from, empty for a constant.
    """
    if not (parameter and isinstance(error, Refused) and error.of_value):
        return ""
    how = {Refused.TOO_HIGH: "a smaller", Refused.TOO_LOW: "a larger"}.get(error.code, "another")
    return f"set {how} `{parameter}`"
