# SPDX-License-Identifier: Apache-2.0
"""The tests of this folder share a robot without ROS."""

from __future__ import annotations

import pytest
from fake_gateway import FakeGateway


@pytest.fixture
def gateway():
    return FakeGateway()
