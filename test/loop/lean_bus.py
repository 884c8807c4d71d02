# SPDX-License-Identifier: Apache-2.0
"""python-can's `virtual` bus without its deep copy of each frame: half of a closed loop's time."""

from __future__ import annotations

import can
from can.interfaces.virtual import VirtualBus


class LeanVirtualBus(VirtualBus):
    """`virtual` for plain frames within one thread or several; the rest goes the ordinary way."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand a copy to every other end of the channel."""
        if msg.is_extended_id or msg.is_remote_frame or msg.is_error_frame or msg.is_fd:
            super().send(msg, timeout)
            return
        copy = can.Message(
            0.0, msg.arbitration_id, False, dlc=msg.dlc, data=bytes(msg.data), check=False
        )
        for queue in self.channel:
            if queue is not self.queue:
                queue.put(copy)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None without one."""
        if timeout != 0.0:
            return super().recv(timeout)
        return None if self.queue.empty() else self.queue.get_nowait()
