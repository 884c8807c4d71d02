# SPDX-License-Identifier: Apache-2.0
"""Wait for the force sample of the same tick, unless the sample is always late."""

from __future__ import annotations

_SHARE = 0.1  # of a period
_TRY_AGAIN = 64  # periods


class Pace:
    """Records whether the wait succeeded; wait_ns: its length [ns]."""

    def __init__(self, period_ns: int):
        self.wait_ns = round(_SHARE * period_ns)
        self._quick = True
        self._periods = 0

    def worth_waiting(self) -> bool:
        """Return whether to wait in this period; call once a period."""
        self._periods += 1
        return self._quick or self._periods % _TRY_AGAIN == 0

    def came(self, came: bool) -> None:
        """Record whether the sample came during the wait."""
        self._quick = came
