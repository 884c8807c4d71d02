# SPDX-License-Identifier: Apache-2.0
"""Installs screw_module_ros as an ament_python package: code, executables, data, index marker."""

from glob import glob

from setuptools import find_packages, setup

NAME = "screw_module_ros"
PROGRAMS = (  # what they are: screw_module_ros/programs.py
    "encoder", "force_sensor", "impedance_controller", "amplifier", "module", "whole", "manus",
    "endpoint_state", "supervisor", "session_recorder", "therapy_session", "web_bridge", "sim_rig",
    "bringup", "robot_description", "characterize", "demo", "therapy",
    "check_hardware", "session", "reproduce", "study",
)  # fmt: skip
# What the modules of each product import beside ROS 2 (the table in pyproject.toml), and what those
# below it do. package.xml and requirements/runtime.txt follow, but for gymnasium: a test compares
# all three.
ROBOT = [
    "canopen", "click", "lz4", "mcap", "msgpack", "numpy", "python-can", "pyyaml", "rich",
    "rosbags", "xacro", "zstandard",
]  # fmt: skip
THERAPY = [*ROBOT, "aiohttp", "jinja2", "matplotlib", "scipy"]
SIMULATION = [*THERAPY, "greenlet", "numba"]
EXPERIMENTS = [*SIMULATION, "markdown-it-py"]
GYM = [*EXPERIMENTS, "gymnasium"]
EXECUTABLES = [f"{program} = {NAME}.programs:{program}" for program in PROGRAMS]

setup(
    name=NAME,
    version="0.1.0",
    description="A three-axis upper-limb therapy robot: MIT-MANUS and a vertical screw module.",
    license="Apache-2.0",
    author="screw_module_ros maintainers",
    maintainer="screw_module_ros maintainers",
    maintainer_email="unpublished@screw-module-ros.invalid",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: ["py.typed", "devices/*.csv", "rig/eds/*.eds", "bridge/pages/static/*.*",
               "bridge/pages/static/*/*", "bridge/pages/static/*/*/*", "therapy/*.jinja",
               "identification/*.jinja", "trials/*.html", "control/laws/*.yaml"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/params", sorted(glob("params/*.*"))),
        (f"share/{NAME}/params/devices", sorted(glob("params/devices/*.yaml"))),
        (f"share/{NAME}/params/games", sorted(glob("params/games/*.yaml"))),
        (f"share/{NAME}/params/therapy", sorted(glob("params/therapy/*.yaml"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.py"))),
        (f"share/{NAME}/urdf", sorted(glob("urdf/*.*"))),
        (f"share/{NAME}/rviz", sorted(glob("rviz/*.*"))),
        (f"share/{NAME}/security", sorted(glob("security/*.*"))),
    ],
    zip_safe=False,
    extras_require={
        "robot": ROBOT,
        "therapy": THERAPY,
        "simulation": SIMULATION,
        "experiments": EXPERIMENTS,
        "gym": GYM,
        "cluster": ["distributed"],  # study --scheduler
        "mujoco": ["mujoco"],  # runs what robot_description --mujoco prints; Python 3.11 or newer
        "test": [
            "durand", "hypothesis", "ipykernel", "mcap-ros2-support", "nbclient", "nbformat",
            "pytest", "pytest-timeout",
        ],
    },
    entry_points={
        "console_scripts": EXECUTABLES,
        f"{NAME}.session": [
            f"therapy = {NAME}.therapy.cli:add_commands",
            f"bridge = {NAME}.bridge.tokens:add_commands",
        ],
        "can.interface": [f"rig = {NAME}.rig.rig_bus:RigBus"],
    },
)
