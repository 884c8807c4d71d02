# SPDX-License-Identifier: Apache-2.0
"""The system clock is set while a recording runs: nothing is out of order, missing or stretched."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import pytest
from bag_counts import MS, SECOND, START
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from screw_module_ros.clock import Clock
from screw_module_ros.recording.bag import Bag, Message
from screw_module_ros.recording.bag_files import information
from screw_module_ros.recording.recorder import Recording
from screw_module_ros.recording.records import notes
from screw_module_ros.recording.timeline import Timeline
from screw_module_ros.recording.verify import verify
from screw_module_ros.session_command import main

BOOT = 5 * SECOND  # monotonic time when a recording begins
DRAIN = 20  # ms from one look at the queues to the next
TOPICS = ("/screw/encoder", "/other")


class SetClock(Clock):
    """A wall clock that somebody sets: `offset` is the system clock minus the monotonic one."""

    def __init__(self) -> None:
        self.now, self.offset = BOOT, START - BOOT

    def now_ns(self) -> int:
        return self.now

    def stamp_ns(self) -> int:
        return self.now + self.offset


@pytest.fixture
def encoded(codec):
    """Return what encodes an encoder sample: number, monotonic and system time [ns]."""

    def encode(number: int, at_ns: int, stamp_ns: int) -> bytes:
        sec, nanosec = divmod(stamp_ns, SECOND)
        stamp = {"sec": sec, "nanosec": nanosec}
        values = {"sequence": number, "monotonic_ns": at_ns, "stamp": stamp}
        return codec.encode("screw_module_msgs/msg/EncoderSample", values)

    return encode


@pytest.fixture
def recorded(tmp_path, encoder_topic, encoded):
    """Return what records `count` samples of 1 kHz on two topics while the clock is set."""
    folders = iter(range(10**6))

    def make(count: int, sets: dict[int, int]) -> Path:
        """sets: by how much before which sample [ns]."""
        clock = SetClock()
        recording = Recording(Bag(tmp_path / f"{next(folders)}"), None, lambda: 2**40, clock)
        channels = [recording.add_topic(encoder_topic._replace(name=name)) for name in TOPICS]
        waiting: dict[int, list[Message]] = {channel: [] for channel in channels}
        for number in range(count):
            clock.now = BOOT + number * MS
            clock.offset += sets.get(number, 0)
            stamp = clock.stamp_ns()
            data = encoded(number, clock.now, stamp)
            for channel in channels:
                waiting[channel].append(Message(channel, stamp, stamp - 9000, number + 1, data))
            if number % DRAIN == DRAIN - 1:
                recording.put([message for queue in waiting.values() for message in queue])
                waiting = {channel: [] for channel in channels}
                recording.work(clock.now)
        recording.put([message for queue in waiting.values() for message in queue])
        recording.close()
        return recording.folder

    return make


def judged(bag: Path, count: int) -> list[int]:
    """Check a bag of gapless samples; return the log times of a topic [ns]."""
    report = verify(bag)
    assert report.problems == []
    assert report.duration == pytest.approx((count - 1) * 1e-3, abs=DRAIN * 1e-3)
    told = information(bag)["duration"]["nanoseconds"] * 1e-9
    assert told == pytest.approx((count - 1) * 1e-3, abs=DRAIN * 1e-3)
    with (bag / f"{bag.name}_0.mcap").open("rb") as file:
        found = {name: [] for name in TOPICS}
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            found[channel.topic].append((message.sequence, message.log_time))
    for name in TOPICS:
        assert [number for number, _ in found[name]] == list(range(1, count + 1))
        times = [time for _, time in found[name]]
        assert all(before <= after for before, after in pairwise(times))
    return [time for _, time in found[TOPICS[0]]]


STEP = st.one_of(st.integers(-3600 * SECOND, 3600 * SECOND), st.integers(-SECOND, SECOND))


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(sets=st.dictionaries(st.integers(1, 299), STEP, max_size=5))
@example(sets={90: -60 * SECOND})
@example(sets={150: 3600 * SECOND, 151: -3600 * SECOND})
@example(sets={100: -7 * MS, 200: 7 * MS})
def test_steps_of_any_size_change_neither_order_nor_duration(recorded, sets):
    """A gapless recording was "NOT complete: 90 not received, 35 out of order"."""
    judged(recorded(300, sets), 300)


def test_a_log_time_after_a_step_is_that_of_an_unset_clock(recorded):
    for place in (140, 151, 159):  # at an end of a drain, and within one
        times = judged(recorded(300, {place: -3600 * SECOND}), 300)
        assert [time - START for time in times] == [number * MS for number in range(300)]


def test_a_step_is_a_remark_and_a_note(recorded, capsys):
    bag = recorded(400, {200: -60 * SECOND, 300: 3600 * SECOND})
    assert main(["verify", str(bag)]) == 0
    said = capsys.readouterr().out
    assert "NOTE the system clock was set by -60.0 s, +3600.0 s while it was recorded" in said
    noted = notes(bag)["clock"]
    assert noted["set"].startswith("by -60.000 s, 0.2 s after the start; by +3600.000 s, 0.3 s")
    assert main(["info", str(bag)]) == 0
    assert "\nduration: 0.4 s\n" in capsys.readouterr().out


def test_without_a_step_nothing_is_changed_or_remarked(recorded):
    bag = recorded(300, {})
    assert judged(bag, 300)[-1] == START + 299 * MS
    assert verify(bag).remarks == [] and "set" not in notes(bag)["clock"]


@pytest.mark.parametrize("step", [-3600.0, -60.0, -0.5, 0.5, 60.0, 3600.0])
def test_a_bag_whose_log_times_were_moved_is_complete_too(tmp_path, encoder_topic, encoded, step):
    """As other recorders write it: duration and ends are those of the monotonic times."""
    writer = Bag(tmp_path / "bag")
    channel = writer.add_topic(encoder_topic)
    quiet = writer.add_topic(encoder_topic._replace(name="/late"))
    for number in range(3000):
        offset = START - BOOT + (round(step * SECOND) if number >= 1000 else 0)
        at_ns = BOOT + number * MS
        for which in (channel, quiet) if number >= 1500 else (channel,):
            data = encoded(number, at_ns, at_ns + offset)
            place = number + 1 if which == channel else number - 1499
            writer.write([Message(which, at_ns + offset, at_ns, place, data)])
    writer.close()
    report = verify(writer.folder)
    assert report.duration == pytest.approx(2.999, abs=1e-3)
    assert report.problems == ["/late: begins 1.5 s after the recording and ends 0.0 s before it"]
    assert f"the system clock was set by {step:+.1f} s while" in report.remarks[0]


def test_what_an_older_version_sorted_by_the_clock_is_complete_by_its_numbers(
    tmp_path, encoder_topic, encoded
):
    writer = Bag(tmp_path / "bag")
    channel = writer.add_topic(encoder_topic)
    for start in range(0, 500, 100):
        batch = []
        for number in range(start, start + 100):
            offset = START - BOOT - (60 * SECOND if number >= 265 else 0)
            at_ns = BOOT + number * MS
            data = encoded(number, at_ns, at_ns + offset)
            batch.append(Message(channel, at_ns + offset, at_ns, number + 1, data))
        writer.write(sorted(batch, key=lambda message: message.log_time))
    writer.close()
    report = verify(writer.folder)
    assert report.problems == []
    counts = report.topics["/screw/encoder"]
    assert (counts.lost, counts.missed, counts.out_of_order) == (0, 0, 0)


def test_a_program_that_is_held_up_between_two_readings_sets_no_clock():
    class HeldUp(SetClock):
        """The processor is taken away after the first reading, for long, and each time."""

        def now_ns(self) -> int:
            self.now += 30 * MS
            return self.now

    clock = HeldUp()
    timeline = Timeline(clock)
    for _ in range(20):
        timeline.continued([])
    assert timeline.sets == []
    assert json.dumps(timeline.note()).count("begun") == 1
