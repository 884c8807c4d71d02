# SPDX-License-Identifier: Apache-2.0
"""A protocol: the trials of a session, with all parameters.

`protocol_file` reads it from YAML; `plan` yields its trials in order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, NamedTuple

from ..control.slot import Slot
from ..settings import Setting
from .adaptation import AdaptationBounds
from .hand import AXES, Point
from .line import Line
from .support import BlockSupport

REACH, CIRCLE, HOLD, RESISTED, STRENGTH = "reach", "circle", "hold", "resisted", "strength"
GAME = "game"  # a minute of it, without walls: what happens on the screen is the game's
KINDS = (REACH, CIRCLE, HOLD, RESISTED, STRENGTH, GAME)
WEIGH = "weigh"  # kind in the state of the session's node while an arm is weighed, of no trial
CLOCK, COLUMN, CENTRE = "clock", "column", "centre"
LAYOUTS = (CLOCK, COLUMN, CENTRE)
LARGEST_X, LARGEST_Y = 0.1755, 0.2136  # [m] the workspace without the soft stops at its edges
LOWEST_Z, HIGHEST_Z = 0.02, 0.34  # [m] the travel without its soft stops


class Rules(NamedTuple):
    """Conditions for the transitions between the phases of a trial."""

    hit_radius: Annotated[
        float, Setting("distance from a point at which it counts as reached", "m", 0.001, 0.05)
    ]
    start_share: Annotated[
        float, Setting("share of the minimum-jerk peak speed that starts a movement", "", 0.01, 1.0)
    ]
    start_way: Annotated[
        float, Setting("way along the line that starts a slow movement", "m", 0.001, 0.1)
    ]
    wait: Annotated[
        float, Setting("time after which a movement starts by itself", "s", 0.1, 60.0)
    ]
    hold: Annotated[float, Setting("time at the target before the next trial", "s", 0.0, 10.0)]
    give_up: Annotated[
        float, Setting("time since the start after which a trial ends", "s", 0.5, 120.0)
    ]
    prepare_duration: Annotated[
        float, Setting("time in which the hand is brought to the start", "s", 0.5, 20.0)
    ]
    prepare_stiffness: Annotated[
        float, Setting("of the walls that bring the hand to the start", "N/m", 0.0, 800.0)
    ]
    prepare_limit: Annotated[
        float, Setting("longest time to the start, then the session pauses", "s", 1.0, 120.0)
    ]
    settle_time: Annotated[
        float, Setting("time within the hit radius of the start before a trial", "s", 0.0, 5.0)
    ]
    prepare_growth: Annotated[
        float, Setting("stiffening of these walls until the hand is there", "N/m/s", 0.0, 200.0)
    ] = 60.0  # ours: as the back wall of clock_adaptive
    hold_stiffness: Annotated[
        float, Setting("of what holds the axes that are not used", "N/m", 0.0, 800.0)
    ] = 800.0  # ours: the stiffest wall of a slot


class Targets(NamedTuple):
    """Targets around the centre.

    clock: `count` targets at `distance` in the plane, clockwise from the farthest, alternately
    `rise` above and below; column: one above and one below the centre at `distance`; centre: the
    centre itself. rounds: visits to all targets per circuit.
    """

    layout: Annotated[str, Setting("clock, column or centre", choices=LAYOUTS)]
    count: Annotated[int, Setting("number of targets on the clock", "", 1, 16)] = 8  # type: ignore[assignment]
    distance: Annotated[float, Setting("from the centre", "m", 0.01, 0.2)] = 0.14
    rise: Annotated[float, Setting("above and below the centre in turn", "m", 0.0, 0.16)] = 0.0
    rounds: Annotated[int, Setting("visits to all targets in a circuit", "", 1, 50)] = 1


class Rest(NamedTuple):
    """Rests within a block: after each so many trials, unless the session is over."""

    every: Annotated[int, Setting("trials from one rest to the next", "", 1, 1000)]
    seconds: Annotated[float, Setting("of a rest", "s", 10.0, 600.0)]


class Block(NamedTuple):
    """A part of a session: circuits of one kind.

    duration: of a circle, hold, resisted or strength trial [s]; stiffness: of the walls that hold
    the hand in these trials, 0 = none [N/m]. support: of the arm from its beginning on, None = as
    it is. rest: None = none.
    """

    kind: Annotated[str, Setting("what the patient does", choices=KINDS)]
    title: Annotated[str, Setting("for screens and reports")]
    assisted: Annotated[bool, Setting("with the slot's walls")]
    circuits: Annotated[int, Setting("number of circuits", "", 1, 100)]
    targets: Targets
    duration: Annotated[float, Setting("of a trial that is not a reach", "s", 0.0, 120.0)] = 0.0
    stiffness: Annotated[
        float, Setting("of the walls that hold the hand", "N/m", 0.0, 800.0)
    ] = 0.0
    support: BlockSupport | None = None
    rest: Rest | None = None


class Guidance(NamedTuple):
    """The slot of a protocol, without start and target. Fields as in `control.slot.Slot`."""

    duration: Annotated[float, Setting("of the back wall's way", "s", 0.3, 10.0)]
    back_stiffness: Annotated[float, Setting("of the back wall", "N/m", 0.0, 800.0)]
    side_stiffness: Annotated[float, Setting("of the side walls", "N/m", 0.0, 800.0)]
    damping: Annotated[float, Setting("everywhere in the slot", "Ns/m", 0.0, 30.0)]
    half_width: Annotated[float, Setting("to a side wall at the start", "m", 0.0, 0.1)]
    end_half_width: Annotated[float, Setting("to a side wall at the end", "m", 0.0, 0.1)]
    growth: Annotated[float, Setting("stiffening of the back wall over time", "N/m/s", 0.0, 200.0)]

    def slot(self) -> Slot:
        """Return the slot of these numbers, start and target at the origin."""
        return Slot(0.0, 0.0, 0.0, 0.0, *self)


class Protocol(NamedTuple):
    """A protocol. space: plane, vertical or space; adaptation: None = fixed assistance."""

    name: Annotated[str, Setting("as in the file's name")]
    title: Annotated[str, Setting("for screens and reports")]
    space: Annotated[str, Setting("where it takes place", choices=tuple(AXES))]
    centre: Point
    guidance: Guidance
    rules: Rules
    blocks: tuple[Block, ...]
    adaptation: AdaptationBounds | None = None

    def flaw(self) -> str:
        """Return what does not fit together or lies out of reach, empty if nothing."""
        return next(self._flaws(), "")

    def _flaws(self) -> Iterator[str]:
        if not self.blocks:
            yield "blocks: at least one is wanted"
        if self.guidance.end_half_width > self.guidance.half_width:
            yield (
                f"guidance.end_half_width = {self.guidance.end_half_width:g} m: must not be more "
                f"than half_width = {self.guidance.half_width:g} m"
            )
        if self.adaptation is not None:
            yield from _start_flaws(self.guidance, self.adaptation)
        for block in self.blocks:
            yield from (f"block {block.title!r}: {text}" for text in _block_flaws(self, block))


class TrialPlan(NamedTuple):
    """One trial: number in the session from 1; block and circuit from 1; start, target [m]."""

    number: int
    block: int
    circuit: int
    start: Point
    target: Point


def plan(protocol: Protocol) -> Iterator[TrialPlan]:
    """Yield the trials of a protocol in order: out to each target and back to the centre."""
    number = 0
    for index, block in enumerate(protocol.blocks, 1):
        for circuit in range(1, block.circuits + 1):
            for start, target in ways(protocol, block):
                number += 1
                yield TrialPlan(number, index, circuit, start, target)


def ways(protocol: Protocol, block: Block) -> list[tuple[Point, Point]]:
    """Return start and target [m] of the trials of one circuit.

    Reaches go out and back. Trials of other kinds start at the centre.
    """
    found = []
    for _ in range(block.targets.rounds):
        for point in points(protocol, block):
            found.append((protocol.centre, point))
            if block.kind == REACH:
                found.append((point, protocol.centre))
    return found


def points(protocol: Protocol, block: Block) -> list[Point]:
    """Return the targets of a block [m]."""
    targets, (x, y, z) = block.targets, protocol.centre
    if targets.layout == CENTRE:
        return [protocol.centre]
    if targets.layout == COLUMN:
        return [(x, y, z + targets.distance), (x, y, z - targets.distance)]
    found = []
    for number in range(targets.count):
        angle = 2.0 * math.pi * number / targets.count
        rise = targets.rise if number % 2 == 0 else -targets.rise
        aside, away = targets.distance * math.sin(angle), targets.distance * math.cos(angle)
        found.append((x + aside, y + away, z + rise))
    return found


def _start_flaws(guidance: Guidance, bounds: AdaptationBounds) -> Iterator[str]:
    for name, low, high in (
        ("duration", bounds.shortest, bounds.longest),
        ("side_stiffness", bounds.softest, bounds.stiffest),
    ):
        value = getattr(guidance, name)
        if not low <= value <= high:
            yield (
                f"guidance.{name} = {value:g}: outside what adaptation allows, {low:g} to {high:g}"
            )


def _block_flaws(protocol: Protocol, block: Block) -> Iterator[str]:
    """Yield what is wrong with a block.

    Only a reach has a way along which walls guide, and which the adaptation can judge.
    """
    if block.kind != REACH and block.duration <= 0.0:
        yield f"duration: a {block.kind} needs some time"
    if block.kind != REACH and block.support and block.support.fade:
        yield f"support.fade: only reaches succeed or not, a {block.kind} does not"
    if block.kind != REACH and block.assisted:
        yield f"assisted: only a reach is, a {block.kind} is not"
    for x, y, z in (protocol.centre, *points(protocol, block)):
        if abs(x) > LARGEST_X or abs(y) > LARGEST_Y or not LOWEST_Z <= z <= HIGHEST_Z:
            yield (
                f"the point ({x:.3f}, {y:.3f}, {z:.3f}) m lies outside what the robot reaches: "
                f"x +-{LARGEST_X} m, y +-{LARGEST_Y} m, z {LOWEST_Z} to {HIGHEST_Z} m"
            )
    for start, target in ways(protocol, block) if block.kind not in (HOLD, GAME) else ():
        if Line(start, target, protocol.space).length <= protocol.rules.hit_radius:
            yield (
                f"a {block.kind} needs a way longer than hit_radius = "
                f"{protocol.rules.hit_radius:g} m on the axes of space = {protocol.space!r}: "
                "choose another layout or space, or a larger distance"
            )
