# SPDX-License-Identifier: Apache-2.0
"""The bench of the loop's tests: the whole rig in one thread, on virtual buses."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent.parent / "loop"))
from screw_module_ros.trials.one_thread import OneThreadRobot


@pytest.fixture
def bench():
    """A robot whose devices are there and not configured."""
    made = OneThreadRobot()
    made.clock.time_ns += 100_000_000  # the devices have booted
    made.clock.rounds.serve(made.now_ns)
    yield made
    made.close()
