# SPDX-License-Identifier: Apache-2.0
"""Conversations of the drivers with scripted devices, written from the standards; `drive.txt`."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from conversation import conversations
from talk import KINDS, Talk, converse

FILES = ("contract.txt", "drive.txt", "encoder.txt", "force_sensor.txt")
ALL = [
    pytest.param(device, settings, steps, id=f"{device}: {sentence}")
    for name in FILES
    for (devices, *settings), sentence, steps in conversations(Path(__file__).with_name(name))
    for device in devices.split("|")
]


@pytest.mark.parametrize(("device", "settings", "steps"), ALL)
def test_conversation(wire, device, settings, steps):
    converse(Talk(wire, device, settings), *steps)


@pytest.mark.parametrize(
    ("device", "field", "value"),
    [
        ("drive", "heartbeat_period", 0.2),
        ("drive", "command_timeout", 0.001),
        ("drive", "master_id", 1),
        ("drive", "stop_reaction", "hope"),
        ("drive", "direction", 0),
        ("drive", "rated_torque", 0.0),
        ("drive", "max_torque", math.nan),
        ("drive", "lasting_torque", 0.25),
        ("encoder", "node_id", 0),
        ("encoder", "node_id", 128),
        ("encoder", "direction", 0),
        ("encoder", "lead", math.nan),
        ("encoder", "rate", 0.0),
        ("sensor", "base_id", 0x10),
        ("sensor", "base_id", 0x20),
        ("sensor", "sign", 0),
        ("sensor", "roll", math.inf),
        ("sensor", "calibration", 16),
    ],
)
def test_settings_that_cannot_work_name_the_field(wire, device, field, value):
    kind = KINDS[device]
    with pytest.raises(ValueError, match=field):
        kind.driver(wire.port, kind.settings._replace(**{field: value}))
