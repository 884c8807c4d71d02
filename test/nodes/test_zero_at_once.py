# SPDX-License-Identifier: Apache-2.0
"""A sample that cannot be gets a zero at once, in its own process and in `module`; no graph."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import SafetyState
from wired import Topics

from screw_module_ros.clock import ManualClock
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.nodes.support.topics import Newest
from screw_module_ros.nodes.support.wire import COMMAND
from screw_module_ros.samples import EncoderReading, ForceReading

MS = 1_000_000


class Axis:
    """A controller node that has a force out, its messages, and the time."""

    def __init__(self, node):
        self.ends = Topics(node)
        node.connect()
        node.begin()
        self.node = node
        self.tick = 100

    @property
    def told(self) -> list:
        """Tick and force of each command."""
        return [COMMAND.unpack(data)[:3:2] for data in self.ends.told["screw/force_command"]]

    @property
    def now(self) -> int:
        return self.tick * MS + 200_000

    def sample(self, position: float = 0.18) -> EncoderReading:
        self.tick += 1
        return EncoderReading(self.tick, self.tick * MS, 7, 0, position, 0.0, True)

    def force(self) -> ForceReading:
        return ForceReading(self.tick, self.tick * MS, 7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


@pytest.fixture
def axis(make_node):
    made = Axis(make_node("impedance_controller"))
    for _ in range(700):
        sample = made.sample()
        made.node.role.on_drive(True, 0.0, made.now)
        made.node.role.on_force(made.force(), made.now)
        output = made.node.role.on_encoder(sample, made.now)
    assert output.force > 5.0
    yield made
    made.node.close()


def step(axis, sample) -> None:
    """One step of the node's loop with that sample on the topic."""
    wires = Wires(take_sample=lambda until_ns: sample, publish_command=axis.node.publish_command)
    loop = VerticalLoop(ManualClock(axis.now), MS, wires)
    loop.step(Roles(controller=axis.node.role))


def test_the_node_sends_zero_for_a_sample_that_is_no_number(axis):
    step(axis, axis.sample(math.nan))
    assert axis.told == [(axis.tick - 1, 0.0)], "with the sample it last answered"
    assert "not a finite number" in axis.node.role.reason
    step(axis, axis.sample(math.nan))
    assert len(axis.told) == 1


def test_the_node_goes_on_after_a_repeated_sample(axis):
    step(axis, axis.node.role.answered)
    assert axis.told == [] and axis.node.role.reason == ""


def act_and_publish(axis, sample):
    """One period of `module`'s loop with that sample; return what the drive was given."""
    given = []
    encoder = SimpleNamespace(
        begin=lambda tick: None, answer=lambda until_ns: sample, end=lambda: None
    )
    drive = SimpleNamespace(
        begin=lambda tick: None,
        act=lambda sequence, stamp, force, now, mode, _number: given.append((sequence, force)),
        end=lambda tick, permission: None,
        permit=SimpleNamespace(enabled=True),
        position=0.0,
        brakes=False,
    )
    loop = VerticalLoop(ManualClock(axis.now), MS, Wires(publish_command=axis.node.publish_command))
    loop.step(Roles(encoder, None, axis.node.role, drive))
    return given


def test_module_writes_zero_for_a_sample_that_is_no_number(axis):
    given = act_and_publish(axis, axis.sample(math.nan))
    assert given == axis.told == [(axis.tick - 1, 0.0)]


def test_module_writes_zero_when_samples_cease(axis):
    axis.tick += 10
    given = act_and_publish(axis, None)
    assert given == axis.told == [(axis.tick - 10, 0.0)]
    assert act_and_publish(axis, None) == []


# The supervisor's counter of resets ----------------------------------------------------------


@pytest.fixture
def supervised(axis, monkeypatch):
    """Return `supervised(resets)`: the node has heard that count and reads its inputs 10 ms on."""
    safety = SafetyState()
    monkeypatch.setattr(Newest, "fresh", lambda newest, now_ns: safety)

    def read(resets: int) -> None:
        safety.resets = resets
        for _ in range(10):
            axis.node.role.on_encoder(axis.sample(), axis.now)
            axis.node.role.on_force(axis.force(), axis.now)
        axis.node.read_inputs(axis.now)

    return read


def test_only_a_rise_of_the_counter_resets(axis, supervised):
    """A supervisor that was started anew counts from 0: no reset that anybody asked for."""
    axis.node.role.on_encoder(axis.sample(math.nan), axis.now)
    assert axis.node.role.faulted
    for resets, faulted in ((3, True), (3, True), (0, True), (0, True), (1, False)):
        supervised(resets)
        assert axis.node.role.faulted is faulted, resets


def test_a_reset_is_read_with_the_inputs_however_rarely_the_state_is_published(axis, supervised):
    supervised(3)
    axis.node.role.on_encoder(axis.sample(math.nan), axis.now)
    supervised(3)
    axis.node.publish_state(axis.now)  # the first one is due at once
    assert axis.node.role.faulted
    supervised(4)
    assert not axis.node.role.faulted
