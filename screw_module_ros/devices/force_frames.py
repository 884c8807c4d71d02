# SPDX-License-Identifier: Apache-2.0
"""A force sensor on CAN that answers one frame with one or several."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial
from typing import Any, ClassVar

from ..can_io.load import Traffic
from ..can_io.port import Port
from ..plugins import told
from .errors import Occupied
from .force_base import ForceSensor
from .force_sensor_settings import ForceSensorSettings
from .life import Phase
from .polled import FRESH, LATE, UNEXPECTED


class FrameSensor(ForceSensor):
    """Matches the frames of an answer.

    request_id, answer_ids: identifiers of the request, and of the frames of an answer in their
    order; the first may be that of the request. The frames carry no number, so a sample is valid
    only when all came, in their order, before the next request. counters: also out_of_order (frames
    without those before them), foreign_requests (of another master).
    """

    #: The request, and the lengths of the frames that answer it [byte].
    REQUEST: ClassVar[bytes] = b""
    SIZES: ClassVar[tuple[int, ...]]

    def __init__(
        self,
        port: Port,
        settings: ForceSensorSettings,
        label: str = "force sensor",
        own: Any = None,
        request_id: int = 0,
        answer_ids: tuple[int, ...] = (),
    ):
        """Raises ValueError unless each frame of an answer has a length and an identifier."""
        if not 0 < len(self.SIZES) == len(answer_ids):
            raise ValueError(
                f"{type(self).__name__}: {len(self.SIZES)} SIZES and {len(answer_ids)} answer_ids: "
                "one of each is wanted for each frame of an answer"
            )
        super().__init__(port, settings, label, own, len(self.SIZES))
        self.port: Port = port
        self.request_id, self.answer_ids = request_id, answer_ids
        self._last = len(self.SIZES) - 1
        self._frames: list[bytes] = []
        self._shared_id = request_id == answer_ids[0]
        for part, can_id in enumerate(answer_ids):
            port.subscribe(can_id, partial(self._on_frame, part))
        if not self._shared_id:
            port.subscribe(request_id, self._on_request)

    @abstractmethod
    def values(self, *frames: bytes) -> tuple[int, tuple[float, ...] | None]:
        """Return status word and six values of an answer, None for values not to be used."""

    @property
    def traffic(self) -> list[Traffic]:
        """Frames for the bus load."""
        sizes = {"request": len(self.REQUEST)}
        sizes |= {f"answer {part + 1}": size for part, size in enumerate(self.SIZES)}
        rate = self.settings.rate
        return [Traffic(f"{self.label} {name}", size, rate) for name, size in sizes.items()]

    def refuse_others(self) -> None:
        """Raise Occupied when somebody else already polls this sensor."""
        poll = {self.request_id: lambda data: bytes(data) == self.REQUEST}
        if self.port.listen(poll, self.settings.listen) is not None:
            raise Occupied(
                f"somebody already polls the {self.label} ({self.place}) on {self.port.name}: is a "
                "second copy of this node running?"
            )

    def ask(self, monotonic_ns: int) -> None:
        """Send the request. Raises BusError."""
        self._frames.clear()
        self.port.send(self.request_id, self.REQUEST)

    def _on_request(self, data: bytes, _arrival_ns: int) -> None:
        """Latch that another master polls: its answers would pass for ours."""
        if self.phase is Phase.RUNNING and data == self.REQUEST:
            self.counters["foreign_requests"] += 1
            self.latch(f"somebody else polls the {self.label} on {self.port.name}")

    def _on_frame(self, part: int, data: bytes, arrival_ns: int) -> None:
        if self.phase is not Phase.RUNNING:
            return
        if part == 0:
            if self._shared_id and data == self.REQUEST:
                self._on_request(data, arrival_ns)
                return
            if self._unanswered > self._too_many_unanswered:
                self.heard()
            self._unanswered = 0
        verdict = self._poll.note(len(data) == self.SIZES[part], part)
        if verdict in (LATE, UNEXPECTED):
            return  # of an older answer: the present one still needs its own
        frames = self._frames
        if verdict != FRESH or len(frames) != part:
            if verdict == FRESH:
                self.counters["out_of_order"] += 1
            frames.clear()
            return
        frames.append(data)
        if part == self._last:
            try:
                status, values = self.values(*frames)
                if values is not None:
                    self.take(status, values)
            except BaseException as error:  # the driver may be somebody else's
                self.lose(f"the driver of the {self.label} failed: {told(error)}")
