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
OTHER_PYTHONS = ("python3.12", "python3.11", "python3.13", "python3.10")
OLDEST_GLIBC = (2, 28)  # of the ROS wheels
DISK_NEEDED = 2.5e9  # bytes, for the virtual environment, its downloads and the build
COMPILERS = ("c++", "g++", "clang++")
# Beside letters and digits; others mean something to the loader, CMake, make or a shell.
FINE_IN_PATHS = " /._-+@"


class Missing(Exception):
    """A prerequisite is missing; the text is one line that ends with the way out."""


def interpreter() -> str:
    """Return the Python to make the virtual environment with: never one of a virtual environment.

    The one in use may be that of the environment which is about to be replaced.
    """
    return getattr(sys, "_base_executable", "") or sys.executable


def chromium() -> str | None:
    """Return the path of the browser in which the pages are tested, None without one."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


def ros_prefix() -> Path | None:
    """Return the prefix of a sourced ROS 2 Jazzy, None without one.

    Raises Missing when another ROS is sourced, or one that this Python cannot use. A virtual
    environment with the wheels is no sourced ROS.
    """
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    prefixes = [p for p in prefixes if not (p / "pyvenv.cfg").exists()]
    rclpy = [p for p in prefixes if (p / "share/rclpy").is_dir()]
    if not rclpy:
        return None
    distro = os.environ.get("ROS_DISTRO", "unknown")
    if distro != "jazzy":
        raise Missing(
            f"ROS 2 {distro} is sourced ({rclpy[0]}), this package is for jazzy: "
            "source jazzy's setup.bash, or use a shell without ROS to build with wheels"
        )
    if not _works(interpreter(), "import rclpy"):
        raise Missing(
            f"{interpreter()} cannot import the sourced ROS's rclpy: name the Python that ROS was "
            "made for, usually: make build PYTHON=/usr/bin/python3"
        )
    return rclpy[0]


def check_python() -> None:
    """Refuse a Python that cannot make a virtual environment or compile the messages.

    Python that is too old or too new is replaced by a supported one where there is one.
    """
    version = sysconfig.get_python_version()
    if not OLDEST_PYTHON <= sys.version_info[:2] <= NEWEST_PYTHON:
        other = next((name for name in OTHER_PYTHONS if _works(name, "import venv")), None)
        if other is None:
            raise Missing(
                f"Python {version} is not supported ({sys.executable}) and none from 3.10 to 3.13 "
                f"is on the PATH: install one, or name it: make build PYTHON=/path/to/python3.12"
            )
        print(f"Python {version} is not supported, using {other}.", flush=True)
        os.execvp(other, [other, *sys.argv])
    for module in ("venv", "ensurepip"):
        # ensurepip may be there and refuse to work: so it is with Debian's Python without venv
        if not _works(interpreter(), f"import {module}; getattr({module}, 'version', str)()"):
            raise Missing(
                f"Python's {module} module is missing: "
                f"on Debian or Ubuntu, apt install python{version}-venv"
            )
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not header.is_file():
        raise Missing(
            f"Python's headers are missing ({header}): "
            f"on Debian or Ubuntu, apt install python{version}-dev"
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


def check_path(folder: Path, ros: Path | None) -> None:
    """Refuse a checkout in a folder that the tools cannot be told of, before anything is built."""
    bad = {c for c in str(folder) if not _is_fine(c)}
    if ros is not None:  # its CMake files read paths as ASCII; those of the wheels are mended
        bad |= {c for c in str(folder) if not c.isascii()}
    if bad:
        raise Missing(
            f"the path {ascii(str(folder))} has letters that CMake or the loader do not take "
            f"({ascii(' '.join(sorted(bad)))}): move the checkout to a path without them"
        )


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


def _is_fine(letter: str) -> bool:
    if letter.isascii():
        return letter.isalnum() or letter in FINE_IN_PATHS
    return letter.isprintable()


def _works(python: str, code: str) -> bool:
    try:
        run = subprocess.run([python, "-c", code], capture_output=True, check=False)
    except OSError:
        return False
    return run.returncode == 0
