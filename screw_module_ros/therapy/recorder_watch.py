# SPDX-License-Identifier: Apache-2.0
"""Monitors the recording of a session."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting


class RecorderWatchSettings(NamedTuple):
    """Longest silence of the recorder, which reports once a second. The value is ours."""

    timeout: Annotated[
        float, Setting("silence of the recorder after which a session pauses", "s", 2.0, 60.0)
    ] = 5.0


class RecorderWatch:
    """Monitors one recording, from `begin` on. silent: it was lost without a report of its end."""

    def __init__(self, settings: RecorderWatchSettings = RecorderWatchSettings()):  # noqa: B008
        self._settings = settings
        self._heard_ns = 0
        self._problem = ""
        self.silent = False

    def begin(self, now_ns: int) -> None:
        """Start monitoring; now_ns: time [ns]. Earlier reports do not count."""
        self._heard_ns, self._problem, self.silent = now_ns, "", False

    def hear(self, recording: bool, message: str, now_ns: int) -> None:
        """Note a report; recording: whether it records; message: its message; now_ns: time [ns]."""
        self._heard_ns = now_ns
        if not recording:
            self._problem = f"the recording has ended: {message}"

    def lost(self, now_ns: int) -> str:
        """Return why the recording has ended, empty while it continues; now_ns: time [ns]."""
        timeout = self._settings.timeout
        if not self._problem and now_ns - self._heard_ns > timeout * 1e9:
            self._problem = f"the session recorder has been silent for {timeout:g} s"
            self.silent = True
        return self._problem
