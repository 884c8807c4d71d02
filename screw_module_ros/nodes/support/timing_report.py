# SPDX-License-Identifier: Apache-2.0
"""The timing contract (`safety/timing.py`) in a node's diagnostics.

Rates and latencies come from the newest state message: the hot loop owns the meter, and another
thread creates the diagnostics.
"""

from __future__ import annotations

from typing import Any

from screw_module_ros.safety.timing import (
    BIN_NS,
    LEAST_SUCCESS,
    DeadlineMeter,
    histogram_text,
    quantile,
)

_SHARES = (0.5, 0.99, 0.999)


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
