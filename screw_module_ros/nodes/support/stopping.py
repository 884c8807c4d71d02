# SPDX-License-Identifier: Apache-2.0
"""SIGINT and SIGTERM as an event to wait for, or as a flag to poll."""

from __future__ import annotations

import queue
import signal
import threading
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def stop_on_signals(stopping: threading.Event) -> None:
    """Set `stopping` when SIGINT or SIGTERM comes; call from the main thread.

    A separate thread sets the event. The signal handler must not: it interrupts the main thread,
    which may be in `stopping.wait` and hold the event's lock. Then `set` would wait for ever.
    """
    caught: queue.SimpleQueue[int] = queue.SimpleQueue()  # made to be put into by handlers

    def wait() -> None:
        caught.get()
        stopping.set()

    threading.Thread(target=wait, name="signals", daemon=True).start()
    for number in _SIGNALS:
        signal.signal(number, lambda received, _: caught.put(received))


def stopped() -> None:
    """Ignore further signals: the process ends, and the interpreter removes the handlers first.

    Otherwise a second Ctrl-C would kill a process that has finished its work.
    """
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class StopFlag:
    """True once SIGINT or SIGTERM came between `catch` and `release`; both from the main thread.

    Not an Event: a handler that interrupts another one in `set` would wait for ever.
    """

    def __init__(self) -> None:
        self._came = False
        self._before: dict[signal.Signals, Any] = {}

    def __bool__(self) -> bool:
        return self._came

    def catch(self) -> None:
        """Handle the signals from now on."""
        for number in _SIGNALS:
            self._before[number] = signal.signal(number, self._note)

    def release(self) -> None:
        """Restore the previous handlers."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def _note(self, *_: object) -> None:
        self._came = True
