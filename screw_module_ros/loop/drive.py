# SPDX-License-Identifier: Apache-2.0
"""The vertical drive in the loop: SYNC and heartbeat on the tick, torque on the command.

::

    force command -> plausible? -> permit -> torque chain (`control.torque_chain`) -> drive
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

from ..can_io.port import Port
from ..control.laws import all_names
from ..control.limits import COLD
from ..control.modes import EXCITATION, OFF
from ..control.torque_chain import (
    TorqueChain,
    commanded,
    commanded_torque,
    excitation_chain,
    followed,
    largest_command,
)
from ..devices.drive import Drive
from ..devices.errors import DeviceError
from ..safety.checks import Stream, command_flaw
from ..safety.latch import Latch
from ..safety.permit import CLOSED, Permit, PermitSettings
from ..safety.timing import DeadlineMeter, empty_histogram, note_latency
from .ticker import Tick

_LONGEST_STEP = 5  # periods; longest dt of the rate limit (the permit checks the command's age)
_ANSWER = 0.1  # periods that the drive has to answer SYNC before the loop waits for the command
_LOOK_NS = 4_000_000  # time between looks at permission and missed deadlines

Permission = Callable[[Permit, int], None]
"""Passes the supervisor's permission on; argument: time of now [ns]."""


class Written(NamedTuple):
    """The last write: desired torque and sent command [Nm], whether a limit acted."""

    torque: float
    command: float
    saturated: bool


_NOTHING = Written(0.0, 0.0, False)


class VerticalDrive:
    """Turns force commands into drive writes; only the loop's thread calls it.

    The driver latches errors of the bus, and state and diagnostics show them; the loop continues
    with its other work.

    period_ns: between commands. brakes: the drive does when the torque goes off, else it coasts.
    permit: its gate. chain: from force to torque, of the laws; mode
    EXCITATION has `excitation_chain`, for as long as the gate that `ready` prepared is open.
    missed_limit:
    deadlines missed in a row that stop the torque. heat: of the motor at the start [Nm^2]. asked:
    the last force command [N]. meter: latency from the sample behind a command to its write; own:
    histogram of this process's part of it. skipped: ticks that an overrun skipped.
    """

    def __init__(
        self,
        drive: Drive,
        port: Port,
        period_ns: int,
        permit: PermitSettings,
        chain: TorqueChain,
        missed_limit: int = 20,
        heat: float = COLD,
    ):
        self.drive, self.brakes = drive, drive.brakes
        recovery_s = drive.settings.enable_timeout
        self.permit = Permit([drive], permit, period_ns, recovery_s)
        self.last = _NOTHING
        self.asked = 0.0
        self.skipped = 0
        self.meter = DeadlineMeter(period_ns)
        self.own = empty_histogram()
        self._port, self._clock = port, port.clock
        self._fault = Latch()  # of the commands
        self._commands = Stream("force command", period_ns, self._fault)
        self._laws, self._excitation = chain, excitation_chain(chain)
        self._prepared = self._chain = chain
        self._mode = OFF
        self._activation = self._opened_for = 0
        self._phase = CLOSED
        self._force = self._followed = 0.0
        self._heat = heat
        self._written_ns = self._pumped_ns = 0
        self._period_ns = period_ns
        self._longest_step = _LONGEST_STEP * period_ns * 1e-9
        self._missed_limit = missed_limit
        self._look_every = max(1, round(_LOOK_NS / period_ns))

    @property
    def position(self) -> float:
        """Travel of the nut from the drive's newest answer [m], not homed."""
        reading = self.drive.reading
        return reading.position if reading is not None else 0.0

    def heat(self, now_ns: int) -> float:
        """Return the motor's heat now [Nm^2], after no torque since the last write."""
        if not self._written_ns:  # an activation that failed
            return self._heat
        elapsed = max(1e-6, (now_ns - self._written_ns) * 1e-9)
        return commanded_torque(self._chain, self._heat, 0.0, elapsed)[1]

    def ready(self) -> float:
        """Prepare the next opening of the gate for the newest command's mode, before the request.

        Returns the largest torque command [Nm] of that mode.
        """
        if self.permit.phase == CLOSED:
            self._prepared = self._excitation if self._mode == EXCITATION else self._laws
        return largest_command(self._prepared)

    # One period ----------------------------------------------------------------------------

    def begin(self, tick: Tick) -> None:
        """Send the frames of the tick: SYNC and, when due, the heartbeat."""
        self.skipped += tick.skipped
        try:
            self.drive.sync(tick.monotonic_ns)
            self.drive.heartbeat(tick.monotonic_ns)
        except DeviceError:
            pass

    def await_answer(self, tick: Tick) -> None:
        """Wait a moment for the drive's answer to SYNC: the permit needs its present state."""
        until_ns = tick.monotonic_ns + round(_ANSWER * self._period_ns)
        try:
            while self._clock.now_ns() < until_ns:
                reading = self.drive.reading
                if reading is not None and reading.monotonic_ns >= tick.monotonic_ns:
                    return
                self._pump(tick.monotonic_ns, until_ns)
        except DeviceError:
            pass

    def act(
        self, sequence: int, monotonic_ns: int, force: float, now_ns: int, mode: int = OFF,
        activation: int = 0,
    ) -> None:  # fmt: skip
        """Turn a command [N] into torque at once.

        sequence, monotonic_ns: of the sample behind it; now_ns: when the sample or command came
        [ns]; mode: of the controller, constant of `modes`; activation: of the controller.
        """
        # Torque first: the status read last time is one period old, ten are allowed.
        self.asked = force
        try:
            if self.command(sequence, monotonic_ns, force, now_ns, mode, activation):
                done_ns = self._clock.now_ns()
                self.meter.tick(sequence, monotonic_ns, done_ns)
                note_latency(self.own, done_ns - now_ns)
            self._pump(now_ns)
        except DeviceError:
            pass

    def end(self, tick: Tick, permission: Permission) -> None:
        """Update permit and drive, whether a command came or not."""
        now_ns = tick.monotonic_ns
        if tick.sequence % self._look_every <= tick.skipped:  # also one that was left out
            permission(self.permit, now_ns)
            self.permit.missed(self.meter.missed_in_a_row(now_ns), self._missed_limit)
        try:
            if now_ns - self._pumped_ns > self._period_ns:
                self._pump(now_ns)  # no command came; a command would have done it
        except DeviceError:
            pass
        try:
            self.serve_without_command(now_ns)
        except DeviceError:
            pass

    def release(self, now_ns: int) -> None:
        """Close the permit and write zero, after an error that ends the loop."""
        self.permit.close()
        with suppress(Exception):
            self.write(0.0, now_ns)

    def _pump(self, now_ns: int, until_ns: int = 0) -> None:
        self._pumped_ns = now_ns
        self._port.pump(until_ns)

    # From force to torque ------------------------------------------------------------------

    def command(
        self, sequence: int, monotonic_ns: int, force: float, now_ns: int, mode: int = OFF,
        activation: int = 0,
    ) -> bool:  # fmt: skip
        """Write a force command [N]; return whether it was plausible and new. Raises DeviceError.

        Zero torque is always written, whatever fault exists.
        """
        newer = self._commands.accept(sequence, monotonic_ns, now_ns)
        implausible = command_flaw(force) if newer else ""
        self._fault.set(implausible)
        if self._fault.reason:
            self.permit.fault.set(self._fault.reason)
            self._fault.clear()  # else it would latch again after `clear_fault`
            self._commands.restart()
        accepted = newer and not implausible
        if accepted:
            self._mode, self._activation = mode, activation
            self.write(force, now_ns)
        elif force == 0.0:  # a controller that stops repeats the sequence of its last sample
            self.write(0.0, now_ns)
        return accepted

    def serve_without_command(self, now_ns: int) -> None:
        """Serve permit and drive without a new command; once a tick is enough.

        The last force stays until the permit finds it too old: a single late command must not cause
        a step to zero and back. Raises DeviceError.
        """
        if now_ns - self._written_ns >= 2 * self._period_ns:
            self.write(self._force, now_ns)

    def _fits_the_gate(self) -> bool:
        """Latch a fault when the gate was opened for another mode, or for another controller.

        A controller that is activated anew begins where the hand is, without the ramp of an opening
        gate, and nobody has asked for its torque.
        """
        if self._phase == CLOSED:
            return True
        excites = self._chain is self._excitation
        if excites != (self._mode == EXCITATION):
            opened = "for mode EXCITATION" if excites else "for the laws"
            self.permit.fault.set(
                f"force command: mode {all_names().get(self._mode, self._mode)}, the torque was "
                f"enabled {opened}: disable before the mode changes"
            )
            return False
        if self._activation != self._opened_for:
            self.permit.fault.set(
                "force command: the controller was activated anew while the torque was on"
            )
            return False
        return True

    def write(self, force: float, now_ns: int) -> None:
        """Write a force [N] as gate, chain and heat let it pass. Raises DeviceError."""
        self._force = force = force if self._fits_the_gate() else 0.0
        scale = self.permit.step(self._commands.monotonic_ns, now_ns)
        if self.permit.phase == CLOSED:
            self._chain = self._laws
        elif self._phase == CLOSED:
            self._chain, self._opened_for = self._prepared, self._activation
        self._phase = self.permit.phase
        elapsed = min(now_ns - self._written_ns, 100 * self._period_ns) * 1e-9
        self._written_ns = now_ns
        elapsed = max(elapsed, 1e-6)
        # A closed permit passed no force: the rate limit of the next force starts from zero.
        last = self._followed if scale else 0.0
        self._followed = followed(self._chain, last, force, min(elapsed, self._longest_step))
        limited = self._followed != force
        made, self._heat = commanded(self._chain, self._heat, self._followed, scale, elapsed)
        self.last = _NOTHING  # also if the write fails
        sent = self.drive.write(made.command, now_ns)
        self.last = Written(made.torque if sent else 0.0, sent, made.limited or limited)
