# SPDX-License-Identifier: Apache-2.0
"""Requests of other threads that the loop's thread carries out, between two ticks.

State of motion, gate and devices changes nowhere else while a loop runs.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from ..clock import Clock

_ANSWER_S = 1.0


class Requests:
    """A queue of acts, each with its answer."""

    def __init__(self) -> None:
        self._asked: queue.SimpleQueue[tuple[Callable[[], Any], Future]] = queue.SimpleQueue()

    def put(self, act: Callable[[], Any]) -> Future:
        """Have the loop carry out an act; return its answer to be."""
        answer: Future = Future()
        self._asked.put((act, answer))
        return answer

    def ask(self, act: Callable[[], Any], clock: Clock) -> Any:
        """Have the loop carry out an act; return its answer, or a sentence why it cannot.

        Raises what the act raises. What its caller takes for failed is not carried out later.
        """
        answer = self.put(act)
        try:
            clock.wait_for(answer.done, _ANSWER_S)
        finally:
            too_late = answer.cancel()
        return "the loop does not run: activate the node" if too_late else answer.result()

    @property
    def waiting(self) -> bool:
        """Whether something has been asked for."""
        return not self._asked.empty()

    def serve(self) -> None:
        """Carry out what has been asked for; for the loop's thread."""
        while not self._asked.empty():
            act, answer = self._asked.get_nowait()
            if answer.set_running_or_notify_cancel():
                try:
                    answer.set_result(act())
                except Exception as error:
                    answer.set_exception(error)
