# SPDX-License-Identifier: Apache-2.0
"""Whether a sample or a command can be trusted."""

from __future__ import annotations

import math

from anything import MS, START_NS, absurd, fixed, near, stamps
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from screw_module_ros.safety.checks import (
    LARGEST_COMMAND,
    Stream,
    VerticalChecks,
    WatchSettings,
    command_flaw,
)
from screw_module_ros.safety.latch import Latch
from screw_module_ros.samples import EncoderReading, ForceReading

#: How far the number of a sample is off that of its tick.
numbers = st.one_of(st.sampled_from((0, 0, 0, 0, 1, -1)), st.integers(-(2**33), 2**33))


def numbered(stamp: int, off: int) -> int:
    return (stamp // MS + off) & 0xFFFFFFFF
waits = st.integers(0, 8 * MS)


class Commands(RuleBasedStateMachine):
    """Commands in any order: what is acted upon is new, finite and possible."""

    def __init__(self):
        super().__init__()
        self.fault = Latch()
        self.stream = Stream("force command", MS, self.fault)
        self.now_ns, self.newest_ns = START_NS, None

    @rule(off=numbers, age=stamps, force=st.one_of(near(-65.0, 65.0), absurd), wait=waits)
    def command(self, off, age, force, wait):
        self.now_ns += wait
        stamp = self.now_ns + age
        fault = self.fault.reason
        newer = self.stream.accept(numbered(stamp, off), stamp, self.now_ns)
        if newer:
            assert stamp <= self.now_ns + MS and (off + 1) % 2**32 <= 2
            assert self.newest_ns is None or stamp > self.newest_ns
        possible = math.isfinite(force) and abs(force) <= LARGEST_COMMAND
        assert bool(command_flaw(force)) != possible
        assert not fault or self.fault.reason == fault  # the first reason stays
        self.newest_ns = self.stream.monotonic_ns or self.newest_ns

    @rule()
    def reset(self):
        self.fault.clear()
        self.stream.restart()


class Samples(RuleBasedStateMachine):
    """Samples of both sensors in any order: a fault stays, and what is let through is possible."""

    def __init__(self):
        super().__init__()
        self.settings = WatchSettings()
        self.watch = VerticalChecks(self.settings, MS)
        self.now_ns, self.heard_ns = START_NS, {}

    def step(self, off, age, wait):
        self.now_ns += wait
        self.fault = self.watch.fault.reason
        return numbered(self.now_ns + age, off), self.now_ns + age, 0

    def judge(self, stream, accepted, stamp, values):
        assert not self.fault or self.watch.fault.reason == self.fault
        if stamp <= self.now_ns + MS:
            self.heard_ns[stream] = max(stamp, self.heard_ns.get(stream, stamp))
        if not accepted:
            return
        assert all(math.isfinite(value) for value in values)
        reason = self.watch.check(self.now_ns)
        if self.now_ns - stamp > self.settings.stale_periods * MS:
            assert reason

    @rule(off=numbers, age=stamps, wait=waits, position=near(-0.02, 0.38),
          velocity=near(-1.2, 1.2), homed=st.sampled_from((True, True, False)))  # fmt: skip
    def encoder(self, off, age, wait, position, velocity, homed):
        begin = self.step(off, age, wait)
        sample = EncoderReading(*begin, 0, position, velocity, homed)
        accepted = self.watch.encoder(sample, self.now_ns)
        self.judge("encoder", accepted, begin[1], (position, velocity))
        bounds = self.settings
        inside = abs(velocity) <= bounds.speed and bounds.lowest <= position <= bounds.highest
        if accepted and not (homed and inside):
            assert self.watch.check(self.now_ns)

    @rule(off=numbers, age=stamps, wait=waits, wrench=st.tuples(*[near(-160.0, 160.0)] * 6),
          status=st.one_of(st.just(0), st.integers(0, 0xFFFF)))  # fmt: skip
    def force(self, off, age, wait, wrench, status):
        begin = self.step(off, age, wait)
        accepted = self.watch.force(ForceReading(*begin, *wrench, status), self.now_ns)
        self.judge("force", accepted, begin[1], wrench)

    @rule(wait=st.integers(0, 20 * MS))
    def silence(self, wait):
        self.now_ns += wait
        fault = self.watch.fault.reason
        reason = self.watch.check(self.now_ns)
        assert not fault or reason == fault
        old = [ns for ns in self.heard_ns.values() if self.now_ns - ns > 5 * MS]
        if old or len(self.heard_ns) < 2:
            assert reason

    @rule()
    def reset(self):
        self.watch.reset(self.now_ns)


TestCommands = Commands.TestCase
TestCommands.settings = fixed(30, 30)
TestSamples = Samples.TestCase
TestSamples.settings = fixed(30, 30)
