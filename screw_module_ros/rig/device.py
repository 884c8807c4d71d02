# SPDX-License-Identifier: Apache-2.0
"""Base of every simulated device: its cable, the present time, and its faults as they come and go.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from screw_module_ros.rig.faults import CABLE, SIZE, Fault
from screw_module_ros.rig.link import OFF_BUS, Link
from screw_module_ros.settings import shown

CLEAR = "clear"

_S = 1_000_000_000


class SimulatedDevice:
    """One device of the rig: its name in faults, its cable, the present time and its faults."""

    FAULTS: Mapping[str, Fault] = CABLE

    def __init__(self, name: str, link: Link):
        self.name = name
        self.link = link
        self.now_ns = 0
        self._until_ns: dict[str, float] = {}

    @property
    def active(self) -> tuple[str, ...]:
        """The faults that last."""
        return tuple(self._until_ns)

    def poll(self, now_ns: int) -> None:
        """End the faults whose time is over; send the frames that faults of the cable held back."""
        self.now_ns = now_ns
        if self._until_ns:
            for name in self.active:
                if now_ns >= self._until_ns[name]:
                    self._end(name)
        if self.link.faults:
            self.link.poll(now_ns)

    def refresh(self) -> None:
        """React to an attribute that a fault has changed."""

    def leave_bus(self, _size: float) -> None:
        """Lose the bus, as a CAN controller with too many errors does."""
        self.link.start(OFF_BUS)

    def announce(self, name: str, size: float, duration: float) -> str:
        """Return what `inject` will do. Raises ValueError with the problem and the known faults."""
        if name == CLEAR:
            return f"{self.name}: {', '.join(self.active) or 'no fault'} cleared"
        size = self._checked(name, size, duration)
        fault = self.FAULTS[name]
        sized = f" {size:g} {fault.size.unit}" if fault.size else ""
        lasting = f"for {duration:g} s" if duration else f"until '{CLEAR}'"
        return f"{self.name}: {name}{sized}, {'once' if fault.once else lasting}"

    def inject(self, name: str, size: float, duration: float, now_ns: int) -> None:
        """Begin a fault for `duration` [s], 0 = until cleared; the fault `clear` ends all.

        Raises ValueError as `announce` does.
        """
        if name == CLEAR:
            for active in self.active:
                self._end(active)
            return
        size = self._checked(name, size, duration)
        fault = self.FAULTS[name]
        if fault.on_cable:
            self.link.start(name, size)
        value = size if fault.value is SIZE else fault.value
        if fault.attribute and value is not None:
            setattr(self, fault.attribute, value)
        if fault.start:
            getattr(self, fault.start)(size if value is None else value)
        if not fault.once:
            self._until_ns[name] = now_ns + round(duration * _S) if duration else math.inf
        if fault.attribute:
            self.refresh()

    def _checked(self, name: str, size: float, duration: float) -> float:
        """Return the size to use. Raises ValueError with the problem and the known faults."""
        fault = self.FAULTS.get(name)
        if fault is None:
            names = ", ".join((CLEAR, *self.FAULTS))
            raise ValueError(f"{self.name} has no fault {shown(name)}; it has: {names}")
        if not (math.isfinite(duration) and duration >= 0.0):
            raise ValueError(f"duration = {duration} s: 0 (until '{CLEAR}') or more is wanted")
        if fault.size is None:
            return 0.0
        unit, default, low, high = fault.size
        if size == 0.0 or math.isnan(size):
            return default
        if not low <= size <= high:
            limits = f"{low:g} to {high:g} {unit}"
            raise ValueError(f"{self.name} {name}: value = {size:g}: {limits} is wanted")
        return type(default)(size)

    def _end(self, name: str) -> None:
        del self._until_ns[name]
        fault = self.FAULTS[name]
        if fault.on_cable:
            self.link.end(name)
        if fault.attribute:
            vars(self).pop(fault.attribute, None)  # the class's healthy value shows again
            self.refresh()
        if fault.end:
            getattr(self, fault.end)()
