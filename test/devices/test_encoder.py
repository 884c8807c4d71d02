# SPDX-License-Identifier: Apache-2.0
"""The encoder driver against a scripted CiA 406 device: raw frames in, samples out."""

from __future__ import annotations

import math

import pytest
from running_drivers import tick

from screw_module_ros.devices.encoder import Encoder, EncoderSettings
from screw_module_ros.devices.errors import (
    BusError,
    NotAnswering,
    NotConfigured,
    NotNow,
    Occupied,
    WrongDevice,
)

SETTINGS = EncoderSettings(listen=0.0, sdo_timeout=0.02)
COUNT = 0.01905 / 20000


@pytest.fixture
def encoder(wire, encoder_end):
    driver = Encoder(wire.port, SETTINGS)
    driver.configure()
    driver.start()
    return driver


# -- frames by hand ------------------------------------------------------------------------------


def test_request_is_sync_and_the_answer_is_little_endian(wire, encoder, encoder_end):
    encoder_end.answering = False
    encoder.request(41, wire.now_ns, 99)
    assert wire.frames[-1] == (0x080, b"")
    wire.emit(0x182, "20 4E 00 00")  # 20 000 counts: one turn of the screw
    wire.port.pump()
    sample = encoder.reading()
    assert sample.sequence == 41
    assert (sample.monotonic_ns, sample.stamp_ns) == (wire.now_ns, 99)
    assert sample.count == 20000
    assert sample.position == pytest.approx(0.01905)
    assert sample.homed is False
    assert encoder.reading() is None


def test_nmt_goes_to_this_node_only(wire, encoder):
    assert wire.sent(0x000) == [bytes([0x80, 0x02]), bytes([0x01, 0x02])]


def test_stop_ends_in_pre_operational_and_silence(wire, encoder):
    encoder.stop()
    assert wire.frames[-1] == (0x000, bytes([0x80, 0x02]))
    assert tick(wire, encoder) is None
    assert wire.frames[-1][0] == 0x000


# -- configuration -------------------------------------------------------------------------------


def test_configuration_order(wire, encoder, encoder_end):
    assert encoder_end.writes == [
        (0x6000, 0, 0x0004),
        (0x6001, 0, 20000),
        (0x1801, 1, 0xC0000282),  # the unused PDO
        (0x1800, 1, 0xC0000182),  # disable
        (0x1A00, 0, 0),
        (0x1A00, 1, 0x60040020),
        (0x1A00, 0, 1),
        (0x1800, 2, 1),
        (0x1800, 1, 0x40000182),  # enable; bit 30 is the device's own
    ]


def test_what_is_right_already_is_not_written_again(wire, encoder, encoder_end):
    encoder_end.writes.clear()
    encoder.configure()
    assert not [w for w in encoder_end.writes if 0x6000 <= w[0] <= 0x6002]


def test_silent_device_is_named(wire, encoder_end):
    encoder_end.mute = True
    with pytest.raises(NotAnswering, match=r"node id 2.*does not answer.*check its power"):
        Encoder(wire.port, SETTINGS).configure()


def test_a_drive_in_the_encoders_place_is_refused(wire, encoder_end):
    encoder_end.objects[0x1000, 0] = bytes.fromhex("92 01 02 00")
    with pytest.raises(WrongDevice, match="CiA 402"):
        Encoder(wire.port, SETTINGS).configure()


@pytest.mark.parametrize(("field", "value"), [("vendor_id", 0x1235), ("product_code", 0x78)])
def test_another_vendor_or_product_is_refused(wire, encoder_end, field, value):
    with pytest.raises(WrongDevice, match=field):
        Encoder(wire.port, SETTINGS._replace(**{field: value})).configure()


def test_value_that_reads_back_otherwise_is_refused(wire, encoder_end):
    encoder_end.deaf.add((0x1800, 2))
    with pytest.raises(NotConfigured, match="1800:02"):
        Encoder(wire.port, SETTINGS).configure()


@pytest.mark.parametrize("counts", [1, 19999])
def test_range_of_less_than_a_turn_is_refused(wire, encoder_end, counts):
    encoder_end.objects[0x6002, 0] = counts.to_bytes(4, "little")
    driver = Encoder(wire.port, SETTINGS)
    with pytest.raises(NotConfigured, match=f"wraps after {counts} counts"):
        driver.configure()
    assert not driver.configured


def test_restart_during_configuration_is_noticed(wire, encoder_end):
    driver = Encoder(wire.port, SETTINGS)
    encoder_end.written = lambda key, data: encoder_end.boot_up() if key == (0x1A00, 1) else None
    with pytest.raises(NotConfigured, match="restarted"):
        driver.configure()


def test_second_sync_producer_is_refused_before_anything_is_sent(wire, encoder_end):
    wire.emit(0x080, "")
    with pytest.raises(Occupied, match="SYNC"):
        Encoder(wire.port, SETTINGS._replace(listen=0.05)).configure()
    assert wire.frames == []


def test_encoder_without_scaling_must_count_as_the_settings_say(wire, encoder_end):
    encoder_end.deaf.add((0x6000, 0))
    with pytest.raises(NotConfigured, match="8192 per turn"):
        Encoder(wire.port, SETTINGS).configure()
    driver = Encoder(wire.port, SETTINGS._replace(counts_per_turn=8192))
    driver.configure()
    driver.start()
    encoder_end.position = 8192 * 4096 - 1
    assert tick(wire, driver).count == -1


def test_direction_in_the_device_and_ours(wire, encoder_end):
    driver = Encoder(wire.port, SETTINGS._replace(code_sequence=1, direction=-1))
    driver.configure()
    driver.start()
    assert encoder_end.objects[0x6000, 0] == b"\x05\x00"
    encoder_end.position = 20000
    assert tick(wire, driver).position == pytest.approx(-0.01905)


@pytest.mark.parametrize(
    ("field", "value"),
    [("node_id", 0), ("node_id", 128), ("direction", 0), ("lead", math.nan), ("rate", 0.0)],
)
def test_settings_out_of_range_name_the_field(wire, field, value):
    with pytest.raises(ValueError, match=field):
        Encoder(wire.port, SETTINGS._replace(**{field: value}))


# -- rollover ------------------------------------------------------------------------------------


def test_first_sample_is_signed_and_the_wrap_is_at_6002(wire, encoder, encoder_end):
    counts = []
    for position in (0x00FFFFFE, 0x00FFFFFF, 0x00000000, 0x00000005, 0x00FFFFFF):
        encoder_end.position = position
        counts.append(tick(wire, encoder).count)
    assert counts == [-2, -1, 0, 5, -1]


def test_position_beyond_the_measuring_range_is_dropped(wire, encoder, encoder_end):
    encoder_end.position = 0x01000000
    assert tick(wire, encoder) is None
    assert encoder.counters["out_of_range"] == 1


def test_whole_range_wraps_at_2_32(wire, encoder_end):
    encoder_end.objects[0x6002, 0] = bytes(4)
    driver = Encoder(wire.port, SETTINGS)
    driver.configure()
    driver.start()
    encoder_end.position = 0xFFFFFFFF
    assert tick(wire, driver).count == -1


@pytest.mark.parametrize(
    ("wrap", "silent_ms", "homed"),
    [
        (20_000, 4, True),  # one turn of the screw: at 2 m/s half of it takes 4.8 ms
        (20_000, 5, False),
        (0x01000000, 60_000, True),  # longer than any travel: no turn can be lost
        (0, 60_000, True),
    ],
)
def test_a_silence_in_which_the_position_may_have_wrapped_loses_the_home(
    wire, encoder_end, wrap, silent_ms, homed
):
    """Of an encoder that wraps after a turn: how many turns went by unseen cannot be told."""
    encoder_end.objects[0x6002, 0] = wrap.to_bytes(4, "little")
    driver = Encoder(wire.port, SETTINGS)
    driver.configure()
    driver.start()
    tick(wire, driver)
    driver.home()
    wire.advance(silent_ms - 1)
    encoder_end.position = 9_900
    sample = tick(wire, driver, 2)
    assert (sample.homed, driver.homed) == (homed, homed)
    assert tick(wire, driver, 3).homed == homed


# -- velocity ------------------------------------------------------------------------------------


def test_velocity_settles_at_the_true_one_across_lost_samples(wire, encoder, encoder_end):
    sample = None
    for n in range(200):
        encoder_end.position = 105 * n  # 0.1 m/s at 1 kHz
        encoder_end.answering = n % 50 != 49
        sample = tick(wire, encoder, n) or sample
    assert sample.velocity == pytest.approx(105e3 * COUNT, rel=1e-3)


# -- homing --------------------------------------------------------------------------------------


def test_homing_stores_the_reference_height_and_boot_up_undoes_it(wire, encoder, encoder_end):
    encoder.settings = SETTINGS._replace(home_position=0.1)
    encoder_end.position = 5000
    tick(wire, encoder)
    assert encoder.home() == pytest.approx(0.1)
    encoder_end.position = 5000 + 20000
    sample = tick(wire, encoder)
    assert sample.homed
    assert sample.position == pytest.approx(0.1 + 0.01905)
    encoder_end.boot_up()
    wire.port.pump()
    assert encoder.homed is False
    assert "boot-up" in encoder.fault


def test_homing_refuses_without_a_sample_and_in_motion(wire, encoder, encoder_end):
    with pytest.raises(NotNow, match="no sample"):
        encoder.home()
    for n in range(50):
        encoder_end.position = 105 * n
        tick(wire, encoder, n)
    with pytest.raises(NotNow, match="moves"):
        encoder.home()


@pytest.fixture
def homed(wire, encoder, encoder_end):
    """Homed at 0.1 m, and 57 mm from there since."""
    encoder.settings = SETTINGS._replace(home_position=0.1)
    encoder_end.position = 5000
    tick(wire, encoder)
    encoder.home()
    encoder_end.position += round(0.057 / COUNT)
    for n in range(200):
        tick(wire, encoder, n)
    return encoder


def test_homing_elsewhere_must_be_asked_for_twice(wire, homed):
    with pytest.raises(NotNow, match=r"57\.0 mm against the last homing.*again"):
        homed.home()
    sample = tick(wire, homed, 300)
    assert sample.position == pytest.approx(0.157, abs=1e-6), "nothing moved"
    assert not sample.homed, "one of the two homings is wrong"
    wire.advance(3000)
    tick(wire, homed, 301)
    assert homed.home() == pytest.approx(0.1)
    assert tick(wire, homed, 302).position == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("pause_ms", [20, 900, 16_000])
def test_who_asks_again_at_once_or_much_later_has_not_consented(wire, homed, pause_ms):
    for n in range(20):
        with pytest.raises(NotNow, match="against the last homing"):
            homed.home()
        wire.advance(pause_ms)
        tick(wire, homed, 300 + n)


def test_homing_at_the_same_mark_and_after_a_boot_up_is_asked_for_once(wire, homed, encoder_end):
    encoder_end.position = 5000 + round(0.004 / COUNT)
    for n in range(200):
        tick(wire, homed, 300 + n)
    homed.home()
    encoder_end.boot_up()
    wire.port.pump()
    homed.clear_fault()
    encoder_end.position = 0
    tick(wire, homed, 600)
    homed.home()
    assert homed.homed


@pytest.mark.parametrize(("rate", "longest_ms"), [(1000.0, 100.0), (50.0, 200.0)])
def test_homing_refuses_an_old_position(wire, encoder_end, rate, longest_ms):
    driver = Encoder(wire.port, SETTINGS._replace(rate=rate))
    driver.configure()
    driver.start()
    tick(wire, driver)
    wire.advance(longest_ms + 1.0)
    with pytest.raises(NotNow, match="s old, the encoder does not answer"):
        driver.home()
    assert driver.homed is False
    tick(wire, driver, 2)
    wire.advance(longest_ms - 1.0)
    driver.home()
    assert driver.homed


# -- what goes wrong -----------------------------------------------------------------------------


@pytest.mark.parametrize("payload", ["", "01 02 03", "01 02 03 04 05", "00" * 8])
def test_wrong_length_is_counted_and_never_delivered(wire, encoder, encoder_end, payload):
    encoder_end.answering = False
    encoder.request(1, wire.advance(), 0)
    wire.emit(0x182, payload)
    wire.port.pump()
    assert encoder.reading() is None
    assert encoder.counters["wrong_length"] == 1
    encoder_end.answering = True
    assert tick(wire, encoder, 2).sequence == 2


def test_duplicate_is_counted_as_unexpected(wire, encoder, encoder_end):
    encoder.request(1, wire.advance(), 0)
    wire.emit(0x182, "07 00 00 00")
    wire.port.pump()
    assert encoder.reading().count == 0
    assert encoder.counters["unexpected"] == 1


def test_late_answer_is_never_taken_for_a_new_one(wire, encoder, encoder_end):
    encoder_end.hold()
    encoder_end.position = 10
    assert tick(wire, encoder, 1) is None
    encoder_end.position = 20
    encoder.request(2, wire.advance(), 0)
    encoder_end.release(2)
    wire.port.pump()
    sample = encoder.reading()
    assert (sample.sequence, sample.count) == (2, 20)
    assert (encoder.counters["missing"], encoder.counters["late"]) == (1, 1)


def test_answer_read_only_after_its_tick_is_laid_to_no_other(wire, encoder, encoder_end):
    encoder_end.position = 10
    encoder.request(1, wire.advance(), 0)  # answered at once, but nobody pumps
    encoder_end.position = 20
    sample = tick(wire, encoder, 2)
    assert (sample.sequence, sample.count) == (2, 20)
    assert (encoder.counters["missing"], encoder.counters["late"]) == (1, 1)


def test_emergency_is_latched_by_name(wire, encoder, encoder_end):
    wire.emit(0x082, "20 73 20 00 00 00 00 00")  # 7320
    wire.port.pump()
    assert "position" in encoder.fault
    assert tick(wire, encoder) is None
    encoder.clear_fault()
    assert encoder.fault == ""
    assert tick(wire, encoder) is not None


def test_boot_up_needs_a_new_configuration_on_request(wire, encoder, encoder_end):
    encoder_end.boot_up()
    encoder_end.objects[0x1800, 1] = bytes.fromhex("82 01 00 C0")
    wire.port.pump()
    writes = len(encoder_end.writes)
    assert tick(wire, encoder) is None
    assert len(encoder_end.writes) == writes  # nothing silently
    encoder.clear_fault()
    assert encoder.fault == ""
    assert encoder_end.objects[0x1800, 1] == bytes.fromhex("82 01 00 40")
    assert tick(wire, encoder) is not None


def test_somebody_elses_sync_is_a_fault(wire, encoder):
    wire.emit(0x080, "")
    wire.port.pump()
    tick(wire, encoder)
    assert "SYNC" in encoder.fault


def test_alarms_and_warnings_are_polled_by_name(wire, encoder, encoder_end):
    encoder_end.objects[0x6505, 0] = b"\x11\x00"
    encoder.poll_slow()
    assert encoder.warnings == ["frequency exceeded", "battery charge too low"]
    assert encoder.fault == ""
    encoder_end.objects[0x6503, 0] = b"\x01\x10"
    encoder.poll_slow()
    assert encoder.fault == "encoder alarm: position error, bit 12"


def test_an_alarm_that_persists_is_not_cleared(wire, encoder, encoder_end):
    """Its EMCY was sent once: who clears it must ask whether it has ended."""
    encoder_end.objects[0x6503, 0] = b"\x01\x00"
    encoder.poll_slow()
    encoder.clear_fault()
    assert encoder.fault == "encoder alarm: position error"
    encoder_end.objects[0x6503, 0] = b"\x00\x00"
    encoder.clear_fault()
    assert encoder.fault == ""


def test_encoder_without_alarm_objects_is_asked_once(wire, encoder, encoder_end):
    del encoder_end.objects[0x6503, 0]
    encoder.poll_slow()
    asked = len(wire.sent(0x602))
    encoder.poll_slow()
    assert len(wire.sent(0x602)) == asked + 2
    assert encoder.fault == ""


def test_slow_poll_of_a_silent_device_is_counted(wire, encoder, encoder_end):
    encoder_end.mute = True
    encoder.poll_slow()
    assert encoder.counters["slow_polls_failed"] == 1


def test_bus_that_fails_is_counted_and_raised(wire, encoder):
    wire.bus.shutdown()
    with pytest.raises(BusError):
        encoder.request(1, wire.advance(), 0)
    assert encoder.counters["bus_errors"] == 1


def test_start_before_configuration_is_refused(wire):
    with pytest.raises(NotConfigured, match="not configured"):
        Encoder(wire.port, SETTINGS).start()


# -- somebody else's SYNC ------------------------------------------------------------------------


def test_on_a_shared_bus_the_sync_seen_is_the_request(wire, encoder_end):
    wire.port.sync_producer = False
    driver = Encoder(wire.port, SETTINGS)
    driver.configure()
    driver.start()
    driver.request(0, wire.now_ns, wire.now_ns + 500)
    assert wire.frames[-1][0] == 0x000  # no SYNC of ours
    wire.now_ns = 2_000_000_300
    wire.emit(0x080, "")
    wire.emit(0x182, "2A 00 00 00")
    wire.port.pump()
    sample = driver.reading()
    assert sample.sequence == 2000
    assert sample.stamp_ns - sample.monotonic_ns == 500
    assert sample.count == 42
