# SPDX-License-Identifier: Apache-2.0
"""An encoder that does not answer takes no sample of the force sensor with it."""

from __future__ import annotations


def test_the_force_sensor_is_read_while_the_encoder_is_silent(bench):
    before = bench.force_sensor.counters["received"]
    bench.rig.inject("encoder", "mute", 0.0, 0.0, bench.now_ns)
    bench.ticks(50)
    assert bench.encoder.counters["missing_in_a_row"] >= 45
    assert bench.force_sensor.counters["received"] - before >= 48
