# SPDX-License-Identifier: Apache-2.0
"""State machine of a simulated CiA 402 drive (CiA 402-2, section 8: PDS FSA).

The transitions are a table. The option codes 605A (quick stop), 605B (shutdown), 605C (disable
operation) and 605E (fault reaction) set the reaction: 0 releases the motor at once, any other value
brakes to standstill first.
"""

from __future__ import annotations

from collections.abc import Callable

(
    NOT_READY,
    SWITCH_ON_DISABLED,
    READY,
    SWITCHED_ON,
    ENABLED,
    QUICK_STOP,
    FAULT_REACTION,
    FAULT,
) = range(8)

STATUS_BITS = (0x0000, 0x0040, 0x0021, 0x0023, 0x0027, 0x0007, 0x000F, 0x0008)
"""Bits 0 to 3, 5 and 6 of the statusword in each state."""

VOLTAGE_ENABLED, WARNING, REMOTE, TARGET_REACHED, INTERNAL_LIMIT, FOLLOWS_COMMAND = (
    0x0010,
    0x0080,
    0x0200,
    0x0400,
    0x0800,
    0x1000,
)

NO_COMMAND, SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP_COMMAND = range(6)

QUICK_STOP_OPTION, SHUTDOWN_OPTION, DISABLE_OPTION, FAULT_OPTION = 0x605A, 0x605B, 0x605C, 0x605E

_FAULT_RESET = 0x80
_STAYS_IN_QUICK_STOP = range(5, 9)

_TRANSITIONS = {
    (SWITCH_ON_DISABLED, SHUTDOWN): READY,
    (READY, SWITCH_ON): SWITCHED_ON,
    (READY, ENABLE): ENABLED,
    (READY, DISABLE_VOLTAGE): SWITCH_ON_DISABLED,
    (READY, QUICK_STOP_COMMAND): SWITCH_ON_DISABLED,
    (SWITCHED_ON, ENABLE): ENABLED,
    (SWITCHED_ON, SHUTDOWN): READY,
    (SWITCHED_ON, DISABLE_VOLTAGE): SWITCH_ON_DISABLED,
    (SWITCHED_ON, QUICK_STOP_COMMAND): SWITCH_ON_DISABLED,
    (ENABLED, SWITCH_ON): SWITCHED_ON,
    (ENABLED, SHUTDOWN): READY,
    (ENABLED, DISABLE_VOLTAGE): SWITCH_ON_DISABLED,
    (ENABLED, QUICK_STOP_COMMAND): QUICK_STOP,
    (QUICK_STOP, DISABLE_VOLTAGE): SWITCH_ON_DISABLED,
    (QUICK_STOP, ENABLE): ENABLED,
}


def command(controlword: int) -> int:
    """Return the command that bits 0, 1, 2, 3 and 7 of a controlword give."""
    if controlword & _FAULT_RESET:
        return NO_COMMAND
    if not controlword & 0x02:
        return DISABLE_VOLTAGE
    if not controlword & 0x04:
        return QUICK_STOP_COMMAND
    if not controlword & 0x01:
        return SHUTDOWN
    return ENABLE if controlword & 0x08 else SWITCH_ON


class StateMachine:
    """State of one drive.

    option: reads an option code (605A, 605B, 605C or 605E) as it is now. state: the present one.
    after_stop: the next one while the drive waits for the motor to stand still, else None.
    """

    def __init__(self, option: Callable[[int], int]):
        self._option = option
        self.after_stop: int | None = None
        self.state = NOT_READY

    @property
    def driving(self) -> bool:
        """Return whether the drive follows its target."""
        return self.state == ENABLED and self.after_stop is None

    @property
    def braking(self) -> bool:
        """Return whether the drive is braking the motor."""
        return self.after_stop is not None or self.state == QUICK_STOP

    def boot(self) -> None:
        """Go through the self-test: transitions 0 and 1."""
        self._go(SWITCH_ON_DISABLED)
        self._last_controlword = 0

    def control(self, controlword: int, may_reset: bool, may_switch_on: bool) -> None:
        """Process a controlword.

        may_reset: the cause of the fault is gone; may_switch_on: the power is on.
        """
        rising = controlword & ~self._last_controlword & _FAULT_RESET
        self._last_controlword = controlword
        if self.state == FAULT:
            if rising and may_reset:
                self._go(SWITCH_ON_DISABLED)
            return
        requested = command(controlword)
        if self.after_stop is not None and self.state == ENABLED and requested == ENABLE:
            self.after_stop = None
            return
        target = _TRANSITIONS.get((self.state, requested))
        if target is not None and (may_switch_on or target == SWITCH_ON_DISABLED):
            self._take(target)

    def fault(self) -> None:
        """React to a fault: transitions 13 and 14."""
        if self.state in (FAULT, FAULT_REACTION):
            return
        if self.state in (ENABLED, QUICK_STOP) and self._option(FAULT_OPTION):
            self.state, self.after_stop = FAULT_REACTION, FAULT
        else:
            self._go(FAULT)

    def disable_voltage(self) -> None:
        """Release the motor: transitions 7, 9, 10 and 12."""
        if self.state in (READY, SWITCHED_ON, ENABLED, QUICK_STOP):
            self._go(SWITCH_ON_DISABLED)

    def quick_stop(self) -> None:
        """Stop as on the quick stop command: transitions 7, 10 and 11."""
        target = _TRANSITIONS.get((self.state, QUICK_STOP_COMMAND))
        if target is not None:
            self._take(target)

    def standstill(self) -> None:
        """Finish the transition that waited for standstill."""
        if self.after_stop is not None:
            self._go(self.after_stop)

    def _take(self, target: int) -> None:
        if target == QUICK_STOP:
            self._begin_quick_stop()
        elif self.state == QUICK_STOP and target == ENABLED:
            if self._option(QUICK_STOP_OPTION) in _STAYS_IN_QUICK_STOP:
                self._go(ENABLED)
        elif self.state == ENABLED and target in (SWITCHED_ON, READY):
            option = DISABLE_OPTION if target == SWITCHED_ON else SHUTDOWN_OPTION
            if self._option(option):
                self.after_stop = target
            else:
                self._go(target)
        else:
            self._go(target)

    def _begin_quick_stop(self) -> None:
        option = self._option(QUICK_STOP_OPTION)
        if option == 0:
            self._go(SWITCH_ON_DISABLED)
            return
        self.state = QUICK_STOP
        self.after_stop = None if option in _STAYS_IN_QUICK_STOP else SWITCH_ON_DISABLED

    def _go(self, state: int) -> None:
        self.state = state
        self.after_stop = None
