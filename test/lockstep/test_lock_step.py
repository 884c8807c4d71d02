# SPDX-License-Identifier: Apache-2.0
"""Time moves when nobody is busy and nothing is under way to somebody who waits; never before."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from operator import setitem

import pytest

from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.lockstep.conductor import Conductor, ConductorExists
from screw_module_ros.lockstep.end import End
from screw_module_ros.lockstep.member import Member
from screw_module_ros.lockstep.page import (
    FOREVER,
    NOW,
    START_NS,
    THREADS,
    Page,
    TableFull,
    page_name,
    sweep,
)

MS = 1_000_000


def never() -> bool:
    return False


@pytest.fixture
def member(page):
    return Member(page, "member", never)


class Waiting:
    """A member of its own thread that waits once."""

    def __init__(self, page, until_ns, *ends):
        self.reached_ns = 0
        self.member = Member(page, "waiting", never)
        self._page = page
        self._given = (until_ns, ends)
        self._thread = threading.Thread(target=self._wait)
        self._thread.start()

    def _wait(self):
        self.member.wait(*self._given)
        self.reached_ns = self._page.header[NOW]

    @property
    def ended(self) -> bool:
        return not self._thread.is_alive()

    def join(self) -> None:
        self._thread.join(10.0)
        assert self.ended


def quiet(conductor, wait_until) -> int:
    wait_until(lambda: conductor.quiet() is not None)
    return conductor.quiet()


def move(conductor, to_ns) -> None:
    conductor.move(to_ns)
    conductor.release()


def test_a_busy_member_holds_time(conductor, member):
    assert conductor.quiet() is None
    member.idle()
    assert conductor.quiet() == FOREVER
    member.busy()
    assert conductor.quiet() is None


def test_time_may_move_to_the_earliest_wish(conductor, page, wait_until):
    waiting = [Waiting(page, START_NS + n * MS) for n in (5, 2, 9)]
    assert quiet(conductor, wait_until) == START_NS + 2 * MS
    move(conductor, START_NS + 2 * MS)
    assert conductor.quiet() is None, "who was woken is busy, though he may not run yet"
    waiting[1].join()
    waiting[1].member.idle()
    assert quiet(conductor, wait_until) == START_NS + 5 * MS
    move(conductor, START_NS + 9 * MS)
    for each in waiting:
        each.join()
    assert waiting[0].reached_ns == waiting[2].reached_ns == START_NS + 9 * MS


def test_a_time_that_has_come_is_not_waited_for(page, member):
    now_ns = page.header[NOW]
    member.wait(now_ns)
    member.wait(now_ns - MS)
    assert page.header[NOW] == now_ns


# Frames and messages --------------------------------------------------------------------------


def bus(page, name="bus") -> End:
    return End(page, name, sends=True, follows=True)


def topic(page, name="topic") -> tuple[End, End]:
    """Return a publisher and a subscription."""
    return End(page, name, sends=True, numbered=True), End(page, name)


def send(end: End) -> None:
    end.count()
    end.announce()


def of_another_process(page, *ends: End) -> None:
    for end in ends:
        page.end_pid[end.row] = os.getppid()


def test_a_frame_holds_time_for_who_waits_for_it(conductor, page, member, wait_until):
    near, far = bus(page), bus(page)
    send(bus(page, "another bus"))
    member.idle()
    send(far)
    of_another_process(page, near, far)
    assert conductor.quiet() == FOREVER, "nobody waits for it now"
    waiting = Waiting(page, START_NS + 10 * MS, near)
    waiting.join()
    assert waiting.reached_ns == START_NS and near.pending
    near.take_next()
    assert not near.pending
    again = Waiting(page, START_NS + 10 * MS, near)
    waiting.member.idle()
    assert quiet(conductor, wait_until) == START_NS + 10 * MS
    send(far)
    assert conductor.quiet() is None, "held from the moment it is sent"
    again.join()


def test_frames_to_the_conductor_hold_time(conductor, page, member):
    own, other = bus(page), bus(page)
    of_another_process(page, other)
    member.idle()
    send(other)
    assert conductor.quiet() is None
    own.take_next()
    assert conductor.quiet() == FOREVER


def test_a_frame_may_be_read_before_its_sender_counts_it(conductor, page, member):
    own, other = bus(page), bus(page)
    of_another_process(page, other)
    member.idle()
    own.take_next()
    send(other)
    assert not own.pending and conductor.quiet() == FOREVER
    send(other)
    assert conductor.quiet() is None


def test_frames_that_were_no_longer_waited_for_hide_no_later_ones(conductor, page, member):
    own, other = bus(page), bus(page)
    of_another_process(page, other)
    member.idle()
    send(other)
    own.catch_up()  # it seemed lost
    own.take_next()  # and came after all
    conductor.quiet()
    conductor.move(START_NS + MS)
    conductor.quiet()
    own.take_next()
    conductor.move(START_NS + 2 * MS)
    send(other)
    assert conductor.quiet() is None


def test_two_threads_of_a_process_count_each_frame(page):
    """The loop sends while another thread transfers by SDO: a lost count lets time pass a frame."""
    near, far = bus(page), bus(page)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [
            threading.Thread(target=lambda: [far.count() for _ in range(5000)]) for _ in range(2)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert page.sent[far.row] == 10_000
    assert near.pending


def test_an_end_that_goes_takes_its_count_with_it(conductor, page, member):
    one, other = bus(page), bus(page)
    member.idle()
    send(other)
    one.take_next()
    other.close()
    third = bus(page)
    assert not one.pending
    send(third)
    assert one.pending


def test_what_an_end_that_goes_left_holds_nothing(conductor, page, member):
    one, other, third = bus(page), bus(page), bus(page)
    of_another_process(page, other, third)
    member.idle()
    for end in (other, other, third):
        send(end)
    one.take_next()
    assert conductor.quiet() is None
    other.close()
    assert not one.pending and conductor.quiet() == FOREVER
    send(third)
    assert one.pending


def test_one_taken_while_its_sender_left_hides_no_later_one(conductor, page, member):
    one, other, third = bus(page), bus(page), bus(page)
    member.idle()
    send(other)
    other.close()
    page.taken[one.row] += 1  # its owner counted at the same moment
    conductor.quiet()
    conductor.move(START_NS + MS)
    send(third)
    assert one.pending


def test_a_message_holds_time_for_who_waits_and_keeps_up(conductor, page, member, wait_until):
    publisher, end = topic(page)
    of_another_process(page, publisher, end)
    member.idle()
    publisher.count()
    assert not end.pending, "it has not kept up yet"
    end.take(1)
    publisher.count()
    assert end.pending
    assert conductor.quiet() == FOREVER, "nobody waits for it now"
    waiting = Waiting(page, START_NS + MS, end)
    waiting.join()
    assert waiting.reached_ns == START_NS
    end.take(2)
    again = Waiting(page, START_NS + MS, end)
    waiting.member.idle()
    assert quiet(conductor, wait_until) == START_NS + MS
    send(publisher)
    again.join()
    assert again.reached_ns == START_NS


def test_a_message_is_settled_when_time_has_moved(conductor, page, member):
    publisher, end = topic(page)
    member.idle()
    publisher.count()
    end.take(1)
    assert end.is_early and not end.unsettled
    conductor.move(START_NS + MS)
    assert not end.is_early
    publisher.count()
    assert end.pending and not end.unsettled
    conductor.move(START_NS + 2 * MS)
    assert end.unsettled
    end.take(2)
    assert not end.unsettled and not end.is_early


def test_requests_of_all_clients_hold_time(conductor, page, member):
    served = End(page, "request /node")
    clients = [End(page, "request /node", sends=True) for _ in range(2)]
    served.hold(member.row)
    member.idle()
    for client in clients:
        client.count()
        assert conductor.quiet() is None
        served.catch_up()
        assert conductor.quiet() == FOREVER


@pytest.mark.parametrize("taken_meanwhile", [False, True])
def test_a_pause_holds_no_time_and_forgets_no_message(conductor, page, member, taken_meanwhile):
    publisher, end = topic(page, "requests")
    end.hold(member.row)
    member.idle()
    publisher.count()
    with end.paused():
        assert conductor.quiet() == FOREVER
        if taken_meanwhile:
            end.catch_up()
    assert end.pending is not taken_meanwhile
    assert (conductor.quiet() is None) is not taken_meanwhile


def test_who_is_given_up_stays_so_after_a_pause(page, member):
    publisher, end = topic(page, "requests")
    end.hold(member.row)
    publisher.count()
    end.stop_following()
    with end.paused():
        pass
    assert not end.pending


def test_a_publisher_that_starts_anew_is_counted_on(page):
    publisher, end = topic(page)
    for number in (1, 2, 3):
        publisher.count()
        end.take(number)
    publisher.close()
    assert end.is_orphaned
    again = End(page, "topic", sends=True, numbered=True)
    again.count()
    assert end.pending
    end.take(1)
    assert not end.pending


def test_a_second_publisher_does_not_hold_time(page):
    publisher, end = topic(page)
    second = End(page, "topic", sends=True, numbered=True)
    publisher.count()
    end.take(1)
    second.count()
    assert not end.pending
    for number in (7, 2**40, 0):
        end.take(number)
        assert not end.pending
    publisher.count()
    assert end.pending


# Who dies, hangs or joins ---------------------------------------------------------------------


def test_who_hangs_is_given_up_and_waited_for_again(conductor, page, member, told, wait_until):
    def given_up():
        conductor.look()
        conductor.sleep(0.05)
        return conductor.quiet() is not None

    wait_until(given_up)
    assert "member" in told[0] and conductor.given_up == 1
    thread = threading.Thread(target=lambda: member.wait(START_NS + 3 * MS))
    thread.start()
    wait_until(lambda: conductor.quiet() == START_NS + 3 * MS)
    move(conductor, START_NS + 3 * MS)
    thread.join(10.0)
    assert conductor.quiet() is None, "he follows again"


def _hold(name: str, work) -> None:
    Member(Page(name), "busy one", never)
    while True:
        work()


@pytest.mark.parametrize(
    ("work", "starved_s"), [(lambda: None, 1.5), (signal.pause, 60.0)]
)
def test_who_could_run_has_more_time_than_who_hangs(
    conductor, page, name, told, wait_until, monkeypatch, work, starved_s
):
    """On a host of many virtual machines a process stood still for over a second."""
    monkeypatch.setattr("screw_module_ros.lockstep.conductor.PATIENCE_S", 0.3)
    monkeypatch.setattr("screw_module_ros.lockstep.conductor.STARVED_S", starved_s)
    process = multiprocessing.get_context("fork").Process(target=_hold, args=(name, work))
    process.start()
    try:
        wait_until(lambda: "busy one" in [page.name(row) for row in range(4)], 30.0)
        begun = time.monotonic()

        def given_up() -> bool:
            conductor.look()
            conductor.sleep(0.05)
            return conductor.quiet() is not None

        wait_until(given_up, 30.0)
        assert "busy one" in told[0]
        if starved_s < 10.0:
            assert time.monotonic() - begun > starved_s
    finally:
        process.kill()
        process.join()


def test_who_declares_himself_content_does_not_keep_who_hangs(
    conductor, page, member, told, wait_until
):
    """The loop of a node that is not active does so 20 times a second."""
    idler = Member(page, "idler", never)

    def given_up():
        idler.idle()
        conductor.look()
        conductor.sleep(0.05)
        return conductor.quiet() is not None

    wait_until(given_up)
    assert "member" in told[0] and "idler" not in told[0]


def _join_and_die(name: str) -> None:
    page = Page(name)
    Member(page, "short-lived", never)
    bus(page)
    End(page, "topic")
    os._exit(1)


def test_who_dies_is_not_waited_for(conductor, page, name, wait_until):
    process = multiprocessing.get_context("fork").Process(target=_join_and_die, args=(name,))
    process.start()
    wait_until(lambda: "short-lived" in [page.name(row) for row in range(4)], 30.0)
    process.join()
    roster = page.roster

    def dismissed():
        conductor.look()
        conductor.sleep(0.05)
        return conductor.quiet() == FOREVER

    wait_until(dismissed)
    assert page.roster > roster
    assert not any(page.thread_pid) and not any(page.end_pid)


def test_without_a_conductor_time_stands_still_and_that_is_said(page):
    waiting = Member(page, "loop", never, patience_s=0.05)
    with pytest.raises(TimeStandsStill, match="no sim_rig runs"):
        waiting.wait(START_NS + MS)


def test_two_conductors_are_refused(conductor, page, monkeypatch):
    with page.locked():
        page.conductor = os.getppid()
    with pytest.raises(ConductorExists, match=str(os.getppid())):
        Conductor(page, 1.0, print)
    page.conductor = 0


def test_a_full_table_is_told(page):
    for _ in range(THREADS):
        Member(page, "one more", never)
    with pytest.raises(TableFull, match="thread"):
        Member(page, "one too many", never)


def _take_rows(page: Page, count: int) -> None:
    sys.setswitchinterval(1e-6)
    threads = [
        threading.Thread(target=lambda: [Member(page, "one more", never) for _ in range(count)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def test_threads_of_several_processes_take_rows_of_their_own(page, name):
    fork = multiprocessing.get_context("fork")
    for _ in range(20):
        child = fork.Process(target=lambda: _take_rows(Page(name), THREADS // 8))
        child.start()
        interval = sys.getswitchinterval()
        try:
            _take_rows(page, THREADS // 8)
        finally:
            sys.setswitchinterval(interval)
            child.join()
        assert all(page.thread_pid)
        page.dismiss(child.pid)
        page.dismiss(os.getpid())


def test_a_page_is_kept_for_a_process_that_only_has_it_open(page, name):
    other = Page(name)
    Member(other, "gone at once", never)
    other.close()
    assert page.path.exists()


def test_pages_that_killed_processes_left_are_swept(monkeypatch, tmp_path):
    monkeypatch.setattr("screw_module_ros.lockstep.page._FOLDER", tmp_path)
    kept = Page("7")
    Member(kept, "alive", never)
    fork = multiprocessing.get_context("fork")
    killed = fork.Process(target=lambda: [Page("77"), Page("77_left"), os._exit(9)])
    killed.start()
    killed.join()
    other = Page("777")
    left = [kept.path.with_name(f"{kept.path.name}7{end}") for end in ("", "_left")]
    assert all(path.exists() for path in left)
    sweep("77")
    assert kept.path.exists() and other.path.exists()
    assert not any(path.exists() for path in left)


def test_time_begins_anew_where_all_were_killed(page, name):
    """A run in such a domain began with the time of the last one: two runs were not the same."""
    fork = multiprocessing.get_context("fork")
    for among, begins_ns in ((f"{name}_left", START_NS), (name, 2 * START_NS)):
        # It ends without closing its page, as a killed one does.
        killed = fork.Process(target=lambda at=among: setitem(Page(at).header, NOW, 2 * START_NS))
        killed.start()
        killed.join()
        found = Page(among)
        assert found.header[NOW] == begins_ns, "among the living it goes on"
        found.close()


def test_each_domain_and_namespace_has_its_own_time():
    names = [("0", ""), ("1", ""), ("1", "/left"), ("1", "/left/arm"), ("11", "")]
    names += [("1", "/left_arm"), ("1", "/left_")]
    assert len({page_name(*each) for each in names}) == len(names)
    assert page_name("", "/") == page_name("0", "")


# Several processes ----------------------------------------------------------------------------


def _tick(name: str, period_ns: int, ticks: int) -> None:
    page = Page(name)
    member = Member(page, f"every {period_ns}", never)
    for number in range(1, ticks + 1):
        due_ns = START_NS + number * period_ns
        member.wait(due_ns)
        if page.header[NOW] != due_ns:
            os._exit(2)  # it ran away, or came too early
    page.close()


def test_processes_with_different_periods_all_see_each_of_their_ticks(conductor, page, name):
    fork = multiprocessing.get_context("fork")
    periods = (MS, MS, 2 * MS, 700_000)
    processes = [fork.Process(target=_tick, args=(name, p, 700 * MS // p)) for p in periods]
    with page.locked():  # time must not begin before all are there
        hold = page.take(page.thread_pid, "hold")
    page.until[hold] = 0
    for process in processes:
        process.start()
    while sum(pid != 0 for pid in page.thread_pid) < len(periods) + 1:
        conductor.look()
        conductor.sleep(0.01)
        assert all(process.is_alive() for process in processes)
    page.until[hold] = FOREVER
    while any(process.is_alive() for process in processes):
        conductor.look()
        due_ns = conductor.quiet()
        if due_ns is not None and due_ns < FOREVER:
            move(conductor, due_ns)
        else:
            conductor.sleep(0.01)
    assert [process.exitcode for process in processes] == [0] * len(periods)
    assert page.header[NOW] == START_NS + 700 * MS


def test_to_be_idle_again_is_no_progress():
    page = Page(f"test_idle_{os.getpid()}")
    try:
        member = Member(page, "loop", lambda: False)
        member.idle()
        declared = page.waits[member.row]
        member.idle()
        assert page.waits[member.row] == declared
        member.busy()
        member.idle()
        assert page.waits[member.row] == declared + 1
    finally:
        page.close()


def test_who_was_idle_holds_time_even_when_its_wait_is_over_at_once(page, conductor):
    member = Member(page, "loop", lambda: False)
    member.idle()
    conductor.move(3_000_000)
    member.wait(1_000_000)
    assert conductor.quiet() is None
    member.leave()
