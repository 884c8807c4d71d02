# SPDX-License-Identifier: Apache-2.0
"""What services do with a gate: they ask the loop to open, close or clear it, and wait.

`safety/permit.py` is the gate itself, and only the loop's thread calls it.
"""

from __future__ import annotations

from ..safety.permit import OPENING, REFUSAL_HOLD_NS, Permit
from .requests import Requests

_ANSWER_S = 1.0
_PERMISSION_NS = REFUSAL_HOLD_NS + 100_000_000
_ASK_AGAIN_S = 0.005


def enable(permit: Permit, requests: Requests) -> str:
    """Enable and wait until torque passes; return why it does not, empty when it does.

    A permission, or the end of a disabling, may still be on its way: these do not refuse at once.
    Raises TimeStandsStill, NotNow; then the drives do not become enabled later either.
    """
    answered = False
    try:
        refused = _asked_to_open(permit, requests)
        if not refused:
            longest_s = permit.settings.drive_timeout + _ANSWER_S
            requests.clock.wait_for(lambda: permit.phase != OPENING, longest_s)
        answered = True
    finally:
        if not answered:
            requests.put(permit.close)
    return refused or permit.reason


def _asked_to_open(permit: Permit, requests: Requests) -> str:
    clock = requests.clock
    deadline_ns = clock.now_ns() + _PERMISSION_NS
    while True:
        lacking = permit.unsettled  # read before the request: it may settle in between
        refused = requests.ask(lambda: permit.open(clock.now_ns()))
        if not refused or not lacking or clock.now_ns() > deadline_ns:
            return refused
        clock.sleep(_ASK_AGAIN_S)


def disable(permit: Permit, requests: Requests) -> None:
    """Disable. Raises TimeStandsStill, NotNow."""
    requests.ask(permit.close)


def clear_fault(permit: Permit, requests: Requests) -> str:
    """Recover the drives, up to switched on at most; return the remaining fault, empty if none.

    Raises DeviceError when a restarted drive cannot be configured again.
    """
    known = permit.fault.reason
    for drive in permit.drives:
        if drive.fault:
            drive.clear_fault()
    longest_s = permit.recovery_s + _ANSWER_S
    requests.clock.wait_for(
        lambda: not any(drive.recovering for drive in permit.drives), longest_s
    )
    return permit.drive_fault or requests.ask(lambda: permit.clear(known))
