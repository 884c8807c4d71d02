# SPDX-License-Identifier: Apache-2.0
"""Without gymnasium, which rosdep does not install, its tests are left out."""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore = [] if find_spec("gymnasium") else ["test_gym.py", "test_same_robot.py"]
