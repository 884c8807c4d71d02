# SPDX-License-Identifier: Apache-2.0
"""Golden dialogues: every frame that a driver sends from configure to the clean exit, in order.

`dialogues.txt` holds conversations in the language of `drive.txt`. Under each step stand the frames
that the driver sent, one a line, and `# name = value` for what it shows differently after the step.
Recorded once against the scripted devices, which are written from the manuals. A driver that sends
another byte, in another order, or takes an answer otherwise, fails here. Who changes it on purpose
renews it with --write and reads the difference.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest
from conversation import carry_out
from scripted import written
from talk import Talk

from screw_module_ros.devices.drive import Drive

FILE = Path(__file__).with_name("dialogues.txt")
TITLE = re.compile(r"^[a-z].*", re.MULTILINE)
SCENES = TITLE.findall(FILE.read_text(encoding="utf-8"))
CYCLIC = {"080", "201", "770"}

# What a driver shows. Sentences are not kept, only whether there are any.
SHOWN = (
    "phase", "remedy", "homed", "silent", "configured", "mode", "step", "torque_of",
    "shown", "error_code", "mode_display", "digital_inputs", "operating_status", "nmt", "enabling",
    "identity", "tared", "rate", "counts_per_newton",
)  # fmt: skip
WORDED = ("fault", "emergency", "warnings", "unguarded")


def seen(driver) -> dict[str, object]:
    found = {name: getattr(driver, name) for name in SHOWN if hasattr(driver, name)}
    found |= {name: bool(getattr(driver, name)) for name in WORDED if hasattr(driver, name)}
    found |= {f"counters.{name}": count for name, count in driver.counters.items() if count}
    return found | ({"reading": driver.reading} if isinstance(driver, Drive) else {})


def of_an_exit(frames: list[str]) -> list[str]:
    """Return the frames of an exit without those of its loop, then its commands, each once.

    The loop goes on beside the SDO transfers: how many periods is left to the machine.
    """
    commands = [frame for frame in frames if frame[:3] == "201"]
    others = [frame for frame in frames if frame[:3] not in CYCLIC]
    return others + [frame for frame, _ in itertools.groupby(commands)]


def played(talk: Talk, steps: list[str]) -> list[str]:
    """Return the steps, with the frames of each and what is shown differently after it."""
    lines, before = [], {}
    for step in steps:
        talk.wire.frames.clear()
        carry_out(talk, step)
        frames = [written(*frame) for frame in talk.wire.frames]
        if step.startswith("leave"):
            return [*lines, f"    {step}", *of_an_exit(frames)]
        now = seen(talk.driver)
        changed = [f"# {name} = {now[name]}" for name in sorted(now)
                   if before.get(name) != now[name]]  # fmt: skip
        lines += [f"    {step}", *frames, *changed]
        before = now
    return lines


@pytest.mark.parametrize("title", SCENES)
def test_the_driver_sends_what_is_kept(wire, title, request):
    text = FILE.read_text(encoding="utf-8")
    before, _, after = text.partition(f"{title}\n")
    kept, _, rest = after.partition("\n\n")
    device, *settings = title.partition(": ")[0].split()
    steps = [line.strip() for line in kept.split("\n") if line.startswith(" ")]
    found = "\n".join(played(Talk(wire, device, settings), steps))
    if request.config.getoption("--write"):
        FILE.write_text(f"{before}{title}\n{found}\n\n{rest}", encoding="utf-8")
    assert found == kept.rstrip("\n")
