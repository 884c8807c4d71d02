# SPDX-License-Identifier: Apache-2.0
"""The life of one device, as its driver knows it::

    NEW --- configure ---> CONFIGURED --- start ---> RUNNING
     ^                          |                       |
     +--------------------------+-----------------------+   stop, or its configuration is gone
"""

from __future__ import annotations

from enum import Enum

from ..clock import Clock

UNWATCHED_NS = 2_000_000_000
"""Time without a reader of its bus after which a device may have lost what it was told [ns]."""


class Phase(Enum):
    """How far a device has come."""

    NEW = 0
    CONFIGURED = 1
    RUNNING = 2


class Remedy(Enum):
    """What clearing a fault has to do to the device; each does what the one before does, too."""

    NOTHING = 0
    CONFIGURE = 1
    RESET = 2


class Life:
    """Base of the drivers.

    phase: see above. remedy: a device that needs one may still be RUNNING: a drive
    that somebody may have altered must still hear its zero.
    """

    def __init__(self, clock: Clock):
        self.phase = Phase.NEW
        self.remedy = Remedy.NOTHING
        self._clock = clock
        self._configured_ns: int | None = None

    @property
    def configured(self) -> bool:
        """Whether `start` may follow: it runs, or was configured just now and not left since.

        While nobody listens to it, it may restart unheard.
        """
        since_ns = self._configured_ns
        if since_ns is None or self.phase is Phase.NEW:
            return False
        return self.phase is Phase.RUNNING or self._clock.now_ns() - since_ns <= UNWATCHED_NS

    @property
    def unsound(self) -> bool:
        """Whether it has to be configured again, or for the first time."""
        return self.phase is Phase.NEW or self.remedy is not Remedy.NOTHING

    def need(self, remedy: Remedy) -> None:
        """Note what the next clearing of a fault has to do, if it is more than what is noted."""
        if remedy.value > self.remedy.value:
            self.remedy = remedy

    def become_new(self) -> None:
        """Count the configuration as gone: nobody watches any more, or it has restarted."""
        self._configured_ns = None  # first: see `become_running`
        self.phase = Phase.NEW

    def become_configured(self) -> None:
        """Note that the device has just been configured."""
        self._configured_ns = self._clock.now_ns()
        self.phase = Phase.CONFIGURED

    def become_running(self) -> None:
        """Note that the device runs, unless another thread has heard just now that it restarted."""
        self.phase = Phase.RUNNING
        if self._configured_ns is None:
            self.phase = Phase.NEW
