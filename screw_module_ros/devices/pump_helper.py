# SPDX-License-Identifier: Apache-2.0
"""A thread that keeps frames coming in while somebody blocks and no loop pumps the port."""

from __future__ import annotations

import threading
from collections.abc import Callable

from .errors import BusError

_SLICE_S = 0.005


class PumpHelper:
    """Runs while at least one caller has entered; its error is handed over on leaving.

    pump_if_idle(timeout [s]): pumps once unless a loop does anyway; returns whether it pumped.
    """

    def __init__(self, pump_if_idle: Callable[[float], bool]):
        self._pump_if_idle = pump_if_idle
        self._lock = threading.Lock()
        self._users = 0
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._error: BusError | None = None

    def enter(self) -> None:
        """Start pumping unless it runs already."""
        with self._lock:
            self._users += 1
            if self._users == 1:
                self._stop.clear()
                self._error = None
                self._thread = threading.Thread(target=self._run, name="can-pump", daemon=True)
                self._thread.start()

    def leave(self) -> BusError | None:
        """Stop with the last caller; return the error that ended the pumping, if one did."""
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._stop.set()
                self._thread.join()
            return self._error

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                if not self._pump_if_idle(_SLICE_S):
                    self._stop.wait(_SLICE_S / 2)
        except BusError as error:
            self._error = error
