# SPDX-License-Identifier: Apache-2.0
"""Order and age of one stream of numbered samples, checked by its receiver."""

from __future__ import annotations

from ..samples import sequence_gap

# Leaky count of samples that are not newer: a single sender repeats a sample now and then; two
# senders on one topic raise the count towards ten.
_REPEATS_KEPT = 0.9
_REPEATS_OF_TWO_SENDERS = 5.0
# A leaky bucket: every sample fills it, accepted or not, and time empties it a little faster than a
# single sender can fill it. If it holds more than a burst of late samples, another sender exists,
# whatever its rate.
_BURST = 10.0
_DRAIN = 1.02


class Stream:
    """Separates new samples from repeated, older and impossible ones.

    seen: a sample was accepted; monotonic_ns: acquisition of the newest one [ns]; fault: why the
    stream cannot be trusted, empty while it can.
    """

    def __init__(self, name: str, period_ns: int):
        """Start without samples; every reason begins with name; period_ns: of the samples [ns]."""
        self.name = name
        self.seen = False
        self.monotonic_ns = 0
        self.fault = ""
        self._period_ns = period_ns
        self._sequence: int | None = None
        self._repeats = 0.0
        self._held, self._seen_ns = 0.0, 0

    def accept(self, sequence: int, monotonic_ns: int, now_ns: int) -> bool:
        """Record a sample received at now_ns [ns]; return whether it is newer than all before."""
        self._count(now_ns)
        if monotonic_ns > now_ns + self._period_ns:
            # A future stamp would stay fresh for ever.
            self.fault = self.fault or f"{self.name}: a sample is stamped in the future"
            return False
        known = self._sequence
        if self.seen and (
            monotonic_ns <= self.monotonic_ns
            or (known is not None and sequence_gap(known, sequence) < 0)
        ):
            self._repeats += 1.0
            if self._repeats >= _REPEATS_OF_TWO_SENDERS:
                self.fault = self.fault or (
                    f"{self.name}: samples repeat or go back; is a second node sending?"
                )
            return False
        self._repeats *= _REPEATS_KEPT
        self.seen, self._sequence, self.monotonic_ns = True, sequence, monotonic_ns
        return True

    def _count(self, now_ns: int) -> None:
        """Note a fault when samples come faster than their period lets one node send them."""
        elapsed = max(0, now_ns - self._seen_ns) / self._period_ns
        self._seen_ns = now_ns
        self._held = max(0.0, self._held - _DRAIN * elapsed) + 1.0
        if self._held > _BURST:
            self.fault = self.fault or (
                f"{self.name}: more samples than one each {self._period_ns / 1e6:g} ms; is a "
                "second node sending, or one with another rate?"
            )

    def check_age(self, now_ns: int, largest_ns: int) -> None:
        """Note a fault when the newest sample is older than largest_ns at now_ns [ns]."""
        age_ns = now_ns - self.monotonic_ns
        if age_ns > largest_ns:
            self.fault = self.fault or f"{self.name}: no sample for {age_ns / 1e6:.1f} ms"

    def reset(self) -> None:
        """Clear the fault and the sequence number, which may be a foreign sender's.

        The time of the newest sample stays.
        """
        self.fault = ""
        self._sequence = None
        self._repeats = self._held = 0.0
