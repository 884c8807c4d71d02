# SPDX-License-Identifier: Apache-2.0
"""What a screen has to know of the protocols to offer them and to draw their targets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from .protocol import Protocol, plan, points
from .protocol_file import SHIPPED, ProtocolError, load_protocol

_MOST = 50  # files that are offered


def protocols_for_screens(
    folder: Path | None = None, told: Callable[[str], None] = lambda sentence: None
) -> list[dict[str, Any]]:
    """Return what to start each protocol by (`name`) and what it calls itself (`protocol`).

    Besides title, space, number of trials, centre and targets [m]. folder: of protocols of one's
    own, beside those of the package. told: takes what is wrong with a file, which is not offered
    then.
    """
    found = [_described(name, load_protocol(name)) for name in SHIPPED]
    files = sorted(folder.glob("*.yaml"))[:_MOST] if folder is not None else ()
    for file in files:
        try:
            found.append(_described(file.name, load_protocol(file)))
        except ProtocolError as error:
            told(str(error))
    return found


def _described(name: str, protocol: Protocol) -> dict[str, Any]:
    targets = {point for block in protocol.blocks for point in points(protocol, block)}
    return {
        "name": name,
        "protocol": protocol.name,
        "title": protocol.title,
        "space": protocol.space,
        "trials": sum(1 for _ in plan(protocol)),
        "centre": protocol.centre,
        "targets": sorted(targets - {protocol.centre}),
    }
