# SPDX-License-Identifier: Apache-2.0
"""Quality of service of the graph's topics: samples best effort, commands reliable."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _keep_last(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )


SAMPLE = _keep_last(1, ReliabilityPolicy.BEST_EFFORT)
"""Samples at the tick rate: only the newest is useful; the sequence shows a lost one."""

COMMAND = _keep_last(1, ReliabilityPolicy.RELIABLE)
"""Commands and permissions: reliable, and only the newest counts."""

NEWEST = COMMAND
"""For the hot loop's subscriptions of states: a deeper queue would return old ones first."""

STATE = _keep_last(10, ReliabilityPolicy.RELIABLE)
"""States at 50 to 200 Hz: reliable, so that clients with default settings receive them."""

EACH_STATE = _keep_last(200, ReliabilityPolicy.RELIABLE)
"""For a subscription that counts each state: a second at 200 Hz, in which its process may pause."""

PERMISSION = _keep_last(10, ReliabilityPolicy.RELIABLE)
"""For the drives' subscriptions of safety_state: each refusal counts, also an overwritten one."""
