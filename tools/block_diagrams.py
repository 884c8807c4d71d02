# SPDX-License-Identifier: Apache-2.0
"""Block diagrams of the laws, one for each mode, drawn from what their functions do.

    tools/run python tools/block_diagrams.py                           # those of docs/control.md
    tools/run python tools/block_diagrams.py --law floor --to FOLDER   # those of a law of your own

Nobody draws an arrow. Each function of a law runs over the same second of samples once more for
each signal and each setting, with that one changed; what then answers otherwise hangs on it. The
modes come from the list of laws, the names are the code's: fields of `Sample` and `Motion`, and
settings of the law. `test/tools/test_block_diagrams.py` compares the kept diagrams with what this
makes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import click

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.friction import FrictionModel
from screw_module_ros.control.law import Law, Motion, Robot, Sample
from screw_module_ros.control.laws import LAWS, load, settings_of
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.planar_settings import STUDIED_GAIN, PlanarSettings
from screw_module_ros.control.plane_law import PlaneLaw, PlaneMotion, PlaneSample
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.settings import fields

DOCS = Path(__file__).resolve().parents[1] / "docs"
DT = 4e-3
JUDGED = 150
"""Ticks at the end in which answers are compared."""
FRICTION_MODEL, WEIGHT = "friction model", "weight"
_CHANGE = 0.3  # share of a signal's size, or of a setting's value, that is changed
_LEAST = 1e-6  # [N] a difference beyond rounding, and beyond what is left of a fade

_LOUD_AND_QUIET = 1.0, 0.005
"""Times the sizes below: once limits are reached, once all stays within the dead bands."""

# Mean and size of each signal; `pressed` has been bounded before the law hears of it.
_VERTICAL = {
    "position": (0.18, 0.05), "velocity": (0.0, 0.2), "force": (0.0, 80.0), "handle": (0.0, 80.0),
    "share": (0.6, 0.3), "to_position": (0.18, 0.05), "to_velocity": (0.0, 0.1),
    "stiffness": (100.0, 30.0), "damping": (5.0, 4.0), "speed": (0.0, 0.2),
    "disturbance": (0.0, 40.0), "foreseen": (0.0, 20.0), "error": (0.0, 20.0),
    "pressed": (0.0, 40.0), "sent": (0.0, 50.0),
}  # fmt: skip
_PLANE = {
    "x, y": (0.0, 0.05), "vx, vy": (0.0, 0.2), "force_x, force_y": (0.0, 60.0),
    "guided": (0.5, 0.6), "helped_x, helped_y": (0.0, 50.0), "to_x, to_y": (0.0, 0.05),
    "to_vx, to_vy": (0.0, 0.1), "stiffness": (100.0, 30.0), "damping": (10.0, 3.0),
    "pressed": (0.0, 40.0), "share": (0.6, 0.3),
}  # fmt: skip

Signals = dict[str, float]
Answers = dict[str, float]


class Hangs(NamedTuple):
    """On what an answer of a law hangs: signals, and settings of the law with what it is given."""

    signals: tuple[str, ...]
    settings: tuple[str, ...]


def _signals(
    kind: dict[str, tuple[float, float]], tick: int, changed: str, loud: float
) -> Signals:
    """Return the signals of a tick, each a sine of its own; `changed` moves otherwise too."""
    time, found = tick * DT, {}
    for number, (name, (mean, whole)) in enumerate(kind.items()):
        size = loud * whole
        found[name] = mean + size * math.sin(math.tau * (1.3 + 0.37 * number) * time + number)
        if name == changed:
            found[name] += _CHANGE * size * math.cos(math.tau * 3.1 * time)
    return found


def _vertical_tick(law: Law, mode: int, own: Any, m: Any) -> Callable[[Signals, float], Answers]:
    """Return what answers for one sample of a vertical law; its memory is `m`."""

    def tick(now: Signals, travelled: float) -> Answers:
        sample = Sample(
            DT, mode, now["position"], travelled, now["velocity"], now["force"], now["handle"],
            now["share"], True, now["sent"],
        )  # fmt: skip
        foreseen = law.foresee(own, m, sample)
        motion = Motion(
            now["to_position"], now["to_velocity"], now["stiffness"], now["damping"], now["speed"],
            now["disturbance"], now["foreseen"], now["error"], now["error"],
        )  # fmt: skip
        asked = law.ask(own, m, sample, motion)
        helped = law.help(own, m, sample, motion, now["pressed"])
        return {
            "foreseen": foreseen, "pull": asked.pull, "friction": helped.friction,
            "feedback": helped.feedback, "carried": helped.wanted - now["pressed"],
            "relief": helped.relief,
        }  # fmt: skip

    return tick


def _plane_tick(law: PlaneLaw, own: Any, m: Any) -> Callable[[Signals, float], Answers]:
    """Return what answers for one sample of a law of the plane; x and y move alike."""

    def tick(now: Signals, travelled: float) -> Answers:
        x, v, force, helped = (
            now[name] for name in ("x, y", "vx, vy", "force_x, force_y", "helped_x, helped_y")
        )
        sample = PlaneSample(DT, x, x, v, v, force, force, True, now["guided"], helped, helped)
        needs = law.needs(own, m, sample, now["stiffness"])
        to_x, to_v = now["to_x, to_y"], now["to_vx, to_vy"]
        motion = PlaneMotion(to_x, to_x, to_v, to_v, now["stiffness"], now["damping"])
        pull, _ = law.ask(own, m, sample, motion)
        pressed, share = (now["pressed"],) * 2, (now["share"],) * 2
        feedback, _ = law.help(own, m, sample, motion, pressed, share)
        return {
            "damper": needs.damper, "damper in a slot": needs.in_slot,
            "pull": pull, "feedback": feedback,
        }  # fmt: skip

    return tick


def _run(
    tick: Callable[[Signals, float], Answers], kind: dict[str, tuple[float, float]],
    changed: str, ticks: int, loud: float,
) -> list[Answers]:  # fmt: skip
    found, before = [], None
    for number in range(ticks):
        now = _signals(kind, number, changed, loud)
        place = now.get("position", 0.0)
        found.append(tick(now, place - (place if before is None else before)))
        before = place
    return found


def _differing(one: list[Answers], other: list[Answers]) -> set[str]:
    """Return the answers that differ anywhere."""
    return {
        name for a, b in zip(one, other, strict=True) for name in a
        if abs(a[name] - b[name]) > _LEAST
    }  # fmt: skip


def _ticks(p: VerticalSettings | PlanarSettings) -> int:
    """Return after how many ticks all parts of a law have faded in, and some are left to judge."""
    slowest = 2.0 * p.fade_time if isinstance(p, VerticalSettings) else STUDIED_GAIN / p.gain_rate
    return int(slowest / (1.0 - _CHANGE) / DT) + JUDGED


def _weaker(model: FrictionModel) -> FrictionModel:
    """Return a model with less of its trend, up and down."""
    up, down = (
        branch._replace(trend=tuple((1.0 - _CHANGE) * each for each in branch.trend))
        for branch in (model.up, model.down)
    )
    return model._replace(up=up, down=down)


def hangs_of(law: Law | PlaneLaw, mode: int = 0, settings: Any = None) -> dict[str, Hangs]:
    """Return on what each answer of a law hangs in a mode; an answer that is always 0 is left out.

    settings: of the law, None = its defaults.
    """
    plane = isinstance(law, PlaneLaw)
    kind = _PLANE if plane else _VERTICAL
    envelope = PlanarSettings() if plane else VerticalSettings()
    usual = settings or settings_of(law, envelope)
    robot = Robot(thesis_friction(), VerticalSettings().mass, VerticalSettings().gravity)

    def answers(p: Any, given: Robot = robot, changed: str = "") -> list[Answers]:
        own, found = law.own(p, envelope if plane else given), []
        for loud in _LOUD_AND_QUIET:
            m = law.memory(own)
            law.rest(own, m)
            tick = _plane_tick(law, own, m) if plane else _vertical_tick(law, mode, own, m)
            found += _run(tick, kind, changed, _ticks(envelope), loud)[-JUDGED:]
        return found

    base = answers(usual)
    if not plane and not any(abs(each["foreseen"]) > _LEAST for each in base):
        kind = {**kind, "foreseen": (0.0, 0.0)}  # a law that foresees nothing is told nothing of it
        base = answers(usual)
    by_signal = {name: _differing(base, answers(usual, changed=name)) for name in kind}
    by_setting = {}
    for name, value in usual._asdict().items():
        if type(value) is float:
            other = usual._replace(**{name: value * (1.0 - _CHANGE) if value else _CHANGE})
            by_setting[name] = _differing(base, answers(other))
    if not plane:
        for name, given in (
            (FRICTION_MODEL, robot._replace(friction=_weaker(robot.friction))),
            (WEIGHT, robot._replace(gravity=0.5 * robot.gravity)),
        ):
            by_setting[name] = _differing(base, answers(usual, given))
    return {
        name: Hangs(
            tuple(signal for signal, found in by_signal.items() if name in found),
            tuple(setting for setting, found in by_setting.items() if name in found),
        )
        for name in base[0]
        if any(abs(each[name]) > _LEAST for each in base)
    }


class Block(NamedTuple):
    """A box of a diagram: what goes in, what it is, the settings it hangs on, what comes out."""

    inputs: tuple[str, ...]
    title: str
    settings: tuple[str, ...]
    output: tuple[str, ...]
    ours: bool = False  # it is a part of the law, not of the envelope


_TOLD = (  # parts of the vertical envelope before the law, as `control/envelope.py` has them
    Block(("position_wanted", "velocity_wanted"), "set point",
          ("setpoint_speed", "setpoint_acceleration"), ("to_position", "to_velocity")),
    Block(("force",), "low pass", ("force_cutoff",), ("handle",)),
    Block(("position", "sent", "force", "foreseen"), "extended-state observer",
          ("observer_bandwidth", "observer_delay", "mass", "observer_limit", "observer_rest"),
          ("speed", "disturbance")),
    Block(("pressed + carried", "force"), "low pass", ("observer_cutoff",), ("error",)),
    Block(("pressed", "force", "speed"), "guard of the gains", ("chatter_limit",), ("share",)),
)  # fmt: skip
_SENT = (
    Block(("pull", "speed", "support"), "damper of the guard, endpoint's limits",
          ("chatter_damping", "force_up", "force_down"), ("pressed",)),
    Block(("pressed", "friction", "feedback", "carried", "relief", "share"),
          "sum with the weight, standing bound, speed limit, force limits, soft stops, rate",
          ("gravity", "standing_force", "speed_limit", "edge_braking", "command_up",
           "command_down", "force_rate"), ("command",)),
)  # fmt: skip
_PLANE_TOLD = (  # parts of the plane's envelope before it, as `control/plane_envelope.py` has
    Block(("x, y wanted",), "set point", (), ("to_x, to_y", "to_vx, to_vy")),
    Block(("damper", "damper in a slot"), "largest of setting and needs", ("damping",),
          ("damping",)),
    Block(("pressed", "force_x, force_y", "vx, vy"), "guard of the gains, x and y", (),
          ("share",)),
    Block(("feedback",), "its limits", ("force_limit",), ("helped_x, helped_y",)),
)  # fmt: skip
_PLANE_SENT = (
    Block(("pull", "slot"), "damper of the guard, force limit, speed limit, edges",
          ("force_limit", "edge_braking"), ("pressed",)),
    Block(("pressed", "helped_x, helped_y"), "transposed Jacobian, joint and torque limits, rate",
          ("shoulder_torque", "elbow_torque", "torque_rate"), ("torques",)),
)  # fmt: skip
_PARTS = {
    "foreseen": "foresee", "pull": "ask", "friction": "help: friction",
    "feedback": "help: feedback", "carried": "help: carried mass", "relief": "help: relief",
    "damper": "needs: damper", "damper in a slot": "needs: damper in a slot",
}  # fmt: skip
_COLUMNS = (140, 640, 1130)  # left edges of the boxes
_WIDTH, _LINE, _GAP = 240, 15, 16
_TOP, _WHOLE = 56, 1470


def columns_of(law: Law | PlaneLaw, hangs: dict[str, Hangs]) -> tuple[list[Block], ...]:
    """Return the boxes of a diagram: what the envelope tells, the law, what the envelope makes.

    A part of the envelope that tells the law nothing is left out.
    """
    plane = isinstance(law, PlaneLaw)
    parts = [
        Block(found.signals, _PARTS[name], found.settings, (name,), ours=True)
        for name, found in hangs.items()
    ]
    told, sent = (_PLANE_TOLD, _PLANE_SENT) if plane else (_TOLD, _SENT)
    made = {name for part in parts for name in part.output}
    heard = {name for part in parts for name in part.inputs}
    known = {*made, "pressed", "support", "speed", "slot", "helped_x, helped_y"}
    if not law.heeds:  # the envelope takes the share off its help
        known, heard = {*known, "share"}, {*heard, "share"}
    sent = [each._replace(inputs=tuple(n for n in each.inputs if n in known)) for each in sent]
    return [each for each in told if heard & set(each.output)], parts, sent


def diagram(title: str, columns: tuple[list[Block], ...], values: dict[str, str]) -> str:
    """Return the drawing as SVG; values: of settings, as they are shown."""
    drawn, bottom = [], 0
    for left, blocks in zip(_COLUMNS, columns, strict=True):
        top = _TOP
        for block in blocks:
            lines = [*_folded(block.title), *(values.get(name, name) for name in block.settings)]
            high = _LINE * max(len(lines), len(block.inputs), len(block.output)) + 12
            drawn += _box(left, top, high, block, lines)
            top += high + _GAP
        bottom = max(bottom, top)
    heads = ("what the envelope tells the law", "the law", "what the envelope makes of it")
    drawn += [
        _text(left, _TOP - 14, head, "start", "italic")
        for left, head in zip(_COLUMNS, heads, strict=True)
    ]
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WHOLE} {bottom}" '
        f'width="{_WHOLE}" height="{bottom}" font-family="sans-serif" font-size="12">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{_WHOLE}" height="{bottom}" fill="#ffffff"/>',
        _text(14, 22, title, "start", "bold"), *drawn, "</svg>\n",
    ])  # fmt: skip


def _folded(title: str) -> list[str]:
    """Return a title in lines that fit into a box."""
    lines = [""]
    for word in title.split():
        if len(lines[-1]) + len(word) > 30:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


def _text(x: int, y: int, text: str, anchor: str, style: str = "") -> str:
    more = {"bold": ' font-weight="bold"', "italic": ' font-style="italic"'}.get(style, "")
    place = f'x="{x}" y="{y}" text-anchor="{anchor}" fill="#222222"'
    return f"<text {place}{more}>{escape(text)}</text>"


def _box(left: int, top: int, high: int, block: Block, lines: list[str]) -> list[str]:
    fill = "#dcebf7" if block.ours else "#f3f1ea"
    drawn = [
        f'<rect x="{left}" y="{top}" width="{_WIDTH}" height="{high}" rx="4" fill="{fill}" '
        'stroke="#5c564b"/>'
    ]
    titles = len(_folded(block.title))
    for number, line in enumerate(lines):
        style = "bold" if number < titles else ""
        drawn.append(_text(left + 8, top + 18 + _LINE * number, line, "start", style))
    for names, at, to, anchor in (
        (block.inputs, left - 16, left, "end"),
        (block.output, left + _WIDTH + 20, left + _WIDTH + 16, "start"),
    ):
        for number, name in enumerate(names):
            y = top + 18 + _LINE * number
            drawn.append(_text(at if anchor == "start" else at - 3, y, name, anchor))
            drawn.append(
                f'<path d="M{to - 16} {y - 4}h10v-3l6 3 -6 3v-3" fill="#5c564b" stroke="#5c564b"/>'
            )
    return drawn


def _values(settings: Any) -> dict[str, str]:
    """Return settings as they are shown: name, value, unit."""
    return {
        name: f"{name} = {value:g} {fields(type(settings))[name].setting.unit}".rstrip()
        for name, value in settings._asdict().items()
        if type(value) is float
    }


def diagrams(laws: tuple[Law, ...], planes: tuple[PlaneLaw, ...]) -> dict[str, str]:
    """Return the diagrams by the names of their files."""
    usual = VerticalSettings().calibrated(VerticalSettings().gravity, VerticalSettings().mass)
    drawn = {}
    for law in laws:
        settings = settings_of(law, usual)
        values = {**_values(usual), **_values(settings)}
        for mode, variant in law.variants.items():
            columns = columns_of(law, hangs_of(law, mode, settings))
            drawn[f"blocks_{mode}.svg"] = diagram(f"{mode} {variant.name}", columns, values)
    for plane in planes:
        settings = settings_of(plane, PlanarSettings(force_gain=STUDIED_GAIN))
        values = {**_values(PlanarSettings()), **_values(settings)}
        columns = columns_of(plane, hangs_of(plane, settings=settings))
        drawn[f"blocks_{plane.name}.svg"] = diagram(f"The plane: {plane.name}", columns, values)
    return drawn


@click.command()
@click.option("--law", "path", help="package.module:NAME or entry point; the shipped laws without")
@click.option("--to", "folder", type=click.Path(path_type=Path), default=DOCS, show_default=True)
def main(path: str | None, folder: Path) -> None:
    """Draw the block diagrams of a law, one for each of its modes."""
    folder.mkdir(parents=True, exist_ok=True)
    made = diagrams((load(path),), ()) if path else diagrams(LAWS, (PLANE_IMPEDANCE,))
    for name, text in made.items():
        (folder / name).write_text(text, "utf-8")
        print(folder / name)


if __name__ == "__main__":
    main()
