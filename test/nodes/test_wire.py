# SPDX-License-Identifier: Apache-2.0
"""The structs of the hot messages against rclpy's own serialization, both ways."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample

from screw_module_ros.control.laws import all_names
from screw_module_ros.control.vertical import VerticalOutput
from screw_module_ros.devices.motion import FULL_RANGE, Unwrapper
from screw_module_ros.loop.controller import NO_FORCE
from screw_module_ros.nodes.support.wire import (
    COMMAND,
    ENCODER,
    FORCE,
    pack_command,
    pack_encoder,
    pack_force,
)
from screw_module_ros.samples import Command, EncoderReading, ForceReading

S = 1_000_000_000
u32, i64 = st.integers(0, 2**32 - 1), st.integers(-(2**63), 2**63 - 1)
number = st.floats(allow_nan=False, width=64)
stamp_ns = st.integers(0, (2**31 - 1) * S)
encoders = st.builds(
    EncoderReading, u32, i64, stamp_ns, st.integers(-(2**31), 2**31 - 1), number, number,
    st.booleans(), u32,
)  # fmt: skip
forces = st.builds(ForceReading, u32, i64, stamp_ns, *[number] * 6, st.integers(0, 2**16 - 1))
AT_ZERO = EncoderReading(0, 0, 0, 0, 0.0, 0.0, False)


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


@given(
    encoders, st.lists(number, min_size=6, max_size=6), st.sampled_from(list(all_names())),
    st.booleans(), u32,
)  # fmt: skip
@example(AT_ZERO, [0.0] * 4 + [math.inf, -math.inf], 0, False, 0)
def test_force_commands(sample, values, mode, saturated, activation):
    output = VerticalOutput(*values, saturated, 0.0, 0.0)
    data = pack_command(sample, output, mode, activation)
    message = deserialize_message(data, ForceCommand)
    assert len(serialize_message(message)) == len(data)
    told = output._asdict() | sample._asdict() | {"mode": mode, "activation": activation}
    told["feedback"] += told["carried"]
    found = fields(message)  # where both are infinite, their sum may be no number
    exactly = pytest.approx({name: told[name] for name in found}, rel=0.0, abs=0.0, nan_ok=True)
    assert found == exactly
    wanted = Command(sample.sequence, sample.monotonic_ns, output.force, mode, activation)
    assert COMMAND.unpack(data) == wanted


@pytest.mark.parametrize("seconds", [2**31 - 1, 2**31, 2**33])
def test_a_system_clock_beyond_2038_ends_no_loop(seconds):
    """The stamp's seconds have 32 bits; the control itself never uses the system clock."""
    at_ns = seconds * S + 7
    sample = EncoderReading(1, 2, at_ns, 3, 0.1, 0.0, True)
    force = ForceReading(1, 2, at_ns, *[1.0] * 6, 0)
    packed = (
        (pack_encoder(sample), EncoderSample),
        (pack_force(force), ForceSample),
        (pack_command(sample, NO_FORCE, 1, 5), ForceCommand),
    )
    for data, kind in packed:
        message = deserialize_message(data, kind)
        assert (message.stamp.sec, message.stamp.nanosec) == (2**31 - 1, 7)
        assert (message.sequence, message.monotonic_ns) == (1, 2)


def test_a_stamp_that_a_foreign_sender_makes_up_ends_no_loop():
    """More than a second of nanoseconds on top of the last second that fits."""
    foreign = EncoderSample(sequence=1, monotonic_ns=2)
    foreign.stamp.sec, foreign.stamp.nanosec = 2**31 - 1, 2**32 - 1
    sample = ENCODER.unpack(serialize_message(foreign))
    assert deserialize_message(pack_command(sample, NO_FORCE, 1, 5), ForceCommand).sequence == 1


def garbled_count() -> int:
    """Return the count after one garbled frame of an encoder that wraps at 2^32."""
    unwrapper = Unwrapper(FULL_RANGE)
    unwrapper.step(100_000)
    return unwrapper.step(100_000 + 2**31 - 1)


@pytest.mark.parametrize("count", [2**31 - 1, garbled_count(), -(2**31) - 1, 5 * 2**32 + 9])
def test_a_count_beyond_the_message_wraps(count):
    sample = deserialize_message(
        pack_encoder(EncoderReading(1, 2, 3, count, 0.1, 0.0, True)), EncoderSample
    )
    assert (sample.count - count) % 2**32 == 0
    assert sample.position == 0.1 and sample.homed


@pytest.mark.parametrize("flat", [ENCODER, FORCE, COMMAND])
def test_another_form_is_left_to_rclpy(flat):
    """Big-endian, as another middleware may send it, and a message with padding behind it."""
    little = serialize_message(flat.kind(sequence=7, monotonic_ns=9))
    assert flat.unpack(little + bytes(8)).sequence == 7
    big = b"\x00\x00" + little[2:4] + bytes(8) + (7).to_bytes(4, "big") + bytes(4)
    big += (9).to_bytes(8, "big") + bytes(len(little) - len(big) - 8)
    assert flat.unpack(big)[:2] == (7, 9)
