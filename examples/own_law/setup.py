# SPDX-License-Identifier: Apache-2.0
"""The package of the laboratory: its entry point is what the robot finds the law by."""

from setuptools import setup

setup(
    name="mylab",
    version="0.1.0",
    py_modules=["mylab"],
    entry_points={"screw_module_ros.laws": ["floor = mylab:FLOOR"]},
)
