# SPDX-License-Identifier: Apache-2.0
"""Gaps, duplicates and disorder are counted from raw bytes, with the stride learned."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.recording.bag import Topic
from screw_module_ros.recording.counts import Count, Counts, tick_of
from screw_module_ros.recording.definitions import Definition

MASK = 0xFFFFFFFF


FLAT = "builtin_interfaces/Time stamp\nuint32 sequence\nint64 monotonic_ns\n"
HEADER = FLAT.replace("builtin_interfaces/Time stamp", "std_msgs/Header header")
OWN = "screw_module_msgs/msg/"


def flat(sequence):
    """Return the beginning of a flat message: encapsulation, stamp, sequence, little endian."""
    return b"\x00\x01\x00\x00" + bytes(8) + (sequence & MASK).to_bytes(4, "little") + bytes(8)


def count_of(kind="EncoderSample", text=FLAT, name="/x"):
    return Count(Topic(name, OWN + kind, Definition("ros2msg", text, "")))


def counted(sequences, numbers=None, every=None):
    """Count messages; every: their stride by the parameters, else it is 1."""
    count = count_of("PlanarState" if every else "EncoderSample")
    for place, sequence in enumerate(sequences):
        count.take(numbers[place] if numbers else 0, flat(sequence))
    return count.result({"/manus": f'{{"state_every": {every}}}'})


def test_nothing_missing():
    assert counted(range(7, 1007)) == Counts(messages=1000, stride=1)
    assert counted(range(7, 1007)).complete


def test_each_gap_and_each_lost_message_is_counted():
    sequences = [n for n in range(1000) if n not in (100, 500, 501, 502)]
    counts = counted(sequences)
    assert (counts.gaps, counts.lost) == (2, 4)
    assert not counts.complete


def test_the_stride_is_that_of_the_graph_or_of_a_parameter():
    """One that is learned would hide a regular loss."""
    counts = counted(range(0, 1000, 2))
    assert (counts.stride, counts.lost, counts.gaps) == (1, 499, 499)
    counts = counted([n for n in range(0, 2000, 4) if n not in (100, 104)], every=4)
    assert (counts.stride, counts.lost, counts.gaps) == (4, 2, 1)
    assert counted([n * n for n in range(200)]).lost == 199 * 198
    assert counted([]) == Counts(stride=1)


@pytest.mark.parametrize("text", ["{}", "[]", "no answer", '{"state_every": "often"}'])
def test_a_stride_that_nobody_tells_is_unknown(text):
    count = count_of("PlanarState")
    for sequence in range(0, 800, 8):
        count.take(0, flat(sequence))
    counts = count.result({"/manus": text})
    assert (counts.stride, counts.lost) == (0, 0)


def test_jitter_round_the_stride_is_no_loss():
    sequences, now = [], 0
    for turn in range(300):
        now += 5 + {0: 1, 1: -1}.get(turn % 20, 0)
        sequences.append(now)
    counts = counted(sequences, every=5)
    assert (counts.stride, counts.lost, counts.gaps) == (5, 0, 0)


def test_a_thinned_topic_and_one_of_another_type_have_no_stride():
    for count in (count_of(name="/screw/encoder/decimated"), count_of("SimTruth")):
        for sequence in range(0, 500, 5):
            count.take(0, flat(sequence))
        assert (count.result({}).stride, count.result({}).lost) == (0, 0)


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
    count = count_of("SimTruth", "")
    for number in (1, 5, 2, 6):
        count.take(number, flat(0))
    count.several = True
    assert count.result({}).missed == -1
    assert count.result({}).complete


@given(
    first=st.integers(0, MASK),
    stride=st.integers(1, 7),
    missing=st.sets(st.integers(1, 298), max_size=60),
)
def test_any_loss_inside_a_regular_topic_is_counted(first, stride, missing):
    kept = [n for n in range(300) if n not in missing]
    counts = counted([first + stride * n for n in kept], every=stride)
    assert (counts.stride, counts.lost) == (stride, len(missing))
    assert counts.gaps == sum(b - a > 1 for a, b in zip(kept, kept[1:], strict=False))


@given(frame=st.text(max_size=40), sequence=st.integers(0, MASK))
def test_sequence_behind_a_header_is_found_whatever_the_frame(codec, frame, sequence):
    frame = frame.replace("\0", "")
    values = {"header": {"frame_id": frame}, "sequence": sequence}
    data = codec.encode("screw_module_msgs/msg/PlanarState", values)
    assert tick_of(data, after_header=True) == sequence


@pytest.mark.parametrize("order", ["little", "big"])
def test_both_byte_orders(order):
    marker = {"little": b"\0\1", "big": b"\0\0"}[order]
    data = marker + b"\0\0" + bytes(8) + (77).to_bytes(4, order)
    assert tick_of(data, after_header=False) == 77


def test_topics_with_ticks_are_those_with_a_number_and_its_time(definitions, own_types):
    """Not one that shows the number of a sample that it has heard."""
    ticked = set()
    for name in own_types:
        count = Count(Topic("/x", name, definitions.find(name)))
        count.take(0, flat(5))
        count.take(0, flat(9))
        ticked |= {name} if count._steps else set()
    assert ticked == {OWN + kind for kind in
                      ("EncoderSample", "ForceSample", "ForceCommand", "PlanarState",
                       "EndpointState")}  # fmt: skip


def test_many_different_steps_do_not_fill_the_memory():
    count = count_of()
    now = 0
    for step in range(2000):
        now += step
        count.take(0, flat(now))
    assert len(count._steps) < 300 and len(count._places) < 1500
