# SPDX-License-Identifier: Apache-2.0
"""NMT, SDO, heartbeat and SYNC of the far end, against the layouts of CiA 301."""

import can


def test_boot_up_comes_once_and_before_anything_else(make_bench):
    bench = make_bench("encoder", booted=False)
    bench.now_ns = 0  # where simulated time begins
    assert bench.run(0) == [(0x702, "00")]
    assert bench.run(5) == []


def test_device_types_and_identity(make_bench):
    bench = make_bench("encoder", "drive")
    assert bench.ask(0x602, "40 00 10 00 00 00 00 00") == [(0x582, "43 00 10 00 96 01 02 00")]
    assert bench.ask(0x601, "40 00 10 00 00 00 00 00") == [(0x581, "43 00 10 00 92 01 02 00")]
    assert bench.ask(0x601, "40 18 10 00 00 00 00 00") == [(0x581, "4F 18 10 00 04 00 00 00")]
    assert bench.ask(0x601, "40 18 10 01 00 00 00 00") == [(0x581, "43 18 10 01 FF FF 0F 00")]


def test_name_is_uploaded_in_segments(encoder):
    assert encoder.ask(0x602, "40 08 10 00 00 00 00 00") == [(0x582, "41 08 10 00 19 00 00 00")]
    text = b""
    for toggle, last in (("60", False), ("70", False), ("60", False), ("70", True)):
        ((_, payload),) = encoder.ask(0x602, toggle + "00000000000000")
        data = bytes.fromhex(payload)
        assert bool(data[0] & 1) is last
        text += data[1 : 8 - (data[0] >> 1 & 7)]
    assert text == b"Simulated CiA 406 encoder"


def test_sdo_aborts_carry_the_codes_of_the_standard(encoder):
    assert encoder.ask(0x602, "40 34 12 00 00 00 00 00") == [(0x582, "80 34 12 00 00 00 02 06")]
    assert encoder.read(2, "6004:01") == "06090011"
    assert encoder.read(2, "1018:05") == "06090011"
    assert encoder.read(2, "1003:01") == "08000024"
    assert encoder.write(2, "6004:00", "00000000") == "06010002"
    assert encoder.write(2, "6000:00", "01") == "06070010"
    assert encoder.write(2, "1029:01", "03") == "06090031"
    assert encoder.write(2, "1003:00", "01") == "06090030"


def test_a_value_below_or_above_what_the_eds_file_allows_is_refused(drive):
    assert drive.write(1, "605D:00", "0000") == "06090032"
    assert drive.write(1, "605D:00", "0500") == "06090031"
    assert [drive.write(1, "605D:00", value) for value in ("0100", "0400")] == ["ok", "ok"]


def test_expedited_download_may_leave_its_size_open(encoder):
    """CiA 301, 7.2.4.3.3: with s = 0 the master does not say how many of the bytes count."""
    assert encoder.ask(0x602, "22 00 60 00 04 00 00 00") == [(0x582, "60 00 60 00 00 00 00 00")]
    assert encoder.read(2, "6000:00") == "0400"
    assert encoder.ask(0x602, "22 01 60 00 10 27 00 00") == [(0x582, "60 01 60 00 00 00 00 00")]
    assert encoder.read(2, "6001:00") == "10270000"
    assert encoder.ask(0x602, "22 29 10 01 01 00 00 00") == [(0x582, "60 29 10 01 00 00 00 00")]
    assert encoder.read(2, "1029:01") == "01"
    assert encoder.ask(0x602, "22 34 12 00 00 00 00 00") == [(0x582, "80 34 12 00 00 00 02 06")]
    assert encoder.ask(0x602, "22 08 10 00 00 00 00 00")[0][1].startswith("80 08 10 00")


def test_a_broken_sdo_request_is_survived(encoder):
    node = encoder.rig.devices["encoder"].node
    assert encoder.ask(0x602, "40 00 10") == []
    assert encoder.ask(0x602, "00 00 00 00 00 00 00 00") == []  # a segment of nothing
    assert node.malformed == 2
    assert encoder.read(2, "1000:00") == "96010200"


def test_pdos_only_while_operational(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "01", "82010000")
    assert encoder.ask(0x080) == []
    encoder.send(0x000, "01 03")
    assert encoder.ask(0x080) == []  # NMT for another node
    encoder.start(2)
    assert encoder.ask(0x080) == [(0x182, "00 00 00 00")]
    encoder.send(0x000, "80 00")
    assert encoder.ask(0x080) == []  # pre-operational, all nodes
    encoder.send(0x000, "01 00 00")
    assert encoder.ask(0x080) == []  # not an NMT frame


def test_stopped_means_no_sdo_but_a_heartbeat(encoder):
    encoder.write(2, "1017:00", "0A00")
    encoder.send(0x000, "02 02")
    assert encoder.ask(0x602, "40 00 10 00 00 00 00 00") == []
    assert encoder.run(10) == [(0x702, "04")]
    encoder.send(0x000, "80 02")
    assert encoder.read(2, "1000:00") == "96010200"


def test_heartbeat_shows_the_state_at_its_period(encoder):
    encoder.write(2, "1017:00", "3200")
    assert encoder.run(0) == []
    assert encoder.run(149) == [(0x702, "7F")] * 2
    encoder.silence(2)
    encoder.start(2)
    assert encoder.run(1) == [(0x702, "05")]
    encoder.now_ns += 170_000_000  # a stall: those that were missed are not sent, the next is due
    assert encoder.run(0) == [(0x702, "05")]
    assert encoder.run(29) == []
    assert encoder.run(1) == [(0x702, "05")]
    encoder.write(2, "1017:00", "0000")
    assert encoder.run(200) == []


def test_lost_heartbeat_of_the_master_is_noticed_once_and_forgiven(encoder):
    encoder.silence(2)
    encoder.write(2, "1016:01", "64007000")  # node 112, 100 ms
    encoder.start(2)
    assert encoder.run(500) == []  # armed by the first heartbeat only
    assert encoder.ask(0x770, "05") == []
    assert encoder.run(99) == []
    assert encoder.run(1) == [(0x082, "30 81 11 00 00 00 00 00")]
    assert encoder.run(300) == []
    assert encoder.read(2, "1001:00") == "11"
    assert encoder.read(2, "1003:01") == "30810000"
    assert encoder.rig.devices["encoder"].state == 0x7F  # 1029:01 = 0
    assert encoder.ask(0x770, "05") == [(0x082, "00 00 00 00 00 00 00 00")]


def test_error_behaviour_1_stays_operational_after_a_lost_heartbeat(encoder):
    encoder.silence(2)
    encoder.write(2, "1029:01", "01")
    encoder.write(2, "1016:01", "0A007000")
    encoder.start(2)
    encoder.ask(0x770, "05")
    encoder.run(20)
    assert encoder.rig.devices["encoder"].state == 0x05


def test_one_node_cannot_be_watched_twice(encoder):
    assert encoder.write(2, "1016:01", "64007000") == "ok"
    assert encoder.write(2, "1016:02", "C8007000") == "06040043"
    assert encoder.write(2, "1016:02", "C8007100") == "ok"
    assert encoder.write(2, "1016:01", "0A008000") == "ok"  # 128 is no node
    encoder.silence(2)
    encoder.start(2)
    assert encoder.ask(0x780, "05") + encoder.run(30) == []


def test_reset_forgets_the_configuration_and_boots(encoder):
    encoder.map_pdo(2, 0, ["20000460"], "01", "82010000")
    encoder.write(2, "6001:00", "10270000")
    encoder.start(2)
    encoder.drain()
    assert encoder.ask(0x000, "81 02") == []
    assert encoder.ask(0x602, "40 00 10 00 00 00 00 00") == []  # away for a moment
    assert encoder.run(20) == [(0x702, "00")]
    assert encoder.read(2, "1800:02") == "fe"
    assert encoder.read(2, "6001:00") == "204e0000"


def test_reset_communication_keeps_the_application_objects(encoder):
    encoder.write(2, "6001:00", "10270000")
    encoder.write(2, "1017:00", "E803")
    encoder.ask(0x000, "82 02")
    encoder.run(30)
    assert encoder.read(2, "6001:00") == "10270000"
    assert encoder.read(2, "1017:00") == "0000"


def test_sync_with_data_is_reported_and_not_answered(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "01", "82010000")
    encoder.start(2)
    assert encoder.ask(0x080, "01") == [(0x082, "40 82 11 00 00 00 00 00")]


def test_frames_of_other_kinds_are_ignored(encoder):
    remote = can.Message(arbitration_id=0x182, is_remote_frame=True, is_extended_id=False)
    extended = can.Message(arbitration_id=0x602, data=bytes(8), is_extended_id=True)
    for frame in (remote, extended):
        encoder.bus.send(frame)
    assert encoder.run(0) == []
    assert encoder.rig.counters.ignored == 2


def test_emcy_can_be_switched_off(drive):
    drive.write(1, "1014:00", "81000080")
    drive.rig.inject("drive", "over_temperature", 0, 0, drive.now_ns)
    assert [can_id for can_id, _ in drive.run(1)] == []
