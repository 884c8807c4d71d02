# SPDX-License-Identifier: Apache-2.0
"""Faults of one device by name: inject, end, clear and list them.

Every device has a `FaultBook`. The faults of its cable are in every book; the device adds its own.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from screw_module_ros.rig.frame_faults import FRAME_FAULTS, OFF_BUS, FrameFaults
from screw_module_ros.rig.port import Link
from screw_module_ros.settings import shown

CLEAR = "clear"

_S = 1_000_000_000


class Fault(NamedTuple):
    """One fault that can be injected.

    text: description; start: called with the value; stop: ends the fault, None for a single event.
    unit, default, low, high: of the value; a value of 0 or NaN means default.
    """

    text: str
    start: Callable[[float], None]
    stop: Callable[[], None] | None = None
    unit: str = ""
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0

    @property
    def sized(self) -> bool:
        """Return whether the fault takes a value."""
        return bool(self.unit)


class FaultBook:
    """The faults of one device, and which of them are active."""

    def __init__(self, device: str, link: Link):
        self.device = device
        self._faults: dict[str, Fault] = {}
        self._until_ns: dict[str, int | None] = {}
        self._frames = FrameFaults(link, zlib.crc32(device.encode()))
        for name, spec in FRAME_FAULTS.items():
            start, stop = partial(self._frames.start, name), partial(self._frames.stop, name)
            self.add(name, Fault(spec.text, start, stop, *spec[1:]))

    def add(self, name: str, fault: Fault) -> None:
        """Add a fault of this device."""
        self._faults[name] = fault

    @property
    def active(self) -> tuple[str, ...]:
        """The faults that last."""
        return tuple(self._until_ns)

    def check(self, name: str, value: float, duration: float) -> float:
        """Return the value to use. Raises ValueError with the problem and the known faults."""
        fault = self._faults.get(name)
        if fault is None:
            names = ", ".join((CLEAR, *self._faults))
            raise ValueError(f"{self.device} has no fault {shown(name)}; it has: {names}")
        if not (math.isfinite(duration) and duration >= 0.0):
            raise ValueError(f"duration = {duration} s: 0 (until '{CLEAR}') or more is wanted")
        if not fault.sized or value == 0.0 or math.isnan(value):
            return fault.default
        if not fault.low <= value <= fault.high:
            limits = f"{fault.low:g} to {fault.high:g} {fault.unit}"
            raise ValueError(f"{self.device} {name}: value = {value:g}: {limits} is wanted")
        return value

    def inject(self, name: str, value: float, duration: float, now_ns: int) -> str:
        """Inject a fault for `duration` [s], 0 = until cleared; the fault `clear` ends all.

        Returns a description as `announce` does, and raises ValueError as `check` does.
        """
        sentence = self.announce(name, value, duration)
        if name == CLEAR:
            self.clear()
            return sentence
        fault = self._faults[name]
        fault.start(self.check(name, value, duration))
        if fault.stop is not None:
            self._until_ns[name] = now_ns + round(duration * _S) if duration else None
        return sentence

    def announce(self, name: str, value: float, duration: float) -> str:
        """Return a description of the effect of `inject`. Raises ValueError as `check` does."""
        if name == CLEAR:
            return f"{self.device}: {', '.join(self.active) or 'no fault'} cleared"
        value = self.check(name, value, duration)
        fault = self._faults[name]
        size = f" {value:g} {fault.unit}" if fault.sized else ""
        lasting = f"for {duration:g} s" if duration else f"until '{CLEAR}'"
        return f"{self.device}: {name}{size}, {'once' if fault.stop is None else lasting}"

    def __contains__(self, name: str) -> bool:
        return name in self._faults

    def poll(self, now_ns: int) -> None:
        """End the faults whose time is over, and update the faults of the cable."""
        for name, until_ns in tuple(self._until_ns.items()) if self._until_ns else ():
            if until_ns is not None and now_ns >= until_ns:
                self._end(name)
        self._frames.poll(now_ns)

    def clear(self) -> None:
        """End every fault that lasts."""
        for name in self.active:
            self._end(name)

    def cable(self, out: bool) -> None:
        """Take the device off its bus, or put it back, as part of another fault."""
        if out:
            self._frames.start(OFF_BUS, 0.0)
        else:
            self._frames.stop(OFF_BUS)

    def describe(self) -> dict[str, str]:
        """Return fault -> one line with its description and its value."""
        return {name: _line(fault) for name, fault in self._faults.items()}

    def _end(self, name: str) -> None:
        del self._until_ns[name]
        stop = self._faults[name].stop
        if stop is not None:
            stop()


def _line(fault: Fault) -> str:
    notes = []
    if fault.sized:
        notes.append(f"value {fault.low:g} to {fault.high:g} {fault.unit}, 0 = {fault.default:g}")
    if fault.stop is None:
        notes.append("happens once")
    return f"{fault.text} ({'; '.join(notes)})" if notes else fault.text


def catalogue(books: dict[str, dict[str, str]]) -> list[str]:
    """Return readable lines from device -> fault -> text, shared faults once."""
    shared: dict[str, str] = {}
    if len(books) > 1:
        first, *others = books.values()
        shared = {k: text for k, text in first.items() if all(o.get(k) == text for o in others)}
    groups: dict[tuple, list[str]] = {}
    for device, book in books.items():
        rest = tuple((name, text) for name, text in book.items() if name not in shared)
        groups.setdefault(rest, []).append(device)
    lines = _section("each of " + ", ".join(books), tuple(shared.items())) if shared else []
    for rest, devices in groups.items():
        lines += _section(", ".join(devices), rest) if rest else []
    return lines


def _section(title: str, faults: tuple) -> list[str]:
    width = max(len(name) for name, _ in faults)
    return [title, *(f"  {name:{width}} {text}" for name, text in faults)]
