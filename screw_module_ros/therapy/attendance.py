# SPDX-License-Identifier: Apache-2.0
"""Whether the therapist's page that attends a session is still there."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting


class AttendanceSettings(NamedTuple):
    """How long a page may be silent. The bound is ours."""

    timeout: Annotated[
        float, Setting("silence of a therapist's page after which a session pauses", "s", 0.5, 10.0)
    ] = 2.0


class Attendance:
    """Watches over a session once a page has attended it; without any page it has no say."""

    def __init__(self, settings: AttendanceSettings = AttendanceSettings()):  # noqa: B008
        self._settings = settings
        self._heard_ns: int | None = None

    def hear(self, now_ns: int) -> None:
        """Note that somebody is at the page [ns]."""
        self._heard_ns = now_ns

    def missed(self, now_ns: int) -> str:
        """Return why the session must not go on, empty when it may."""
        timeout = self._settings.timeout
        if self._heard_ns is None or now_ns - self._heard_ns <= timeout * 1e9:
            return ""
        return f"the therapist's page has been silent for {timeout:g} s"

    def begin(self, now_ns: int) -> None:
        """Forget a page that has gone: somebody starts the session, or goes on, without it."""
        if self.missed(now_ns):
            self._heard_ns = None
