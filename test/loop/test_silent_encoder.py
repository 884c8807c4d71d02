# SPDX-License-Identifier: Apache-2.0
"""An encoder that does not answer takes no sample of the force sensor with it."""

from __future__ import annotations

import pytest

from screw_module_ros.trials.one_thread import PERIOD_NS


def test_the_force_sensor_is_read_while_the_encoder_is_silent(bench):
    before = bench.force_sensor.counters["received"]
    bench.rig.inject("encoder", "mute", 0.0, 0.0, bench.now_ns)
    bench.ticks(50)
    assert bench.encoder.counters["missing_in_a_row"] >= 45
    assert bench.force_sensor.counters["received"] - before >= 48


def test_two_silent_sensors_hold_no_tick_up(bench):
    for device in ("encoder", "force_sensor"):
        bench.rig.inject(device, "mute", 0.0, 0.0, bench.now_ns)
    before = bench.now_ns
    bench.ticks(50)
    assert bench.now_ns - before == 50 * PERIOD_NS


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_three_lost_answers_in_a_row_stop_the_robot(enabled, lost):
    """A lost answer costs two more ticks, in which a late one would show (`devices/polled.py`)."""
    enabled.rig.inject("encoder", "drop", 1.0, lost * PERIOD_NS * 1e-9, enabled.now_ns)
    reasons = {row.reason for row in enabled.ticks(50)} - {""}
    assert reasons == ({"no fresh command"} if lost == 3 else set())
    assert enabled.torque_passes == (lost < 3)
    assert enabled.encoder.counters["missing"] == lost + 2
