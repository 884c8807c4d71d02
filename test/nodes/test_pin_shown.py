# SPDX-License-Identifier: Apache-2.0
"""The lock pin in `endpoint_state` while nobody hears of the supervisor."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import SafetyState


@pytest.fixture
def shown(make_node):
    """Return a function that returns safety and pin as shown at a time [ns]."""
    node = make_node("endpoint_state")
    node.trigger_configure()
    node.trigger_activate()

    def shown_at(now_ns: int) -> tuple[int, bool]:
        node._ticker = SimpleNamespace(
            sleep=lambda: SimpleNamespace(monotonic_ns=now_ns, sequence=1)
        )
        node.step()
        return node._message.safety, node._message.vertical_locked

    shown_at.safety = node._inputs["safety_state"]
    return shown_at


def test_a_pin_does_not_come_out_with_the_supervisor_s_end(shown):
    assert shown(10**9) == (SafetyState.UNKNOWN, False)
    shown.safety.message = SafetyState(level=SafetyState.OK, vertical_locked=True)
    shown.safety.arrival_ns = 2 * 10**9
    assert shown(2 * 10**9) == (SafetyState.OK, True)
    assert shown(9 * 10**9) == (SafetyState.UNKNOWN, True)
