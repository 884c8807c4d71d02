# SPDX-License-Identifier: Apache-2.0
"""One gate over one or more drives: no torque passes to any unless it may pass to all.

The loop's thread calls `step` before each write. Services call from another thread; the loop
carries out their requests, so that gate and drives change only between two writes.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import Future

from ..clock import Clock, TimeStandsStill
from ..control import gate
from ..control.gate import GATE_CLOSED, GateInput, GateSettings, GateState
from ..devices.cia402 import State
from ..devices.drive import Drive
from ..devices.errors import DeviceError

_ANSWER_S = 1.0
_REFUSAL_STANDS_NS = 200_000_000
_PERMISSION_NS = _REFUSAL_STANDS_NS + 100_000_000
_ASK_AGAIN_S = 0.005


class GatedDrives:
    """Gate and drives of one axis group.

    settings: of the gate. period_ns: between commands. fault: the owner's own reason to stop the
    torque; it closes the gate and stays until `clear_fault`.
    """

    def __init__(self, drives: Sequence[Drive], settings: GateSettings, period_ns: int):
        self.drives = tuple(drives)
        self.gate: GateState = GATE_CLOSED
        self.fault = ""
        self._settings = settings
        self._period_ns = period_ns
        self._safety_ns = 0
        self._permitted = False
        self._refused_ns: int | None = None
        self._safety_reason = ""
        self._closed_because = ""
        self._asked: queue.SimpleQueue[tuple[Callable, Future]] = queue.SimpleQueue()

    # -- loop's thread ---------------------------------------------------------------------------

    def permit(self, permitted: bool, reason: str, now_ns: int) -> None:
        """Process a safety_state that arrived at now_ns [ns]; reason: why not permitted.

        A refusal holds for a while, so that a second sender cannot override the supervisor's.
        """
        if not permitted:
            self._refused_ns = now_ns
            self._safety_reason = reason
        refused_ns = self._refused_ns
        self._permitted = refused_ns is None or now_ns - refused_ns > _REFUSAL_STANDS_NS
        self._safety_ns = now_ns

    def missed(self, in_a_row: int, limit: int) -> None:
        """Stop with a fault after `limit` missed deadlines in a row while torque passes."""
        if self.enabled and in_a_row >= limit:
            self.fault = self.fault or f"{in_a_row} deadlines missed in a row"

    def step(self, command_ns: int, now_ns: int) -> float:
        """Update gate and drives; return the factor on the torque, 0 to 1.

        command_ns: acquisition time of the newest command's sample [ns], 0 = none yet.
        """
        inp = self._input(command_ns, now_ns)
        while not self._asked.empty():
            action, answer = self._asked.get_nowait()
            if answer.set_running_or_notify_cancel():
                answer.set_result(action(inp))
        before = self.gate
        self.gate = gate.gate_step(self._settings, before, inp)
        if before.phase != gate.CLOSED and self.gate.phase == gate.CLOSED:
            self._closed()
        return self.gate.scale

    def close(self, now_ns: int) -> None:
        """Close the gate as `disable` does, also after the loop has ended. now_ns [ns]."""
        self.gate = gate.disable(self.gate, now_ns)
        self._closed()

    def _input(self, command_ns: int, now_ns: int) -> GateInput:
        states = [drive.state(now_ns) for drive in self.drives]
        return GateInput(
            now_ns,
            command_ns,
            self._period_ns,
            self._safety_ns,
            self._permitted,
            all(state is State.OPERATION_ENABLED for state in states),
            bool(self._latched()),
        )

    def _drive_fault(self) -> str:
        return next((drive.fault for drive in self.drives if drive.fault), "")

    def _latched(self) -> str:
        """Return the owner's fault or a drive's, empty when there is none."""
        return self.fault or self._drive_fault()

    def _closed(self) -> None:
        self._closed_because = self._why(self.gate)
        for drive in self.drives:
            drive.request_disable()

    def _why(self, state: GateState) -> str:
        if state.reason == gate.DRIVE_FAULT or state.reason == gate.DRIVE_LEFT:
            return self._latched() or gate.REASONS[state.reason]
        if state.reason == gate.NO_PERMISSION and self._safety_reason:
            return f"not permitted: {self._safety_reason}"
        return gate.REASONS[state.reason]

    def _open(self, inp: GateInput) -> str:
        """Carry out an `enable`; return why it is refused, empty when the gate is opening."""
        state, refused = gate.enable(self._settings, self.gate, inp)
        if refused:
            return self._detailed(refused, inp)
        if state is self.gate:
            return ""
        try:
            for drive in self.drives:
                drive.request_enable()
        except DeviceError as error:
            for drive in self.drives:
                drive.request_disable()
            return str(error)
        self.gate, self._closed_because = state, ""
        return ""

    def _detailed(self, refused: str, inp: GateInput) -> str:
        """Return the gate's refusal to open, with the drive's or the supervisor's own reason."""
        if inp.drive_faulted:
            return self._why(self.gate._replace(reason=gate.DRIVE_FAULT))
        if refused == gate.REASONS[gate.NO_PERMISSION]:
            return self._why(self.gate._replace(reason=gate.NO_PERMISSION))
        return refused

    def _disable(self, inp: GateInput) -> str:
        self.close(inp.now_ns)
        return ""

    def _clear(self, inp: GateInput) -> str:
        if self.gate.phase != gate.CLOSED:
            return self.fault  # it has come just now, and closes the gate first
        self.fault = ""
        self.gate = gate.clear(self.gate)
        self._closed_because = ""
        return ""

    # -- any thread ------------------------------------------------------------------------------

    @property
    def enabled(self) -> bool:
        """Whether torque passes."""
        return self.gate.phase == gate.OPEN

    def at_rest(self, now_ns: int) -> bool:
        """Return whether the gate is closed and no drive is in operation enabled at now_ns [ns]."""
        states = [drive.state(now_ns) for drive in self.drives]
        return self.gate.phase == gate.CLOSED and State.OPERATION_ENABLED not in states

    @property
    def faulted(self) -> bool:
        """Whether a fault is latched; `clear_fault` clears it."""
        return self.gate.latched or bool(self._latched())

    @property
    def reason(self) -> str:
        """Why no torque passes, empty while it does."""
        fault = self._latched()
        if fault or self.gate.phase == gate.OPEN:
            return fault
        return self._closed_because or gate.REASONS[self.gate.reason]

    def enable(self, clock: Clock) -> str:
        """Enable and wait until torque passes; return why it does not, empty when it does.

        clock: clock of the wait. A permission may still be on its way, so a missing one does not
        refuse at once. Raises TimeStandsStill; then the drives do not become enabled later either.
        """
        try:
            return self._opened(clock)
        except TimeStandsStill:
            self._asked.put((self._disable, Future()))
            raise

    def _opened(self, clock: Clock) -> str:
        deadline_ns = clock.now_ns() + _PERMISSION_NS
        while True:
            lacking = not self._permitted  # read before the request: it may come in between
            refused = self._ask(self._open, clock)
            if not refused or not lacking or clock.now_ns() > deadline_ns:
                break
            clock.sleep(_ASK_AGAIN_S)
        if refused:
            return refused
        longest_s = self._settings.drive_timeout + _ANSWER_S
        clock.wait_for(lambda: self.gate.phase != gate.OPENING, longest_s)
        return self.reason

    def disable(self, clock: Clock) -> str:
        """Disable; return the problem, empty when done."""
        return self._ask(self._disable, clock)

    def clear_fault(self, clock: Clock) -> str:
        """Recover the drives, up to switched on at most; return the remaining fault, empty if none.

        Raises DeviceError when a restarted drive cannot be configured again.
        """
        for drive in self.drives:
            if drive.fault:
                drive.clear_fault()
        longest_s = max(drive.settings.enable_timeout for drive in self.drives) + _ANSWER_S
        clock.wait_for(lambda: not any(drive.recovering for drive in self.drives), longest_s)
        left = self._drive_fault()
        return left or self._ask(self._clear, clock)

    def _ask(self, action: Callable[[GateInput], str], clock: Clock) -> str:
        answer: Future = Future()
        self._asked.put((action, answer))
        try:
            clock.wait_for(answer.done, _ANSWER_S)
        finally:  # what its caller takes for failed is not carried out later
            too_late = answer.cancel()
        return "the loop does not run: activate the node" if too_late else answer.result()
