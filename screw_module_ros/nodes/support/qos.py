# SPDX-License-Identifier: Apache-2.0
"""Quality of service of the graph's topics (design: samples best effort, commands reliable)."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _keep_last(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )


SAMPLE = _keep_last(1, ReliabilityPolicy.BEST_EFFORT)
"""Samples at the tick rate: only the newest is of use, a lost one is counted by its sequence."""

COMMAND = _keep_last(1, ReliabilityPolicy.RELIABLE)
"""Commands and permissions: delivered, and only the newest counts."""

NEWEST = COMMAND
"""What the hot loop subscribes states with: a deeper queue would hand out old ones first."""

STATE = _keep_last(10, ReliabilityPolicy.RELIABLE)
"""States at 50 to 200 Hz: reliable, so that clients with default settings receive them."""

PERMISSION = _keep_last(10, ReliabilityPolicy.RELIABLE)
"""What the drives take safety_state with: each refusal counts, also one that others talk over."""
