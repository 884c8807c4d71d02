# SPDX-License-Identifier: Apache-2.0
"""The tests of this folder share a robot without ROS."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from fake_gateway import FakeGateway


@pytest.fixture
def gateway():
    return FakeGateway()
