# SPDX-License-Identifier: Apache-2.0
"""The default rig, and one without noise and zeros, for the tests of the plant."""

from __future__ import annotations

import pytest

from screw_module_ros.plant.module import ModuleInput, VerticalParams, vertical_params
from screw_module_ros.plant.patient import arm_force
from screw_module_ros.plant.settings import WorldSettings, load_world


@pytest.fixture(scope="session")
def settings() -> WorldSettings:
    """The rig of params/plant.yaml."""
    return load_world()


@pytest.fixture(scope="session")
def vertical(settings) -> VerticalParams:
    """The default module with the default arm, for `vertical_step`."""
    arm = arm_force(settings.arm)
    return vertical_params(
        settings.vertical,
        settings.friction,
        settings.amplifier,
        settings.transducer,
        arm,
        settings.substep,
    )


@pytest.fixture(scope="session")
def still() -> ModuleInput:
    """No power, no fixture, upright."""
    return ModuleInput(
        current=0.0,
        powered=False,
        braked=False,
        fixture=1,
        locked=False,
        upright=1.0,
        hand=0.0,
        hand_velocity=0.0,
        stage_speed=0.0,
        stage_target=0.0,
        side_force=0.0,
        load=0.0,
        vigour=1.0,
    )
