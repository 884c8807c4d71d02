# SPDX-License-Identifier: Apache-2.0
"""Golden frames: one table written from the standards, to which driver and rig are held alike.

What driver and simulated device have misunderstood in common, no test of one against the other
finds. So neither is asked here what the other says: each is shown its half of a table and must give
the other half. CiA 301 (SDO, NMT, EMCY), CiA 402-2 (drive), CiA 406 (encoder), ATI 9610-05-1030
(NETCANOEM) and 9620-05-Net FT (box). Hex as on the wire.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
from running_drivers import watched_drive, watched_tick
from scripted import FarEnd
from scripted_devices import ScriptedBox, ScriptedDrive, ScriptedEncoder, ScriptedSensor
from scripted_fixtures import wire  # noqa: F401

from screw_module_ros.devices.ati_net import NetForceSensor
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import Refused
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.devices.netcanoem import NetcanoemSensor
from screw_module_ros.devices.sdo import Sdo
from screw_module_ros.rig.build import RigSettings

QUICK = {"listen": 0.0, "sdo_timeout": 0.02}
QUICK_SENSOR = {"listen": 0.0, "timeout": 0.02}
RATED, RATED_CURRENT = 0.42, 2.625  # objects 6076 and 6075: 420 mNm, 2625 mA


class Tick(NamedTuple):
    """RPDO: 6040 controlword, 6071 torque. TPDO, at the next SYNC: 6041, 6064, 6077.

    mask: the bits of 6041 that name the state (CiA 402-2, table of statuswords). counts, torque:
    of the motor then, 20 000 counts a turn, per mille of the rated torque.
    """

    rpdo: str
    tpdo: str
    mask: int
    counts: int = 0
    torque: int = 0


DRIVE = (
    Tick("00 00 00 00", "40 02 00 00 00 00 00 00", 0x4F),  # switch on disabled
    Tick("06 00 00 00", "31 02 00 00 00 00 00 00", 0x6F),  # ready to switch on
    Tick("07 00 00 00", "33 02 00 00 00 00 00 00", 0x6F),  # switched on
    Tick("0F 00 00 00", "37 02 00 00 00 00 00 00", 0x6F),  # operation enabled
    Tick("0F 00 EE 00", "37 02 10 27 00 00 EE 00", 0x6F, 10_000, 238),  # 0.1 Nm
    Tick("0F 00 24 FE", "37 02 F0 D8 FF FF 24 FE", 0x6F, -10_000, -476),  # -0.2 Nm
    Tick("00 00 00 00", "50 02 F0 D8 FF FF 00 00", 0x4F, -10_000),  # disable voltage
)
ENABLED_AT, DISABLED_AT = 3, 6
TORQUES = (0.0, 0.0, 0.0, 0.0, 0.1, -0.2, 0.0)  # asked of the driver [Nm]

# Object 6004, 4096 turns of 20 000 counts: it wraps where the measuring range ends.
ENCODER = (
    (0, "00 00 00 00"),
    (20_000, "20 4E 00 00"),
    (12_345_678, "4E 61 BC 00"),
    (-1, "FF FF E1 04"),
    (-20_000, "E0 B1 E1 04"),
)

# Status and gauges 0 2 4, then gauges 1 3 5, big endian: at rest, with its zero offsets.
BOARD = ((312, -145, 87, -260, 41, 198), "00 00 01 38 00 57 00 29", "FF 6F FE FC 00 C6")
# Fx Tx Fy Ty, then Fz Tz and status, little endian; 200 per N, 5000 per Nm.
BOX = ((5.0, -1.0, 20.0, -0.1, 0.01, 0.0), "E8 03 0C FE 38 FF 32 00", "A0 0F 00 00 00 00")
# Continuous over current 2310, error register: generic and current.
EMERGENCY = "10 23 03 00 00 00 00 00"
NO_SUCH_OBJECT = ("40 99 20 00 00 00 00 00", "80 99 20 00 00 00 02 06")


class Player(ScriptedDrive):
    """A drive that answers each SYNC with the table's TPDO, whatever it was told."""

    row = DRIVE[0]

    def report(self) -> None:
        self.wire.emit(0x181, self.row.tpdo)

    def command(self, word: int) -> None:
        pass


def test_the_driver_commands_as_the_table_says(wire):  # noqa: F811
    player = wire.attach(Player(wire))
    drive = Drive(wire.port, DriveSettings(**QUICK), "vertical drive")
    drive.configure()
    drive.start()
    for number, (row, torque) in enumerate(zip(DRIVE, TORQUES, strict=True)):
        if number == ENABLED_AT:
            drive.request_enable()
        elif number == DISABLED_AT:
            drive.request_disable()
        now_ns = wire.advance()
        wire.emit(0x701, "05")
        drive.sync(now_ns)
        drive.heartbeat(now_ns)
        wire.port.pump()
        before = DRIVE[max(0, number - 1)]
        assert drive.reading.statusword.to_bytes(2, "little") == bytes.fromhex(before.tpdo[:5])
        assert drive.reading.position == pytest.approx(before.counts / 20_000 * 2.0 * math.pi)
        assert drive.reading.torque == pytest.approx(before.torque * 1e-3 * RATED)
        drive.write(torque, now_ns)
        assert wire.sent(0x201)[-1] == bytes.fromhex(row.rpdo)
        player.row = row


def test_the_rig_answers_as_the_table_says(torque_drive):
    torque_drive.drain()
    for row in DRIVE:
        torque_drive.send(0x201, row.rpdo)
        torque_drive.run(0)
        world = torque_drive.world
        world.encoder_count, world.vertical_torque = row.counts, row.torque * 1e-3 * RATED
        (frame,) = [bytes.fromhex(data) for i, data in torque_drive.ask(0x080) if i == 0x181]
        wanted = bytes.fromhex(row.tpdo)
        assert frame[0] & row.mask == wanted[0] & row.mask
        assert frame[2:] == wanted[2:]
        if frame[0] & 0x6F == 0x27:
            assert world.vertical_command == pytest.approx(row.torque * 1e-3 * RATED_CURRENT)


def test_the_driver_reads_the_encoder_as_the_table_says(wire):  # noqa: F811
    end = wire.attach(ScriptedEncoder(wire))
    end.objects[0x6001, 0] = end.objects[0x6501, 0] = bytes.fromhex("20 4E 00 00")
    end.objects[0x6002, 0] = bytes.fromhex("00 00 E2 04")  # 4096 turns
    end.answering = False
    encoder = Encoder(wire.port, EncoderSettings(**QUICK))
    encoder.configure()
    encoder.start()
    for counts, frame in ENCODER:
        encoder.request(1, wire.advance(), 0)
        assert wire.frames[-1] == (0x080, b"")
        wire.emit(0x182, frame)
        wire.port.pump()
        assert encoder.reading().count == counts


def test_the_rig_counts_as_the_table_says(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "01", "82010000")
    encoder.start(2)
    encoder.drain()
    for counts, frame in ENCODER:
        encoder.world.encoder_count = counts
        assert encoder.ask(0x080) == [(0x182, frame)]


def reading(can_wire, sensor):
    sensor.configure()
    sensor.start()
    sensor.request(1, can_wire.advance(), 0)
    can_wire.port.pump()
    return sensor.reading()


def test_the_driver_reads_the_board_as_the_table_says(wire):  # noqa: F811
    end = wire.attach(ScriptedSensor(wire))
    (g0, g1, g2, g3, g4, g5), end.first, end.second = BOARD
    sample = reading(wire, NetcanoemSensor(wire.port, ForceSensorSettings(**QUICK_SENSOR)))
    assert wire.frames[-1] == (0x120, b"")
    # The scripted matrix: 2 g0 - g1 / 2, then one gauge a row; 1000 per N, 10 000 per Nm.
    forces = [force / 1000 for force in (2 * g0 - g1 / 2, g1, g2)]
    assert sample[3:9] == pytest.approx([*forces, *(torque / 10_000 for torque in (g3, g4, g5))])


def test_the_rig_measures_as_the_table_says(sensor):
    assert sensor.ask(0x120) == [(0x120, BOARD[1]), (0x121, BOARD[2])]


def test_the_driver_reads_the_box_as_the_table_says(wire):  # noqa: F811
    end = wire.attach(ScriptedBox(wire))
    wrench, end.xy, last = BOX
    end.z, end.status = last[:11], last[12:]
    scales = {"counts_per_force": 200.0, "counts_per_torque": 5000.0}
    sample = reading(wire, NetForceSensor(wire.port, ForceSensorSettings(**QUICK_SENSOR, **scales)))
    assert wire.frames[-1] == (0x120, b"\x02")
    assert sample[3:9] == pytest.approx(wrench)


def test_the_rigs_box_measures_as_the_table_says(make_bench):
    bench = make_bench("force_sensor", settings=RigSettings(sensor_profile="ati_net"))
    bench.rig.devices["force_sensor"].converter_noise = 0.0
    bench.world.load, first, last = BOX
    (one, two) = bench.ask(0x120, "02")
    assert (one, two[0], two[1][:17]) == ((0x125, first), 0x126, last)


def test_an_emergency_is_the_same_for_both(wire, torque_drive):  # noqa: F811
    torque_drive.drain()
    torque_drive.rig.inject("drive", "over_current", 0.0, 0.0, torque_drive.now_ns)
    assert (0x081, EMERGENCY) in torque_drive.run(1)
    wire.attach(ScriptedDrive(wire))
    drive = watched_drive(wire, DriveSettings(**QUICK))
    wire.emit(0x081, EMERGENCY)
    watched_tick(wire, drive)
    assert drive.error_code == 0x2310 and drive.emergency


class Refusing(FarEnd):
    """A node that answers each request with the table's refusal."""

    def handle(self, can_id: int, data: bytes) -> None:
        if can_id == 0x601:
            self.wire.emit(0x581, NO_SUCH_OBJECT[1])


def test_a_refused_object_is_the_same_for_both(wire, drive):  # noqa: F811
    assert drive.ask(0x601, NO_SUCH_OBJECT[0]) == [(0x581, NO_SUCH_OBJECT[1])]
    wire.attach(Refusing(wire))
    with pytest.raises(Refused) as caught:
        Sdo(wire.port, 1, "drive", 0.02, lambda: None).read(0x2099)
    assert caught.value.code == 0x06020000
    assert wire.sent(0x601) == [bytes.fromhex(NO_SUCH_OBJECT[0])]
