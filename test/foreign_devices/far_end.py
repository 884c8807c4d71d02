# SPDX-License-Identifier: Apache-2.0
"""Makes a device of one of the two stacks, on a virtual bus."""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

from local_device import LocalDevice
from makes import MAKES, dictionary
from position_encoder import PositionEncoder
from power_drive import PowerDrive

LOCAL_NODE, DURAND = "canopen.LocalNode", "durand"
STACKS = (LOCAL_NODE, DURAND)
DRIVE_NODE, ENCODER_NODE = 1, 2
HAS_DURAND = importlib.util.find_spec("durand") is not None


def far_end(stack: str, channel: str, make: str, node_id: int = 0) -> Any:
    """Return a device; node_id: 0 for the default of its kind. Its `close` ends it."""
    is_drive = MAKES[make].file == "drive.eds"
    node_id = node_id or (DRIVE_NODE if is_drive else ENCODER_NODE)
    torque = MAKES[make].torque
    application = partial(PowerDrive, torque=torque) if is_drive else PositionEncoder
    objects = dictionary(make, node_id)
    if stack == LOCAL_NODE:
        return LocalDevice(channel, node_id, objects, application, MAKES[make].unmappable)
    from durand_device import DurandDevice  # where it is installed

    return DurandDevice(channel, node_id, objects, application)
