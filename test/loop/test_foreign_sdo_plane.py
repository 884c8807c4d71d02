# SPDX-License-Identifier: Apache-2.0
"""A foreign SDO client may have moved the origin of a planar drive's position: home again."""

from __future__ import annotations

import struct

import can
import pytest

HOME_OFFSET = 0x607C
"""Object by which a drive shifts the zero of its position (CiA 402)."""


@pytest.mark.parametrize("node_id", [3, 4])
def test_after_a_foreign_sdo_client_the_plane_must_be_homed_again(bench, node_id):
    """Shifted counts are no jump: the drive was silent while it was configured anew."""
    assert bench.plane.homed
    data = struct.pack("<BHBi", 0x23, HOME_OFFSET, 0, 1000)
    with can.Bus(interface="virtual", channel=bench.ports["planar"].bus.channel_id) as intruder:
        request = can.Message(arbitration_id=0x600 + node_id, data=data, is_extended_id=False)
        intruder.send(request)
        bench.ticks(5)
        drives = bench.plane.permit.drives
        assert any("another SDO client" in drive.fault for drive in drives)
        assert bench._asking(bench.plane.clear_fault) == ""
    assert not bench.plane.homed
    assert "not homed" in bench.enable_plane()
    bench.ticks(50)
    assert bench.plane.take_home(bench.now_ns) == ""
    assert bench.enable_plane() == ""
