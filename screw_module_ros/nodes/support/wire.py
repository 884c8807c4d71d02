# SPDX-License-Identifier: Apache-2.0
"""Packs and unpacks the messages between encoder and amplifier in one step each.

rclpy converts a message field by field, 10 to 40 us each and several times per tick. These types
are flat, so their serialized form (CDR, little-endian, OMG formal/02-06-51 15.3) is a fixed struct.
rclpy converts messages of any other form.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from rclpy.serialization import deserialize_message
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample

from screw_module_ros.samples import Command, EncoderReading, ForceReading

if TYPE_CHECKING:  # a process without a controller imports no law
    from screw_module_ros.control.vertical import VerticalOutput

_S = 1_000_000_000
_LATEST = 2**31 - 1  # [s] that a stamp can hold: 19 January 2038
_HALF_COUNT, _COUNT_MASK = 0x80000000, 0xFFFFFFFF
_HEAD = b"\x00\x01\x00\x00"
_HEAD_SIZE = len(_HEAD)
_ENCODER = struct.Struct("<4siII4xqi4xdd?3xI")
_FORCE = struct.Struct("<4siII4xqddddddH2x")
_COMMAND = struct.Struct("<4siII4xqdB7xdddd?3xI")

_Reading = TypeVar("_Reading", EncoderReading, ForceReading)


class Layout(NamedTuple):
    """A message type and the function that unpacks its serialized form."""

    kind: type
    unpack: Callable[[bytes], Any]


def pack_encoder(reading: EncoderReading) -> bytes:
    """Return a serialized EncoderSample; a count beyond 32 bits, left by garbage, wraps."""
    sequence, monotonic_ns, stamp_ns, count, position, velocity, homed, homings = reading
    shown = (count + _HALF_COUNT & _COUNT_MASK) - _HALF_COUNT
    return _ENCODER.pack(
        _HEAD, *_stamped(stamp_ns), sequence, monotonic_ns, shown, position, velocity, homed,
        homings,
    )  # fmt: skip


def pack_force(reading: ForceReading) -> bytes:
    """Return a serialized ForceSample."""
    sequence, monotonic_ns, stamp_ns, *wrench, status = reading
    return _FORCE.pack(_HEAD, *_stamped(stamp_ns), sequence, monotonic_ns, *wrench, status)


def pack_command(
    sample: EncoderReading, output: VerticalOutput, mode: int, activation: int
) -> bytes:
    """Return the serialized ForceCommand for an encoder sample; feedback counts carried mass in."""
    return _COMMAND.pack(
        _HEAD, *_stamped(sample.stamp_ns), sample.sequence, sample.monotonic_ns, output.force, mode,
        output.impedance, output.gravity, output.friction, output.feedback + output.carried,
        output.saturated, activation,
    )  # fmt: skip


def _stamped(stamp_ns: int) -> tuple[int, int]:
    """Return seconds and nanoseconds of a system time; a clock set beyond 2038 stays there.

    The control does not use the system clock, so no setting of it may end a loop.
    """
    seconds, nanoseconds = divmod(stamp_ns, _S)
    return min(seconds, _LATEST), nanoseconds


def _sample_layout(kind: type, fixed: struct.Struct, reading: type[_Reading]) -> Layout:
    """Return the layout of a sample whose fields after the stamp are those of its reading."""
    names = reading._fields[3:]

    def unpack(data: bytes) -> _Reading:
        if len(data) == fixed.size and data[:_HEAD_SIZE] == _HEAD:
            _, seconds, nanoseconds, sequence, at_ns, *rest = fixed.unpack(data)
        else:
            m = deserialize_message(data, kind)
            seconds, nanoseconds = m.stamp.sec, m.stamp.nanosec
            sequence, at_ns, rest = m.sequence, m.monotonic_ns, (getattr(m, n) for n in names)
        return reading(sequence, at_ns, seconds * _S + nanoseconds, *rest)

    return Layout(kind, unpack)


def _unpack_command(data: bytes) -> Command:
    if len(data) == _COMMAND.size and data[:_HEAD_SIZE] == _HEAD:
        _, _, _, sequence, monotonic_ns, force, mode, *_, activation = _COMMAND.unpack(data)
        return Command(sequence, monotonic_ns, force, mode, activation)
    m = deserialize_message(data, ForceCommand)
    return Command(m.sequence, m.monotonic_ns, m.force, m.mode, m.activation)


ENCODER = _sample_layout(EncoderSample, _ENCODER, EncoderReading)
FORCE = _sample_layout(ForceSample, _FORCE, ForceReading)
COMMAND = Layout(ForceCommand, _unpack_command)
LAYOUTS = {layout.kind: layout for layout in (ENCODER, FORCE, COMMAND)}
"""By message class."""
