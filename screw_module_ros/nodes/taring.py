# SPDX-License-Identifier: Apache-2.0
"""Permission to tare the force sensor, and the readings for it.

Taring is permitted only while the vertical drive gives no torque: with force feedback the patient
would feel the removed bias at once, multiplied by the gain.
"""

from __future__ import annotations

import threading

from rclpy.node import Node

from screw_module_ros.clock import Clock
from screw_module_ros.samples import ForceReading

from .support.driver import TorqueOff
from .support.inbox import Inbox

_GATHER_S = 3.0


class Taring:
    """Readings of the loop's thread for the service thread. inbox: for the amplifier's state."""

    def __init__(self, node: Node, inbox: Inbox, clock: Clock):
        self._clock = clock
        self._torque_off = TorqueOff(node, inbox, clock)
        self._readings: list[ForceReading] | None = None
        self._wanted = 0
        self._enough = threading.Event()

    def note(self, reading: ForceReading) -> None:
        """Store a reading while taring; for the loop's thread."""
        readings = self._readings  # the service may end the collection meanwhile
        if readings is not None:
            readings.append(reading)
            if len(readings) >= self._wanted:
                self._enough.set()

    def permitted(self) -> None:
        """Raise NotPermitted when the amplifier's next state shows torque."""
        self._torque_off.check("would jump")

    def gathered(self, count: int) -> list[ForceReading]:
        """Return the next `count` readings; fewer if they do not come in time."""
        self._enough.clear()
        self._wanted = count
        self._readings = []
        self._clock.wait_for(self._enough.is_set, _GATHER_S)
        readings, self._readings = self._readings, None
        return readings[:count]
