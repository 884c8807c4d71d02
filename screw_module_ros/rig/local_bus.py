# SPDX-License-Identifier: Apache-2.0
"""A simulated bus within the process of its rig: frames pass by calls, in queues.

`LocalHub` is the rig's end, and each `join` makes a `LocalBus`, a member. Nothing waits here: the
clock lets the rig answer before a wait (`lockstep.rounds`). `rig_hub` adds other processes.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import can

from ..can_io.frames import ERROR, EXTENDED, EXTENDED_ID, REMOTE, STANDARD_ID, Frame, word_of

ENDED = "sim_rig has ended"
AWAY = "Network is down: the simulated adapter was unplugged"
_UNHEARD = "nobody is there to acknowledge a frame"
_ON_THE_WIRE = EXTENDED | REMOTE | ERROR | EXTENDED_ID


class FrameBus(can.BusABC):
    """A bus of python-can whose ends exchange frames; all raise CanOperationError."""

    def __init__(self, channel: str, **kwargs: Any):
        self.channel_info = f"rig {channel}"
        super().__init__(channel, **kwargs)

    @abstractmethod
    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send a frame: its word and its data."""

    @abstractmethod
    def receive_frame(self, timeout_s: float | None) -> Frame | None:
        """Return the next frame, None without one within `timeout_s` [s]; None: no limit."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a classical frame to all others on the bus."""
        if msg.is_fd:
            raise can.CanOperationError(f"{self.channel_info} carries no CAN FD frames")
        data = bytes(msg.dlc) if msg.is_remote_frame else bytes(msg.data)
        self.send_frame(word_of(msg) & _ON_THE_WIRE, data)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        frame = self.receive_frame(timeout)
        if frame is None:
            return None, False
        word, data = frame
        extended, remote = bool(word & EXTENDED), bool(word & REMOTE)
        message = can.Message(
            timestamp=time.time(),
            arbitration_id=word & (EXTENDED_ID if extended else STANDARD_ID),
            is_extended_id=extended,
            is_remote_frame=remote,
            is_error_frame=bool(word & ERROR),
            dlc=len(data),
            data=None if remote else data,
        )
        return message, False


class LocalHub(FrameBus):
    """A bus within one process; as a python-can bus it is the rig's own place on it.

    queue: frames for the rig. near: the members in this process; far: those in others.
    """

    far: Mapping[int, object] = MappingProxyType({})

    def __init__(self, channel: str):
        self.queue: deque[Frame] = deque()
        self.near: list[LocalBus] = []
        self.plugged = True
        super().__init__(channel)

    def join(self, again: Callable[[], LocalHub | None] = lambda: None) -> LocalBus:
        """Return a new member; again: the hub of this bus, once this one is closed.

        Raises CanInitializationError while the adapter is unplugged.
        """
        return LocalBus(self, again)

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send a frame to all members."""
        if not self.plugged:
            raise can.CanOperationError(_UNHEARD)
        for member in self.near:
            member.queue.append((can_id, data))
        if self.far:
            self._send_far(can_id, data)

    def receive_frame(self, timeout_s: float | None) -> Frame | None:
        """Return the next frame of a member, None without one; never waits."""
        return self.queue.popleft() if self.queue else None

    def pass_on(self, sender: LocalBus | None, can_id: int, data: bytes) -> None:
        """Take a member's frame to all others; sender: None for one of another process."""
        for member in self.near:
            if member is not sender:
                member.queue.append((can_id, data))
        if self.far and sender is not None:
            self._send_far(can_id, data)

    def _send_far(self, can_id: int, data: bytes) -> None:
        raise NotImplementedError

    def plug(self, plugged: bool) -> None:
        """Unplug the adapter of all members, who are dead from then on, or plug it in again."""
        self.plugged = plugged
        if not plugged:
            self._dismiss(AWAY)

    def _dismiss(self, told: str) -> None:
        near, self.near = self.near, []
        for member in near:
            member.lose(told)

    def shutdown(self) -> None:
        """Close the bus for all members."""
        super().shutdown()
        self._dismiss(ENDED)


class LocalBus(FrameBus):
    """A member of a bus in its rig's process; it joins again when the rig has ended and is back.

    One whose adapter was unplugged does not: like a socket of SocketCAN, it has to be opened anew.
    queue: frames that it has not read.
    """

    def __init__(self, hub: LocalHub, again: Callable[[], LocalHub | None]):
        self.queue: deque[Frame] = deque()
        self._again = again
        self._told = ENDED
        self._hub: LocalHub | None = None
        try:
            self._join(hub)
        except can.CanOperationError as error:
            raise can.CanInitializationError(str(error)) from error
        super().__init__(hub.channel_info.removeprefix("rig "))

    def _join(self, hub: LocalHub | None) -> LocalHub:
        if hub is None or self._told == AWAY:
            raise can.CanOperationError(self._told)
        if not hub.plugged:
            raise can.CanOperationError(AWAY)
        hub.near = [*hub.near, self]
        self._hub = hub
        return hub

    def lose(self, told: str) -> None:
        """Be off the bus, for a reason; what came before it can be read."""
        self._hub, self._told = None, told

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send a frame to the rig and all other members."""
        hub = self._hub
        if hub is None:
            raise can.CanOperationError(self._told)
        hub.queue.append((can_id, data))
        if len(hub.near) > 1 or hub.far:
            hub.pass_on(self, can_id, data)

    def receive_frame(self, timeout_s: float | None) -> Frame | None:
        """Return the next frame, None without one; never waits."""
        if self.queue:
            return self.queue.popleft()
        if self._hub is None:
            self._join(self._again())
        return None

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        if self._hub is not None:
            self._hub.near = [member for member in self._hub.near if member is not self]
            self.lose(ENDED)
