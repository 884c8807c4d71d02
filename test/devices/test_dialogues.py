# SPDX-License-Identifier: Apache-2.0
"""Golden dialogues: every frame that a driver sends from configure to the clean exit, in order.

`dialogues.txt` holds them as raw bytes: `[scene]`, then `= step` and one frame a line, identifier
and data in hex; `# name = value` is what the driver shows differently after the step, and `-> ...`
what it returned. Recorded once against the scripted devices, which are written from the manuals. A
driver that sends another byte, in another order, or takes an answer otherwise, fails here. Who
changes it on purpose renews it with --write and reads the difference.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from running_drivers import tick, tick_both, two_drives, watched_tick
from scripted_devices import ScriptedDrive, ScriptedEncoder, ScriptedSensor

from screw_module_ros.devices import drive_group
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.devices.force_sensor import ForceSensor
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings

STORED = Path(__file__).with_name("dialogues.txt")
DRIVE = DriveSettings(listen=0.0, sdo_timeout=0.02)
ENCODER = EncoderSettings(listen=0.0, sdo_timeout=0.02)
SENSOR = ForceSensorSettings(listen=0.0, timeout=0.02)
NO_SUCH_OBJECT = 0x06020000
READ_ONLY = 0x06010002


# What a driver shows. Sentences are not kept, only whether there are any.
SHOWN = (
    "running", "intact", "altered", "homed", "silent", "configured", "mode", "step", "torque_of",
    "shown", "error_code", "mode_display", "digital_inputs", "operating_status", "nmt", "enabling",
    "identity", "tared", "rate", "counts_per_newton",
)  # fmt: skip
WORDED = ("fault", "emergency", "warnings", "unguarded")


class Scene:
    """A driver at work; `step` begins a new part of the dialogue, `lines` is what was sent."""

    def __init__(self, wire, end, driver=None):
        self.wire, self.end, self.driver = wire, end, driver
        self.lines = []
        self._seen, self._shown = 0, {}

    def step(self, title, act, *arguments):
        """Do something and note the frames of it; returns what it returned."""
        self.lines.append(f"= {title}")
        try:
            found = act(*arguments)
            if found not in (None, ""):
                self.lines.append(f"-> {found}")
            return found
        except DeviceError as error:
            self.lines.append(f"! {type(error).__name__}")
        finally:
            self.take()
            self.look()

    def look(self):
        """Note what the driver shows now and did not before."""
        if (driver := self.driver) is None:
            return
        shown = {name: getattr(driver, name) for name in SHOWN if hasattr(driver, name)}
        shown |= {name: bool(getattr(driver, name)) for name in WORDED if hasattr(driver, name)}
        shown |= {f"counters.{name}": count for name, count in driver.counters.items() if count}
        if isinstance(driver, Drive):
            shown["reading"] = driver.reading
        self.lines += [
            f"# {name} = {value}" for name, value in sorted(shown.items())
            if self._shown.get(name) != value
        ]  # fmt: skip
        self._shown = shown

    def take(self):
        frames, self._seen = self.wire.frames[self._seen :], len(self.wire.frames)
        self.lines += [f"{can_id:03X} {data.hex(' ').upper()}".strip() for can_id, data in frames]


def driven(wire, settings=DRIVE):
    end, drive = wire.attach(ScriptedDrive(wire)), Drive(wire.port, settings, "vertical drive")
    return Scene(wire, end, drive), drive


def ticks(scene, drive, count=1, torque=0.0):
    for _ in range(count):
        watched_tick(scene.wire, drive, torque)


def begun(scene, drive):
    drive.configure()
    drive.start()
    ticks(scene, drive, 5)
    scene.take()
    scene.lines.clear()


def enabled(scene, drive, torque=0.1):
    begun(scene, drive)
    drive.request_enable()
    ticks(scene, drive, 4, torque)
    assert scene.end.state == "operation enabled"
    scene.take()
    scene.lines.clear()


def drive_life(wire):
    scene, drive = driven(wire)
    scene.step("configure", drive.configure)
    scene.step("start", drive.start)
    scene.step("arm, then up to switched on", ticks, scene, drive, 5, 0.3)
    drive.request_enable()
    scene.step("enable", ticks, scene, drive, 3, 0.1)
    scene.step("0.1 Nm, -0.2 Nm, 9 Nm", ticks, scene, drive, 1, 0.1)
    ticks(scene, drive, 1, -0.2)
    ticks(scene, drive, 1, 9.0)
    scene.take()
    drive.request_disable()
    scene.step("disable", ticks, scene, drive, 3)
    return scene


def drive_clean_exit(wire):
    """The commands go on beside the SDO transfers: how many of them is left to the machine."""
    scene, drive = driven(wire)
    enabled(scene, drive)
    scene.driver = None
    scene.step("shutdown", drive_group.leave, [drive], wire.port)
    cyclic = ("080", "201", "770")
    others = [line for line in scene.lines if line[:3] not in cyclic]
    commands = [line for line in scene.lines if line[:3] == "201"]
    scene.lines = [*others, "= its commands", *(line for line, _ in itertools.groupby(commands))]
    return scene


def drive_other_settings(wire):
    """Brake, reversed, a slow SYNC, identity checked, drive without 60FD, 60B2 and event timer."""
    settings = DRIVE._replace(
        stop_reaction="brake", direction=-1, sync_divider=2, master_id=99, vendor_id=0x99,
        product_code=1, max_torque=0.3, heartbeat_period=0.01, heartbeat_timeout=0.055,
        command_timeout=0.031, drive_heartbeat=0.02,
    )  # fmt: skip
    scene, drive = driven(wire, settings)
    scene.end.objects[0x60B2, 0] = b"\x05\x00"
    scene.end.objects[0x605B, 0] = b"\x00\x00"
    scene.end.refused[0x1A01, 3] = 0x06040041
    scene.step("configure", drive.configure)
    scene.step("start", drive.start)
    return scene


def drive_that_refuses(wire):
    """Every guard refused; fixed RPDO mapping; target and controlword by PDO only."""
    scene, drive = driven(wire)
    for key in ((0x1400, 5), (0x1017, 0), (0x1016, 1), (0x605A, 0), (0x6072, 0)):
        scene.end.refused[key] = READ_ONLY
    scene.end.refused[0x6071, 0] = scene.end.refused[0x6040, 0] = READ_ONLY
    scene.end.deaf |= {(0x605E, 0)}
    del scene.end.objects[0x6007, 0]
    scene.step("configure", drive.configure)
    scene.step("start", drive.start)
    scene.step("arm", ticks, scene, drive, 2)
    scene.driver = None
    scene.step("disarm", drive_group.leave, [drive], wire.port)
    scene.lines = [line for line in scene.lines if line[:3] not in ("080", "770", "201")]
    return scene


def drive_in_profile_torque(wire):
    scene, drive = driven(wire)
    scene.end.objects[0x6502, 0] = b"\x08\x00\x00\x00"
    scene.end.objects[0x6087, 0] = b"\x00\x10\x00\x00"
    scene.step("configure", drive.configure)
    return scene


def drive_fault_and_recovery(wire):
    scene, drive = driven(wire)
    enabled(scene, drive)
    scene.step("fault", scene.end.fail)
    scene.step("the ticks after it", ticks, scene, drive, 3, 0.1)
    scene.end.cause_stands = True
    scene.step("clear fault", drive.clear_fault)
    scene.step("edges while the cause stands", ticks, scene, drive, 55)
    scene.end.cause_stands = False
    scene.step("recovery", ticks, scene, drive, 55)
    assert drive.fault == ""
    return scene


def drive_quick_stop(wire):
    scene, drive = driven(wire, DRIVE._replace(stop_reaction="brake"))
    enabled(scene, drive)
    scene.step("torque that is no number", ticks, scene, drive, 1, float("nan"))
    scene.step("the ticks after it", ticks, scene, drive, 3, 0.1)
    return scene


def drive_and_another_master(wire):
    scene, drive = driven(wire)
    enabled(scene, drive)
    wire.emit(0x201, "0F 00 E8 03")
    scene.step("NMT stop after the last zero", ticks, scene, drive, 3, 0.1)
    scene.step("and again while it stays", ticks, scene, drive, 105)
    scene.step("clear fault", drive.clear_fault)
    scene.step("recovery", ticks, scene, drive, 5)
    return scene


def drive_restarted(wire):
    scene, drive = driven(wire)
    enabled(scene, drive)
    scene.end.boot_up()
    scene.step("boot-up", ticks, scene, drive, 3, 0.1)
    scene.step("clear fault configures", drive.clear_fault)
    scene.step("recovery", ticks, scene, drive, 5)
    return scene


def drive_that_falls_back(wire):
    """It answers no SYNC and says PRE-OPERATIONAL: NMT stop."""
    scene, drive = driven(wire)
    enabled(scene, drive)
    scene.end.operational = False
    scene.lines.append("= ticks")
    for _ in range(14):
        now_ns = wire.advance()
        wire.emit(0x701, "7F")
        drive.sync(now_ns)
        drive.heartbeat(now_ns)
        wire.port.pump()
        drive.write(0.1, now_ns)
    scene.take()
    scene.look()
    return scene


def two_drives_of_a_bus(wire):
    ends, (one, other) = two_drives(wire, DRIVE)
    scene = Scene(wire, ends[0], one)
    scene.step("configure", one.configure)
    scene.step("configure the other", other.configure)
    scene.step("start", one.start)
    scene.step("start the other", other.start)
    scene.lines.append("= ticks")
    for _ in range(30):
        tick_both(wire, (one, other))
    scene.take()
    scene.look()
    scene.driver = None
    scene.step("exit", drive_group.leave, (one, other), wire.port)
    at = scene.lines.index("= exit")
    shared = ("080", "771", "203", "204")
    scene.lines[at:] = [line for line in scene.lines[at:] if line[:3] not in shared]
    return scene


def encoder_life(wire):
    encoder = Encoder(wire.port, ENCODER)
    scene = Scene(wire, wire.attach(ScriptedEncoder(wire)), encoder)
    scene.step("configure", encoder.configure)
    scene.step("start", encoder.start)
    scene.step("three ticks", lambda: [tick(wire, encoder, k) for k in range(3)])
    scene.step("slow polls", encoder.poll_slow)
    scene.step("home", encoder.home)
    scene.end.boot_up()
    scene.step("boot-up", tick, wire, encoder)
    scene.step("clear fault", encoder.clear_fault)
    scene.step("tick", tick, wire, encoder)
    wire.port.pump()
    wire.advance(150)
    scene.step("clear fault while it is silent", encoder.clear_fault)
    scene.step("stop", encoder.stop)
    return scene


def encoder_of_other_kinds(wire):
    scene = Scene(wire, wire.attach(ScriptedEncoder(wire)))
    objects = scene.end.objects
    settings = ENCODER._replace(
        code_sequence=1, counts_per_turn=8000, measuring_range=8_000_000, vendor_id=0x1234,
        product_code=0x77,
    )  # fmt: skip
    scene.step("scaled and reversed", Encoder(wire.port, settings).configure)
    scene.step("the same once more: nothing written twice", Encoder(wire.port, settings).configure)
    scene.end.deaf |= {(0x6000, 0)}
    objects[0x6000, 0] = b"\x00\x00"
    unscaled = ENCODER._replace(counts_per_turn=8192)
    scene.step("cannot scale", Encoder(wire.port, unscaled).configure)
    del objects[0x6502, 0]
    scene.step("incremental", Encoder(wire.port, unscaled).configure)
    scene.end.refused[0x1A00, 0] = READ_ONLY
    scene.step("fixed mapping", Encoder(wire.port, unscaled).configure)
    scene.step("another vendor", Encoder(wire.port, ENCODER._replace(vendor_id=1)).configure)
    scene.end.mute = True
    scene.step("silent", Encoder(wire.port, ENCODER).configure)
    return scene


def encoder_that_alarms(wire):
    encoder = Encoder(wire.port, ENCODER)
    scene = Scene(wire, wire.attach(ScriptedEncoder(wire)), encoder)
    encoder.configure()
    encoder.start()
    scene.take()
    scene.lines.clear()
    scene.end.objects[0x6503, 0] = b"\x01\x00"
    del scene.end.objects[0x6505, 0]
    scene.step("slow polls", encoder.poll_slow)
    scene.step("slow polls without what it has not", encoder.poll_slow)
    scene.end.objects[0x6503, 0] = b"\x00\x00"
    scene.step("clear fault", encoder.clear_fault)
    scene.step("tick", tick, wire, encoder)
    return scene


def force_sensor_life(wire):
    sensor = ForceSensor(wire.port, SENSOR._replace(calibration=3, serial="FT012345"))
    scene = Scene(wire, wire.attach(ScriptedSensor(wire)), sensor)
    scene.step("configure", sensor.configure)
    scene.step("start", sensor.start)
    scene.step("three ticks", lambda: [tick(wire, sensor, k) for k in range(3)])
    scene.step("slow polls", sensor.poll_slow)
    scene.end.first = "01 00 00 01 00 02 00 03"
    scene.step("bad status", tick, wire, sensor)
    scene.end.first = "00 00 00 01 00 02 00 03"
    scene.step("clear fault restarts", sensor.clear_fault)
    scene.step("tick", tick, wire, sensor)
    wire.emit(0x126, "05")
    scene.step("set by somebody else", tick, wire, sensor)
    scene.step("clear fault configures", sensor.clear_fault)
    scene.step("tick after it", tick, wire, sensor)
    scene.step("stop", sensor.stop)
    scene.step("no tick after it", tick, wire, sensor)
    return scene


def force_sensor_that_is_slow(wire):
    """Repeated requests, and the serial number asked for after a repeated row."""
    end = wire.attach(ScriptedSensor(wire))
    scene, handle = Scene(wire, end), end.handle
    lost = iter((0x122, 0x125))

    def forgetful(can_id, data):
        nonlocal left
        if can_id == left and (can_id != 0x122 or data == b"\x02"):
            left = next(lost, None)
        else:
            handle(can_id, data)

    left = next(lost)
    end.handle = forgetful
    sensor = ForceSensor(wire.port, SENSOR)
    scene.step("configure", sensor.configure)
    scene.step("restart", sensor.reset)
    end.mute = True
    scene.step("silent", sensor.configure)
    return scene


SCENES = (
    drive_life, drive_clean_exit, drive_other_settings, drive_that_refuses,
    drive_in_profile_torque, drive_fault_and_recovery, drive_quick_stop, drive_and_another_master,
    drive_restarted, drive_that_falls_back, two_drives_of_a_bus, encoder_life,
    encoder_of_other_kinds, encoder_that_alarms, force_sensor_life, force_sensor_that_is_slow,
)  # fmt: skip


def stored() -> dict[str, list[str]]:
    scenes: dict[str, list[str]] = {}
    for line in STORED.read_text().splitlines():
        if line.startswith("["):
            lines = scenes.setdefault(line.strip("[]"), [])
        elif line:
            lines.append(line)
    return scenes


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_the_driver_sends_what_is_stored(wire, scene, request):
    lines, dialogues = scene(wire).lines, stored()
    if request.config.getoption("--write"):
        dialogues[scene.__name__] = lines
        text = "\n".join("\n".join([f"[{name}]", *dialogues[name], ""]) for name in dialogues)
        STORED.write_text(text, encoding="utf-8")
    assert lines == dialogues[scene.__name__]


def test_each_stored_dialogue_has_its_scene():
    assert list(stored()) == [scene.__name__ for scene in SCENES]
