# SPDX-License-Identifier: Apache-2.0
"""The encoder's driver against encoders of two CANopen stacks that nobody here wrote."""

from __future__ import annotations

import itertools

import pytest
from ati_board import COUNTS_PER_FORCE, COUNTS_PER_TORQUE, AtiBoard
from far_end import STACKS

from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.devices.netcanoem import NetcanoemSensor

pytestmark = pytest.mark.timeout(120)

NMT, SYNC, POSITION, REQUEST = 0x000, 0x080, 0x182, 0x602
RANGE = 20_000 * 4096


@pytest.fixture(params=STACKS)
def far(request, device):
    return device(request.param, "generic_406")


@pytest.fixture
def encoder(far, near):
    """Return a driver that is started."""
    made = near.encoder()
    made.configure()
    made.start()
    return made


def steps(near, encoder, count) -> list[int]:
    """Return the differences of so many samples."""
    found = samples(near, encoder, count + 1)
    return [after - before for before, after in itertools.pairwise(found)]


def samples(near, encoder, count):
    return [sample.count for sample in (near.sample(encoder) for _ in range(count)) if sample]


def test_each_sync_brings_its_position(far, near, encoder):
    far.do(lambda: setattr(far.application, "speed", -300))
    assert samples(near, encoder, 60) == [-300 * n for n in range(1, 61)]
    cyclic = [can_id for can_id, _ in near.frames(SYNC, POSITION)]
    assert cyclic == [SYNC, POSITION] * 60
    assert encoder.counters["missing"] == encoder.counters["unexpected"] == 0


def test_its_position_goes_on_where_it_wraps(far, near, encoder):
    far.do(lambda: vars(far.application).update(count=RANGE // 2 - 3100, speed=1000))
    assert steps(near, encoder, 7) == [1000] * 7
    far.do(lambda: vars(far.application).update(count=-3100))
    assert steps(near, encoder, 7) == [1000] * 7


def test_the_order_of_the_configuration(near, encoder):
    frames = near.frames(NMT, REQUEST, SYNC)
    assert [frame for frame in frames if frame[0] == NMT] == [
        (NMT, bytes.fromhex("80 02")), (NMT, bytes.fromhex("01 02"))
    ]  # fmt: skip
    assert frames[0][0] == NMT and frames[-1][0] == NMT, "between the two it is configured"
    assert SYNC not in [can_id for can_id, _ in frames]


@pytest.mark.parametrize("how", ["power", "81", "82"])
def test_a_restart_is_latched_and_configured_anew(far, near, encoder, how):
    assert samples(near, encoder, 3)
    encoder.home()
    before = len(near.frames(REQUEST))
    if how == "power":
        far.restart()
    else:
        near.emit(NMT, f"{how} 02")
    near.until(lambda: encoder.fault, lambda: near.sample(encoder), "is noticed")
    assert "the encoder restarted (boot-up)" in encoder.fault
    assert not encoder.homed and near.sample(encoder) is None
    assert len(near.frames(REQUEST)) == before, "nothing is configured by itself"
    encoder.clear_fault()
    assert encoder.fault == "" and not encoder.homed
    assert len(samples(near, encoder, 3)) == 3


def test_an_emergency_is_latched_by_its_name(far, near, encoder):
    far.do(lambda: far.application.stack.emergency(0x5530, 0x81))
    near.until(lambda: encoder.fault, lambda: near.sample(encoder), "is noticed")
    assert "encoder emergency 0x5530" in encoder.fault
    assert near.sample(encoder) is None
    encoder.clear_fault()
    assert len(samples(near, encoder, 3)) == 3


def test_an_alarm_is_read_from_6503(far, near, encoder):
    far.do(lambda: far.application.stack.put(0x6503, 0, 0x0001))
    encoder.poll_slow()
    assert encoder.fault == "encoder alarm: position error"


@pytest.mark.parametrize("command", ["02 02", "80 02", "80 00"])
def test_a_foreign_nmt_command_stops_the_samples_and_clearing_starts_them(
    far, near, encoder, command
):
    assert samples(near, encoder, 3)
    near.emit(NMT, command)
    near.until(lambda: encoder.silent, lambda: near.sample(encoder), "is silent")
    encoder.clear_fault()
    assert len(samples(near, encoder, 3)) == 3


def test_a_stopped_driver_leaves_it_pre_operational(far, near, encoder):
    assert samples(near, encoder, 3)
    encoder.stop()
    near.emit(SYNC, "")
    frames = near.frames(NMT, POSITION)
    near.until(lambda: near.frames(0x582)[-1], lambda: encoder.sdo.unsigned(0x6500), "answers")
    assert near.frames(NMT, POSITION) == frames and frames[-1] == (NMT, bytes.fromhex("80 02"))


def test_a_force_sensor_of_its_manual_works_on_the_same_bus(request, near, encoder, closing):
    board = AtiBoard(request.node.nodeid)
    closing.callback(board.close)
    sensor = NetcanoemSensor(near.port, ForceSensorSettings(timeout=5.0, listen=0.02))
    sensor.configure()
    sensor.start()
    board.gauges = [250, -1200, 800, 4000, -15, 6]
    wanted = [*(each / COUNTS_PER_FORCE for each in board.gauges[:3]),
              *(each / COUNTS_PER_TORQUE for each in board.gauges[3:])]  # fmt: skip
    readings = []

    def take():
        near.pump()
        readings.extend(filter(None, [sensor.reading()]))

    for n in range(1, 21):
        sensor.request(n, near.now_ns, near.now_ns)
        assert near.sample(encoder)
        near.until(lambda n=n: len(readings) == n, take, "measures")
    for reading in readings:
        assert reading[3:9] == pytest.approx(wanted, abs=1.5 / COUNTS_PER_FORCE)
    assert sensor.fault == encoder.fault == ""
