# SPDX-License-Identifier: Apache-2.0
"""Frames that nobody should send into every driver, at work and while it is being configured.

The far end are the scripted devices of `test/devices`. A driver may refuse, latch and give up; it
may not fall over, hang, give torque that was not asked for, or deliver what is no number.
"""

from __future__ import annotations

import itertools
import math
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import can
from runner import sentence
from scripted import FarEnd, Wire
from scripted_devices import ScriptedBox, ScriptedDrive, ScriptedEncoder, ScriptedSensor

from screw_module_ros.devices import drive_group
from screw_module_ros.devices.ati_net import NetForceSensor
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.devices.netcanoem import NetcanoemSensor

_DRIVE = DriveSettings(listen=0.0, sdo_timeout=0.02, max_torque=1.6)
_ENCODER = EncoderSettings(listen=0.0, sdo_timeout=0.02)
_SENSOR = ForceSensorSettings(listen=0.0, timeout=0.02, tare_samples=2)
_BOX = _SENSOR._replace(counts_per_force=200.0, counts_per_torque=5000.0)
_SENSORS = ((ScriptedSensor, NetcanoemSensor, _SENSOR), (ScriptedBox, NetForceSensor, _BOX))
_IDS = (
    [0x000, 0x080, 0x100, 0x770, 0x701, 0x702, 0x7E5]
    + [base + node for base in (0x080, 0x180, 0x200, 0x280, 0x580, 0x600) for node in (1, 2)]
    + [0x120 | opcode for opcode in range(16)]
)
_TORQUES = (0.0, 0.3, -0.3, 1e9, -1e9, math.nan, math.inf, -math.inf)
_STEP = 1e-3 * _DRIVE.rated_torque  # the drive is told whole per mille
_numbers = itertools.count()


class CanFrames:
    """One case: one driver, at work while frames come in or configured by a device that babbles."""

    def __init__(self, folder: Path) -> None:
        self.counts: Counter[str] = Counter()

    def case(self, rng: random.Random) -> None:
        """Let one driver work among odd frames."""
        wire = Wire(f"fuzz frames {next(_numbers)}")
        try:
            rng.choice((self._drive, self._encoder, self._sensor))(rng, wire)
        finally:
            wire.close()

    def close(self) -> None:
        """Nothing is held."""

    # -- drivers -----------------------------------------------------------------------------------

    def _drive(self, rng: random.Random, wire: Wire) -> None:
        end = ScriptedDrive(wire)
        drive = Drive(wire.port, _DRIVE, "vertical drive")
        if not self._start("drive", rng, wire, end, drive):
            return
        requests = (drive.request_enable, drive.request_disable, drive.clear_fault)
        for _ in range(60):
            self._odd_frame(rng, wire, "drive")
            self._ask("drive", rng, requests)
            now_ns = wire.advance()
            torque = rng.choice(_TORQUES)
            drive.sync(now_ns)
            drive.heartbeat(now_ns)
            wire.port.pump()
            wished = drive.logic.enabling
            written = drive.write(torque, now_ns)
            assert math.isfinite(written) and abs(written) <= _DRIVE.max_torque + _STEP
            assert not written or wished, "torque that nobody asked for"
            assert not (written and drive.fault), "torque with a fault latched"
        self.counts["drive: latched" if drive.fault else "drive: well"] += 1
        _sentences(drive.fault, *drive.warnings, drive_group.leave([drive], wire.port))

    def _encoder(self, rng: random.Random, wire: Wire) -> None:
        end = ScriptedEncoder(wire)
        encoder = Encoder(wire.port, _ENCODER)
        if not self._start("encoder", rng, wire, end, encoder):
            return
        requests = (encoder.home, encoder.clear_fault, encoder.poll_slow)
        for number in range(60):
            self._odd_frame(rng, wire, "encoder")
            self._ask("encoder", rng, requests)
            now_ns = wire.advance()
            encoder.request(number, now_ns, now_ns)
            wire.port.pump()
            if (sample := encoder.reading()) is not None:
                assert math.isfinite(sample.position) and math.isfinite(sample.velocity)
                assert not encoder.fault, "a sample with a fault latched"
                self.counts["encoder: samples"] += 1
        self.counts["encoder: latched" if encoder.fault else "encoder: well"] += 1
        _sentences(encoder.fault, *encoder.warnings)

    def _sensor(self, rng: random.Random, wire: Wire) -> None:
        device, driver, settings = rng.choice(_SENSORS)
        end, sensor = device(wire), driver(wire.port, settings)
        if not self._start("force sensor", rng, wire, end, sensor):
            return
        for number in range(60):
            self._odd_frame(rng, wire, "force sensor")
            now_ns = wire.advance()
            sensor.request(number, now_ns, now_ns)
            wire.port.pump()
            if (sample := sensor.reading()) is not None:
                values = (sample.fx, sample.fy, sample.fz, sample.tx, sample.ty, sample.tz)
                assert all(map(math.isfinite, values))
                self.counts["force sensor: samples"] += 1
        self.counts["force sensor: well"] += 1

    # -- what is done to them ----------------------------------------------------------------------

    def _start(self, name: str, rng: random.Random, wire: Wire, end, driver) -> bool:
        """Configure a driver, in half of the cases against a device that babbles."""
        wire.attach(end)
        if rng.random() < 0.5:
            _babbles(rng, wire, end)
        try:
            driver.configure()
            driver.start()
        except DeviceError as error:
            sentence(error)
            self.counts[f"{name}: not configured"] += 1
            return False
        return True

    def _ask(self, name: str, rng: random.Random, requests: tuple[Callable, ...]) -> None:
        if rng.random() > 0.15:
            return
        request = rng.choice(requests)
        try:
            request()
        except DeviceError as error:
            sentence(error)
            self.counts[f"{name}: {request.__name__} refused"] += 1

    def _odd_frame(self, rng: random.Random, wire: Wire, name: str) -> None:
        if rng.random() > 0.3:
            return
        data = rng.randbytes(rng.randrange(9))
        kind = rng.random()
        number = rng.choice(_IDS) if rng.random() < 0.9 else rng.randrange(0x800)
        message = can.Message(
            arbitration_id=number,
            data=b"" if kind < 0.05 else data,
            is_extended_id=0.05 < kind < 0.1,
            is_remote_frame=kind < 0.05,
            is_error_frame=0.1 < kind < 0.15,
        )
        wire.emit_message(message)
        self.counts["frames"] += 1


def _babbles(rng: random.Random, wire: Wire, end: FarEnd) -> None:
    """Let a device send some of its frames damaged, twice or not at all."""
    emit = wire.emit

    def odd(can_id: int, data: bytes | str) -> None:
        frame = bytes.fromhex(data) if isinstance(data, str) else data
        way = rng.random()
        if way < 0.02:
            return
        if way < 0.05:
            frame = rng.randbytes(rng.randrange(9))
        elif way < 0.08 and frame:
            place = rng.randrange(len(frame))
            frame = frame[:place] + bytes([rng.randrange(256)]) + frame[place + 1 :]
        elif way < 0.1:
            emit(can_id, frame)
        emit(can_id, frame)

    wire.emit = odd


def _sentences(*told: str) -> None:
    for text in told:
        if text:
            sentence(text)
