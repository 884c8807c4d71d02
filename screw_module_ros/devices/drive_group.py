# SPDX-License-Identifier: Apache-2.0
"""Drives that share a bus: their common start, and their clean exit.

Start: a drive whose guards may be disarmed is configured anew, as is one that may have restarted
unseen while nobody read the bus.

Exit: disable, disarm 1400:05 and 1016, only then stop the heartbeat. Any other order leaves the
drive in a fault, and the next start begins with it. Until the guards are disarmed, commands and
heartbeats to all drives of the bus continue during the SDO transfers. A drive that did not confirm
that it left operation enabled keeps its guards: they stop it when the commands end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from ..can_io.port import Port
from ..clock import TimeStandsStill
from . import cia402, drive_guards
from .canopen import NMT_PRE_OPERATIONAL
from .cia402 import State
from .drive import Drive
from .errors import BusError, DeviceError
from .life import Phase

_DISABLE_WITHIN_NS = 500_000_000
_PERIOD_NS = 1_000_000


def start(drives: Sequence[Drive]) -> list[Drive]:
    """Start all drives, disabled; return those that had to be configured anew. Blocking then.

    Raises as `Drive.configure` and `Drive.start`; all are configured before any is started.
    """
    anew = [drive for drive in drives if not drive.configured]
    for drive in anew:
        drive.configure()
    for drive in drives:
        drive.start()
    return anew


def leave(drives: Sequence[Drive], port: Port) -> str:
    """Take the drives of one bus out of operation; return the errors, empty without any."""
    running = [drive for drive in drives if drive.phase is Phase.RUNNING]
    if not running:
        return ""
    for drive in running:
        drive.request_disable()
    problems: list[str] = []
    try:
        _disable(running, port)
        off = _disarm(running, port, problems)
        for drive in off:
            drive.command_nmt(NMT_PRE_OPERATIONAL)
    except BusError as error:
        problems.append(str(error))
    for drive in running:
        drive.stop()
    return "; ".join(problems)


def _disable(drives: Sequence[Drive], port: Port) -> None:
    begun_ns = port.clock.now_ns()

    def is_over() -> bool:
        now_ns = port.clock.now_ns()
        off = all(_is_off(drive.state(now_ns)) for drive in drives)
        return off or now_ns - begun_ns > _DISABLE_WITHIN_NS

    _command_until(drives, port, is_over)


def _is_off(state: State) -> bool:
    return state not in (State.OPERATION_ENABLED, State.UNKNOWN)


def _state(drive: Drive, port: Port) -> State:
    """Return the drive's present state; request the statusword if it is stale."""
    state = drive.state(port.clock.now_ns())
    return cia402.decode(drive.sdo.unsigned(0x6041)) if state is State.UNKNOWN else state


def _disarm(drives: Sequence[Drive], port: Port, problems: list[str]) -> list[Drive]:
    """Disarm the drives that are off and return them; append errors to problems.

    The SDO transfers run in parallel with the commands, which must not pause.
    """
    off: list[Drive] = []

    def talk() -> None:
        for drive in drives:
            try:
                state = _state(drive, port)
                if not _is_off(state):
                    problems.append(
                        f"guards of {drive.label} not disarmed, they stop it: its state is "
                        f"{state.text}"
                    )
                    continue
                off.append(drive)
                drive_guards.disarm(drive.sdo)
            except (DeviceError, TimeStandsStill) as error:
                why = f"{drive.fault}; {error}" if drive.fault else f"{error}"
                problems.append(f"guards of {drive.label} not disarmed: {why}")
        port.clock.leave()

    talker = threading.Thread(target=talk, name="disarm", daemon=True)
    talker.start()
    _command_until(drives, port, lambda: not talker.is_alive())
    talker.join()
    return off


def _command_until(drives: Sequence[Drive], port: Port, done: Callable[[], bool]) -> None:
    """Command zero torque every millisecond until `done`."""
    while not done():
        now_ns = port.clock.now_ns()
        drives[0].sync(now_ns)
        for drive in drives:
            drive.heartbeat(now_ns)
            drive.write(0.0, now_ns)
        next_ns = now_ns + _PERIOD_NS
        while port.clock.now_ns() < next_ns:
            port.pump(next_ns)
