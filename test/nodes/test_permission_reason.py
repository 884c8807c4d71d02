# SPDX-License-Identifier: Apache-2.0
"""Who is refused by `~/enable` reads why, also where the reason is none against all motion."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import SafetyState

from screw_module_ros.loop.requests import Requests
from screw_module_ros.nodes.support.drives import PLANAR, VERTICAL, Permission
from screw_module_ros.safety.permit import Permit, PermitSettings

MS = 1_000_000


def refused(field: str, safety: SafetyState) -> str:
    """Return what `~/enable` says after this safety_state."""
    waiting = [safety]
    inbox = SimpleNamespace(subscribe=lambda *_: lambda: waiting.pop() if waiting else None)
    node = SimpleNamespace(senders=lambda topic: SimpleNamespace(warning=""))
    permit = Permit([], Requests(), PermitSettings(), MS)
    Permission(node, inbox, field).pass_on(permit, MS)
    answer = permit.requests.put(permit.apply_enable)
    permit.step(MS, MS)
    return answer.result(timeout=0.0)


@pytest.mark.parametrize(
    ("field", "safety", "told"),
    [
        (VERTICAL, SafetyState(reasons=["emergency stop"], vertical_locked=True),
         "not permitted: emergency stop"),
        (VERTICAL, SafetyState(motion_permitted=True, planar_permitted=True, vertical_locked=True),
         "not permitted: the vertical axis is locked"),
        (PLANAR, SafetyState(motion_permitted=True, vertical_locked=True),
         "not permitted: the supervisor's parameter `required` does not name"),
        (PLANAR, SafetyState(motion_permitted=True, planar_permitted=True, vertical_locked=True),
         ""),
    ],
)  # fmt: skip
def test_a_refused_permission_has_its_reason(field, safety, told):
    said = refused(field, safety)
    assert said.startswith(told) and bool(said) == bool(told)
