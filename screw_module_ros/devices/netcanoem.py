# SPDX-License-Identifier: Apache-2.0
"""ATI six-axis transducer, polled once a tick (thesis 3.1.9), with NETCANOEM electronics.

wrench = matrix @ (gauges - bias) / counts per unit. The driver keeps the bias as a wrench. `ati`
has the protocol.
"""

from __future__ import annotations

from typing import Any

from ..can_io.port import Port
from . import ati
from .errors import BusError, NotAnswering, WrongDevice
from .force_base import Row
from .force_frames import FrameSensor
from .force_sensor_settings import ANY_CALIBRATION, ForceSensorSettings
from .life import Phase


class NetcanoemSensor(FrameSensor):
    """Driver of one board.

    board: its identity and units. counters: foreign_requests also of who sets it up or restarts it.
    """

    SIZES = ati.GAUGES_FIRST.size, ati.GAUGES_SECOND.size
    SATURATED = ati.SATURATED
    FORGETS = False

    def __init__(
        self,
        port: Port,
        settings: ForceSensorSettings,
        label: str = "force sensor",
        own: Any = None,
    ):
        poll = settings.base_id << 4 | ati.READ_GAUGES
        second = settings.base_id << 4 | ati.READ_GAUGES_SECOND
        super().__init__(port, settings, label, own, poll, (poll, second))
        self.board = ati.SensorIdentity()
        self._dialogue = ati.Dialogue(port, settings.base_id, label, settings.timeout)
        for opcode in (ati.SET_CALIBRATION, ati.RESET):
            port.subscribe(self.request_id | opcode, self._on_foreign_setting)

    def identify(self) -> list[Row]:
        """Return the calibration of the board; raises as `configure`."""
        settings, dialogue = self.settings, self._dialogue
        serial = dialogue.serial()
        if settings.serial and serial != settings.serial:
            raise WrongDevice(
                f"{self.label} on {self.port.name} has serial {serial!r}; "
                f"{settings.serial!r} is wanted"
            )
        if settings.calibration != ANY_CALIBRATION:
            dialogue.set_calibration(settings.calibration)
        self.board = dialogue.identify()
        self.identity = self.board.text
        return ati.in_units(dialogue.matrix(), self.board)

    def reset_device(self) -> None:
        """Restart the board and wait until it answers. Raises NotAnswering, BusError."""
        self._dialogue.reset()

    def values(self, *frames: bytes) -> tuple[int, tuple[float, ...] | None]:
        """Return status word and six counts of the two halves."""
        first, second = frames
        status, g0, g2, g4 = ati.GAUGES_FIRST.unpack(first)
        g1, g3, g5 = ati.GAUGES_SECOND.unpack(second)
        return status, (g0, g1, g2, g3, g4, g5)

    def poll_slow(self) -> None:
        """Read the diagnostic voltages; not for the loop."""
        try:
            self.shown = {
                f"{name} [ADC counts]": self._dialogue.diagnostic(index)
                for index, name in ati.DIAGNOSTICS.items()
            }
        except (NotAnswering, BusError):
            self.counters["slow_polls_failed"] += 1

    def _on_foreign_setting(self, _data: bytes, _arrival_ns: int) -> None:
        """Stop delivering samples; while it runs, we ask for neither, nor is this our reply."""
        if self.phase is not Phase.RUNNING:
            return
        self.counters["foreign_requests"] += 1
        self.lose(
            f"somebody else set up or restarted the {self.label} on {self.port.name}, its "
            "calibration may be another now"
        )
