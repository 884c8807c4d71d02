# SPDX-License-Identifier: Apache-2.0
"""Object dictionary access and PDO configuration against devices with manners of their own."""

from __future__ import annotations

import pytest
from scripted import ScriptedNode, pdo_objects, unsigned

from screw_module_ros.devices import pdo
from screw_module_ros.devices.errors import NotAnswering, NotConfigured, Refused
from screw_module_ros.devices.sdo import Sdo

WANTED = pdo.Pdo(1, True, 0x185, 1, (pdo.Entry(0x6041, 0, 16), pdo.Entry(0x6064, 0, 32)), 100)


@pytest.fixture
def node(wire):
    objects = pdo_objects(0x1800, 1, 0x40000185, [0x60410010])
    objects |= {(0x1018, 4): unsigned(0xDEADBEEF, 4), (0x6061, 0): b"\xff"}
    return wire.attach(ScriptedNode(wire, 5, objects))


@pytest.fixture
def sdo(wire, node):
    return Sdo(wire.port, 5, "test device", 0.02, lambda: None)


# -- SDO -----------------------------------------------------------------------------------------


def test_upload_and_download_frames_by_hand(wire, sdo):
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF
    assert wire.frames[-1] == (0x605, bytes.fromhex("40 18 10 04 00 00 00 00"))
    assert sdo.signed(0x6061) == -1
    sdo.write(0x6061, 0, -2, 1)
    assert wire.frames[-1] == (0x605, bytes.fromhex("2F 61 60 00 FE 00 00 00"))
    assert sdo.signed(0x6061) == -2


def test_abort_is_told_in_words(sdo):
    with pytest.raises(Refused, match="test device refused object 1234:05.*not exist") as found:
        sdo.read(0x1234, 5)
    assert found.value.code == 0x06020000
    assert found.value.absent


def test_one_lost_answer_is_asked_for_again(wire, node, sdo):
    sdo_of_node = node._sdo
    node._sdo = lambda data: setattr(node, "_sdo", sdo_of_node) if data[0] == 0x40 else None
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF


def test_silence_is_not_answering_after_two_tries(wire, node, sdo):
    node.mute = True
    with pytest.raises(NotAnswering, match="node id 5"):
        sdo.read(0x1018, 4)
    uploads = [data for data in wire.sent(0x605) if data[0] == 0x40]
    assert len(uploads) == 2


@pytest.mark.parametrize("garbage", ["", "43 18 10", "80 18 10 04 00 00 00", "FF" * 8])
def test_garbage_before_the_answer_is_not_believed(wire, node, sdo, garbage):
    answer = node._reply

    def reply(data):
        wire.emit(0x585, garbage)
        node._reply = answer
        answer(data)

    node._reply = reply
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF
    if len(bytes.fromhex(garbage)) != 8:
        assert len(wire.sent(0x605)) == 1  # no answer at all: nothing to ask again for


def test_answer_for_another_object_is_not_believed(wire, node, sdo):
    answer = node._reply
    others = iter([bytes.fromhex("43 00 10 00 01 02 03 04")])
    node._reply = lambda data: answer(next(others, data))
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF


def test_abort_of_another_object_is_not_believed(node, sdo):
    """The late answer to a repeated request, when the next one has been sent."""
    answer = node._reply
    others = iter([bytes.fromhex("80 02 14 01 00 00 02 06")])
    node._reply = lambda data: answer(next(others, data))
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF


def test_abort_without_an_object_is_believed(node, sdo):
    node._reply = lambda data: node.wire.emit(0x585, "80 00 00 00 00 00 04 05")
    with pytest.raises(Refused):
        sdo.unsigned(0x1018, 4)


def test_read_back_of_another_value(node, sdo):
    node.deaf.add((0x6061, 0))
    with pytest.raises(NotConfigured, match=r"wrote 0xA to object 6061:00 but read back 0xFF"):
        sdo.set(0x6061, 0, 10, 1)


def test_constant_is_taken_when_it_is_the_right_one(node, sdo):
    node.refused[0x6061, 0] = 0x06010002  # attempt to write a read-only object
    sdo.set(0x6061, 0, -1, 1)
    with pytest.raises(Refused, match="6061:00"):
        sdo.set(0x6061, 0, 10, 1)


# -- PDO -----------------------------------------------------------------------------------------


def test_order_of_the_writes(node, sdo):
    pdo.configure(sdo, WANTED)
    assert node.writes == [
        (0x1800, 1, 0xC0000185),
        (0x1A00, 0, 0),
        (0x1A00, 1, 0x60410010),
        (0x1A00, 2, 0x60640020),
        (0x1A00, 0, 2),
        (0x1800, 2, 1),
        (0x1800, 5, 100),
        (0x1800, 1, 0x40000185),
    ]


def test_inhibit_time_is_cleared(node, sdo):
    node.objects[0x1800, 3] = b"\x10\x00"
    pdo.configure(sdo, WANTED)
    assert node.objects[0x1800, 3] == b"\0\0"


def test_device_without_timers_is_fine_where_none_is_wanted(node, sdo):
    del node.objects[0x1800, 3], node.objects[0x1800, 5]
    pdo.configure(sdo, WANTED._replace(timer_ms=0))
    with pytest.raises(Refused, match="1800:05"):
        pdo.configure(sdo, WANTED)


def test_fixed_mapping_is_taken_when_it_is_the_right_one(node, sdo):
    node.refused[0x1A00, 0] = 0x06010002
    with pytest.raises(NotConfigured, match="1A00 is fixed and not the one needed"):
        pdo.configure(sdo, WANTED)
    node.objects |= {(0x1A00, 0): b"\x02", (0x1A00, 2): unsigned(0x60640020, 4)}
    pdo.configure(sdo, WANTED)


def test_fixed_type_and_timer_are_taken_when_they_are_the_right_ones(node, sdo):
    node.objects |= {(0x1800, 2): b"\x01", (0x1800, 5): unsigned(100, 2)}
    node.refused |= {(0x1800, 2): 0x06010002, (0x1800, 5): 0x06010002}
    pdo.configure(sdo, WANTED)
    with pytest.raises(Refused, match="1800:02"):
        pdo.configure(sdo, WANTED._replace(kind=2))


@pytest.mark.parametrize("shown", [0xC0000185, 0x60000185, 0x40000186])
def test_identifier_that_reads_back_otherwise(node, sdo, shown):
    def stubborn(key, data):
        if key == (0x1800, 1) and not data[3] & 0x80:
            node.objects[key] = unsigned(shown, 4)

    node.written = stubborn
    with pytest.raises(NotConfigured, match="should be enabled with identifier 0x185"):
        pdo.configure(sdo, WANTED)


def test_bits_beyond_the_identifier_are_the_devices_own(node, sdo):
    def stubborn(key, data):
        if key == (0x1800, 1) and not data[3] & 0x80:
            node.objects[key] = unsigned(0x00000185, 4)  # bit 30 dropped

    node.written = stubborn
    pdo.configure(sdo, WANTED)
    assert node.objects[0x1800, 1] == unsigned(0x00000185, 4)


def test_unused_pdos_are_disabled_wherever_they_are(node, sdo):
    node.objects |= pdo_objects(0x1400, 2, 0x305, [0x60400010])
    node.objects |= pdo_objects(0x1800, 4, 0x485, [0x60410010])
    pdo.disable_unused(sdo, (WANTED,))
    assert node.writes == [(0x1401, 1, 0x80000305), (0x1803, 1, 0x80000485)]


def test_pdo_that_cannot_be_disabled(node, sdo):
    node.deaf.add((0x1800, 1))
    with pytest.raises(NotConfigured, match="cannot be disabled"):
        pdo.configure(sdo, WANTED)
