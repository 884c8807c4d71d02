# SPDX-License-Identifier: Apache-2.0
"""Protocols and games as YAML files, with strict checks, as they determine forces on a patient.

A missing or unknown key or a value out of range is refused with a message that names it. The
therapist's limits are applied before the session starts, so that the bag records the executed
protocol and a replay computes it again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml

from ..resources import resource_path
from ..settings import Setting, SettingError, plain, read
from ..settings_file import parse, read_text
from .games import game_in
from .hand import AXES, Point
from .protocol import REACH, Protocol, plan, points, ways
from .wishes import WishLimits

SHIPPED = ("evaluation", "clock_adaptive", "elevator", "reach_3d", "lift")
GAMES = ("fruit",)
"""Protocols and games that come with the package."""
GAME_FOLDER = "games"  # the folder of games below that of protocols
_SOFTEST_SHARE = 0.5  # share of the stiffest walls, if these are softer than the protocol's softest
_ROUNDING = 1e-9  # [m] rounding of the targets' sines
_MOST = 50  # largest number of files offered to screens


class AssistanceLimits(NamedTuple):
    """Largest assistance of a session with any protocol. The default has no effect."""

    stiffness: Annotated[
        float, Setting("stiffest wall of the next session", "N/m", 0.0, 800.0, live=True)
    ] = 800.0


def load_protocol(name: str | Path) -> Protocol:
    """Return a protocol: a packaged one by its name, or a YAML file by its path.

    Of a game it is the first level. Raises SettingError naming file, key and problem.
    """
    return parse_protocol(protocol_text(name), str(name))


def protocol_text(name: str | Path) -> str:
    """Return a protocol's YAML, name as in `load_protocol`. Raises SettingError."""
    if str(name) in (*SHIPPED, *GAMES):
        folder = GAME_FOLDER if name in GAMES else "therapy"
        return read_text(resource_path(f"params/{folder}/{name}.yaml"))
    if not Path(name).is_file():
        raise SettingError(
            f"no protocol {str(name)!r}: name a YAML file, or one of "
            f"{', '.join((*SHIPPED, *GAMES))}"
        )
    return read_text(name)


def parse_protocol(text: str, name: str, level: str = "", minutes: int = 0) -> Protocol:
    """Return the protocol of a YAML text; name: for messages; level, minutes: of a game.

    Raises SettingError.
    """
    try:
        content = parse(text, "it")
        if game := game_in(content):
            content = plain(game.protocol(level, minutes))
        return read(Protocol, content)
    except SettingError as error:
        raise SettingError(f"protocol {name}: {error}") from None


def as_yaml(protocol: Protocol) -> str:
    """Return a protocol as YAML; `parse_protocol` returns the same protocol."""
    return yaml.safe_dump(plain(protocol), sort_keys=False, allow_unicode=True)


def sha256(text: str) -> str:
    """Return the SHA-256 of a protocol's YAML, its identity in records, as hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def allowed_protocol(
    text: str, name: str, assistance: AssistanceLimits, workspace: WishLimits, side: str = "",
    level: str = "", minutes: int = 0,
) -> tuple[Protocol, str]:
    """Return the limited protocol of a YAML text, and its YAML: the text itself if nothing changes.

    level, minutes: of a game, whose text is another one than its protocol's.

    A file is written for the right arm; for the left one its centre is mirrored in x. Raises
    SettingError for an invalid protocol, ValueError for a target outside the workspace.
    """
    protocol = parse_protocol(text, name, level, minutes)
    softened = limited(protocol, assistance.stiffness)
    if side == "left" and protocol.centre[0]:
        x, y, z = protocol.centre
        softened = softened._replace(centre=(-x, y, z))
    if softened != protocol or game_in(parse(text, name)):
        text = as_yaml(softened)
        protocol = parse_protocol(text, name)  # what is recorded is what is carried out
    _check_workspace(protocol, workspace)
    return protocol, text


def limited(protocol: Protocol, stiffest: float) -> Protocol:
    """Return a protocol without a wall stiffer than `stiffest` [N/m], also after it has stiffened.

    The adaptation stays within the limit; without walls there is nothing to adapt.
    """
    bounds = protocol.adaptation
    guidance, rules = protocol.guidance, protocol.rules
    shortest = bounds.shortest if bounds else guidance.duration
    growth = _bounded_growth(
        guidance.growth, guidance.back_stiffness, rules.give_up + rules.hold - shortest, stiffest
    )
    prepare_growth = _bounded_growth(
        rules.prepare_growth, rules.prepare_stiffness,
        rules.prepare_limit + rules.settle_time - rules.prepare_duration, stiffest,
    )  # fmt: skip
    if bounds is not None:
        bounds = _softened(bounds, stiffest, "stiffest")
        if bounds.softest >= bounds.stiffest:
            bounds = bounds._replace(softest=_SOFTEST_SHARE * bounds.stiffest)
    guidance = _softened(guidance, stiffest, "back_stiffness", "side_stiffness")
    rules = _softened(rules, stiffest, "prepare_stiffness", "hold_stiffness")
    return protocol._replace(
        guidance=guidance._replace(growth=growth),
        rules=rules._replace(prepare_growth=prepare_growth),
        blocks=tuple(_softened(block, stiffest, "stiffness") for block in protocol.blocks),
        adaptation=bounds if stiffest > 0.0 else None,
    )


def _softened(record: Any, stiffest: float, *names: str) -> Any:
    return record._replace(**{name: min(getattr(record, name), stiffest) for name in names})


def _bounded_growth(growth: float, stiffness: float, longest: float, stiffest: float) -> float:
    """Return the growth [N/m/s] with which no wall passes the limit `stiffest` [N/m].

    stiffness: of the wall at first [N/m]; longest: time for which it grows [s]. Without a limit
    any growth: the controllers then bound the growing wall.
    """
    if stiffest >= AssistanceLimits().stiffness or longest <= 0.0:
        return growth
    return min(growth, (stiffest - min(stiffness, stiffest)) / longest)


def _check_workspace(protocol: Protocol, workspace: WishLimits) -> None:
    visited = {
        point for block in protocol.blocks for way in ways(protocol, block) for point in way
    }
    ranges = workspace.ranges()
    for point in sorted(visited):
        for axis in AXES[protocol.space]:
            low, high = ranges[axis]
            if not low - _ROUNDING <= point[axis] <= high + _ROUNDING:
                raise ValueError(
                    f"{protocol.name}: the target at {'xyz'[axis]} = {point[axis]:.3f} m lies "
                    f"outside the workspace allowed, {low:g} to {high:g} m: widen it, or choose "
                    "another protocol"
                )


def protocols_for_screens(
    folder: Path | None = None, on_problem: Callable[[str], None] = lambda sentence: None
) -> list[dict[str, Any]]:
    """Return for each protocol the name to start it by (`name`), its own name (`protocol`), title,
    space, number of trials, centre, targets [m], and those of each block by its title (`blocks`);
    about how many minutes it takes; of a game also page, levels and picture.

    folder: of the user's protocols, in addition to the packaged ones. on_problem: called with the
    error of an invalid file, or of one with the name of another protocol, which is omitted.
    """
    shipped = (_described(name, name) for name in (*SHIPPED, *GAMES))
    found = {each["protocol"]: each for each in shipped}
    files = {
        str(file.relative_to(folder)): file
        for each in ("*.yaml", f"{GAME_FOLDER}/*.yaml") for file in folder.glob(each)
    } if folder else {}  # fmt: skip
    for name, file in sorted(files.items())[:_MOST]:
        try:
            own = _described(name, file)
        except SettingError as error:
            on_problem(str(error))
            continue
        other = found.setdefault(own["protocol"], own)
        if other is not own:  # screens tell protocols apart by this name
            on_problem(
                f"protocol {own['name']}: name = {own['protocol']!r} is that of {other['name']}, "
                "whose targets the pages would show: give it a name of its own"
            )
    return list(found.values())


def expected(protocol: Protocol) -> float:
    """Return about how long a session takes [s], by the times of its file."""
    found, rules = 0.0, protocol.rules
    for block in protocol.blocks:
        count = block.circuits * len(ways(protocol, block))
        moves = protocol.guidance.duration if block.kind == REACH else block.duration
        found += count * (moves + rules.hold + rules.settle_time)
        found += (count - 1) // block.rest.every * block.rest.seconds if block.rest else 0.0
    return found


def _described(name: str, file: str | Path) -> dict[str, Any]:
    protocol, game = load_protocol(file), game_in(parse(protocol_text(file), name))
    for each in game.files if game else ():
        if not (Path(file).parent / each).is_file():
            raise SettingError(f"game {name}: {each} is not beside it")
    blocks: dict[str, set[Point]] = {}
    for block in protocol.blocks:
        targets = blocks.setdefault(block.title, set())
        targets.update(points(protocol, block))
        targets.discard(protocol.centre)
    return {
        "minutes": expected(protocol) / 60.0,
        **(game._asdict() | {"origin": game.origin} if game else {}),
        "name": name,
        "protocol": protocol.name,
        "title": protocol.title,
        "space": protocol.space,
        "trials": sum(1 for _ in plan(protocol)),
        "centre": protocol.centre,
        "targets": sorted(set().union(*blocks.values())),
        "blocks": {title: sorted(targets) for title, targets in blocks.items()},
    }
