# SPDX-License-Identifier: Apache-2.0
"""What the machine must have before anything is built; each lack is one line with the way out."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

OLDEST_PYTHON = (3, 10)
NEWEST_PYTHON = (3, 13)
OLDEST_GLIBC = (2, 28)  # of the ROS wheels
DISK_NEEDED = 2.5e9  # bytes, for the virtual environment, its downloads and the build
COMPILERS = ("c++", "g++", "clang++")


class Missing(Exception):
    """A prerequisite is missing; the text is one line that ends with the way out."""


def ros_prefix(venv: Path) -> Path | None:
    """Return the prefix of a sourced ROS 2 Jazzy, None without one.

    Raises Missing when another ROS is sourced. The wheels in `venv` are no sourced ROS.
    """
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    found = next((p for p in prefixes if p != venv and (p / "share/rclpy").is_dir()), None)
    if found is None:
        return None
    distro = os.environ.get("ROS_DISTRO", "unknown")
    if distro != "jazzy":
        raise Missing(
            f"ROS 2 {distro} is sourced ({found}), this package is for jazzy: "
            "source jazzy's setup.bash, or use a shell without ROS to build with wheels"
        )
    return found


def check_python() -> None:
    """Refuse a Python that cannot make a virtual environment or compile the messages."""
    version = sys.version_info[:2]
    if not OLDEST_PYTHON <= version <= NEWEST_PYTHON:
        raise Missing(
            f"Python {version[0]}.{version[1]} is not supported ({sys.executable}): "
            "name one from 3.10 to 3.13, for example: make build PYTHON=python3.12"
        )
    for module in ("venv", "ensurepip"):
        if not _has_module(module):
            raise Missing(
                f"Python's {module} module is missing: "
                f"on Debian or Ubuntu, apt install python{version[0]}.{version[1]}-venv"
            )
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not header.is_file():
        raise Missing(
            f"Python's headers are missing ({header}): "
            f"on Debian or Ubuntu, apt install python{version[0]}.{version[1]}-dev"
        )


def check_compiler() -> None:
    """Refuse a machine on which the message package cannot be compiled."""
    wanted = os.environ.get("CXX", "").split()[:1]
    for program, package in ((tuple(wanted) or COMPILERS, "g++"), (("make",), "make")):
        if not any(shutil.which(name) for name in program):
            raise Missing(
                f"{' or '.join(program)} not found: on Debian or Ubuntu, apt install {package}"
            )


def check_wheels_fit() -> None:
    """Refuse a machine for which there are no ROS wheels."""
    system, machine = platform.system(), platform.machine()
    libc, version = platform.libc_ver()
    way_out = "source a ROS 2 Jazzy installation and run the same command"
    if (system, machine, libc) != ("Linux", "x86_64", "glibc"):
        raise Missing(
            f"the ROS wheels are for x86-64 Linux with glibc, this is {machine} {system}: {way_out}"
        )
    if tuple(int(part) for part in version.split(".")[:2]) < OLDEST_GLIBC:
        raise Missing(f"the ROS wheels need glibc 2.28 or newer, this is {version}: {way_out}")


def check_disk(folder: Path) -> None:
    """Refuse a disk that would fill up half-way, or a folder that cannot be written."""
    if not os.access(folder, os.W_OK):
        raise Missing(f"{folder} cannot be written: clone the repository to a folder of yours")
    free = shutil.disk_usage(folder).free
    if free < DISK_NEEDED:
        raise Missing(
            f"{free / 1e9:.1f} GB free in {folder}, {DISK_NEEDED / 1e9:.1f} GB needed: "
            "make room, or clone to another disk"
        )


def _has_module(name: str) -> bool:
    # In a process of its own: ensurepip may be there and refuse to work (Debian without venv).
    command = [sys.executable, "-c", f"import {name}; getattr({name}, 'version', str)()"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
