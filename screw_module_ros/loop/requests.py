# SPDX-License-Identifier: Apache-2.0
"""Requests of other threads that the loop's thread carries out, between two steps.

State of motion, gate and devices changes nowhere else while a loop runs.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from ..clock import Clock
from ..devices.errors import NotNow

_ANSWER_S = 1.0

Answer = TypeVar("Answer")


class Requests:
    """A queue of acts, each with its answer. clock: of who waits for an answer."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._asked: queue.SimpleQueue[tuple[Callable[[], object], Future]] = queue.SimpleQueue()

    def put(self, act: Callable[[], Answer]) -> Future[Answer]:
        """Have the loop carry out an act; return its answer to be."""
        answer: Future[Answer] = Future()
        self._asked.put((act, answer))
        return answer

    def ask(self, act: Callable[[], Answer]) -> Answer:
        """Have the loop carry out an act; return its answer.

        Raises what the act raises, and NotNow when no loop carries it out. What its caller takes
        for failed is not carried out later.
        """
        answer = self.put(act)
        try:
            self.clock.wait_for(answer.done, _ANSWER_S)
        finally:
            too_late = answer.cancel()
        if too_late:
            raise NotNow("the loop does not run: activate the node")
        return answer.result()

    def serve(self) -> None:
        """Carry out what has been asked for; the loop's thread calls it before each step."""
        while not self._asked.empty():
            act, answer = self._asked.get_nowait()
            if answer.set_running_or_notify_cancel():
                try:
                    answer.set_result(act())
                except Exception as error:
                    answer.set_exception(error)

    def discard(self) -> None:
        """Carry out nothing of what has been asked for; before a start of the loop."""
        while not self._asked.empty():
            self._asked.get_nowait()[1].cancel()
