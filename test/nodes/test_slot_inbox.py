# SPDX-License-Identifier: Apache-2.0
"""What a message of therapy/slot is for the vertical axis: a slot, and the support of the arm."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import TherapySlot

from screw_module_ros.control.slot import Reach, SlotLimits
from screw_module_ros.control.support import SupportSettings
from screw_module_ros.loop.inputs import Guide
from screw_module_ros.loop.support import Support
from screw_module_ros.nodes.support.law_inputs import SlotInbox

NOW = 1_000_000_000


@pytest.mark.parametrize("vertical", [True, False])
@pytest.mark.parametrize(("asked", "comes"), [(12.0, 0.01), (-12.0, -0.01), (math.nan, 0.0)])
def test_it_carries_the_arm_whatever_it_guides(vertical, asked, comes):
    """Also where the slot itself is none that can be: the arm must not fall for it."""
    message = TherapySlot(vertical=vertical, duration=math.nan, support=asked)
    inbox = SlotInbox(SimpleNamespace(subscribe=lambda *_: lambda: message), vertical=True)
    guide, support = Guide(SlotLimits(), Reach(0.0, 0.36)), Support(SupportSettings())
    support.ask(inbox.read(guide, NOW).support, NOW)
    assert bool(inbox.refused) == vertical and guide.free
    force = support.force(25.0, True, 0.0, None, NOW, 0.001)
    assert force == pytest.approx(comes)
