# SPDX-License-Identifier: Apache-2.0
"""What a therapist allows a session: no wall stiffer, no target farther than that.

A session is limited before it starts, by limiting its protocol: what is recorded is then what was
done, and a replay computes it again.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import yaml

from ..settings import Setting
from .protocol import Protocol, ways
from .protocol_file import parse_protocol
from .wishes import WishLimits


class AssistanceLimits(NamedTuple):
    """How much a session may help, whatever its protocol asks for. The default limits nothing."""

    stiffness: Annotated[
        float, Setting("stiffest wall of the next session", "N/m", 0.0, 800.0, live=True)
    ] = 800.0


def limited_text(text: str, limits: AssistanceLimits) -> str:
    """Return a protocol's YAML with no wall stiffer than allowed; unchanged where none is."""
    content = yaml.safe_load(text)
    if not _limit(content, limits.stiffness):
        return text
    return yaml.safe_dump(content, sort_keys=False)


def _limit(content: dict[str, Any], stiffest: float) -> bool:
    """Limit every stiffness of a valid protocol in place; return whether one was too large."""
    found = False
    sections = [(content["guidance"], ("back_stiffness", "side_stiffness"))]
    sections.append((content["rules"], ("prepare_stiffness",)))
    sections.append((content.get("adaptation") or {}, ("softest", "stiffest")))
    sections += [(block, ("stiffness",)) for block in content["blocks"]]
    for section, names in sections:
        for name in names:
            if section.get(name, 0.0) > stiffest:
                section[name], found = stiffest, True
    if found and stiffest == 0.0:
        content["guidance"]["growth"] = 0.0  # nothing that could grow
    return found


def allowed_protocol(
    text: str, name: str, assistance: AssistanceLimits, workspace: WishLimits
) -> tuple[Protocol, str]:
    """Return the protocol of a YAML text as it may be carried out, and the YAML of that.

    Raises ProtocolError for what is no protocol, ValueError for a target outside the workspace.
    """
    parse_protocol(text, name)
    text = limited_text(text, assistance)
    protocol = parse_protocol(text, name)
    _check_workspace(protocol, workspace)
    return protocol, text


def _check_workspace(protocol: Protocol, workspace: WishLimits) -> None:
    axes = {
        "plane": (True, True, False), "vertical": (False, False, True), "space": (True,) * 3,
    }[protocol.space]  # fmt: skip
    ranges = workspace.ranges()
    for block in protocol.blocks:
        for way in ways(protocol, block):
            for point in way:
                for used, name, value, (low, high) in zip(axes, "xyz", point, ranges, strict=True):
                    if used and not low - _ROUNDING <= value <= high + _ROUNDING:
                        raise ValueError(
                            f"{protocol.name}: the target at {name} = {value:.3f} m lies outside "
                            f"the workspace allowed, {low:g} to {high:g} m: widen it, or choose "
                            "another protocol"
                        )


_ROUNDING = 1e-9  # [m] sines of whole turns
