# SPDX-License-Identifier: Apache-2.0
"""What a screen has to know of the protocols to offer them and to draw their targets."""

from __future__ import annotations

from typing import Any

from .protocol import plan, points
from .protocol_file import SHIPPED, load_protocol


def protocols_for_screens() -> list[dict[str, Any]]:
    """Return name, title, space, number of trials, centre and targets [m] of what is shipped."""
    found = []
    for name in SHIPPED:
        protocol = load_protocol(name)
        targets = {point for block in protocol.blocks for point in points(protocol, block)}
        found.append(
            {
                "name": name,
                "title": protocol.title,
                "space": protocol.space,
                "trials": sum(1 for _ in plan(protocol)),
                "centre": protocol.centre,
                "targets": sorted(targets - {protocol.centre}),
            }
        )
    return found
