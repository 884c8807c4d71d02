# SPDX-License-Identifier: Apache-2.0
"""Benches for the tests of the identification."""

from __future__ import annotations

import pytest

from screw_module_ros.identification.bench import InProcessBench
from screw_module_ros.plant.settings import load_world


@pytest.fixture(scope="session")
def module():
    """The thesis's module as installed."""
    return load_world()


@pytest.fixture(scope="session")
def bench(module):
    """The in-process bench on it."""
    return InProcessBench(module)
