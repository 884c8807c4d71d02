# SPDX-License-Identifier: Apache-2.0
"""`endpoint_state` calls the same samples valid as the control path does."""

from __future__ import annotations

import math

import pytest
from screw_module_msgs.msg import EndpointState

from screw_module_ros.nodes.endpoint_state import _fill_force, _fill_vertical
from screw_module_ros.safety.checks import VerticalChecks, WatchSettings
from screw_module_ros.samples import EncoderReading, ForceReading

PERIOD_NS = 1_000_000
FORCE = ForceReading(1, PERIOD_NS, PERIOD_NS, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0)
ENCODER = EncoderReading(1, PERIOD_NS, PERIOD_NS, 0, 0.1, 0.0, True)


@pytest.mark.parametrize("change", [
    *({"status": 1 << bit} for bit in range(16)), {"fx": math.nan}, {"tz": math.inf}, {},
])  # fmt: skip
def test_a_force_sample(change):
    sample, message = FORCE._replace(**change), EndpointState()
    checks = VerticalChecks(WatchSettings(), PERIOD_NS)
    used = checks.force(sample, PERIOD_NS) and not checks.fault.reason
    _fill_force(message, sample)
    assert message.force_valid == used
    assert math.isfinite(message.force.z) == used


@pytest.mark.parametrize("change", [{"position": math.nan}, {"velocity": math.inf}, {}])
def test_an_encoder_sample(change):
    sample, message = ENCODER._replace(**change), EndpointState()
    used = VerticalChecks(WatchSettings(), PERIOD_NS).encoder(sample, PERIOD_NS)
    _fill_vertical(message, sample)
    assert message.valid[2] == used
    assert math.isfinite(message.position.z) == math.isfinite(message.velocity.z) == used
