# SPDX-License-Identifier: Apache-2.0
"""The vertical drive's end of the law: force command in, linearized motor torque out.

::

    force command -> plausible? -> gate -> torque chain (`control.torque_chain`) -> drive
"""

from __future__ import annotations

from typing import NamedTuple

from ..control.command_watch import CommandWatch
from ..control.gate import GateSettings
from ..control.torque_chain import COLD, TorqueChain, commanded
from ..devices.drive import Drive
from .gated_drives import GatedDrives

LARGEST_FORCE = 150.0
"""No controller of this robot may ask for more [N]."""


class Written(NamedTuple):
    """The last write: torque wanted and command sent [Nm], whether a limit acted."""

    torque: float
    command: float
    saturated: bool


class VerticalAxis:
    """Turns force commands into drive writes; every method of the loop's thread.

    period_ns: between commands. chain: from force to torque.
    """

    def __init__(
        self,
        drive: Drive,
        period_ns: int,
        gate: GateSettings,
        chain: TorqueChain,
    ):
        self.drive = drive
        self.drives = GatedDrives([drive], gate, period_ns)
        self.last = Written(0.0, 0.0, False)
        self._watch = CommandWatch(period_ns, LARGEST_FORCE)
        self._chain = chain
        self._force = 0.0
        self._heat = COLD
        self._written_ns = 0
        self._period_ns = period_ns

    def command(self, sequence: int, monotonic_ns: int, force: float, now_ns: int) -> bool:
        """Act on a force command [N] at once; return whether it was plausible and new.

        A zero is written in any case: nobody who asks for less has to be in order.
        """
        accepted = self._watch.accept(sequence, monotonic_ns, force, now_ns)
        if self._watch.fault and not self.drives.fault:
            self.drives.fault = self._watch.fault
            self._watch.reset()
        if accepted:
            self._write(force, now_ns)
        elif force == 0.0:  # a controller that stops repeats the sample it last answered
            self._write(0.0, now_ns)
        return accepted

    def idle(self, now_ns: int) -> None:
        """Keep gate and drive going without a new command; once a tick is enough.

        The last force is held until the gate finds it too old: one late command is no reason for a
        step to zero and back.
        """
        if now_ns - self._written_ns >= 2 * self._period_ns:
            self._write(self._force, now_ns)

    def _write(self, force: float, now_ns: int) -> None:
        self._force = force
        scale = self.drives.step(self._watch.newest_ns, now_ns)
        elapsed = min(now_ns - self._written_ns, 100 * self._period_ns) * 1e-9
        self._written_ns = now_ns
        made, self._heat = commanded(self._chain, self._heat, force, scale, max(elapsed, 1e-6))
        sent = self.drive.write(made.command, now_ns)
        self.last = Written(made.torque if sent else 0.0, sent, made.limited)
