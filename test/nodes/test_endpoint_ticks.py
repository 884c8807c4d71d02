# SPDX-License-Identifier: Apache-2.0
"""`endpoint_state` numbers its messages by its own ticks, whatever the robot's rate."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import EndpointState

from screw_module_ros.clock import ManualClock
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.nodes.endpoint_state import EndpointStateNode
from screw_module_ros.nodes.support.hot_topics import fill_stamp
from screw_module_ros.nodes.therapy_messages import hand_sample
from screw_module_ros.samples import EncoderReading
from screw_module_ros.therapy.line import PLANE
from screw_module_ros.therapy.result import gaps_of

PERIOD_NS = 5_000_000  # 200 Hz


class RigClock(ManualClock):
    """Simulated time, which moves by whole periods of the rig."""

    def __init__(self, period_ns: int):
        super().__init__(10**12)
        self.period_ns = period_ns

    def sleep_until(self, due_ns: int) -> None:
        super().sleep_until(-(-due_ns // self.period_ns) * self.period_ns)


def samples_of(rate: float, count: int, has_encoder: bool = True):
    """Return the hand's samples of a robot that ticks at `rate` [Hz], without ROS's graph."""
    clock, heard = RigClock(round(1e9 / rate)), []

    def encoder(now_ns: int) -> EncoderReading | None:
        tick = now_ns // clock.period_ns
        at_ns = tick * clock.period_ns
        reading = EncoderReading(tick & 0xFFFFFFFF, at_ns, at_ns, 0, 0.1, 0.0, True)
        return reading if has_encoder else None

    message = EndpointState()
    silent = SimpleNamespace(fresh=lambda now_ns: None)
    node = SimpleNamespace(
        _ticker=Ticker(clock, PERIOD_NS, BETWEEN_TICKS_NS),
        _encoder=SimpleNamespace(fresh=encoder),
        _force=silent, _plane=silent, _amplifier=silent, _safety=silent,
        _message=message, _ticks=0,
        stamp=lambda header: fill_stamp(header, clock.stamp_ns()),
        _publish=lambda told: heard.append(hand_sample(told, PLANE)),
        _publish_joints=lambda *given: None,
    )  # fmt: skip
    for _ in range(count):
        EndpointStateNode.step(node)
    return heard


@pytest.mark.parametrize("rate", [250.0, 500.0, 1000.0, 2000.0])
def test_nothing_is_missing_at_a_rate_of_which_its_own_is_no_divisor(rate):
    heard = samples_of(rate, 400)
    assert gaps_of(heard) == ()
    (gap,) = gaps_of(heard[:100] + heard[102:])
    assert gap == (heard[99].sequence, 2)


def test_samples_without_an_encoder_keep_their_order():
    """A replay finds by its number the sample after which a session was paused."""
    numbers = [sample.sequence for sample in samples_of(1000.0, 50, has_encoder=False)]
    assert numbers == list(range(numbers[0], numbers[0] + 50)) and numbers[0] > 0
