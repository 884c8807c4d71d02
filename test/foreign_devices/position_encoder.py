# SPDX-License-Identifier: Apache-2.0
"""The smallest encoder of CiA 406, written from the standard and apart from drivers and rig."""

from __future__ import annotations

from application import Application, Stack


class PositionEncoder(Application):
    """Counts on by `speed` at each SYNC, and wraps at its range; `count` is unbounded."""

    def __init__(self, stack: Stack):
        self.stack = stack
        self.count = self.speed = 0

    def restart(self) -> None:
        """An absolute encoder knows its position after a restart."""

    def sampled(self) -> None:
        self.count += self.speed
        reach = self.stack.get(0x6501) * (self.stack.optional(0x6502) or 1)
        self.stack.put(0x6004, 0, self.count % (reach or 2**32))
