# SPDX-License-Identifier: Apache-2.0
"""One bus, one reader: what comes in, what goes out, what must not count."""

from __future__ import annotations

import socket
import threading

import can
import pytest
from can.interfaces.udp_multicast.utils import pack_message
from scripted_devices import ScriptedEncoder

from screw_module_ros.can_io import echo
from screw_module_ros.can_io.bus import BusSettings, open_bus, open_port
from screw_module_ros.can_io.port import MAX_FRAMES_PER_PUMP, Port
from screw_module_ros.devices.encoder import Encoder, EncoderSettings
from screw_module_ros.devices.errors import BusError

GROUP = "239.74.163.2"


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


def test_pump_does_not_wait_when_told_not_to(wire):
    assert wire.port.pump() == 0


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


def test_full_buffer_is_a_bus_error_with_the_way_out(wire, monkeypatch):
    def refuse(message, timeout=None):
        raise can.CanOperationError("Transmit buffer full")

    monkeypatch.setattr(wire.bus, "send", refuse)
    with pytest.raises(BusError, match="Transmit buffer full; check cable"):
        wire.port.send(0x201, b"")


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
        (BusSettings(channel="10.0.0.1"), "multicast group such as"),
        (BusSettings(channel="not an address"), "not an address:43113"),
    ],
)
def test_bus_that_cannot_be_opened_is_named_with_the_way_out(settings, text):
    with pytest.raises(BusError, match=text):
        open_bus(settings)


def test_a_port_that_another_programs_socket_has_is_told(can_port_base):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", can_port_base))
        with pytest.raises(BusError, match="another program's socket has this UDP port"):
            open_bus(BusSettings(port=can_port_base))


@pytest.mark.parametrize(
    ("field", "value"), [("port", 0), ("port", 65536), ("bitrate", 123456)]
)
def test_settings_out_of_range(field, value):
    with pytest.raises(ValueError, match=field):
        open_bus(BusSettings(**{field: value}))


def test_virtual_bus_opens():
    port = open_port(BusSettings(interface="virtual", channel="opens", sync_producer=False))
    assert port.name == "virtual opens"
    assert port.sync_producer is False
    assert port.fileno() == -1
    port.close()


# -- udp_multicast -------------------------------------------------------------------------------


@pytest.fixture(params=["kernel drops echoes", "port drops echoes"])
def udp(can_port_base, request, monkeypatch):
    """Our port and a stranger's bus on one multicast group."""
    in_kernel = request.param.startswith("kernel")
    if not in_kernel:
        monkeypatch.setattr(echo, "_works", lambda stamp: False)
    settings = BusSettings(port=can_port_base)
    port, far = open_port(settings), open_bus(settings)
    if port._echo.in_kernel != in_kernel:
        pytest.skip("this kernel has no socket filters")
    yield port, far
    port.close()
    far.shutdown()


def test_frames_stay_on_the_machine_and_the_buffer_is_large(udp):
    port, _ = udp
    with socket.socket(fileno=socket.dup(port.fileno())) as duplicate:
        assert duplicate.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        assert duplicate.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) > 200_000


def test_own_echoes_do_not_count(udp, wait_until):
    port, far = udp
    seen = []
    port.subscribe(0x120, lambda data, arrival: seen.append(bytes(data)))
    port.send(0x120, b"")
    assert far.recv(1.0).arbitration_id == 0x120
    far.send(can.Message(arbitration_id=0x120, data=b"reply", is_extended_id=False))
    wait_until(lambda: pumped(port) and seen, what="the reply")
    assert seen == [b"reply"]
    assert port.counters["echoes"] == (not port._echo.in_kernel)


def test_reply_that_equals_its_request_is_no_echo(udp, wait_until):
    """Even when the device returns the very frame it got, tag and all."""
    port, far = udp
    seen = []
    port.subscribe(0x126, lambda data, arrival: seen.append(bytes(data)))
    port.send(0x126, b"\x03")
    far.send(far.recv(1.0))
    wait_until(lambda: pumped(port) and seen, what="the reply")
    assert seen == [b"\x03"]


def test_strangers_sync_is_told_from_our_own(udp, wait_until):
    port, far = udp
    port.send_sync(0)
    far.send(can.Message(arbitration_id=0x080, is_extended_id=False))
    wait_until(lambda: pumped(port) and port.counters["foreign_sync"], what="the foreign SYNC")
    assert port.counters["foreign_sync"] == 1


def test_datagrams_that_are_no_frames_are_counted(udp, can_port_base, wait_until):
    port, far = udp
    seen = []
    port.subscribe(0x181, lambda data, arrival: seen.append(bytes(data)))
    good = pack_message(can.Message(arbitration_id=0x181, data=b"ok", is_extended_id=False))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for datagram in (b"", b"nonsense", good[:-3], b"\x81\xa1x\x01", good):
            stranger.sendto(datagram, (GROUP, can_port_base))
        wait_until(lambda: pumped(port) and seen, what="the good frame")
    assert seen == [b"ok"]
    assert port.counters["malformed"] >= 1  # the filter keeps the short ones out


def test_groups_on_one_udp_port_are_kept_apart(udp, can_port_base, wait_until):
    port, far = udp
    seen = []
    port.subscribe(0x181, lambda data, arrival: seen.append(bytes(data)))
    other = open_bus(BusSettings(channel="239.74.163.3", port=can_port_base))
    other.send(can.Message(arbitration_id=0x181, data=b"other", is_extended_id=False))
    far.send(can.Message(arbitration_id=0x181, data=b"ours", is_extended_id=False))
    wait_until(lambda: pumped(port) and seen, what="our frame")
    other.shutdown()
    assert seen == [b"ours"]


def test_buses_with_other_interfaces_are_sent_to_one_thread_at_a_time(wire):
    """Only three interfaces of python-can are known to take sends from several threads."""

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


def test_scripted_encoder_also_answers_over_a_second_wire(wire):
    """The scripted end is no mock of the driver: it answers raw frames of anybody."""
    end = wire.attach(ScriptedEncoder(wire))
    end.operational = True
    wire.port.send(0x080, b"")
    wire.port.pump()
    assert wire.port.counters["unclaimed"] == 1


def test_a_loop_that_wants_to_read_comes_first(wire, heard):
    """Else whoever waits for an SDO answer takes the lock again and again and the loop starves."""
    port = wire.port
    wire.emit(0x123, "01")
    port._loop_waits = True  # as while it stands at the lock
    assert not port.wait_for(lambda: heard, 0.02), "left to the loop"
    port.pump()
    assert heard and not port._loop_waits
