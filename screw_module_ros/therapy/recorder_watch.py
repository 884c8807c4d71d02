# SPDX-License-Identifier: Apache-2.0
"""Whether a session that is to be recorded still is."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting


class RecorderWatchSettings(NamedTuple):
    """How long the recorder, which reports once a second, may be silent. The bound is ours."""

    timeout: Annotated[
        float, Setting("silence of the recorder after which a session pauses", "s", 2.0, 60.0)
    ] = 5.0


class RecorderWatch:
    """Watches over one recording, from `begin` on."""

    def __init__(self, settings: RecorderWatchSettings = RecorderWatchSettings()):  # noqa: B008
        self._settings = settings
        self._heard_ns = 0
        self._problem = ""

    def begin(self, now_ns: int) -> None:
        """Note that the recording has begun [ns]; what was heard before does not count."""
        self._heard_ns, self._problem = now_ns, ""

    def hear(self, recording: bool, said: str, now_ns: int) -> None:
        """Note what the recorder reports: whether it records, and what it says of that."""
        self._heard_ns = now_ns
        if not recording:
            self._problem = f"the recording has ended: {said}"

    def lost(self, now_ns: int) -> str:
        """Return why there is no recording any more, empty while there is."""
        timeout = self._settings.timeout
        if not self._problem and now_ns - self._heard_ns > timeout * 1e9:
            self._problem = f"the session recorder has been silent for {timeout:g} s"
        return self._problem
