# SPDX-License-Identifier: Apache-2.0
"""Games that a therapist chooses: a file each, and the protocol that a choice of it becomes.

A game is a session whose trials are minutes, so record, report, pause and stop are those of any
session. What the patient sees is a page; it says with `therapy/wish` where the robot should pull,
and with `therapy/score` how well he plays.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, NamedTuple
from urllib.parse import urlsplit

from ..settings import Setting, SettingError, read, shown
from .hand import AXES, SPACE
from .protocol import CENTRE, GAME, Block, Guidance, Protocol, Rules, Targets

BUILT_IN = ("fruit",)
"""Pages of games that are part of the patient's screen."""
_FILE = r"[A-Za-z0-9_-]+\.{}"
_PAGE = re.compile(rf"{'|'.join(BUILT_IN)}|{_FILE.format('html')}|https?://[A-Za-z0-9.:-]+(/\S*)?")
_PICTURE = re.compile(_FILE.format("(png|svg|jpg)"))
_MINUTE = 60.0  # [s]
# A game has no walls and no start to go to: of these numbers `hold_stiffness` alone acts.
_GUIDANCE = Guidance(1.0, 0.0, 0.0, 0.0, 0.01, 0.01, 0.0)
_RULES = Rules(0.01, 0.1, 0.02, 4.0, 0.0, 120.0, 2.0, 0.0, 20.0, 0.0)
_MIDDLE = (0.0, 0.0, 0.18)  # [m]


class Game(NamedTuple):
    """A game as its file has it."""

    name: Annotated[str, Setting("as in the file's name")]
    title: Annotated[str, Setting("for screens and reports")]
    page: Annotated[str, Setting(
        "what the patient sees: fruit, a file beside this one like balloon.html, or an address"
    )]  # fmt: skip
    levels: Annotated[tuple[str, ...], Setting("that may be chosen, the usual one first")]
    minutes: Annotated[int, Setting("that are proposed", "min", 1, 60)]
    space: Annotated[str, Setting("where it takes place", choices=tuple(AXES))] = SPACE
    picture: Annotated[str, Setting("file beside this one, empty for none")] = ""

    def flaw(self) -> str:
        """Return what is wrong, empty if nothing."""
        if not all(self.levels) or not 0 < len(set(self.levels)) == len(self.levels):
            return "levels: at least one is wanted, each with a name of its own"
        if not _PAGE.fullmatch(self.page):
            return (
                f"page = {shown(self.page)}: {', '.join(BUILT_IN)}, a file beside this one like "
                "balloon.html, or an address like https://games.example/balloon is wanted"
            )
        if self.picture and not _PICTURE.fullmatch(self.picture):
            return f"picture = {shown(self.picture)}: a file beside it like balloon.png is wanted"
        return ""

    @property
    def files(self) -> list[str]:
        """Return the names of the files that must lie beside it."""
        return [each for each in (self.page, self.picture) if "." in each and "/" not in each]

    @property
    def origin(self) -> str:
        """Return the origin of a page elsewhere, like https://games.example, else nothing."""
        parts = urlsplit(self.page)
        return parts.netloc and f"{parts.scheme}://{parts.netloc}"

    def protocol(self, level: str, minutes: int) -> Protocol:
        """Return a choice of it; no level is the first one, 0 minutes are those of the file.

        Raises SettingError for a level that it has not.
        """
        if level not in ("", *self.levels):
            wanted = ", ".join(self.levels)
            raise SettingError(f"level = {shown(level)}: one of {wanted} is wanted")
        title, count = level or self.levels[0], minutes or self.minutes
        block = Block(GAME, title, False, count, Targets(CENTRE), _MINUTE)
        return Protocol(self.name, self.title, self.space, _MIDDLE, _GUIDANCE, _RULES, (block,))


def game_in(content: Any) -> Game | None:
    """Return the game of a file's content, None if that is a protocol. Raises SettingError."""
    is_game = isinstance(content, dict) and "page" in content
    return read(Game, content) if is_game else None


def level_of(protocol: Protocol) -> str:
    """Return the level of the game that a protocol is, empty for none."""
    return next((block.title for block in protocol.blocks if block.kind == GAME), "")
