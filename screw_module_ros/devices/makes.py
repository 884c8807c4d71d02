# SPDX-License-Identifier: Apache-2.0
"""Which parameters of which nodes a choice of makes sets."""

from __future__ import annotations

from typing import Any

from ..profiles import NODES, by_kind, load
from .drive_settings import JOINTS

_PREFIXES = {"manus": tuple(f"{joint}." for joint in JOINTS)}
"""Of the parameters of each device, where a node has several."""


def node_parameters(devices: str, simulation: bool) -> dict[str, dict[str, Any]]:
    """Return what a list like `epos4,sick_ahm36` sets: node -> parameter -> value.

    simulation: with what the simulated devices of these makes need. Raises as `by_kind`.
    """
    found: dict[str, dict[str, Any]] = {}
    for kind, name in by_kind(devices).items():
        needed = load(name).simulated.parameters if simulation else {}
        for node in NODES[kind]:
            prefixes = _PREFIXES.get(node, ("",))
            values = {f"{each}{key}": value for each in prefixes for key, value in needed.items()}
            found[node] = {"profile": name, **values}
    return found
