# SPDX-License-Identifier: Apache-2.0
"""A row of the group `intruders`."""

from __future__ import annotations

from .limits import AT_ONCE, VIA_SUPERVISOR
from .row import GOES_ON, OFF, Act, Alarm, Row, nothing

GROUP = "intruders"


def intruder_row(
    name: str, text: str, act: Act, who: str, alarm: Alarm | None, recovery: str,
    back: Act = nothing, safe: str = OFF, within: int = AT_ONCE, watch: float = 0.3,
    apart: bool = False,
) -> Row:  # fmt: skip
    """Return a row of the group; `GOES_ON` has no time limit."""
    stops = safe != GOES_ON
    return Row(
        name=name, group=GROUP, fault=text, inject=act, back=back, alarm=alarm, recovery=recovery,
        noticed_by=who, within=within if stops else 0,
        plane_within=within + VIA_SUPERVISOR if stops else 0, safe=safe, watch=watch,
        apart=apart,
    )  # fmt: skip
