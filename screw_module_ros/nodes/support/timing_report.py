# SPDX-License-Identifier: Apache-2.0
"""The timing contract (design section 5) in a node's diagnostics.

Rates and latencies are read from the newest state message: the meter belongs to the hot loop, the
diagnostics are made in another thread.
"""

from __future__ import annotations

from typing import Any

from screw_module_ros.control.timing import BIN_NS, DeadlineMeter, histogram_text, quantile

HISTOGRAM_KEY = f"latency histogram [{BIN_NS // 1000} us]"


def timing_values(state: Any, meter: DeadlineMeter) -> dict[str, object]:
    """Return the timing part of the diagnostics: of the last second, and since the activation.

    state: the newest AmplifierState or ImpedanceState.
    """
    histogram = meter.histogram.copy()
    return {
        "rate [1/s]": f"{state.rate:.0f}",
        "latency p50 [us]": f"{state.latency_p50 * 1e6:.0f}",
        "latency p99 [us]": f"{state.latency_p99 * 1e6:.0f}",
        "latency p99.9 since activation [us]": f"{quantile(histogram, 0.999) * 1e6:.0f}",
        "late": state.late,
        "lost": state.lost,
        "missed in a row": state.consecutive_missed,
        "success rate": f"{state.success_rate:.3f}",
        HISTOGRAM_KEY: histogram_text(histogram),
    }


def broken_contract(state: Any) -> str:
    """Return the warning about deadlines missed."""
    return (
        f"deadlines are being missed: {100 * state.success_rate:.1f} % of the last 1000 commands "
        "came in time"
    )
