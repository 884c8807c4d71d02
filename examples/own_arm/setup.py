# SPDX-License-Identifier: Apache-2.0
"""The package of the laboratory: by its entry points robot and simulated rig find the arm."""

from setuptools import setup

setup(
    name="serial-arm",
    version="0.1.0",
    py_modules=["serial_arm", "serial_plant"],
    entry_points={
        "screw_module_ros.arms": ["serial = serial_arm:SERIAL"],
        "screw_module_ros.plane_plants": ["serial = serial_plant:SERIAL_PLANT"],
    },
)
