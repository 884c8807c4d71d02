# SPDX-License-Identifier: Apache-2.0
"""What the two stacks do otherwise than CiA 301, as `docs/porting.md` tells it."""

from __future__ import annotations

import canopen
import pytest
from far_end import DURAND
from makes import dictionary

from screw_module_ros.devices.sdo import Sdo

pytestmark = pytest.mark.timeout(120)

NMT, SYNC, NODE = 0x000, 0x080, 2


@pytest.fixture
def sdo(near):
    return Sdo(near.port, NODE, "device", 2.0, lambda: None)


def heard(near, sdo, *can_ids):
    """Return the frames with these identifiers up to an answer that comes after them."""
    sdo.unsigned(0x1000)
    return near.frames(*can_ids)


@pytest.fixture
def mapped(near, device, sdo):
    """A durand encoder whose TPDO1 has these entries and goes at each SYNC."""
    device(DURAND, "generic_406")

    def tell(entry: int, identifier: int = 0x40000182) -> None:
        for index, subindex, value, size in (
            (0x1A00, 1, entry, 4), (0x1A00, 0, 1, 1), (0x1800, 2, 1, 1), (0x1800, 1, identifier, 4),
        ):  # fmt: skip
            sdo.set(index, subindex, value, size)
        near.emit(NMT, "01 02")
        near.emit(SYNC, "")

    return tell


def test_durand_has_no_timers_of_pdos(device, sdo):
    device(DURAND, "generic_406")
    assert sdo.has(0x1800, 2) and not sdo.has(0x1800, 5)
    assert sdo.has(0x1400, 2) and not sdo.has(0x1400, 5)


def test_durand_sets_the_identifiers_of_pdos_back(near, sdo, mapped):
    mapped(0x60040020, 0x40000192)
    assert sdo.unsigned(0x1800, 1) == 0x40000192
    assert heard(near, sdo, 0x182, 0x192) == [(0x182, bytes(4))]


def test_durand_maps_what_is_absent_and_then_sends_an_empty_frame(near, sdo, mapped):
    mapped(0x60050020)
    assert not sdo.has(0x6005)
    assert heard(near, sdo, 0x182) == [(0x182, b"")]


def test_durand_keeps_its_objects_when_it_is_reset(near, device, sdo):
    device(DURAND, "generic_406")
    sdo.set(0x6001, 0, 4096, 4)
    near.emit(NMT, "81 02")
    assert sdo.unsigned(0x6001) == 4096
    assert (0x702, b"\0") in near.frames(0x702)


def test_durand_takes_no_rpdo_that_is_longer_than_its_mapping(near, device):
    far = device(DURAND, "epos4")
    drive = near.drive("epos4")
    near.enabled(drive)
    near.emit(0x201, "0F 00 0A 00 00")
    near.until(lambda: near.frames(0x081), near.pump, "an emergency")
    assert near.frames(0x081) == [(0x081, bytes.fromhex("10 82 00 00 00 00 00 00"))]
    assert far.application.target == 0


def test_a_local_node_that_is_reset_sends_its_boot_up_for_ever(request, near, closing):
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05
    network.connect(interface="virtual", channel=request.node.nodeid, ignore_config=True)
    closing.callback(network.disconnect)
    node = canopen.LocalNode(NODE, dictionary("generic_406", NODE))
    network.add_node(node)
    node.nmt.state = "PRE-OPERATIONAL"
    node.nmt.start_heartbeat(10)
    closing.callback(node.nmt.stop_heartbeat)
    near.until(lambda: (0x702, b"\x7f") in near.frames(0x702), near.pump, "beats")
    near.emit(NMT, "81 02")
    near.until(lambda: near.frames(0x702).count((0x702, b"\0")) > 3, near.pump, "boots")
