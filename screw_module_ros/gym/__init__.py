# SPDX-License-Identifier: Apache-2.0
"""Environments of gymnasium: `gymnasium.make("screw_module_ros.gym:screw_module_ros/reach-v0")`."""

from __future__ import annotations

import gymnasium

from .environment import TASKS

for _task in TASKS:
    gymnasium.register(
        f"screw_module_ros/{_task}-v0",
        "screw_module_ros.gym.environment:TherapyEnv",
        kwargs={"task": _task},
    )
