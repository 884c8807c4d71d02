# SPDX-License-Identifier: Apache-2.0
"""The executables that setup.py installs, by name: `screw_module_ros.programs:encoder`.

One place knows which module each of them is, and says in one sentence what is not installed where
the module cannot be imported.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

_NODES = {
    "encoder": "EncoderNode", "force_sensor": "ForceSensorNode",
    "impedance_controller": "ImpedanceControllerNode", "amplifier": "AmplifierNode",
    "manus": "ManusNode", "endpoint_state": "EndpointStateNode", "supervisor": "SupervisorNode",
    "therapy_session": "TherapySessionNode", "web_bridge": "WebBridgeNode", "sim_rig": "SimRigNode",
}  # fmt: skip
PROGRAMS = {
    **{name: (f"nodes.{name}", node) for name, node in _NODES.items()},
    **{name: (f"trials.{name}", name) for name in ("demo", "therapy")},
    "bringup": ("nodes.bringup", "command"),
    "robot_description": ("nodes.robot_description", "command"),
    "module": ("nodes.module", "main"),
    "whole": ("nodes.whole", "main"),
    "session_recorder": ("nodes.session_recorder", "main"),
    "characterize": ("identification.live.characterize", "main"),
    "check_hardware": ("hardware.command", "command"),
    "reproduce": ("identification.reproduce", "reproduce"),
    "session": ("session_command", "main"),
    "study": ("identification.study", "study"),
}
"""Name of an executable -> module below this package, function, or the class of its node."""

INTERRUPTED = 130
_OF_NODES = ("nodes.", "identification.live.")  # a node that a signal ends has not failed
_PACKAGE, _MESSAGES, _ROS = "screw_module_ros", "screw_module_msgs", "rclpy"
_BUILD = "colcon build && source install/setup.bash (without ROS: make build)"
_REMEDIES = {
    _MESSAGES: f"in the workspace, ln -s {_PACKAGE}/msg_defs src/{_MESSAGES} && {_BUILD}",
    _ROS: "source /opt/ros/jazzy/setup.bash (without ROS: make build)",
    "greenlet": "rosdep does not know it, apt install python3-greenlet (without ROS: make build)",
}
_INSTALL = "rosdep install --from-paths src --ignore-src -y (docs/ros.md; without ROS: make build)"


def missing(error: ImportError) -> str:
    """Return what is not installed and the command that installs it, empty for a defect of ours."""
    package = (error.name or "").partition(".")[0]
    if package in ("", _PACKAGE):
        return ""
    if not isinstance(error, ModuleNotFoundError):
        return f"{package} does not fit this {_PACKAGE} ({error}): {_BUILD}"
    return f"{package} is not installed: {_REMEDIES.get(package, _INSTALL)}"


@contextmanager
def importing(program: str, interrupted: int = INTERRUPTED) -> Iterator[None]:
    """End the process with status 2 and one sentence where an import within fails.

    An error of our own code passes. Where the launch file ends so, `ros2 launch` ends with it.

    interrupted: status with which a SIGINT within ends the process, without a traceback. After it
    a SIGINT is heard, also where a script's & has made it ignored: `ros2 launch` would not notice
    that its nodes were asked to end.
    """
    try:
        with _interruptible(interrupted):
            yield
    except ImportError as error:
        if not (sentence := missing(error)):
            raise
        print(f"{program}: {sentence}", file=sys.stderr)
        raise SystemExit(2) from None


@contextmanager
def _interruptible(status: int) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(status))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # the launch file blocks it
    gc.disable()  # an import makes no garbage, and each collection looks at all that is there
    try:
        yield
    finally:
        gc.enable()
        own = callable(before)
        signal.signal(signal.SIGINT, before if own else signal.default_int_handler)


def __getattr__(name: str) -> Callable[[], Any]:
    """Return the function of an executable; end the process where something is not installed."""
    if name not in PROGRAMS:
        raise AttributeError(f"no executable {name}")
    module, function = PROGRAMS[name]
    with importing(name, 0 if module.startswith(_OF_NODES) else INTERRUPTED):
        found = getattr(importlib.import_module(f"{_PACKAGE}.{module}"), function)
        if not isinstance(found, type):
            return found
        return partial(importlib.import_module(f"{_PACKAGE}.nodes.support.runtime").main, found)
