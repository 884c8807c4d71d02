# SPDX-License-Identifier: Apache-2.0
"""Gaps, duplicates and disorder are counted from raw bytes, with the stride learned."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.recording.audit import (
    FLAT,
    HEADER,
    NO_SEQUENCE,
    Counts,
    TopicAudit,
    layout,
    monotonic_of,
    sequence_of,
)

MASK = 0xFFFFFFFF


def flat(sequence):
    """Return the beginning of a flat message: encapsulation, stamp, sequence, little endian."""
    return b"\x00\x01\x00\x00" + bytes(8) + (sequence & MASK).to_bytes(4, "little") + bytes(8)


def counted(sequences, numbers=None, stride=0):
    audit = TopicAudit(FLAT, stride)
    for place, sequence in enumerate(sequences):
        audit.update(flat(sequence), numbers[place] if numbers else 0)
    return audit.counts()


def test_nothing_missing():
    assert counted(range(7, 1007)) == Counts(messages=1000, stride=1)
    assert counted(range(7, 1007)).complete


def test_each_gap_and_each_lost_message_is_counted():
    sequences = [n for n in range(1000) if n not in (100, 500, 501, 502)]
    counts = counted(sequences)
    assert (counts.gaps, counts.lost) == (2, 4)
    assert not counts.complete


def test_stride_of_two_is_learned():
    counts = counted([n for n in range(0, 2000, 2) if n not in (100, 102)])
    assert (counts.stride, counts.gaps, counts.lost) == (2, 1, 2)


def test_a_known_stride_is_not_learned():
    counts = counted(range(0, 1000, 2), stride=1)
    assert (counts.stride, counts.lost, counts.gaps) == (1, 499, 499)
    counts = counted([n for n in range(0, 2000, 4) if n not in (100, 104)], stride=4)
    assert (counts.stride, counts.lost, counts.gaps) == (4, 2, 1)
    counts = counted([n * n for n in range(200)], stride=1)
    assert counts.lost == 199 * 198
    assert counted([], stride=1) == Counts()


def test_jitter_round_the_stride_is_no_loss():
    sequences, now = [], 0
    for turn in range(300):
        now += 5 + {0: 1, 1: -1}.get(turn % 20, 0)
        sequences.append(now)
    counts = counted(sequences)
    assert (counts.stride, counts.lost, counts.gaps) == (5, 0, 0)


def test_without_a_period_nothing_is_called_lost():
    counts = counted([n * n for n in range(200)])
    assert (counts.stride, counts.lost) == (0, 0)


def test_duplicates_and_disorder():
    counts = counted([*range(100), 99, 99, *range(100, 150), 152, 151, 150, *range(153, 200)])
    assert (counts.duplicates, counts.out_of_order, counts.lost) == (2, 2, 0)


def test_wrap_of_the_tick_number_is_no_gap():
    assert counted(range(MASK - 50, MASK + 50)).lost == 0


def test_restart_of_the_counter_is_no_gap():
    counts = counted([*range(2_000_000, 2_000_100), *range(4_000_000, 4_000_100), *range(5)])
    assert (counts.restarts, counts.lost) == (2, 0)


def test_not_received_is_told_from_not_sent():
    counts = counted([1, 2, 5, 6], numbers=[11, 12, 13, 14])
    assert (counts.lost, counts.missed) == (2, 0)
    counts = counted([1, 2, 5, 6], numbers=[11, 12, 15, 16])
    assert (counts.lost, counts.missed) == (2, 2)


def test_restarted_publisher_has_not_missed_anything():
    assert counted(range(6), numbers=[8, 9, 10, 1, 2, 3]).missed == 0


def test_with_several_publishers_their_numbers_are_not_judged():
    audit = TopicAudit(NO_SEQUENCE)
    for number in (1, 5, 2, 6):
        audit.update(flat(0), number)
    audit.single_publisher = False
    assert audit.counts().missed == -1
    assert audit.counts().complete


@given(
    first=st.integers(0, MASK),
    stride=st.integers(1, 7),
    missing=st.sets(st.integers(1, 298), max_size=60),
)
def test_any_loss_inside_a_regular_topic_is_counted(first, stride, missing):
    # The stride must still be the commonest step.
    kept = [n for n in range(300) if n not in missing]
    steps = [b - a for a, b in zip(kept, kept[1:], strict=False)]
    if 2 * steps.count(1) <= len(steps):
        return
    counts = counted([first + stride * n for n in kept])
    assert (counts.stride, counts.lost) == (stride, len(missing))
    assert counts.gaps == len(steps) - steps.count(1)


@given(frame=st.text(max_size=40), sequence=st.integers(0, MASK), stamp=st.integers(0, 2**63 - 1))
def test_sequence_behind_a_header_is_found_whatever_the_frame(codec, frame, sequence, stamp):
    frame = frame.replace("\0", "")
    data = codec.encode(
        "screw_module_msgs/msg/PlanarState",
        {"header": {"frame_id": frame}, "sequence": sequence, "monotonic_ns": stamp},
    )
    assert sequence_of(data, HEADER) == sequence
    assert monotonic_of(data, HEADER) == stamp


@pytest.mark.parametrize("kind", ["EncoderSample", "ForceSample", "ForceCommand"])
def test_stamp_behind_a_flat_sequence(codec, kind):
    data = codec.encode(f"screw_module_msgs/msg/{kind}", {"sequence": 7, "monotonic_ns": 2**40 + 1})
    assert (sequence_of(data, FLAT), monotonic_of(data, FLAT)) == (7, 2**40 + 1)


@pytest.mark.parametrize("order", ["little", "big"])
def test_both_byte_orders(order):
    marker = {"little": b"\0\1", "big": b"\0\0"}[order]
    data = marker + b"\0\0" + bytes(8) + (77).to_bytes(4, order)
    assert sequence_of(data, FLAT) == 77


def test_layout_of_own_types(definitions, own_types):
    found = {name.split("/")[-1]: layout(definitions.find(name).text) for name in own_types}
    flat_ones = {name for name, where in found.items() if where == FLAT}
    assert flat_ones == {"EncoderSample", "ForceSample", "ForceCommand"}
    assert {name for name, where in found.items() if where == HEADER} == {
        "PlanarState",
        "EndpointState",
        "TherapyState",
    }


def test_many_different_steps_do_not_fill_the_memory():
    audit = TopicAudit(FLAT)
    now = 0
    for step in range(2000):
        now += step
        audit.update(flat(now), 0)
    assert len(audit._steps) < 300
    assert audit.counts().stride == 0
