# SPDX-License-Identifier: Apache-2.0
"""The block diagrams of docs/control.md: as the laws are now, and what each law hears."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, NamedTuple

import pytest

import block_diagrams
from screw_module_ros.control.law import Law, Variant, feeds, pulls
from screw_module_ros.control.laws import LAWS
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.modes import IMPEDANCE
from screw_module_ros.settings import Setting

THE_HAND = {"force", "handle", "error"}


class Bell(NamedTuple):
    """Settings of a law of another package."""

    depth: Annotated[float, Setting("of the spring", "N/m", 0.0, 1e3)] = 50.0
    gain: Annotated[float, Setting("of the hand's force", "", 0.0, 5.0)] = 2.0
    unused: Annotated[float, Setting("heard by nobody")] = 1.0


def bell(**functions: Callable) -> Law:
    return Law("bell", {100: Variant("BELL", ("gain",), force=True)}, Bell, **functions)


@pytest.mark.long
def test_the_kept_diagrams_are_those_of_the_laws():
    made = block_diagrams.diagrams(LAWS, (PLANE_IMPEDANCE,))
    kept = {file.name: file.read_text("utf-8") for file in block_diagrams.DOCS.glob("blocks_*.svg")}
    assert kept == made, "renew them: tools/run python tools/block_diagrams.py"


def test_impedance_hears_nothing_of_the_hand():
    hangs = block_diagrams.hangs_of(THESIS, IMPEDANCE)
    assert set(hangs) == {"pull"}
    assert not THE_HAND & set(hangs["pull"].signals)


def test_what_an_answer_hangs_on_is_found_and_nothing_else():
    law = bell(
        ask=lambda own, m, sample, motion: pulls(-own.depth * (sample.position - 0.18)),
        help=lambda own, m, sample, motion, pressed: feeds(
            own.gain * (max(0.0, abs(sample.handle) - 70.0) + max(-0.3, min(0.3, motion.speed))),
            pressed,
        ),
    )
    assert block_diagrams.hangs_of(law, 100) == {
        "pull": (("position",), ("depth",)),
        "feedback": (("handle", "speed"), ("gain",)),
    }


def test_what_the_guard_takes_by_itself_is_no_part_of_another_law():
    law = bell(help=lambda own, m, sample, motion, pressed: feeds(own.gain * sample.force, pressed))
    assert "share" not in block_diagrams.hangs_of(law, 100)["feedback"].signals
