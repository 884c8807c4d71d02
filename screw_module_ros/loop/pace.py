# SPDX-License-Identifier: Apache-2.0
"""How long to wait for the force sample of the same tick: where it is always late, not at all."""

from __future__ import annotations

_SHARE = 0.1  # of a period
_TRY_AGAIN = 64  # periods


class Pace:
    """Remembers whether the wait was worth it; wait_ns: how long it is [ns]."""

    def __init__(self, period_ns: int):
        self.wait_ns = round(_SHARE * period_ns)
        self._quick = True
        self._periods = 0

    def worth_waiting(self) -> bool:
        """Return whether to wait in this period; call once a period."""
        self._periods += 1
        return self._quick or self._periods % _TRY_AGAIN == 0

    def came(self, came: bool) -> None:
        """Note what became of a wait."""
        self._quick = came
