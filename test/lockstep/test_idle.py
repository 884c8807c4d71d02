# SPDX-License-Identifier: Apache-2.0
"""An idle thread that says so again and again is no sign that time will move on."""

from __future__ import annotations

import os

from screw_module_ros.lockstep.member import Member
from screw_module_ros.lockstep.page import Page


def test_to_be_idle_again_is_no_progress():
    page = Page(f"test_idle_{os.getpid()}")
    try:
        member = Member(page, "loop", lambda: False)
        member.idle()
        declared = page.waits[member.row]
        member.idle()
        assert page.waits[member.row] == declared
        member.busy()
        member.idle()
        assert page.waits[member.row] == declared + 1
    finally:
        page.close()


def test_who_was_idle_holds_time_even_when_its_wait_is_over_at_once(page, conductor):
    member = Member(page, "loop", lambda: False)
    member.idle()
    conductor.move(3_000_000)
    member.wait(1_000_000)
    assert conductor.quiet() is None
    member.leave()
