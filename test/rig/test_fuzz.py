# SPDX-License-Identifier: Apache-2.0
"""Whatever comes over the bus, the far end survives it, and no torque flows without its guards."""

import itertools

import can
from hypothesis import given, settings
from hypothesis import strategies as st

from screw_module_ros.rig import cia402
from screw_module_ros.rig.rig import Rig

MS = 1_000_000
NODES = (1, 2, 3, 4)
_channels = itertools.count()

known_ids = st.sampled_from(
    [0x000, 0x080, 0x770, 0x771]
    + [base + node for base in (0x200, 0x300, 0x400, 0x600) for node in NODES]
    + [0x120 | opcode for opcode in range(16)]
)
objects = st.sampled_from(
    [0x1005, 0x1014, 0x1016, 0x1017, 0x1400, 0x1401, 0x1600, 0x1601, 0x1800, 0x1801, 0x1A00]
    + [0x1A01, 0x6000, 0x6001, 0x6002, 0x6003, 0x6040, 0x605A, 0x605E, 0x6060, 0x6071, 0x6076]
)


@st.composite
def sdo_writes(draw):
    index, subindex = draw(objects), draw(st.integers(0, 6))
    head = draw(st.sampled_from([0x2F, 0x2B, 0x23, 0x40, 0x60, 0x00, 0x21, 0xA0, 0xC2]))
    data = bytes((head, *index.to_bytes(2, "little"), subindex)) + draw(st.binary(min_size=4))[:4]
    return 0x600 + draw(st.sampled_from(NODES)), data


frames = st.one_of(
    st.tuples(known_ids, st.binary(max_size=8)),
    st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)),
    sdo_writes(),
    st.tuples(
        st.sampled_from([0x201, 0x203, 0x301]),
        st.sampled_from([b"\x06\0\0\0", b"\x07\0\0\0", b"\x0f\0\x40\0", b"\x80\0\0\0"]),
    ),
    st.tuples(st.just(0x000), st.sampled_from([b"\x01\0", b"\x80\0", b"\x02\0", b"\x81\0"])),
)


@settings(max_examples=15)
@given(st.lists(st.tuples(frames, st.integers(0, 30)), max_size=60))
def test_any_traffic_is_survived(make_fake_world, traffic):
    world, channel = make_fake_world(), f"fuzz/{next(_channels)}"
    near, far = (can.Bus(interface="virtual", channel=channel) for _ in range(2))
    try:
        rig = Rig(dict.fromkeys(("encoder", "drive", "force_sensor", "planar"), far), world)
        now_ns = 1000 * MS
        rig.process(now_ns)
        for (can_id, data), wait_ms in traffic:
            near.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
            now_ns += wait_ms * MS
            rig.process(now_ns)
            while near.recv(0) is not None:
                pass
            driving = rig.devices["drive"].machine.state == cia402.ENABLED
            assert driving or not world.vertical_powered
    finally:
        near.shutdown()
        far.shutdown()
