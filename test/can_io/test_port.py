# SPDX-License-Identifier: Apache-2.0
"""One bus, one reader: what comes in, what goes out, what must not count."""

from __future__ import annotations

import threading

import can
import pytest

from screw_module_ros.can_io import bus
from screw_module_ros.can_io.bus import BusSettings, open_bus, open_port
from screw_module_ros.can_io.frames import (
    ERROR,
    EXTENDED,
    FD,
    OWN,
    REMOTE,
    STANDARD_ID,
    frames_of,
    word_of,
)
from screw_module_ros.can_io.port import MAX_FRAMES_PER_PUMP, Port
from screw_module_ros.clock import ManualClock
from screw_module_ros.devices.encoder import Encoder, EncoderSettings
from screw_module_ros.devices.errors import BusError


def pumped(port) -> int:
    """Wait 10 ms for frames; return how many came."""
    return port.pump(port.clock.now_ns() + 10_000_000)


@pytest.fixture
def heard(wire):
    frames = []
    wire.port.subscribe(0x123, lambda data, arrival: frames.append((bytes(data), arrival)))
    return frames


# -- dispatch ------------------------------------------------------------------------------------


def test_frames_go_to_their_subscribers_with_the_arrival(wire, heard):
    wire.emit(0x123, "DE AD")
    wire.emit(0x124, "BE EF")
    assert wire.port.pump() == 2
    assert heard == [(b"\xde\xad", wire.now_ns)]
    assert wire.port.counters["unclaimed"] == 1


def test_two_subscribers_of_one_identifier_and_leaving(wire, heard):
    again = []

    def other(data, arrival):
        again.append(bytes(data))

    wire.port.subscribe(0x123, other)
    wire.emit(0x123, "01")
    wire.port.pump()
    wire.port.unsubscribe(0x123, other)
    wire.emit(0x123, "02")
    wire.port.pump()
    assert again == [b"\x01"]
    assert [data for data, _ in heard] == [b"\x01", b"\x02"]


def test_babbling_device_cannot_hold_the_loop(wire, heard):
    for _ in range(MAX_FRAMES_PER_PUMP + 10):
        wire.emit(0x123, "")
    assert wire.port.pump() == MAX_FRAMES_PER_PUMP
    assert wire.port.pump() == 10


@pytest.mark.parametrize("kind", ["is_extended_id", "is_remote_frame", "is_fd"])
def test_extended_remote_and_fd_frames_are_ignored(wire, heard, kind):
    options = {"is_extended_id": False, kind: True}
    wire.emit_message(can.Message(arbitration_id=0x123, **options))
    wire.port.pump()
    assert heard == []
    assert wire.port.counters["ignored"] == 1


def test_error_frames_are_counted_and_bus_off_is_known(wire):
    for flags, bus_off in ((0x004, False), (0x040, True), (0x100, False)):
        wire.emit_message(
            can.Message(arbitration_id=flags, is_error_frame=True, is_extended_id=False, dlc=8)
        )
        wire.port.pump()
        assert wire.port.bus_off is bus_off
    assert wire.port.counters["error_frames"] == 3


def test_foreign_sync_is_counted_where_we_produce_it(wire):
    wire.emit(0x080, "")
    wire.port.pump()
    assert wire.port.counters["foreign_sync"] == 1
    wire.port.sync_producer = False
    seen = []
    wire.port.subscribe(0x080, lambda data, arrival: seen.append(arrival))
    wire.emit(0x080, "")
    wire.port.pump()
    assert seen == [wire.now_ns]
    assert wire.port.counters["foreign_sync"] == 1


@pytest.mark.parametrize(("interface", "is_heard"), [("socketcan", True), ("gs_usb", False)])
def test_another_program_of_this_computer_is_a_master_too(wire, monkeypatch, interface, is_heard):
    """SocketCAN marks its frames as not received; elsewhere these are our own, come back."""
    monkeypatch.setattr(bus, "_opened", lambda settings, clock, hub: wire.bus)
    port = open_port(BusSettings(interface=interface))
    frames: list[bytes] = []
    port.subscribe(0x201, lambda data, arrival: frames.append(bytes(data)))
    sent = can.Message(arbitration_id=0x201, data=b"\x0f\0\0\0", is_extended_id=False, is_rx=False)
    waiting = [sent]
    monkeypatch.setattr(wire.bus, "recv", lambda timeout: waiting.pop() if waiting else None)
    port.pump()
    assert frames == ([b"\x0f\0\0\0"] if is_heard else [])


def test_own_sync_reaches_the_devices_of_the_port(wire):
    seen = []
    wire.port.subscribe(0x080, lambda data, arrival: seen.append(arrival))
    wire.port.send_sync(77)
    assert seen == [77]
    assert wire.frames == [(0x080, b"")]


def test_waiting_gives_up(wire):
    assert wire.port.wait_for(lambda: False, 0.003) is False


# -- a bus that fails ----------------------------------------------------------------------------


def test_closed_bus_raises_on_both_ways(wire):
    wire.bus.shutdown()
    with pytest.raises(BusError, match="cannot send on Virtual bus channel"):
        wire.port.send(0x201, b"")
    with pytest.raises(BusError, match="cannot receive on Virtual bus channel"):
        wire.port.pump()
    with pytest.raises(BusError, match="cannot receive"):
        wire.port.wait_for(lambda: False, 1.0)
    assert wire.port.counters["send_errors"] == 1
    assert wire.port.counters["receive_errors"] == 2


# -- SDO while a loop pumps ----------------------------------------------------------------------


def test_slow_polls_get_their_answers_through_the_loop(wire, encoder_end):
    # The loop moves the time as fast as it can, whenever the other thread has its turn.
    encoder = Encoder(wire.port, EncoderSettings(listen=0.0, sdo_timeout=10.0))
    encoder.configure()
    encoder.start()
    done = threading.Event()
    pumped_by = set()
    inner = wire.port._pump

    def note(timeout_s):
        pumped_by.add(threading.current_thread().name)
        return inner(timeout_s)

    wire.port._pump = note

    def loop():
        tick = 0
        while not done.is_set():
            tick += 1
            encoder.request(tick, wire.advance(0.01), 0)
            wire.port.pump(wire.port.clock.now_ns() + 1)

    looping = threading.Thread(target=loop, name="loop")
    looping.start()
    encoder_end.objects[0x6505, 0] = b"\x02\x00"
    for _ in range(10):
        encoder.poll_slow()
    done.set()
    looping.join()
    assert encoder.warnings == ["light control reserve reached"]
    assert encoder.counters["slow_polls_failed"] == 0
    assert "loop" in pumped_by


# -- opening -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (BusSettings(interface="socketcan", channel="can77"), "ip link set can77 up type can"),
        (BusSettings(interface="nonsense"), "nonsense"),
        (BusSettings("udp_multicast", "10.0.0.1"), "multicast group such as.* can.interface: rig"),
        (BusSettings("udp_multicast", "not an address"), "not an address:43113"),
        (BusSettings(channel="239.74.163.2"), "no bus of sim_rig, which have names such as"),
        (BusSettings(port=43114), r"have names \(can.channel\): remove can.port"),
    ],
)
def test_bus_that_cannot_be_opened_is_named_with_the_way_out(settings, text):
    with pytest.raises(BusError, match=text):
        open_bus(settings)


@pytest.mark.parametrize(
    ("field", "value"), [("port", 0), ("port", 65536), ("bitrate", 123456)]
)
def test_settings_out_of_range(field, value):
    with pytest.raises(ValueError, match=field):
        open_bus(BusSettings(**{field: value}))


@pytest.mark.parametrize("interface", ["udp_multicast", "socketcan", "pcan"])
def test_simulated_time_is_refused_with_any_bus_that_is_not_simulated(interface):
    """Old parameter files name udp_multicast: the sentence says what to write now."""
    told = f"{interface} x.* works by wall clock only.*can.interface to rig and can.channel to"
    for opened in (open_port, open_bus):
        with pytest.raises(BusError, match=told):
            opened(BusSettings(interface=interface, channel="x"), ManualClock())


def test_a_bus_is_sent_to_by_one_thread_at_a_time(wire):
    """Not every interface of python-can takes sends from several threads."""

    class Foreign(can.BusABC):
        def __init__(self):
            super().__init__("foreign")
            self.inside = 0
            self.most = 0

        def send(self, msg, timeout=None):
            self.inside += 1
            self.most = max(self.most, self.inside)
            threading.Event().wait(0.001)
            self.inside -= 1

    bus = Foreign()
    port = Port(bus)
    threads = [threading.Thread(target=port.send, args=(1, b"")) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    bus.shutdown()
    assert bus.most == 1
    assert port.counters["sent"] == 5


def test_a_loop_that_wants_to_read_comes_first(wire, heard):
    """Else whoever waits for an SDO answer takes the lock again and again and the loop starves."""
    port = wire.port
    wire.emit(0x123, "01")
    port._loop_waits = True  # as while it stands at the lock
    assert not port.wait_for(lambda: heard, 0.02), "left to the loop"
    port.pump()
    assert heard and not port._loop_waits


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        ({}, 0x123),
        ({"is_extended_id": True}, 0x123 | EXTENDED),
        ({"is_remote_frame": True}, 0x123 | REMOTE),
        ({"is_error_frame": True}, 0x123 | ERROR),
        ({"is_fd": True}, 0x123 | FD),
        ({"is_rx": False}, 0x123 | OWN),
    ],
)
def test_only_a_plain_frame_of_another_node_has_no_flag(flags, word):
    message = can.Message(**{"arbitration_id": 0x123, "is_extended_id": False, **flags})
    assert word_of(message) == word
    assert (word > STANDARD_ID) == bool(flags)


def test_a_bus_of_messages_sends_and_receives_frames():
    with can.Bus(interface="virtual", channel="frames") as near, \
            can.Bus(interface="virtual", channel="frames") as far:  # fmt: skip
        frames_of(near).send_frame(0x7FF, b"\x01\x02")
        assert frames_of(far).receive_frame(0.0) == (0x7FF, b"\x01\x02")
        assert frames_of(far).receive_frame(0.0) is None


# -- a bus that fails ------------------------------------------------------------------------------


def test_a_failed_bus_is_opened_anew_on_request():
    """As an adapter that was unplugged and is back: what was opened before stays dead."""
    port = open_port(BusSettings("virtual", "unplugged"))
    frames = []
    port.subscribe(0x123, lambda data, arrival: frames.append(bytes(data)))
    port.bus.shutdown()
    for use in (lambda: port.send(0x1, b""), port.pump):
        with pytest.raises(BusError, match="cannot (send|receive) on virtual unplugged.*adapter"):
            use()
    assert port.failed
    port.restore()
    assert not port.failed
    with can.Bus(interface="virtual", channel="unplugged") as far:
        port.send(0x1, b"\x07")
        assert bytes(far.recv(1.0).data) == b"\x07"
        far.send(can.Message(arbitration_id=0x123, data=b"\x08", is_extended_id=False))
        assert pumped(port) == 1 and frames == [b"\x08"]
    port.close()


def test_a_bus_that_works_is_left_alone():
    port = open_port(BusSettings("virtual", "healthy"))
    bus = port.bus
    port.restore()
    assert port.bus is bus
    port.close()


def test_a_bus_that_cannot_be_opened_yet_is_tried_again(wire):
    adapters = [BusError("no such device"), can.Bus(interface="virtual", channel="again")]

    def plugged_in():
        found = adapters.pop(0)
        if isinstance(found, BusError):
            raise found
        return found

    port = Port(can.Bus(interface="virtual", channel="again"), open_anew=plugged_in)
    port.bus.shutdown()
    with pytest.raises(BusError, match="cannot send"):
        port.send(0x1, b"")
    with pytest.raises(BusError, match="no such device"):
        port.restore()
    for use in (lambda: port.send(0x1, b""), port.pump):
        with pytest.raises(BusError, match="it has failed and is not open"):
            use()
    port.restore()
    port.send(0x1, b"")
    port.close()
