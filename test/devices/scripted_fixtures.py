# SPDX-License-Identifier: Apache-2.0
"""Fixtures on a virtual bus whose far end answers inside each send, so that nobody waits."""

from __future__ import annotations

import pytest
from scripted import Wire
from scripted_devices import ScriptedDrive, ScriptedEncoder, ScriptedSensor


@pytest.fixture
def wire(request):
    """A bus with a scripted far end and a clock that moves only when told to."""
    wire = Wire(request.node.nodeid)
    yield wire
    wire.close()


@pytest.fixture
def encoder_end(wire):
    """A scripted CiA 406 encoder, node 2."""
    return wire.attach(ScriptedEncoder(wire))


@pytest.fixture
def drive_end(wire):
    """A scripted CiA 402 drive, node 1."""
    return wire.attach(ScriptedDrive(wire))


@pytest.fixture
def sensor_end(wire):
    """A scripted ATI NETCANOEM board, base 0x12."""
    return wire.attach(ScriptedSensor(wire))
