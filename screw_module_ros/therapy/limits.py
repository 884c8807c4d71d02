# SPDX-License-Identifier: Apache-2.0
"""Limits of a session set by the therapist: stiffest wall, and workspace of the targets.

The limits are applied to the protocol before the session starts, so that the bag records the
executed protocol and a replay computes it again.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import yaml

from ..settings import Setting, parse
from .adaptation import AdaptationBounds
from .line import PLANE, SPACE, VERTICAL
from .protocol import Protocol, ways
from .protocol_file import parse_protocol
from .wishes import WishLimits

_SOFTEST_SHARE = 0.5  # of the stiffest walls, if these are softer than the protocol's softest
_ROUNDING = 1e-9  # [m] rounding of the targets' sines
_AXES = {
    PLANE: (True, True, False), VERTICAL: (False, False, True), SPACE: (True, True, True)
}  # fmt: skip


class AssistanceLimits(NamedTuple):
    """Largest assistance of a session with any protocol. The default has no effect."""

    stiffness: Annotated[
        float, Setting("stiffest wall of the next session", "N/m", 0.0, 800.0, live=True)
    ] = 800.0


def limited_text(text: str, limits: AssistanceLimits) -> str:
    """Return a protocol's YAML with limited stiffness, unchanged if no wall is stiffer."""
    content = parse(text, "protocol")
    if not _limit(content, limits.stiffness):
        return text
    return yaml.safe_dump(content, sort_keys=False)


def _limit(content: dict[str, Any], stiffest: float) -> bool:
    """Limit every stiffness of a valid protocol in place; return whether one was too large."""
    if content.get("adaptation") is not None:  # an omitted bound has a default, also to be limited
        content["adaptation"] = {**AdaptationBounds()._asdict(), **content["adaptation"]}
    sections = [(content["guidance"], ("back_stiffness", "side_stiffness"))]
    sections.append((content["rules"], ("prepare_stiffness",)))
    sections.append((content.get("adaptation") or {}, ("stiffest",)))
    sections += [(block, ("stiffness",)) for block in content["blocks"]]
    found = False
    for section, names in sections:
        for name in names:
            if section.get(name, 0.0) > stiffest:
                section[name], found = stiffest, True
    found |= _limit_growth(content, stiffest)
    if found:
        _make_fit(content, stiffest)
    return found


def _limit_growth(content: dict[str, Any], stiffest: float) -> bool:
    """Limit the growth so that no wall passes the limit at the longest possible end of a trial.

    Without a limit it stays: the controllers then bound the growing wall.
    """
    if stiffest >= AssistanceLimits().stiffness:
        return False
    guidance, rules = content["guidance"], content["rules"]
    shortest = (content.get("adaptation") or {}).get("shortest", guidance["duration"])
    over_time = rules["give_up"] + rules["hold"] - shortest
    over_prepare = rules["prepare_limit"] + rules["settle_time"] - rules["prepare_duration"]
    most = min(
        (stiffest - stiffness) / longest if longest > 0.0 else math.inf
        for stiffness, longest in (
            (guidance["back_stiffness"], over_time),
            (rules["prepare_stiffness"], over_prepare),
        )
    )
    if guidance["growth"] <= most:
        return False
    guidance["growth"] = most
    return True


def _make_fit(content: dict[str, Any], stiffest: float) -> None:
    """Adjust the settings that depend on the stiffness: softest walls, adaptation."""
    if stiffest == 0.0:
        content.pop("adaptation", None)  # without walls there is nothing to adapt
    bounds = content.get("adaptation")
    if bounds and bounds["softest"] >= bounds["stiffest"]:
        bounds["softest"] = _SOFTEST_SHARE * bounds["stiffest"]


def allowed_protocol(
    text: str, name: str, assistance: AssistanceLimits, workspace: WishLimits
) -> tuple[Protocol, str]:
    """Return the limited protocol of a YAML text, and its YAML.

    Raises SettingError for an invalid protocol, ValueError for a target outside the workspace.
    """
    parse_protocol(text, name)
    text = limited_text(text, assistance)
    protocol = parse_protocol(text, name)
    _check_workspace(protocol, workspace)
    return protocol, text


def _check_workspace(protocol: Protocol, workspace: WishLimits) -> None:
    visited = {
        point for block in protocol.blocks for way in ways(protocol, block) for point in way
    }
    used, ranges = _AXES[protocol.space], workspace.ranges()
    for point in sorted(visited):
        for counts, axis, value, (low, high) in zip(used, "xyz", point, ranges, strict=True):
            if counts and not low - _ROUNDING <= value <= high + _ROUNDING:
                raise ValueError(
                    f"{protocol.name}: the target at {axis} = {value:.3f} m lies outside the "
                    f"workspace allowed, {low:g} to {high:g} m: widen it, or choose another "
                    "protocol"
                )
