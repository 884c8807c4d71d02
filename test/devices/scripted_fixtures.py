# SPDX-License-Identifier: Apache-2.0
"""Fixtures on a virtual bus whose far end answers inside each send, so that nobody waits."""

from __future__ import annotations

import pytest
from scripted import Wire
from scripted_devices import ScriptedEncoder


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
