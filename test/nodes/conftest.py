# SPDX-License-Identifier: Apache-2.0
"""What the tests of nodes share."""

from __future__ import annotations

import gc
from types import SimpleNamespace

import pytest
from node_classes import making_nodes

from screw_module_ros.calibration.module import (
    ModuleCalibration,
    SensorBias,
    thesis_friction,
    write_calibration,
)
from screw_module_ros.control.linearization import default_linearization


@pytest.fixture(scope="module", autouse=True)
def no_garbage_of_earlier_modules():
    """Collect it, and let the garbage collector pass over what stays: `make_node` has it work."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def make_node(monkeypatch):
    """Return `make_node(name, *ros_args)`: the node, declared but not configured."""
    with making_nodes(monkeypatch) as make:
        yield make


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    """Return the path, content and identity of the calibration of the module of params/sim.yaml."""
    path = tmp_path_factory.mktemp("calibration") / "sim_module.yaml"
    written = write_calibration(path, ModuleCalibration(
        serial="SIM-0001", date="2001-05-11T09:30:00Z", software="0.1.0", gravity_N=9.25,
        mass_kg=5.5, sensor_bias=SensorBias((0.0,) * 3, (0.0,) * 3),
        residuals={"friction_rms_N": 0.8}, friction=thesis_friction()._replace(phase_rad=0.4),
        linearization=default_linearization(0.02), delay_s=9e-4, drive_delay_s=2.2e-4,
    ))  # fmt: skip
    return SimpleNamespace(path=path, written=written, identity=written.identity(path))
