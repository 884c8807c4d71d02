# SPDX-License-Identifier: Apache-2.0
"""The drive's driver against drives of two CANopen stacks that nobody here wrote."""

from __future__ import annotations

import pytest
from far_end import DURAND, LOCAL_NODE

pytestmark = pytest.mark.timeout(180)

NMT, SYNC, EMERGENCY, STATUS, COMMAND = 0x000, 0x080, 0x081, 0x181, 0x201
BEAT, OUR_BEAT = 0x701, 0x770
START_IT, PRE_OPERATIONAL = bytes.fromhex("01 01"), bytes.fromhex("80 01")
REQUEST = 0x601
# durand has no event timers of PDOs (1400:05, 1801:05), and neither has an EPOS4.
DRIVES = [(LOCAL_NODE, "generic_402"), (LOCAL_NODE, "epos4"), (DURAND, "epos4")]


@pytest.fixture(params=DRIVES, ids=lambda given: " ".join(given))
def kind(request):
    return request.param


@pytest.fixture
def far(kind, device):
    return device(*kind)


@pytest.fixture
def enabled(far, kind, near):
    """Return a maker of drivers that are enabled on `far`; settings: what is not patient."""

    def make(**settings):
        drive = near.drive(kind[1], **settings)
        near.enabled(drive)
        return drive

    return make


def written(near) -> list[tuple[int, int, int]]:
    """Return what was downloaded to the drive, in order: index, sub-index, value."""
    frames = [data for _, data in near.frames(REQUEST) if data[0] & 0xE0 == 0x20]
    return [
        (data[1] | data[2] << 8, data[3], int.from_bytes(data[4:8], "little")) for data in frames
    ]


def recovered(near, drive, far) -> None:
    """Clear the fault, with the loop running; the drive is off after it, and can be enabled."""
    drive.clear_fault()
    near.run(drive, lambda: not drive.recovering, "recovered")
    assert drive.fault == ""
    assert far.application.state != "operation enabled", "a recovery enables nothing"
    near.run(drive, lambda: drive.refusal() == "", "ready")
    drive.request_enable()
    near.run(drive, lambda: drive.is_on(near.now_ns), "enabled again")


def test_torque_and_position_come_back_with_the_sign_that_was_sent(near, far, enabled):
    drive = enabled()
    begun = drive.reading.position
    near.run(drive, lambda: drive.reading.torque == pytest.approx(-0.21), "gives it", torque=-0.21)
    near.run(drive, lambda: drive.reading.position < begun - 0.1, "turns", torque=-0.21)
    assert near.frames(COMMAND)[-1] == (COMMAND, bytes.fromhex("0F 00 0C FE"))  # -500 per mille
    assert far.application.target == -500
    drive.request_disable()
    near.run(drive, lambda: far.application.state == "switched on", "is off", torque=-0.21)
    assert near.frames(COMMAND)[-1][1][2:] == b"\0\0"
    near.run(drive, lambda: drive.reading.torque == 0.0, "gives none")


def test_the_order_of_the_configuration(near, far, kind):
    drive = near.drive(kind[1])
    drive.configure()
    drive.start()
    near.run(drive, lambda: drive.shown.name == "SWITCHED_ON", "ready")
    assert near.frames(NMT) == [(NMT, PRE_OPERATIONAL), (NMT, START_IT)], "to this node alone"
    frames = near.frames(NMT, REQUEST, OUR_BEAT, COMMAND)
    order = [can_id for can_id, _ in frames]
    assert order.index(REQUEST) > order.index(NMT)
    started = frames.index((NMT, START_IT))
    assert OUR_BEAT not in order[:started] and COMMAND not in order[:started]
    assert order[started + 1:started + 3] == [OUR_BEAT, COMMAND], "both guards are armed first"
    assert frames[started + 2] == (COMMAND, bytes(4))
    for parameters, cob_id in ((0x1400, 0x201), (0x1800, 0x181)):
        (disabled, emptied, *mapped, counted, kinds, on) = [
            each for each in written(near)
            if each[0] in (parameters, parameters + 0x200) and each[1] != 5
        ]  # fmt: skip
        assert disabled[:2] == (parameters, 1) and disabled[2] >> 31
        assert emptied == (parameters + 0x200, 0, 0)
        assert [each[1] for each in mapped] == list(range(1, len(mapped) + 1))
        assert counted == (parameters + 0x200, 0, len(mapped))
        assert kinds[:2] == (parameters, 2)
        assert on[:2] == (parameters, 1) and on[2] & 0xBFFFFFFF == cob_id


def test_a_drive_that_hears_our_heartbeat_no_more_stops_itself(near, far, enabled):
    drive = enabled(heartbeat_timeout=0.5)
    near.run(drive, lambda: drive.reading.torque, "gives torque", torque=0.1)
    near.run(drive, lambda: drive.fault, "is noticed", torque=0.1, beat=False)
    assert far.application.state == "fault"
    lost = [data for _, data in near.frames(EMERGENCY)]
    assert [data[:2].hex() for data in lost] == ["3081"]  # 0x8130
    assert "8130" in drive.fault
    assert near.tick(drive, 0.1) == 0.0
    recovered(near, drive, far)


def test_a_drive_whose_heartbeat_is_missing_is_switched_off(near, far, enabled):
    drive = enabled(drive_heartbeat=0.5)
    near.run(drive, lambda: len(near.frames(BEAT)) > 1, "beats")
    far.do(far.silence_heartbeat)
    near.run(drive, lambda: drive.fault, "is noticed", torque=0.1)
    assert drive.fault == "the heartbeat of the drive is missing"
    near.run(drive, lambda: far.application.state == "switch on disabled", "is off", torque=0.1)
    assert near.frames(COMMAND)[-1] == (COMMAND, bytes(4))


@pytest.mark.parametrize("fails", [True, False])
def test_an_emergency_stops_it_and_stands_in_the_text(near, far, enabled, fails):
    drive = enabled()
    application = far.application
    if fails:
        far.do(lambda: application.fail(0x7305))
    else:  # a warning of the make: the drive goes on
        far.do(lambda: application.stack.emergency(0x7305, 0x20))
    near.run(drive, lambda: drive.fault, "is noticed", torque=0.1)
    assert "7305" in drive.fault
    near.run(drive, lambda: application.state != "operation enabled", "is off", torque=0.1)
    recovered(near, drive, far)


@pytest.mark.parametrize("how", ["power", "81", "82"])
def test_a_restart_while_enabled_is_latched_and_configured_anew(near, far, enabled, how):
    drive = enabled()
    before = len(written(near))
    if how == "power":
        far.restart()
    else:
        near.emit(NMT, f"{how} 01")
    near.run(drive, lambda: drive.fault, "is noticed", torque=0.1)
    assert "restarted (boot-up)" in drive.fault
    assert near.tick(drive, 0.1) == 0.0
    assert far.application.state != "operation enabled"
    assert len(written(near)) == before, "nothing is configured by itself"
    recovered(near, drive, far)
    assert (0x6060, 0, 10) in written(near)[before:]
    near.run(drive, lambda: drive.reading.torque == pytest.approx(0.1, abs=1e-3), "gives torque",
             torque=0.1)  # fmt: skip


@pytest.mark.parametrize("command", ["02 01", "80 01", "80 00"])
def test_a_foreign_nmt_command_that_stops_it_is_latched(near, far, enabled, command):
    drive = enabled(stale_periods=50.0, drive_heartbeat=0.2)
    near.emit(NMT, command)
    near.run(drive, lambda: drive.fault, "is noticed", torque=0.1)
    assert far.application.state != "operation enabled"
    assert near.tick(drive, 0.1) == 0.0


def test_a_mode_that_changes_unasked_is_latched(near, far, enabled):
    drive = enabled()
    far.do(lambda: far.application.stack.put(0x6061, 0, 1))

    def act():
        near.tick(drive, 0.1)
        drive.poll_slow()

    near.until(lambda: drive.fault, act, "is noticed")
    assert drive.fault == f"the drive is not in torque mode {drive.mode}, 6061 is 1"


def test_a_command_that_stays_away_stops_the_drive_by_1400_05(near, device):
    far = device(LOCAL_NODE, "generic_402")
    drive = near.drive("generic_402", command_timeout=0.5)
    near.enabled(drive)

    def act():
        drive.sync(near.now_ns)
        drive.heartbeat(near.now_ns)
        near.pump()

    near.until(lambda: drive.fault, act, "is noticed")
    assert far.application.state == "fault"
    assert near.frames(EMERGENCY)[-1][1][:2].hex() == "5082"  # 0x8250
    recovered(near, drive, far)


def test_half_of_the_syncs_are_enough(near, far, kind):
    """Of the plane: 500 Hz beside a SYNC of 1 kHz. durand answers each SYNC from the second on."""
    drive = near.drive(kind[1], sync_divider=2)
    near.enabled(drive)
    before = len(near.frames(SYNC)), len(near.frames(STATUS))
    for _ in range(40):
        near.tick(drive, 0.1)
    syncs, answers = len(near.frames(SYNC)) - before[0], len(near.frames(STATUS)) - before[1]
    assert (syncs, answers) == (40, 40 if kind[0] == DURAND else 20)
    assert drive.fault == "" and drive.counters["missing"] == 0
