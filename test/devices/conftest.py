# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the drivers: a virtual bus whose far end answers inside each send, so no waiting."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def wire(request):
    """A bus with a scripted far end and a clock that moves only when told to."""
    from scripted import Wire

    wire = Wire(request.node.nodeid)
    yield wire
    wire.close()


@pytest.fixture
def encoder_end(wire):
    """A scripted CiA 406 encoder, node 2."""
    from scripted_devices import ScriptedEncoder

    return wire.attach(ScriptedEncoder(wire))


@pytest.fixture
def drive_end(wire):
    """A scripted CiA 402 drive, node 1."""
    from scripted_devices import ScriptedDrive

    return wire.attach(ScriptedDrive(wire))


@pytest.fixture
def sensor_end(wire):
    """A scripted ATI NETCANOEM board, base 0x12."""
    from scripted_devices import ScriptedSensor

    return wire.attach(ScriptedSensor(wire))
