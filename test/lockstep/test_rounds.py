# SPDX-License-Identifier: Apache-2.0
"""Loops of one thread beside the rig: their order, what ends a wait, threads that wait besides."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.lockstep import rounds as module
from screw_module_ros.lockstep.page import START_NS
from screw_module_ros.lockstep.rounds import Rounds, RoundsClock
from screw_module_ros.plant.world import World, load_world
from screw_module_ros.rig.rig import Rig
from screw_module_ros.rig.rig_hub import RigHub

MS = 1_000_000
ASK = 0x602, bytes.fromhex("4000100000000000")
"""Asks the encoder for its device type by SDO (CiA 301, 7.2.4.3.5)."""


class Process:
    """The rig and loops in one thread; seen: what the loops told, with the time of it [ms]."""

    def __init__(self, page, conductor, name):
        self.clock = RoundsClock(page, "test")
        self.hub, self.seen = RigHub(name), []
        self.rig = Rig({"encoder": self.hub}, World(load_world(), 1), self.clock)
        self.rig.process(START_NS)  # the encoder boots: it is silent from then on
        rounds = self.rounds = self.clock.rounds
        rounds.serve, self.clock.buses[name] = self.rig.serve_expected, self.hub
        rounds.turn = partial(self.rig.turn, conductor, lambda now_ns: None, rounds)
        self.ports = []

    def port(self) -> Port:
        self.ports.append(Port(self.hub.join(), clock=self.clock))
        return self.ports[-1]

    def tell(self, what: object) -> None:
        self.seen.append((what, (self.clock.now_ns() - START_NS) / MS))

    def ticks(self, name: str, period: int = 1, count: int = 3) -> None:
        for number in range(1, count + 1):
            self.clock.sleep_until(START_NS + number * period * MS)
            self.tell(name)

    def run(self, *loops) -> list:
        for loop in loops:
            self.rounds.add(loop)
        while not self.rounds.ended:
            self.rounds.turn()
        return self.seen


@pytest.fixture
def process(page, conductor, name):
    made = Process(page, conductor, name)
    yield made
    for port in made.ports:
        port.close()
    made.hub.shutdown()
    made.clock.leave()


@pytest.fixture
def aside(process):
    """Return `aside(work)`: its answer to be, of a thread of the process that serves a node."""

    def worked(work):
        try:
            with process.clock.working():
                here.set()
                return work()
        finally:
            process.clock.leave()

    def begin(work):
        begun = pool.submit(worked, work)
        assert here.wait(10.0)  # from now on it holds time
        return begun

    here = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        yield begin


def test_loops_take_turns_in_the_order_of_their_start(process):
    seen = process.run(partial(process.ticks, "slow", 2), partial(process.ticks, "fast"))
    assert seen == [
        ("fast", 1), ("slow", 2), ("fast", 2), ("fast", 3), ("slow", 4), ("slow", 6),
    ]  # fmt: skip


def test_a_loop_that_waits_for_a_silent_device_lets_the_others_run(process):
    port = process.port()
    seen = process.run(
        lambda: process.tell(port.pump(START_NS + 2 * MS)), partial(process.ticks, "other")
    )
    assert seen == [("other", 1), (0, 2), ("other", 2), ("other", 3)]


def test_a_frame_for_the_rig_holds_time_and_one_for_a_loop_does_not(process):
    assert not process.rounds.holds()
    process.port().send(*ASK)
    assert process.rounds.holds()
    process.rig.serve_expected(START_NS)
    assert not process.rounds.holds()
    assert process.ports[0].pump() > 0


def test_what_comes_into_a_queue_ends_a_wait(process):
    near, far, topic = process.port(), process.port(), []

    def sends():
        process.clock.sleep_until(START_NS + MS)
        far.send(0x7FF, b"")
        process.clock.sleep_until(START_NS + 2 * MS)
        topic.append("message")

    def waits():
        process.tell(near.pump(START_NS + 9 * MS))
        process.clock.await_any(START_NS + 9 * MS, (topic,))
        process.tell(topic[0])

    assert process.run(sends, waits) == [(1, 1), ("message", 2)]


def test_who_rests_holds_no_time(process, monkeypatch):
    """A node that is not active looks again by wall clock, which is turned by hand here."""
    wall_s = [100.0]
    monkeypatch.setattr(module, "_monotonic_s", lambda: wall_s[0])

    def rests():
        process.clock.rest(threading.Event(), 5.0)
        process.tell("rested")

    def ticks():
        process.ticks("other")
        wall_s[0] += 1.0

    assert process.run(rests, ticks) == [("other", 1), ("other", 2), ("other", 3), ("rested", 3)]


def test_the_hub_s_own_wait_moves_time_and_runs_the_loops(process):
    process.rounds.add(partial(process.ticks, "loop"))
    process.clock.sleep_until(START_NS + 2 * MS)
    assert process.clock.now_ns() == START_NS + 2 * MS and process.seen[0] == ("loop", 1)
    process.rounds.stand_still()
    with pytest.raises(TimeStandsStill, match="sim_rig has stopped"):
        process.clock.sleep_until(START_NS + 3 * MS)


def test_what_a_loop_raises_reaches_the_hub_and_it_is_forgotten():
    rounds, ran = Rounds(), []
    rounds.add(lambda: 1 // 0)
    rounds.add(lambda: ran.append(1))
    with pytest.raises(ZeroDivisionError):
        rounds.run_ready(0)
    while rounds.run_ready(0):
        pass
    assert rounds.ended and ran == [1]


def test_at_the_end_no_loop_waits_any_more():
    rounds, told = Rounds(), []

    def waits():
        with pytest.raises(TimeStandsStill) as raised:
            rounds.wait(1)
        told.append(str(raised.value))

    for _ in range(2):
        rounds.add(waits)
    rounds.run_ready(0)
    rounds.end("the rig has ended")
    assert rounds.ended and told == ["the rig has ended"] * 2


# Threads besides --------------------------------------------------------------------------------


def test_a_lock_of_a_thread_that_waits_for_time_does_not_stop_the_loops(process, aside):
    lock = threading.Lock()

    def holds():
        with lock:
            process.clock.sleep_until(START_NS + 3 * MS // 2)

    def wants():
        process.clock.sleep_until(START_NS + MS)
        process.clock.acquire(lock)
        process.tell("has it")

    held = aside(holds)
    seen = process.run(wants, partial(process.ticks, "other"))
    held.result()
    assert [each for each in seen if each[0] == "other"] == [("other", n) for n in (1, 2, 3)]
    assert ("has it", 1) not in seen and "has it" in dict(seen)


def test_a_service_thread_that_waits_at_a_bus_holds_time(process, aside):
    """The frame is there at once; the thread runs when the processor lets it."""
    near, far = process.port(), process.port()

    def reads():
        frames = near.pump(START_NS + 9 * MS)
        process.tell(frames)
        return frames

    def sends():
        process.clock.sleep_until(START_NS + 2 * MS)
        far.send(0x7FF, b"")
        process.ticks("other", 4, 1)

    read = aside(reads)
    assert process.run(sends) == [(1, 2), ("other", 4)]
    assert read.result() == 1


def test_a_request_of_a_service_thread_is_answered_before_time_goes_on(process, aside):
    port = process.port()

    def asks():
        process.clock.sleep_until(START_NS + MS)
        port.send(*ASK)
        answered = port.pump(START_NS + 9 * MS)
        process.tell(answered > 0)

    asked = aside(asks)
    process.run(partial(process.ticks, "other"))
    asked.result()
    assert (True, 1) in process.seen


def test_a_bus_within_the_process_is_one_on_which_its_rig_answers(process, page):
    """`characterize` asks no operator for a mounting where it sees the rig on a bus."""
    own = page.conductor
    assert all(sent == 0 for pid, sent in page.buses() if pid == own)
    port = process.port()
    assert any(sent for pid, sent in page.buses() if pid == own)
    process.ports.remove(port)
    port.close()
    assert all(sent == 0 for pid, sent in page.buses() if pid == own)
