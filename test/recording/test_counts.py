# SPDX-License-Identifier: Apache-2.0
"""Gaps, duplicates and disorder are counted from raw bytes, with the stride learned."""

from itertools import accumulate

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


def without(*missing, every=1):
    return [n for n in range(0, 1000 * every, every) if n not in missing]


COUNTED = {
    "each gap and each message": (without(100, 500, 501, 502), {"gaps": 2, "lost": 4}),
    "every second": (range(0, 1000, 2), {"stride": 1, "lost": 499, "gaps": 499}),
    "ever more": ([n * n for n in range(200)], {"lost": 199 * 198}),
    "no message": ([], {"stride": 1, "lost": 0, "messages": 0}),
    "duplicates and disorder": (
        [*range(100), 99, 99, *range(100, 150), 152, 151, 150, *range(153, 200)],
        {"duplicates": 2, "out_of_order": 2, "lost": 0},
    ),
    "a wrap of the number": (range(MASK - 50, MASK + 50), {"lost": 0}),
    "a restart of the counter": (
        [*range(2_000_000, 2_000_100), *range(4_000_000, 4_000_100), *range(5)],
        {"restarts": 2, "lost": 0},
    ),
}


@pytest.mark.parametrize(("sequences", "wanted"), COUNTED.values(), ids=COUNTED)
def test_what_is_missing_is_counted(sequences, wanted):
    """The stride is no learned one, which would hide a regular loss."""
    counts = counted(sequences)._asdict()
    assert counts | wanted == counts


def test_what_lacks_nothing_is_complete():
    assert counted(range(7, 1007)) == Counts(messages=1000, stride=1)
    assert counted(range(7, 1007)).complete and not counted(without(100)).complete


def test_the_stride_may_be_that_of_a_parameter():
    counts = counted(without(100, 104, every=4), every=4)
    assert (counts.stride, counts.lost, counts.gaps) == (4, 2, 1)


@pytest.mark.parametrize("text", ["{}", "[]", "no answer", '{"state_every": "often"}'])
def test_a_stride_that_nobody_tells_is_unknown(text):
    count = count_of("PlanarState")
    for sequence in range(0, 800, 8):
        count.take(0, flat(sequence))
    counts = count.result({"/manus": text})
    assert (counts.stride, counts.lost) == (0, 0)


def test_jitter_round_the_stride_is_no_loss():
    steps = [5 + {0: 1, 1: -1}.get(turn % 20, 0) for turn in range(300)]
    counts = counted(accumulate(steps), every=5)
    assert (counts.stride, counts.lost, counts.gaps) == (5, 0, 0)


def test_a_thinned_topic_and_one_of_another_type_have_no_stride():
    for count in (count_of(name="/screw/encoder/decimated"), count_of("SimTruth")):
        for sequence in range(0, 500, 5):
            count.take(0, flat(sequence))
        assert (count.result({}).stride, count.result({}).lost) == (0, 0)


@pytest.mark.parametrize(
    ("sequences", "numbers", "lost", "missed"),
    [
        ([1, 2, 5, 6], [11, 12, 13, 14], 2, 0),
        ([1, 2, 5, 6], [11, 12, 15, 16], 2, 2),
        (range(6), [8, 9, 10, 1, 2, 3], 0, 0),
    ],
    ids=["not sent", "not received", "publisher restarted"],
)
def test_not_received_is_told_from_not_sent(sequences, numbers, lost, missed):
    counts = counted(sequences, numbers)
    assert (counts.lost, counts.missed) == (lost, missed)


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
    for sequence in accumulate(range(2000)):
        count.take(0, flat(sequence))
    assert len(count._steps) < 300 and len(count._places) < 1500
