# SPDX-License-Identifier: Apache-2.0
"""SIGINT and SIGTERM as an event that the main thread may wait for."""

from __future__ import annotations

import queue
import signal
import threading

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def stop_on_signals(stopping: threading.Event) -> None:
    """Set `stopping` when SIGINT or SIGTERM comes; call from the main thread.

    A thread of its own sets it. The handler must not: it runs in the main thread in the midst of
    what that is doing, and where that is `stopping.wait`, the event's lock is held for moments;
    `set` would wait for it for ever, and the process could only be killed.
    """
    caught: queue.SimpleQueue[int] = queue.SimpleQueue()  # made to be put into by handlers

    def wait() -> None:
        caught.get()
        stopping.set()

    threading.Thread(target=wait, name="signals", daemon=True).start()
    for number in SIGNALS:
        signal.signal(number, lambda given, _: caught.put(given))
