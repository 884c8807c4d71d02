# SPDX-License-Identifier: Apache-2.0
"""Errors of a bus; `devices/errors.py` shows the whole tree of device errors."""

from __future__ import annotations


class DeviceError(Exception):
    """Base of all errors of a bus and of the devices on it; its text is for the user."""


class BusError(DeviceError):
    """The bus cannot be opened or has failed. Example: unplugged cable, wrong channel, bus off."""


class BusOverload(DeviceError):
    """The configured frames exceed the capacity of the bus at its bit rate."""
