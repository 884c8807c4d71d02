# SPDX-License-Identifier: Apache-2.0
"""PDO configuration and traffic as the master asks for it, right or wrong (CiA 301)."""

import pytest


def test_a_valid_pdo_cannot_be_changed(encoder):
    assert encoder.write(2, "1800:01", "00020000") == "06090030"  # another id while valid
    assert encoder.write(2, "1800:03", "0A00") == "06090030"
    assert encoder.write(2, "1A00:00", "00") == "06010000"
    assert encoder.write(2, "1A00:01", "20000460") == "06010000"
    assert encoder.write(2, "1800:01", "82010080") == "ok"
    assert encoder.write(2, "1A00:01", "20000460") == "06010000"  # count is not zero yet
    assert encoder.write(2, "1A00:00", "00") == "ok"
    assert encoder.write(2, "1A00:01", "20000460") == "ok"


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        ("20007712", "06020000"),  # no such object
        ("20010460", "06090011"),  # no such subindex
        ("10000460", "06040041"),  # 16 of 32 bits
        ("20000160", "06040041"),  # not mappable
        ("00000000", "06020000"),
    ],
)
def test_bad_mapping_entries_are_refused(encoder, entry, code):
    encoder.silence(2)
    encoder.write(2, "1A00:00", "00")
    assert encoder.write(2, "1A00:01", entry) == code


def test_a_mapping_with_an_entry_that_was_never_written_is_refused(encoder):
    encoder.silence(2)
    encoder.write(2, "1A00:00", "00")
    assert encoder.write(2, "1A00:01", "10000365") == "ok"
    assert encoder.write(2, "1A00:00", "04") == "06020000"
    assert encoder.read(2, "1A00:00") == "00"  # and so it is not there
    assert encoder.write(2, "1A00:00", "01") == "ok"


def test_a_mapping_beyond_eight_bytes_is_refused(encoder):
    encoder.silence(2)
    encoder.write(2, "1A00:00", "00")
    for position in (1, 2, 3):
        encoder.write(2, f"1A00:0{position}", "20000460")
    assert encoder.write(2, "1A00:00", "03") == "06040042"
    assert encoder.write(2, "1A00:00", "09") == "06040042"
    assert encoder.write(2, "1A00:00", "02") == "ok"


def test_a_read_only_object_cannot_be_received(drive):
    drive.write(1, "1400:01", "01020080")
    drive.write(1, "1600:00", "00")
    assert drive.write(1, "1600:01", "10004160") == "06040041"
    assert drive.write(1, "1600:01", "10000600") == "ok"  # a dummy of 16 bits
    assert drive.write(1, "1600:02", "10004060") == "ok"
    assert drive.write(1, "1600:00", "02") == "ok"
    drive.write(1, "1400:01", "01020000")
    drive.start(1)
    drive.ask(0x201, "FF FF 06 00")
    assert drive.read(1, "6041:00") == "3102"  # ready to switch on: the rest counts


@pytest.mark.parametrize("cob_id", ["00000000", "01060000", "01070000", "81010020"])
def test_restricted_and_extended_ids_are_refused(encoder, cob_id):
    encoder.silence(2)
    assert encoder.write(2, "1800:01", cob_id) == "06090030"


def test_reserved_transmission_types_are_refused(encoder):
    assert encoder.write(2, "1800:02", "F1") == "06090030"
    assert encoder.write(2, "1800:02", "FD") == "06090030"
    assert encoder.write(2, "1800:02", "F0") == "ok"


def test_type_n_answers_every_nth_sync(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "03", "82010000")
    encoder.start(2)
    answers = [len(encoder.ask(0x080)) for _ in range(7)]
    assert answers == [0, 0, 1, 0, 0, 1, 0]


def test_type_0_answers_sync_only_after_a_change(encoder):
    encoder.silence(2)
    encoder.map_pdo(2, 0, ["20000460"], "00", "82010000")
    encoder.start(2)
    answers = []
    for count in (5, 5, 6, 6):
        encoder.world.encoder_count = count
        answers.append(len(encoder.ask(0x080)))
    assert answers == [1, 0, 1, 0]


def test_a_wrong_mapping_is_sent_as_it_was_asked_for(encoder):
    encoder.silence(2)
    encoder.world.encoder_count = 0x123456
    encoder.map_pdo(2, 0, ["10000365", "20000460"], "01", "85020000")
    encoder.start(2)
    assert encoder.ask(0x080) == [(0x285, "00 00 56 34 12 00")]


def test_an_object_that_only_a_master_changes_is_sent_as_it_was_written(drive):
    drive.silence(1)
    drive.map_pdo(1, 0, ["10007260", "20008760"], "01", "81010000")
    drive.write(1, "6072:00", "E803")
    drive.write(1, "6087:00", "78563412")
    drive.start(1)
    assert drive.ask(0x080) == [(0x181, "E8 03 78 56 34 12")]


def test_both_default_pdos_talk_until_they_are_switched_off(encoder):
    encoder.start(2)
    encoder.world.encoder_count = 7
    assert encoder.ask(0x080) == [(0x282, "07 00 00 00"), (0x182, "07 00 00 00")]


def test_event_driven_pdo_obeys_event_timer_and_inhibit_time(drive):
    drive.silence(1)
    drive.write(1, "1801:03", "6400")  # 10 ms
    drive.write(1, "1801:05", "6400")  # 100 ms
    drive.map_pdo(1, 1, ["10003F60", "08006160", "2000FD60"], "FF", "81020000")
    drive.send(0x000, "01 01")
    assert drive.run(0) == [(0x281, "00 00 00 00 00 00 00")]
    assert drive.run(99) == []
    assert drive.run(1) == [(0x281, "00 00 00 00 00 00 00")]
    drive.rig.inject("drive", "inputs", 1, 0, drive.now_ns)
    assert drive.run(9) == []
    assert drive.run(1) == [(0x281, "00 00 00 01 00 00 00")]


def test_a_short_rpdo_is_refused_and_a_long_one_cut(torque_drive):
    drive = torque_drive
    assert drive.ask(0x201, "06 00 00") == [(0x081, "10 82 11 00 00 00 00 00")]
    assert drive.ask(0x080) == [(0x181, "50 02 00 00 00 00 00 00")]
    assert drive.ask(0x201, "06 00 00 00 AA") == [(0x081, "20 82 11 00 00 00 00 00")]
    assert drive.ask(0x080) == [(0x181, "31 02 00 00 00 00 00 00")]
    # both errors go with the next good one
    assert drive.ask(0x201, "06 00 00 00") == [
        (0x081, "00 00 11 00 00 00 00 00"),
        (0x081, "00 00 00 00 00 00 00 00"),
    ]


def test_synchronous_rpdo_acts_with_the_next_sync(torque_drive):
    drive = torque_drive
    drive.write(1, "1400:02", "01")
    drive.ask(0x201, "06 00 00 00")
    assert drive.read(1, "6041:00") == "5002"
    drive.ask(0x080)
    assert drive.read(1, "6041:00") == "3102"


def test_rpdos_are_deaf_before_nmt_start(drive):
    drive.write(1, "1400:01", "01020000")
    drive.ask(0x201, "06 00")
    assert drive.read(1, "6041:00") == "5002"
