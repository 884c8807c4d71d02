# SPDX-License-Identifier: Apache-2.0
"""A client's part in simulated time where there is no rig, and its way out."""

from __future__ import annotations

import pytest

from screw_module_ros.lockstep.clock import simulated_clock
from screw_module_ros.lockstep.page import FOREVER
from screw_module_ros.operator.robot import Robot, RobotError


def test_the_page_is_left_with_the_last_of_two_users():
    first, second = (simulated_clock(name, "/two_users") for name in ("node", "client"))
    assert first is second
    first.close()
    assert first.page.path.exists()
    second.close()
    assert not first.page.path.exists()


def test_a_client_says_that_time_stands_still():
    with (
        Robot("tester", namespace="/no_rig", simulated=True) as robot,
        pytest.raises(RobotError, match="no sim_rig runs"),
    ):
        robot.pause(1.0)


def test_a_client_tells_of_an_ended_process_rather_than_of_the_time():
    looks = []

    def watch() -> None:
        looks.append(None)
        if len(looks) > 1:
            raise RobotError("sim_rig ended by itself")

    with Robot("tester", namespace="/no_rig", simulated=True) as robot:
        robot.watch = watch
        with pytest.raises(RobotError, match="ended by itself"):
            robot.pause(1.0)


def test_a_wait_by_wall_clock_holds_no_time_after_a_service_call():
    """Time stood still for the whole minute in which a test repeated a call until it was obeyed."""
    held = []
    with Robot("tester", namespace="/no_rig", simulated=True) as robot:
        member, until = robot.clock.member, robot.clock.page.until

        def condition() -> bool:
            held.append(until[member.row] != FOREVER)
            member.busy()  # as a call leaves it
            return len(held) == 3

        assert robot.met_by_wall(condition, 10.0)
    assert held == [False, False, False]
