# SPDX-License-Identifier: Apache-2.0
"""Our end of a virtual bus: drivers by wall clock, and every frame of the bus in its order."""

from __future__ import annotations

from collections.abc import Callable

import can
import pytest
from can.interfaces.virtual import VirtualBus

from screw_module_ros.can_io.bus import BusSettings, open_port
from screw_module_ros.devices.cia402 import State
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.profiles import GENERIC_402, GENERIC_406, load
from screw_module_ros.samples import EncoderReading

ANSWERS_WITHIN_NS = 50_000_000
"""How long a tick waits for a device; only one that is silent makes it wait."""
HAPPENS_WITHIN_NS = 30_000_000_000
"""Bound of what must happen; only a test that fails comes near it."""

_NEVER_S = 10.0  # the longest that a profile may say
# These tests are about what is said, not when: every limit is far away but the one in question.
PATIENT_DRIVE = DriveSettings(
    rate=100.0, stale_periods=500.0, heartbeat_period=0.01, heartbeat_timeout=5.0,
    command_timeout=5.0, drive_heartbeat=3.0, enable_timeout=20.0, sdo_timeout=2.0, listen=0.02,
)  # fmt: skip
PATIENT_ENCODER = EncoderSettings(rate=100.0, sdo_timeout=2.0, listen=0.02)


class NearEnd:
    """One port of ours, and a listener that keeps each frame."""

    def __init__(self, channel: str):
        self.port = open_port(BusSettings(interface="virtual", channel=channel))
        self._ear = VirtualBus(channel=channel)
        self._heard: list[tuple[int, bytes]] = []
        self._sequence = 0

    def close(self) -> None:
        self.port.close()
        self._ear.shutdown()

    def frames(self, *can_ids: int) -> list[tuple[int, bytes]]:
        """Return all frames so far, or those with these identifiers."""
        while (message := self._ear.recv(0.0)) is not None:
            self._heard.append((message.arbitration_id, bytes(message.data)))
        return [frame for frame in self._heard if not can_ids or frame[0] in can_ids]

    def emit(self, can_id: int, data: str) -> None:
        """Send a frame as somebody else on the bus."""
        payload = bytes.fromhex(data)
        self._ear.send(can.Message(arbitration_id=can_id, data=payload, is_extended_id=False))
        self._heard.append((can_id, payload))

    @property
    def now_ns(self) -> int:
        return self.port.clock.now_ns()

    def until(self, ready: Callable[[], object], act: Callable[[], object], what: str) -> None:
        """Repeat `act`, which waits for frames, until `ready`."""
        due_ns = self.now_ns + HAPPENS_WITHIN_NS
        while not ready():
            if self.now_ns > due_ns:
                pytest.fail(f"it did not happen: {what}")
            act()

    def pump(self) -> None:
        self.port.pump(self.now_ns + ANSWERS_WITHIN_NS)

    # Drives.

    def drive(self, profile: str = GENERIC_402, **settings: object) -> Drive:
        """Return a driver; settings: what is not patient."""
        known = load(profile)
        known = known._replace(drive=known.drive._replace(heartbeat_timeout=_NEVER_S))
        return Drive(self.port, PATIENT_DRIVE._replace(**settings), "drive", profile=known)

    def tick(self, drive: Drive, torque: float = 0.0, beat: bool = True) -> float:
        """Do one period as the loop does it; return the torque that was sent."""
        drive.sync(self.now_ns)
        if beat:
            drive.heartbeat(self.now_ns)
        before, due_ns = drive.counters["received"], self.now_ns + ANSWERS_WITHIN_NS
        while drive.counters["received"] == before and self.now_ns < due_ns:
            self.port.pump(due_ns)
        return drive.write(torque, self.now_ns)

    def run(self, drive: Drive, ready: Callable[[], object], what: str, **tick: object) -> None:
        """Do periods until `ready`."""
        self.until(ready, lambda: self.tick(drive, **tick), f"{what}; {drive.fault}")

    def enabled(self, drive: Drive) -> None:
        """Configure, start and enable a drive."""
        drive.configure()
        drive.start()
        self.run(drive, lambda: drive.shown is State.SWITCHED_ON and not drive.refusal(), "ready")
        drive.request_enable()
        self.run(drive, lambda: drive.is_on(self.now_ns), "enabled")

    # Encoders.

    def encoder(self, profile: str = GENERIC_406, **settings: object) -> Encoder:
        """Return a driver; settings: what is not patient."""
        return Encoder(self.port, PATIENT_ENCODER._replace(**settings), profile=load(profile))

    def sample(self, encoder: Encoder) -> EncoderReading | None:
        """Ask for one sample; None if none came."""
        self._sequence += 1
        encoder.request(self._sequence, self.now_ns, self.now_ns)
        due_ns = self.now_ns + ANSWERS_WITHIN_NS
        while (reading := encoder.reading()) is None and self.now_ns < due_ns:
            self.port.pump(due_ns)
        return reading
