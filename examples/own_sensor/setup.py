# SPDX-License-Identifier: Apache-2.0
"""The package of the laboratory; by its entry points the robot finds the sensor."""

from setuptools import setup

setup(
    name="mycell",
    version="0.1.0",
    packages=["mycell"],
    package_data={"mycell": ["*.yaml"]},
    entry_points={
        "screw_module_ros.force_sensors": ["mycell = mycell.driver:LoadCell"],
        "screw_module_ros.rig_sensors": ["mycell = mycell.simulated:SimulatedLoadCell"],
    },
)
