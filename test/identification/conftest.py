# SPDX-License-Identifier: Apache-2.0
"""Benches for the tests of the identification."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from screw_module_ros.identification import reproduce, study
from screw_module_ros.identification.stand import SimulatedStand
from screw_module_ros.plant.settings import load_world


@pytest.fixture(scope="session")
def module():
    """The thesis's module as installed."""
    return load_world()


@pytest.fixture(scope="session")
def stand(module):
    """The in-process stand on it."""
    return SimulatedStand(module)


@pytest.fixture
def in_a_thread(monkeypatch):
    """Have the commands do their trials in a thread; `test_lab.py` judges their processes."""
    for command in (reproduce, study):
        monkeypatch.setattr(command, "worker_pool", ThreadPoolExecutor)
