# SPDX-License-Identifier: Apache-2.0
"""The steps of a conversation between a driver and its scripted device; `drive.txt` explains."""

from __future__ import annotations

from operator import attrgetter
from typing import Any, NamedTuple

import pytest
from conversation import carry_out, value_of, values_of
from scripted import FarEnd, Wire, written
from scripted_devices import ScriptedBox, ScriptedDrive, ScriptedEncoder, ScriptedSensor

from screw_module_ros import profiles
from screw_module_ros.devices import drive_group
from screw_module_ros.devices.ati_net import NetForceSensor
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.devices.netcanoem import NetcanoemSensor


class Kind(NamedTuple):
    """A scripted device and its driver, with settings that make nobody wait."""

    end: type[FarEnd]
    driver: type
    settings: Any
    others: dict[str, object]


DRIVE = DriveSettings(listen=0.0, sdo_timeout=0.02)
ENCODER = EncoderSettings(listen=0.0, sdo_timeout=0.02)
SENSOR = ForceSensorSettings(listen=0.0, timeout=0.02, tare_samples=2)
BOX = SENSOR._replace(counts_per_force=200.0, counts_per_torque=5000.0)
KINDS = {
    "drive": Kind(ScriptedDrive, Drive, DRIVE, {"label": "vertical drive"}),
    "encoder": Kind(ScriptedEncoder, Encoder, ENCODER, {}),
    "sensor": Kind(ScriptedSensor, NetcanoemSensor, SENSOR, {}),
    "box": Kind(ScriptedBox, NetForceSensor, BOX, {}),
}


def key_of(text: str) -> tuple[int, int]:
    index, subindex = text.split(":")
    return int(index, 16), int(subindex, 16)


def told(frames: list[tuple[int, bytes]]) -> str:
    return " | ".join(map(written, *zip(*frames, strict=True))) if frames else "nothing"


def shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value + 0.0:.10g}"  # no negative zero
    if isinstance(value, tuple | list):
        return ", ".join(map(shown, value)) or "nothing"
    return str(value) if value != "" else "nothing"


class Talk:
    """Each method is a step; what it returns is compared with what the step wants."""

    def __init__(self, wire: Wire, device: str, settings: list[str]):
        begun, _, name = device.rpartition("_")
        kind = KINDS[name]
        given = values_of(settings)
        own = {name: given.pop(name) for name in set(given) - set(kind.settings._fields)}
        if "profile" in given:  # the driver gets its name and what is in it, as in its node
            own["profile"] = profiles.load(given["profile"])
        self.wire = wire
        wire.port.sync_producer = own.pop("sync_producer", True)
        self.device = wire.attach(kind.end(wire))
        self.driver = kind.driver(wire.port, kind.settings._replace(**given), **kind.others | own)
        self.sample, self.samples, self.written, self._tick = None, 0, 0.0, 0
        if begun != "new":
            self.begin()
        if begun == "enabled":
            self.enable()
        self.drain()

    def begin(self) -> None:
        self.driver.configure()
        self.driver.start()
        if isinstance(self.driver, Drive):
            self.run("5")

    def enable(self) -> None:
        self.driver.request_enable()
        self.run("3")
        assert self.device.state == "operation enabled"

    def run(self, periods: str, torque: str = "0") -> str:
        """Periods of the loop; return the frames that were sent in them."""
        before = len(self.wire.frames)
        for _ in range(int(periods)):
            if isinstance(self.driver, Drive):
                self._drive(float(torque))
            else:
                self.request()
                self.pump()
        return told(self.wire.frames[before:])

    def _drive(self, torque: float) -> None:
        now_ns = self.wire.advance()
        self.device.show_life()
        self.driver.sync(now_ns)
        self.driver.heartbeat(now_ns)
        self.pump()
        self.written = self.driver.write(torque, now_ns)

    def request(self) -> None:
        """Begin a period; what comes in is not read yet."""
        now_ns, self._tick = self.wire.advance(), self._tick + 1
        self.driver.request(self._tick, now_ns, now_ns + 5)

    def pump(self) -> None:
        self.wire.port.pump()
        if not isinstance(self.driver, Drive):
            self.sample = self.driver.reading()
            self.samples += self.sample is not None

    def write(self, torque: str) -> None:
        """Command a torque, without a word of the drive's."""
        self.written = self.driver.write(float(torque), self.wire.now_ns)

    def stall(self, milliseconds: str) -> None:
        self.wire.advance(float(milliseconds))

    def send(self, can_id: str, *data: str) -> None:
        self.wire.emit(int(can_id, 16), "".join(data))

    def foreign(self, can_id: str, *data: str) -> None:
        """A frame of somebody else's: the device hears it, and we do."""
        self.device.handle(int(can_id, 16), bytes.fromhex("".join(data)))
        self.send(can_id, *data)

    def act(self, what: str, *given: str) -> None:
        """Let the device do something."""
        getattr(self.device, what)(*map(value_of, given))

    def let(self, name: str, *value: str) -> None:
        assert hasattr(self.device, name), name
        setattr(self.device, name, value_of(" ".join(value)))

    def hold(self) -> None:
        self.wire.held = []

    def release(self) -> None:
        self.wire.release()

    def object(self, key: str, data: str) -> None:
        self.device.objects[key_of(key)] = bytes.fromhex(data)

    def read(self, key: str) -> str:
        return self.device.objects[key_of(key)].hex().upper()

    def refuse(self, key: str, code: str = "06010002") -> None:
        self.device.refused[key_of(key)] = int(code, 16)

    def deafen(self, key: str) -> None:
        self.device.deaf.add(key_of(key))

    def remove(self, key: str) -> None:
        del self.device.objects[key_of(key)]

    def wrote(self) -> str:
        """Return what was written into the device's objects."""
        found = [f"{index:04X}:{sub:02X} {value:X}" for index, sub, value in self.device.writes]
        return " | ".join(found) or "nothing"

    def sent(self, can_id: str) -> str:
        """Return the data that we sent under an identifier."""
        found = self.wire.sent(int(can_id, 16))
        return " | ".join(data.hex(" ").upper() or "empty" for data in found) or "nothing"

    def drain(self) -> None:
        """Forget what was sent and written so far, and samples."""
        self.wire.frames.clear()
        getattr(self.device, "writes", []).clear()
        self.samples = 0

    def do(self, what: str, *given: str) -> str:
        """Call the driver."""
        return shown(attrgetter(what)(self.driver)(*map(value_of, given)))

    def cannot(self, what: str, *given: str) -> str:
        """Call the driver, or carry out a step; it refuses."""
        step = getattr(self, what, None)
        with pytest.raises(DeviceError) as refused:
            step(*given) if step else self.do(what, *given)
        return f"{refused.typename}: {refused.value}"

    def leave(self) -> str:
        return shown(drive_group.leave([self.driver], self.wire.port))

    def resume(self) -> str:
        return "anew" if drive_group.start([self.driver]) else "as it is"

    def tare(self) -> None:
        samples = []
        for _ in range(2):
            self.run("1")
            samples.append(self.sample)
        self.driver.tare(samples)

    def see(self, name: str) -> str:
        """Return what the driver shows, or `sample`, `samples`, `written`, `device`."""
        found = self if name.partition(".")[0] in vars(self) else self.driver
        for part in name.split("."):
            found = found[part] if isinstance(found, dict) else getattr(found, part)
        return shown(found)


def converse(talk: Talk, *lines: str) -> None:
    """Hold a conversation, line by line."""
    for line in lines:
        carry_out(talk, line)
