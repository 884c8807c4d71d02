# SPDX-License-Identifier: Apache-2.0
"""The tests of this folder share a robot without ROS; hypothesis runs without its deadline."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

from fake_gateway import FakeGateway  # noqa: E402


@pytest.fixture
def gateway():
    return FakeGateway()
