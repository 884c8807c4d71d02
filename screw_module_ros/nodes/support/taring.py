# SPDX-License-Identifier: Apache-2.0
"""When the force sensor may be tared, and the readings for it.

Only while the vertical drive gives no torque: with force feedback the patient would feel what is
removed, several times over and at once.
"""

from __future__ import annotations

import threading

from screw_module_msgs.msg import AmplifierState

from screw_module_ros.clock import Clock
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.samples import ForceReading

from . import qos
from .realtime import Inbox

_GATHER_S = 3.0
_STATE_S = 0.2
_ENABLED = "the vertical drive is enabled and would jump: disable it first (/amplifier/enable)"


class NotPermitted(DeviceError):
    """The vertical drive gives torque."""


class Taring:
    """Readings of the loop's thread for the service thread. inbox: hears the amplifier's state."""

    def __init__(self, inbox: Inbox, clock: Clock):
        self._clock = clock
        self._take_state = inbox.subscribe(AmplifierState, "screw/amplifier_state", qos.NEWEST)
        self._readings: list[ForceReading] | None = None
        self._wanted = 0
        self._enough = threading.Event()

    def note(self, reading: ForceReading) -> None:
        """Keep a reading where it is wanted; the loop's thread."""
        readings = self._readings  # the service may end it meanwhile
        if readings is not None:
            readings.append(reading)
            if len(readings) >= self._wanted:
                self._enough.set()

    def permitted(self) -> None:
        """Raise NotPermitted when the amplifier's next state says that torque passes.

        One that is silent lets none pass.
        """
        self._take_state()  # what lies there may be old
        states: list[AmplifierState] = []

        def heard() -> bool:
            state = self._take_state()
            states.extend([state] if state is not None else [])
            return bool(states)

        if self._clock.wait_for(heard, _STATE_S) and states[0].enabled:
            raise NotPermitted(_ENABLED)

    def gathered(self, count: int) -> list[ForceReading]:
        """Return the next readings, up to `count`; fewer where they fail to come."""
        self._enough.clear()
        self._wanted = count
        self._readings = []
        self._clock.wait_for(self._enough.is_set, _GATHER_S)
        readings, self._readings = self._readings, None
        return readings[:count]
