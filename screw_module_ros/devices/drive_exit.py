# SPDX-License-Identifier: Apache-2.0
"""The clean exit of drives: disable, disarm 1400:05 and 1016, only then stop the heartbeat.

In any other order a drive ends in a fault and the next start begins there. The guards are armed
until they are disarmed, so commands and heartbeats go on, for all drives of the bus, while the SDO
conversation runs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from . import drive_setup
from .cia402 import State
from .errors import BusError, DeviceError
from .port import Port

if TYPE_CHECKING:
    from .drive import Drive

_DISABLE_WITHIN_NS = 500_000_000
_SLICE_S = 0.001


def leave(drives: Sequence[Drive], port: Port) -> str:
    """Take the drives of one bus out of operation; return what did not work, empty when all did."""
    running = [drive for drive in drives if drive.running]
    if not running:
        return ""
    for drive in running:
        drive.request_disable()
    problems: list[str] = []
    try:
        problems += _disable(running, port)
        problems += _disarm(running, port)
        for drive in running:
            drive.node.pre_operational()
    except BusError as error:
        problems.append(str(error))
    for drive in running:
        drive.stop()
    return "; ".join(problems)


def _disable(drives: Sequence[Drive], port: Port) -> list[str]:
    begun_ns = port.clock()

    def is_over() -> bool:
        return not _still_on(drives, port) or port.clock() - begun_ns > _DISABLE_WITHIN_NS

    _command_until(drives, port, is_over)
    return [f"the {label} still shows operation enabled" for label in _still_on(drives, port)]


def _still_on(drives: Sequence[Drive], port: Port) -> list[str]:
    now_ns = port.clock()
    return [d.label for d in drives if d.state(now_ns) is State.OPERATION_ENABLED]


def _disarm(drives: Sequence[Drive], port: Port) -> list[str]:
    """Run the SDO conversations beside the commands, which must not pause meanwhile."""
    problems: list[str] = []

    def talk() -> None:
        for drive in drives:
            try:
                drive_setup.disarm(drive.node)
            except DeviceError as error:
                problems.append(f"guards of {drive.label} not disarmed: {error}")

    talker = threading.Thread(target=talk, name="disarm", daemon=True)
    talker.start()
    _command_until(drives, port, lambda: not talker.is_alive())
    talker.join()
    return problems


def _command_until(drives: Sequence[Drive], port: Port, done: Callable[[], bool]) -> None:
    """Command zero torque every millisecond until `done`."""
    while not done():
        now_ns = port.clock()
        drives[0].sync(now_ns)
        for drive in drives:
            drive.heartbeat(now_ns)
            drive.write(0.0, now_ns)
        port.pump(_SLICE_S)
