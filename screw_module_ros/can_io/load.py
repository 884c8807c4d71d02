# SPDX-License-Identifier: Apache-2.0
"""Bus load of the configured frames, with worst-case bit stuffing (ISO 11898-1).

An encoder, a drive and a force sensor on one bus take 685 bits a tick: 69 % of 1 Mbit/s at 1 kHz.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from .errors import DeviceError

WARNING_LOAD = 0.8
HIGHEST_LOAD = 1.0

_FRAME_BITS = 47  # 11-bit identifier, no data: SOF to EOF 44, intermission 3
_STUFFED_BITS = 34  # those subject to bit stuffing: SOF to the end of the CRC


class BusOverload(DeviceError):
    """The configured frames exceed the capacity of the bus at its bit rate."""


class Traffic(NamedTuple):
    """One kind of frame: name, data bytes and rate [1/s]."""

    name: str
    data_bytes: int
    rate: float


def frame_bits(data_bytes: int) -> int:
    """Return the bits of a classical frame with an 11-bit identifier and worst-case stuffing.

    Raises ValueError when a classical frame cannot carry this number of data bytes.
    """
    if not 0 <= data_bytes <= 8:
        raise ValueError(f"data_bytes = {data_bytes}: a classical CAN frame carries 0 to 8")
    payload = 8 * data_bytes
    return _FRAME_BITS + payload + (_STUFFED_BITS + payload - 1) // 4


def bits_per_second(traffic: Iterable[Traffic]) -> float:
    """Return the bits per second of all `traffic` together."""
    return sum(frame_bits(each.data_bytes) * each.rate for each in traffic)


def check_load(traffic: Iterable[Traffic], bitrate: int, where: str) -> tuple[float, str]:
    """Return the share of the bus in use [0..1] and a warning, empty below 80 %.

    bitrate [bit/s]; where: name of the bus for messages. Raises BusOverload above 100 %.
    """
    frames = list(traffic)
    load = bits_per_second(frames) / bitrate
    if load <= WARNING_LOAD:
        return load, ""
    largest = max(frames, key=lambda each: frame_bits(each.data_bytes) * each.rate)
    text = (
        f"{where} is loaded to {100 * load:.0f} % of {bitrate} bit/s; lower the rate or give a "
        f"device a bus of its own (largest: {largest.name}, {largest.rate:g} frames/s)"
    )
    if load > HIGHEST_LOAD:
        raise BusOverload(text)
    return load, text
