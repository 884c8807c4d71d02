# SPDX-License-Identifier: Apache-2.0
"""Monitors the attendance of a therapist's page during a session."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting


class AttendanceSettings(NamedTuple):
    """Longest silence of a page. The value is ours."""

    timeout: Annotated[
        float, Setting("silence of a therapist's page after which a session pauses", "s", 0.5, 10.0)
    ] = 2.0


class Attendance:
    """Reports the silence of a page that has attended the session; without a page, nothing."""

    def __init__(self, settings: AttendanceSettings = AttendanceSettings()):  # noqa: B008
        self._settings = settings
        self._heard_ns: int | None = None

    def begin(self, attended: bool, now_ns: int) -> None:
        """Begin a session at now_ns [ns]; attended: a page has promised to attend it."""
        self._heard_ns = now_ns if attended else None

    def resume(self, now_ns: int) -> None:
        """Go on at now_ns [ns]: the page of an attended session gets its time again."""
        if self._heard_ns is not None:
            self._heard_ns = now_ns

    def hear(self, now_ns: int) -> None:
        """Note an attendance message; now_ns: time [ns]."""
        self._heard_ns = now_ns

    def pause_reason(self, now_ns: int) -> str:
        """Return why the session must pause, empty if it may continue; now_ns: time [ns]."""
        timeout = self._settings.timeout
        if self._heard_ns is None or now_ns - self._heard_ns <= timeout * 1e9:
            return ""
        return f"the therapist's page has been silent for {timeout:g} s"
