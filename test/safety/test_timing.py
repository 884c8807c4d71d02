# SPDX-License-Identifier: Apache-2.0
"""The meter counts late, lost and missed-in-a-row, its second forgets, its histogram does not."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.safety.timing import BIN_NS, DeadlineMeter, quantile

PERIOD_NS = 1_000_000


def run(latencies_ns, first=0):
    """Meter after one tick per entry; None stands for a tick that never came."""
    meter = DeadlineMeter(PERIOD_NS)
    for tick, latency_ns in enumerate(latencies_ns, first):
        if latency_ns is not None:
            meter.tick(tick, tick * PERIOD_NS, tick * PERIOD_NS + latency_ns)
    return meter


def test_in_time_at_the_deadline_and_late_behind_it():
    assert run([PERIOD_NS]).late == 0
    assert run([PERIOD_NS + 1]).late == 1


def test_counts():
    meter = run([100, None, None, 100, 2_000_000, 100, 2_000_000, None, 2_000_000])
    assert (meter.samples, meter.late, meter.lost) == (6, 3, 3)
    assert meter.consecutive_missed == 3
    assert meter.success_rate == pytest.approx(1.0 - 6 / 1000)


def test_a_tick_in_time_ends_the_row():
    assert run([2_000_000] * 5 + [100]).consecutive_missed == 0


def test_the_share_covers_the_last_thousand_ticks_only():
    meter = run([2_000_000] * 500 + [100] * 999)
    assert meter.success_rate == pytest.approx(0.999)
    assert meter.late == 500


def test_a_huge_gap_counts_whole_and_costs_little():
    meter = DeadlineMeter(PERIOD_NS)
    meter.tick(0, 0, 0)
    meter.tick(2**31 - 1, PERIOD_NS, PERIOD_NS)
    assert meter.lost == 2**31 - 2
    assert meter.success_rate == pytest.approx(1 / 1000)


def test_repeated_and_older_ticks_are_ignored():
    meter = run([100, 100])
    meter.tick(1, PERIOD_NS, 9 * PERIOD_NS)
    meter.tick(0, 0, 9 * PERIOD_NS)
    assert (meter.samples, meter.late, meter.lost) == (2, 0, 0)


def test_numbers_of_a_foreign_sender_are_left_behind():
    """Ticks acquired later count, whatever somebody's number from the future was."""
    meter = run([100, 100])
    meter.tick(1_000_000, 2 * PERIOD_NS, 2 * PERIOD_NS)
    samples, lost = meter.samples, meter.lost
    meter.tick(3, 3 * PERIOD_NS, 3 * PERIOD_NS + 100)
    assert (meter.samples, meter.lost, meter.consecutive_missed) == (samples + 1, lost, 0)


def test_the_number_wraps():
    meter = DeadlineMeter(PERIOD_NS)
    meter.tick(2**32 - 1, 0, 0)
    meter.tick(0, PERIOD_NS, PERIOD_NS)
    assert (meter.samples, meter.lost) == (2, 0)


def test_silence_counts_as_missed_once_the_next_deadline_is_over():
    meter = run([100], first=10)
    at = 10 * PERIOD_NS
    assert meter.missed_in_a_row(at + 2 * PERIOD_NS - 1) == 0
    assert meter.missed_in_a_row(at + 2 * PERIOD_NS) == 1
    assert meter.missed_in_a_row(at + 21 * PERIOD_NS) == 20


def test_rate_and_latency_of_the_last_second():
    meter = run([900_000] * 1000 + [100_000] * 500 + [300_000] * 490 + [700_000] * 10)
    assert meter.latency(0.5) == pytest.approx(3e-4)  # each tick forgets, unasked
    assert meter.latency(1.0) == pytest.approx(9e-4)  # of the tick 999.3 ms ago
    assert meter.rate(2000 * PERIOD_NS) == 1000
    assert meter.rate(2000 * PERIOD_NS + 100_000) == 999
    assert meter.latency(0.25) == pytest.approx(1e-4)
    assert meter.latency(0.5) == pytest.approx(3e-4)
    assert meter.latency(0.995) == pytest.approx(7e-4)
    assert meter.rate(4000 * PERIOD_NS) == 0.0
    assert meter.latency(0.5) == 0.0


@given(st.lists(st.one_of(st.none(), st.integers(0, 3_000_000)), max_size=100))
def test_samples_and_lost_make_up_all_ticks(latencies_ns):
    meter = run(latencies_ns)
    seen = [i for i, latency in enumerate(latencies_ns) if latency is not None]
    assert meter.samples == len(seen)
    assert meter.lost == (seen[-1] - seen[0] + 1 - len(seen) if seen else 0)
    assert meter.late == sum(1 for i in seen if latencies_ns[i] > PERIOD_NS)
    assert meter.success_rate == pytest.approx(1 - (meter.late + meter.lost) / 1000)


def test_the_histogram_keeps_what_the_second_forgets():
    meter = run([100_000] * 9000 + [300_000] * 990 + [900_000] * 10)
    assert sum(meter.histogram) == meter.samples == 10_000
    assert quantile(meter.histogram, 0.5) == pytest.approx(1e-4, abs=1.01e-9 * BIN_NS)
    assert quantile(meter.histogram, 0.99) == pytest.approx(3e-4, abs=1.01e-9 * BIN_NS)
    assert quantile(meter.histogram, 0.9995) == pytest.approx(9e-4, abs=1.01e-9 * BIN_NS)


def test_a_quantile_is_never_told_too_small():
    assert quantile(run([7_000]).histogram, 0.5) == pytest.approx(10e-6)
    assert quantile(run([0, 0, 60_000_000]).histogram, 0.99) == math.inf
    assert quantile(run([]).histogram, 0.99) == 0.0
