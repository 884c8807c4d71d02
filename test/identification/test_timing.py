# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from screw_module_ros.identification.timing import timing

SECOND = 1_000_000_000


def test_counts_are_those_of_the_stretch():
    found = timing(
        time_ns=np.array([10, 11, 12]) * SECOND,
        commands=np.array([5000, 5990, 6980]),
        late=np.array([7, 8, 17]),
        lost=np.array([100, 110, 120]),
        p50=np.array([200e-6, 220e-6, 240e-6]),
        p99=np.array([400e-6, 900e-6, 500e-6]),
    )
    assert (found.duration, found.rate) == (2.0, 990.0)
    assert (found.commands, found.late, found.lost) == (1980, 10, 20)
    assert found.in_time == pytest.approx(1970 / 2000)
    assert (found.p50, found.p99, found.worst_p99) == (220e-6, 500e-6, 900e-6)


def states(**change):
    two = np.array([0, 1])
    given = dict.fromkeys(("time_ns", "commands", "late", "lost", "p50", "p99"), two)
    return timing(**{**given, **change})


def test_a_restarted_node_is_noticed():
    with pytest.raises(ValueError, match="count of late decreases"):
        states(late=np.array([3, 0]))


def test_unsigned_counters_fall_too():
    with pytest.raises(ValueError, match="count of lost decreases"):
        states(lost=np.array([3, 0], np.uint64))


def test_one_state_says_nothing():
    with pytest.raises(ValueError, match="at least two"):
        timing(*[np.array([1])] * 6)


def test_without_ticks_there_is_no_share():
    assert np.isnan(states(commands=np.array([0, 0]), lost=np.array([0, 0])).in_time)
