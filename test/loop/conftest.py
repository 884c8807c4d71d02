# SPDX-License-Identifier: Apache-2.0
"""Robots with torque for the closed-loop tests."""

from __future__ import annotations

import pytest


@pytest.fixture
def enabled(bench):
    """Return a robot with the vertical axis enabled in IMPEDANCE mode, spring where it stands."""
    bench.controller.mode = 1
    assert bench.enable() == ""
    bench.seconds(0.6)  # the ramp of the gate takes 0.5 s
    return bench


@pytest.fixture
def plane(bench):
    """Return the plane of a robot, with torque; `bench` goes on with it."""
    assert bench.enable_plane() == ""
    bench.ticks(5)
    return bench.plane
