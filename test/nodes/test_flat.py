# SPDX-License-Identifier: Apache-2.0
"""The structs of the hot messages against rclpy's own serialization, both ways."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample

from screw_module_ros.control.vertical_state import VerticalOutput
from screw_module_ros.nodes.support.flat import (
    COMMAND,
    ENCODER,
    FORCE,
    Command,
    pack_command,
    pack_encoder,
    pack_force,
)
from screw_module_ros.samples import EncoderReading, ForceReading

S = 1_000_000_000
u32, i64 = st.integers(0, 2**32 - 1), st.integers(-(2**63), 2**63 - 1)
number = st.floats(allow_nan=False, width=64)
stamp_ns = st.integers(0, (2**31 - 1) * S)
encoders = st.builds(
    EncoderReading, u32, i64, stamp_ns, st.integers(-(2**31), 2**31 - 1), number, number,
    st.booleans(),
)  # fmt: skip
forces = st.builds(ForceReading, u32, i64, stamp_ns, *[number] * 6, st.integers(0, 2**16 - 1))


def fields(message) -> dict:
    names = message.get_fields_and_field_types()
    found = {name: getattr(message, name) for name in names if name != "stamp"}
    return found | {"stamp_ns": message.stamp.sec * S + message.stamp.nanosec}


@given(encoders)
def test_encoder_samples(reading):
    data = pack_encoder(reading)
    message = deserialize_message(data, EncoderSample)
    assert fields(message) == reading._asdict()
    assert len(serialize_message(message)) == len(data)
    assert ENCODER.unpack(serialize_message(message)) == ENCODER.unpack(data) == reading


@given(forces)
def test_force_samples(reading):
    data = pack_force(reading)
    message = deserialize_message(data, ForceSample)
    assert fields(message) == reading._asdict()
    assert len(serialize_message(message)) == len(data)
    assert FORCE.unpack(serialize_message(message)) == FORCE.unpack(data) == reading


@given(encoders, st.lists(number, min_size=5, max_size=5), st.integers(0, 4), st.booleans())
def test_force_commands(sample, values, mode, saturated):
    output = VerticalOutput(*values, saturated, 0.0, 0.0)
    data = pack_command(sample, output, mode)
    found = fields(deserialize_message(data, ForceCommand))
    told = output._asdict()
    assert found["mode"] == mode and found["stamp_ns"] == sample.stamp_ns
    for name in ("force", "impedance", "gravity", "friction", "feedback", "saturated"):
        assert found[name] == told[name], name
    assert COMMAND.unpack(data) == Command(sample.sequence, sample.monotonic_ns, output.force)


@pytest.mark.parametrize("flat", [ENCODER, FORCE, COMMAND])
def test_another_form_is_left_to_rclpy(flat):
    """Big-endian, as another middleware may send it, and a message with padding behind it."""
    little = serialize_message(flat.kind(sequence=7, monotonic_ns=9))
    assert flat.unpack(little + bytes(8)).sequence == 7
    big = b"\x00\x00" + little[2:4] + bytes(8) + (7).to_bytes(4, "big") + bytes(4)
    big += (9).to_bytes(8, "big") + bytes(len(little) - len(big) - 8)
    assert flat.unpack(big)[:2] == (7, 9)
