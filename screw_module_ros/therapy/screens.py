# SPDX-License-Identifier: Apache-2.0
"""Data of the protocols for screens, which offer them and draw their targets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from .protocol import Protocol, plan, points
from .protocol_file import SHIPPED, ProtocolError, load_protocol
from .samples import Point

_MOST = 50  # largest number of offered files


def protocols_for_screens(
    folder: Path | None = None, on_problem: Callable[[str], None] = lambda sentence: None
) -> list[dict[str, Any]]:
    """Return for each protocol the name to start it by (`name`), its own name (`protocol`), title,
    space, number of trials, centre, targets [m], and those of each block by its title (`blocks`).

    folder: of the user's protocols, in addition to the packaged ones. on_problem: called with the
    error of an invalid file, which is omitted.
    """
    found = [_described(name, load_protocol(name)) for name in SHIPPED]
    files = sorted(folder.glob("*.yaml"))[:_MOST] if folder is not None else ()
    for file in files:
        try:
            found.append(_described(file.name, load_protocol(file)))
        except ProtocolError as error:
            on_problem(str(error))
    return found


def _described(name: str, protocol: Protocol) -> dict[str, Any]:
    blocks: dict[str, set[Point]] = {}
    for block in protocol.blocks:
        targets = blocks.setdefault(block.title, set())
        targets.update(points(protocol, block))
        targets.discard(protocol.centre)
    return {
        "name": name,
        "protocol": protocol.name,
        "title": protocol.title,
        "space": protocol.space,
        "trials": sum(1 for _ in plan(protocol)),
        "centre": protocol.centre,
        "targets": sorted(set().union(*blocks.values())),
        "blocks": {title: sorted(targets) for title, targets in blocks.items()},
    }
