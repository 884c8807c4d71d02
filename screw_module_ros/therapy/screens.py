# SPDX-License-Identifier: Apache-2.0
"""Data of the protocols for screens, which offer them and draw their targets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..settings import SettingError
from .protocol import Protocol, plan, points
from .protocol_file import SHIPPED, load_protocol
from .samples import Point

_MOST = 50  # largest number of offered files


def protocols_for_screens(
    folder: Path | None = None, on_problem: Callable[[str], None] = lambda sentence: None
) -> list[dict[str, Any]]:
    """Return for each protocol the name to start it by (`name`), its own name (`protocol`), title,
    space, number of trials, centre, targets [m], and those of each block by its title (`blocks`).

    folder: of the user's protocols, in addition to the packaged ones. on_problem: called with the
    error of an invalid file, or of one with the name of another protocol, which is omitted.
    """
    found = [_described(name, load_protocol(name)) for name in SHIPPED]
    files = sorted(folder.glob("*.yaml"))[:_MOST] if folder is not None else ()
    for file in files:
        try:
            own = _described(file.name, load_protocol(file))
            _check_name(own, found)
        except SettingError as error:
            on_problem(str(error))
        else:
            found.append(own)
    return found


def _check_name(own: dict[str, Any], found: list[dict[str, Any]]) -> None:
    """Raise SettingError if another protocol has its name, by which screens tell them apart."""
    for other in found:
        if own["protocol"] == other["protocol"]:
            raise SettingError(
                f"protocol {own['name']}: name = {own['protocol']!r} is that of {other['name']}, "
                "whose targets the pages would show: give it a name of its own"
            )


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
