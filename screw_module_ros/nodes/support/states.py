# SPDX-License-Identifier: Apache-2.0
"""What nodes show of themselves alike: permit, timing contract, rates; times in [ns].

Each node fills its state message in its loop. In the diagnostics, which another thread makes, rates
and latencies come from the newest state message: the loop owns the meter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from screw_module_ros.safety.timing import (
    BIN_NS,
    LEAST_SUCCESS,
    DeadlineMeter,
    histogram_text,
    quantile,
)

if TYPE_CHECKING:  # not every node has drives: without one, no bus is imported
    from screw_module_ros.safety.permit import Permit

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_SHARES = (0.5, 0.99, 0.999)


class Health(NamedTuple):
    """One entry on /diagnostics: level, message and named values."""

    level: bytes
    message: str
    values: dict

    def status(self, node: str, hardware_id: str) -> DiagnosticStatus:
        """Return the entry as a message; node: its full name."""
        return DiagnosticStatus(
            level=self.level,
            name=node.lstrip("/"),
            message=self.message,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=str(value)) for key, value in self.values.items()],
        )


def at_base(kind: Any, **values: Any) -> Any:
    """Return a message of this class in the robot's frame, with values of its fields."""
    return kind(header=Header(frame_id="manus_base"), **values)


def fill_permit(message: Any, permit: Permit) -> None:
    """Write whether torque may pass, and why not, into the state message of a node with drives."""
    message.enabled, message.faulted = permit.enabled, permit.faulted
    message.reason = permit.reason


def fill_counts(message: Any, meter: DeadlineMeter, now_ns: int) -> None:
    """Write rate and missed deadlines at now_ns [ns] into a state message."""
    message.rate = meter.rate(now_ns)
    message.late, message.lost = meter.late, meter.lost
    message.success_rate = meter.success_rate


def fill_latencies(message: Any, meter: DeadlineMeter, now_ns: int) -> None:
    """Write rate, latencies and missed deadlines at now_ns [ns] into a state message."""
    fill_counts(message, meter, now_ns)
    message.latency_p50, message.latency_p99 = meter.latency(0.5), meter.latency(0.99)
    message.consecutive_missed = meter.missed_in_a_row(now_ns)


def histogram_key(name: str) -> str:
    """Return the key of a histogram in the diagnostics."""
    return f"{name} histogram [{BIN_NS // 1000} us]"


def latency_values(name: str, histogram: list[int]) -> dict[str, object]:
    """Return the diagnostics of the latencies since the activation: quantiles and histogram."""
    histogram = histogram.copy()
    text = "/".join(f"{quantile(histogram, share) * 1e6:.0f}" for share in _SHARES)
    return {
        f"{name} p50/p99/p99.9 since activation [us]": text,
        histogram_key(name): histogram_text(histogram),
    }


def timing_values(state: Any, meter: DeadlineMeter) -> dict[str, object]:
    """Return the timing part of the diagnostics: of the last second, and since the activation.

    state: the newest AmplifierState or ImpedanceState.
    """
    return {
        "rate [1/s]": f"{state.rate:.0f}",
        "latency p50 [us]": f"{state.latency_p50 * 1e6:.0f}",
        "latency p99 [us]": f"{state.latency_p99 * 1e6:.0f}",
        "late": state.late,
        "lost": state.lost,
        "missed in a row": state.consecutive_missed,
        "success rate": f"{state.success_rate:.3f}",
        **latency_values("latency", meter.histogram),
    }


def broken_contract(state: Any) -> str:
    """Return the warning about missed deadlines, empty while the contract holds.

    state: the newest AmplifierState, ImpedanceState or PlanarState.
    """
    if state.success_rate >= LEAST_SUCCESS:
        return ""
    return (
        f"deadlines are being missed: {100 * state.success_rate:.1f} % of the last 1000 commands "
        "came in time"
    )


class RateMeter:
    """Turns a counter into a rate, from one diagnostics entry to the next."""

    def __init__(self) -> None:
        self._count = 0
        self._time_ns = 0

    def rate(self, count: int, now_ns: int) -> float:
        """Return events per second since the last call, NaN at the first and after a restart."""
        elapsed = (now_ns - self._time_ns) * 1e-9
        known = self._time_ns and elapsed > 0 and count >= self._count
        rate = (count - self._count) / elapsed if known else math.nan
        self._count, self._time_ns = count, now_ns
        return rate


class Due:
    """Says when the next message of a slower rate is due, at whole multiples of its period.

    rate: messages per second [Hz]. The first one is due at once.
    """

    def __init__(self, rate: float):
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0

    def __call__(self, now_ns: int) -> bool:
        """Return whether a message is due at now_ns [ns]; True counts it as sent."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return True
