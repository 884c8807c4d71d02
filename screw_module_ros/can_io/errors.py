# SPDX-License-Identifier: Apache-2.0
"""Errors of a bus and of the devices on it, without python-can: nodes without a bus import them."""

from __future__ import annotations


class DeviceError(Exception):
    """Base of all errors of a bus and of the devices on it; its text is for the user."""


class BusError(DeviceError):
    """The bus cannot be opened or has failed. Example: unplugged cable, wrong channel, bus off."""
