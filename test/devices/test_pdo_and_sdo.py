# SPDX-License-Identifier: Apache-2.0
"""Object dictionary access and PDO configuration against devices with manners of their own."""

from __future__ import annotations

import pytest
from scripted import ScriptedNode, pdo_objects, unsigned

from screw_module_ros.devices import pdo
from screw_module_ros.devices.errors import NotAnswering, NotConfigured, Refused
from screw_module_ros.devices.sdo import Sdo

WANTED = pdo.Pdo(1, True, 0x185, 1, (pdo.Entry(0x6041, 0, 16), pdo.Entry(0x6064, 0, 32)), 100)
READ_ONLY = 0x06010002
RIGHT_MAPPING = {(0x1A00, 0): b"\x02", (0x1A00, 2): unsigned(0x60640020, 4)}
RIGHT_TYPE_AND_TIMER = {(0x1800, 2): b"\x01", (0x1800, 5): unsigned(100, 2)}


class Stubborn(ScriptedNode):
    """A node that puts other answers before its own, and shows what it likes as an identifier."""

    first: tuple[str, ...] = ()
    shown: int | None = None
    loses = 0  # answers

    def _reply(self, data: bytes) -> None:
        for frame in self.first:
            self.wire.emit(0x585, frame)
        self.first = ()
        if self.loses:
            self.loses -= 1
        else:
            super()._reply(data)

    def written(self, key: tuple[int, int], data: bytes) -> None:
        if key == (0x1800, 1) and not data[3] & 0x80 and self.shown is not None:
            self.objects[key] = unsigned(self.shown, 4)


@pytest.fixture
def node(wire):
    objects = pdo_objects(0x1800, 1, 0x40000185, [0x60410010])
    objects |= {(0x1018, 4): unsigned(0xDEADBEEF, 4), (0x6061, 0): b"\xff"}
    return wire.attach(Stubborn(wire, 5, objects))


@pytest.fixture
def foreign():
    """Requests of others that were noticed."""
    return []


@pytest.fixture
def sdo(wire, node, foreign):
    return Sdo(wire.port, 5, "test device", 0.02, lambda: foreign.append(True))


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


def test_one_lost_answer_is_asked_for_again(node, sdo):
    node.loses = 1
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF


def test_silence_is_two_tries_and_late_answers_are_nobody_else_s(wire, node, sdo, foreign):
    node.mute = True
    with pytest.raises(NotAnswering, match="node id 5"):
        sdo.read(0x1018, 4)
    assert [data[0] for data in wire.sent(0x605)].count(0x40) == 2
    for _ in range(2):
        wire.emit(0x585, "43 18 10 04 07 00 00 00")
    wire.port.pump()
    node.mute = False
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF
    wire.emit(0x585, "43 18 10 04 07 00 00 00")
    wire.port.pump()
    assert foreign == []
    node.be_asked()
    wire.port.pump()
    assert foreign == [True]


@pytest.mark.parametrize(
    ("frame", "requests"),
    [
        ("", 1), ("43 18 10", 1), ("80 18 10 04 00 00 00", 1),  # no answers: none to ask again for
        ("FF FF FF FF FF FF FF FF", 2),
        ("43 00 10 00 01 02 03 04", 2),  # another object
        ("80 02 14 01 00 00 02 06", 1),  # abort of another, the late answer to a repeated request
    ],
)  # fmt: skip
def test_what_is_no_answer_of_ours_is_not_believed(wire, node, sdo, frame, requests):
    node.first = (frame,)
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF
    assert len(wire.sent(0x605)) == requests


def test_abort_without_an_object_is_believed(node, sdo):
    node.first = ("80 00 00 00 00 00 02 06",)
    with pytest.raises(Refused):
        sdo.unsigned(0x1018, 4)


@pytest.mark.parametrize("frame", ["80 00 00 00 01 00 04 05", "80 18 10 04 00 00 03 05"])
def test_a_transfer_that_an_earlier_client_left_is_not_blamed_on_the_object(wire, node, sdo, frame):
    """Command specifier unknown, toggle bit not alternated: the server was amid a transfer."""
    node.first = (frame,)
    assert sdo.unsigned(0x1018, 4) == 0xDEADBEEF
    assert len(wire.sent(0x605)) == 2


def test_an_abort_of_the_transfer_that_stays_is_told(node, sdo):
    node.refused[0x6061, 0] = 0x05040001
    with pytest.raises(Refused, match="6061"):
        sdo.write(0x6061, 0, 10, 1)


def test_read_back_of_another_value(node, sdo):
    node.deaf.add((0x6061, 0))
    with pytest.raises(NotConfigured, match=r"wrote 0xA to object 6061:00 but read back 0xFF"):
        sdo.set(0x6061, 0, 10, 1)


def test_constant_is_taken_when_it_is_the_right_one(node, sdo):
    node.refused[0x6061, 0] = READ_ONLY
    sdo.set(0x6061, 0, -1, 1)
    with pytest.raises(Refused, match="6061:00"):
        sdo.set(0x6061, 0, 10, 1)


# -- PDO -----------------------------------------------------------------------------------------


def test_order_of_the_writes(node, sdo):
    pdo.configure(sdo, WANTED)
    assert node.writes == [
        (0x1800, 1, 0xC0000185),
        (0x1A00, 0, 0), (0x1A00, 1, 0x60410010), (0x1A00, 2, 0x60640020), (0x1A00, 0, 2),
        (0x1800, 2, 1),
        (0x1800, 5, 100),
        (0x1800, 1, 0x40000185),
    ]  # fmt: skip


def test_inhibit_time_is_cleared(node, sdo):
    node.objects[0x1800, 3] = b"\x10\x00"
    pdo.configure(sdo, WANTED)
    assert node.objects[0x1800, 3] == b"\0\0"


@pytest.mark.parametrize(
    ("absent", "read_only", "objects", "wanted"),
    [
        ([(0x1800, 3), (0x1800, 5)], [], {}, WANTED._replace(timer_ms=0)),
        ([], [(0x1A00, 0)], RIGHT_MAPPING, WANTED),
        ([], [(0x1800, 2), (0x1800, 5)], RIGHT_TYPE_AND_TIMER, WANTED),
    ],
    ids=["no timer where none is wanted", "mapping", "type and timer"],
)
def test_what_is_fixed_is_taken_when_it_is_right(node, sdo, absent, read_only, objects, wanted):
    node.objects |= objects
    node.refused |= dict.fromkeys(read_only, READ_ONLY)
    for key in absent:
        del node.objects[key]
    pdo.configure(sdo, wanted)


@pytest.mark.parametrize(
    ("refused", "error", "told"),
    [
        ({(0x1800, 5): 0x06020000}, Refused, "1800:05"),
        ({(0x1A00, 0): READ_ONLY}, NotConfigured, "1A00 is fixed and not the one needed"),
        ({(0x1800, 2): READ_ONLY}, Refused, "1800:02"),
    ],
)
def test_what_is_fixed_otherwise_is_refused(node, sdo, refused, error, told):
    node.refused |= refused
    with pytest.raises(error, match=told):
        pdo.configure(sdo, WANTED)


@pytest.mark.parametrize("shown", [0xC0000185, 0x60000185, 0x40000186])
def test_identifier_that_reads_back_otherwise(node, sdo, shown):
    node.shown = shown
    with pytest.raises(NotConfigured, match="should be enabled with identifier 0x185"):
        pdo.configure(sdo, WANTED)


def test_bits_beyond_the_identifier_are_the_devices_own(node, sdo):
    node.shown = 0x00000185  # bit 30 dropped
    pdo.configure(sdo, WANTED)
    assert node.objects[0x1800, 1] == unsigned(0x00000185, 4)


def test_unused_pdos_are_disabled_wherever_they_are(node, sdo):
    node.objects |= pdo_objects(0x1400, 2, 0x305, [0x60400010])
    node.objects |= pdo_objects(0x1800, 4, 0x485, [0x60410010])
    pdo.disable_unused(sdo, (WANTED,))
    assert node.writes == [(0x1401, 1, 0x80000305), (0x1803, 1, 0x80000485)]


def test_the_rpdos_at_which_the_device_still_takes_commands_are_told(node, sdo):
    """Of those whose identifier is read-only, one lets its entries go and two do not."""
    for number, identifier in ((2, 0x305), (3, 0x40000405), (4, 0x505), (5, 0x80000605)):
        node.objects |= pdo_objects(0x1400, number, identifier, [0x60400010])
    node.objects |= pdo_objects(0x1800, 2, 0x285, [0x60410010])
    node.refused |= {(0x1401, 1): READ_ONLY, (0x1402, 1): READ_ONLY, (0x1403, 1): READ_ONLY,
                     (0x1404, 1): READ_ONLY, (0x1801, 1): READ_ONLY}  # fmt: skip
    node.refused |= {(0x1601, 0): READ_ONLY, (0x1602, 0): READ_ONLY, (0x1A01, 0): READ_ONLY}
    assert pdo.disable_unused(sdo, (WANTED,)) == (0x305, 0x405)
    assert node.objects[0x1603, 0] == b"\0"


def test_pdo_that_cannot_be_disabled(node, sdo):
    node.deaf.add((0x1800, 1))
    with pytest.raises(NotConfigured, match="cannot be disabled"):
        pdo.configure(sdo, WANTED)
