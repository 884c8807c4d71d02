# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with a bus; `devices/errors.py` has the whole tree of a device's errors."""

from __future__ import annotations


class DeviceError(Exception):
    """Base of all errors of a bus and of the devices on it; its text is for the user."""


class BusError(DeviceError):
    """The bus cannot be opened or has failed. Example: a cable out, a wrong channel, bus off."""


class BusOverload(DeviceError):
    """The frames to be sent per second do not fit on the bus at its bit rate."""
