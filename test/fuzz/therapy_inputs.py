# SPDX-License-Identifier: Apache-2.0
"""Samples of a hand and wishes of a game that cannot be, into a therapy session."""

from __future__ import annotations

import math
import random
from collections import Counter
from pathlib import Path

from runner import sentence

from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.protocol_file import SHIPPED, load_protocol
from screw_module_ros.therapy.session import Session, State
from screw_module_ros.therapy.wishes import WishGate, WishLimits

_ODD = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 1e6)
_PERIOD_NS = 5_000_000
_STATES = (State.RUNNING, State.PAUSED, State.FINISHED, State.ABORTED)


class TherapyInputs:
    """One case: a session of a shipped protocol that takes 500 samples, and a game's wishes."""

    def __init__(self, folder: Path) -> None:
        self.counts: Counter[str] = Counter()
        self._protocols = [load_protocol(name) for name in SHIPPED]

    def close(self) -> None:
        """Nothing is held."""

    def case(self, rng: random.Random) -> None:
        """Feed a session and the gate of wishes."""
        self._session(rng)
        self._wishes(rng)

    def _session(self, rng: random.Random) -> None:
        session = Session(rng.choice(self._protocols))
        now_ns, sequence = 0, 0
        place = list(session.protocol.centre)
        oddness = rng.choice((0.0, 0.001, 0.05))
        for _ in range(500):
            now_ns += rng.choice((0, -_PERIOD_NS, 10**12)) if rng.random() < oddness else _PERIOD_NS
            sequence = rng.getrandbits(32) if rng.random() < oddness else sequence + 5
            place = [value + rng.uniform(-0.004, 0.004) for value in place]
            values = [*place, *(rng.uniform(-0.3, 0.3) for _ in range(3)),
                      *(rng.uniform(-20, 20) for _ in range(3))]  # fmt: skip
            if rng.random() < oddness:
                values[rng.randrange(9)] = rng.choice(_ODD)
            session.take(HandSample(sequence, now_ns, *values))
            self._look(session)
            if session.state == State.PAUSED and rng.random() < 0.3:
                session.resume()
        self.counts[session.state.word] += 1
        self.counts["trials ended"] += len(session.results)

    def _look(self, session: Session) -> None:
        assert session.state in _STATES
        for slot in (session.wish.plane, session.wish.vertical):
            if slot is not None:
                slot.validated()  # or the control loops would refuse it
        if session.state in (State.PAUSED, State.ABORTED):
            sentence(session.reason)

    def _wishes(self, rng: random.Random) -> None:
        limits = WishLimits()
        gate, now_ns = WishGate(limits), 0
        for _ in range(100):
            now_ns += rng.choice((0, -(10**9), _PERIOD_NS, 10**12))
            wish, hand = (
                tuple(rng.choice((*_ODD, 0.1, -0.1)) for _ in range(3)) for _ in range(2)
            )
            x, y, z = gate.passed(wish, hand, now_ns)
            for value, low, high in (
                (x, -limits.half_width, limits.half_width),
                (y, -limits.half_depth, limits.half_depth),
                (z, limits.low, limits.high),
            ):
                assert math.isnan(value) or low <= value <= high
        self.counts["wishes"] += 100
