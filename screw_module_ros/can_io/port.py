# SPDX-License-Identifier: Apache-2.0
"""One CAN bus with one reader: dispatches frames by identifier, sends frames.

A realtime loop reads the bus with `pump`. Blocking transfers (SDO) run in other threads and get
their answers through the same loop; if no loop pumps, `wait_for` pumps itself.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import can

from ..clock import Clock, WallClock
from .errors import BusError
from .frames import ERROR, EXTENDED_ID, OWN, STANDARD_ID, Frame, frames_of

Callback = Callable[[bytes, int], None]

SYNC_ID = 0x80
#: Frames per pump at most, so that a device that floods the bus cannot block the loop.
MAX_FRAMES_PER_PUMP = 256
_BUS_OFF_FLAG = 0x40  # Linux CAN error frames: CAN_ERR_BUSOFF in the identifier
_RESTARTED_FLAG = 0x100  # CAN_ERR_RESTARTED, set beside the flag above
_LOOP_IS_ALIVE_NS = 5_000_000
_SLICE_NS = 1_000_000
_LOCK_S = 0.001


class Port:
    """One CAN bus, one reader.

    bus: an open python-can bus. sync_producer: this process sends SYNC here, so any other SYNC is
    an error. echoes: frames that are not marked as received are our own; on SocketCAN they are
    those of other programs of this computer. name: of the bus in messages. clock: of arrival stamps
    and waits. open_anew(): opens the bus once more, for `restore`. failed: the bus has refused a
    frame or could not be read, and has taken none since. counters: frames since it was first
    opened, by kind: sent, received, echoes, unclaimed, ignored, error_frames, send_errors,
    receive_errors, foreign_sync.
    """

    def __init__(
        self,
        bus: can.BusABC,
        sync_producer: bool = True,
        name: str = "",
        clock: Clock | None = None,
        echoes: bool = True,
        open_anew: Callable[[], can.BusABC] | None = None,
    ):
        self.bus = bus
        self.sync_producer = sync_producer
        self.name = name or str(bus.channel_info)
        self.clock = clock or WallClock()
        self._frames: Any = frames_of(bus)
        self._arrivals: Any = self.clock.arrivals(self._frames)
        self._open_anew = open_anew
        self.failed = False
        self.counters: Counter[str] = Counter()
        self.bus_off = False
        self._echoes = echoes
        self._callbacks: dict[int, tuple[Callback, ...]] = {}
        self._reading = threading.Lock()
        self._loop_waits = False
        self._sending = threading.Lock()
        self._pumped_ns = 0

    # -- sending ---------------------------------------------------------------------------------

    def send(self, can_id: int, data: bytes) -> None:
        """Send one classical frame with an 11-bit identifier; safe from any thread.

        Raises BusError when the bus does not accept it (bus off, cable, full buffer).
        """
        try:
            with self._sending:  # not every backend of python-can takes sends from two threads
                self._frames.send_frame(can_id, data)
                self.failed = False  # within: `restore` may exchange the bus right after
                self._arrivals.sent()
        except (can.CanError, OSError) as error:
            self.counters["send_errors"] += 1
            self.failed = True
            raise BusError(
                f"cannot send on {self.name}: {error.__cause__ or error}; check adapter, cable, "
                "termination and bit rate"
            ) from error
        self.counters["sent"] += 1

    def send_sync(self, now_ns: int) -> None:
        """Send SYNC (CiA 301, 7.2.5) and notify the devices of this port that wait for it.

        now_ns: CLOCK_MONOTONIC [ns].
        """
        self.send(SYNC_ID, b"")
        for callback in self._callbacks.get(SYNC_ID, ()):
            callback(b"", now_ns)

    # -- receiving -------------------------------------------------------------------------------

    def subscribe(self, can_id: int, callback: Callback) -> None:
        """Call `callback(data, arrival)` for each frame; arrival on CLOCK_MONOTONIC [ns]."""
        self._callbacks[can_id] = (*self._callbacks.get(can_id, ()), callback)

    def unsubscribe(self, can_id: int, callback: Callback) -> None:
        """Undo one `subscribe`; unknown callbacks are ignored."""
        left = tuple(each for each in self._callbacks.get(can_id, ()) if each != callback)
        if left:
            self._callbacks[can_id] = left
        else:
            self._callbacks.pop(can_id, None)

    def pump(self, until_ns: int = 0) -> int:
        """Wait at most until `until_ns` [ns] for a frame, then dispatch all; 0 = no wait.

        Returns the number of frames, own echoes not counted. Raises BusError when the bus failed.
        """
        self._loop_waits = True
        if not self._reading.acquire(blocking=False):
            self.clock.acquire(self._reading)
        try:
            self._loop_waits = False
            handled = self._pump(until_ns)
        finally:
            self._reading.release()
        self._pumped_ns = self.clock.now_ns()
        return handled

    def _pump(self, until_ns: int) -> int:
        receive, dispatch, now_ns = self._arrivals.receive, self._dispatch, self.clock.now_ns
        handled = 0
        for _ in range(MAX_FRAMES_PER_PUMP):
            if handled and not self._arrivals.expects():
                break  # a frame that nobody counts is read by the next pump
            try:
                frame = receive(0 if handled else until_ns)
            except (can.CanError, OSError) as error:
                self.counters["receive_errors"] += 1
                self.failed = True
                raise BusError(
                    f"cannot receive on {self.name}: {error.__cause__ or error}; check adapter, "
                    "cable and driver"
                ) from error
            if frame is None:
                break
            handled += dispatch(frame, now_ns())
        return handled

    def _dispatch(self, frame: Frame, now_ns: int) -> int:
        can_id, data = frame
        if can_id > STANDARD_ID:
            if can_id & ~(OWN | STANDARD_ID):  # no device of ours sends such frames
                self._note_odd(can_id)
                return 1
            if self._echoes:
                self.counters["echoes"] += 1
                return 0
            can_id &= STANDARD_ID
        self.counters["received"] += 1
        callbacks = self._callbacks.get(can_id)
        if can_id == SYNC_ID and self.sync_producer:
            self.counters["foreign_sync"] += 1
        elif callbacks is not None:
            for callback in callbacks:
                callback(data, now_ns)
        else:
            self.counters["unclaimed"] += 1
        return 1

    def _note_odd(self, word: int) -> None:
        if not word & ERROR:
            self.counters["ignored"] += 1
            return
        self.counters["error_frames"] += 1
        classes = word & EXTENDED_ID
        if classes & _BUS_OFF_FLAG:
            self.bus_off = True
        elif classes & _RESTARTED_FLAG:
            self.bus_off = False

    # -- waiting: not for the realtime loop ------------------------------------------------------

    def wait_for(self, ready: Callable[[], object], timeout_s: float) -> bool:
        """Block until `ready()`, for `timeout_s` [s] at most; return whether it became ready.

        The loop that pumps this port receives the frames; without such a loop this method pumps.
        Raises BusError when the bus fails meanwhile.
        """
        clock = self.clock
        deadline_ns = clock.now_ns() + round(timeout_s * 1e9)
        while not ready():
            now_ns = clock.now_ns()
            if now_ns >= deadline_ns:
                return False
            slice_ns = min(deadline_ns, now_ns + _SLICE_NS)
            # A lock is not fair: taking it again at once would block the loop all the time.
            if self._loop_waits or now_ns - self._pumped_ns < _LOOP_IS_ALIVE_NS:
                clock.sleep_until(slice_ns)
            elif self._reading.acquire(timeout=_LOCK_S):
                try:
                    self._pump(slice_ns)
                finally:
                    self._reading.release()
        return True

    def listen(self, can_ids: dict[int, Callable[[bytes], bool]], listen_s: float) -> int | None:
        """Listen for `listen_s` [s]; return the identifier of the first frame that passes its test.

        If this process produces SYNC, any received SYNC counts too.
        """
        found: list[int] = []

        def watcher(can_id: int, test: Callable[[bytes], bool]) -> Callback:
            return lambda data, _arrival: found.append(can_id) if test(data) else None

        watchers = [(can_id, watcher(can_id, test)) for can_id, test in can_ids.items()]
        for can_id, watch in watchers:
            self.subscribe(can_id, watch)
        before = self.counters["foreign_sync"]
        self.wait_for(lambda: found or self.counters["foreign_sync"] > before, listen_s)
        for can_id, watch in watchers:
            self.unsubscribe(can_id, watch)
        if self.counters["foreign_sync"] > before:
            return SYNC_ID
        return found[0] if found else None

    def restore(self) -> None:
        """Open the bus anew if it has failed: what was opened stays dead when an adapter was away.

        Raises BusError while it cannot be opened; the next call tries again.
        """
        if not self.failed or self._open_anew is None:
            return
        with self._reading, self._sending:
            self._arrivals.close()
            with suppress(can.CanError, OSError):  # many an adapter can be opened only once
                self.bus.shutdown()
            self._frames = self._arrivals = _NoBus()
        bus = self._open_anew()
        with self._reading, self._sending:
            self.bus, self._frames = bus, frames_of(bus)
            self._arrivals = self.clock.arrivals(self._frames)
            self.failed = self.bus_off = False

    def close(self) -> None:
        """Close the bus."""
        self._arrivals.close()
        self.bus.shutdown()


class _NoBus:
    """In place of a bus that has failed and cannot be opened anew: its frames and arrivals."""

    def send_frame(self, _can_id: int, _data: bytes) -> None:
        raise can.CanOperationError("it has failed and is not open")

    def receive(self, _until_ns: int) -> Frame | None:
        raise can.CanOperationError("it has failed and is not open")

    def expects(self) -> bool:
        return False

    def close(self) -> None:
        """Do nothing: there is nothing to close."""
