# SPDX-License-Identifier: Apache-2.0
"""The command `study`: every mode on rigs drawn by seed, one table of medians and worst cases.

A law is judged on rigs that it was not tuned on. A rig is one of `load_world(seed)` whose encoder,
delay and transducer are drawn as well, wider than between two modules of one make; the screw's
axial support is drawn there. Family A has a rigid hand, family B a hand with a soft grip
(`plant.patient`). The trials are those in which a force-feedback law fails: reaches, walls that
stand or move, a heavy arm, an obstacle that the transducer does not feel, a change of mode, besides
slow and small motion, holding and letting go. No mode is calibrated. In process, no ROS, no
hardware.

With `--support` it is an arm that hangs on the handle and is carried (`carrying`), in the modes
that feed the force back, on the same rigs and on the thesis's module, where the seed is the
noise's.

With `--plane` it is the plane, without and with force feedback: the arm with its set of joint
inertias and the structure that bends, rate, delay, age of the force, counts of the joints, and
place and direction of the motion in the workspace are drawn as well.

`--law` adds a law of another package: its modes stand beside the shipped ones, on the same rigs and
in the same trials. `--scheduler` sends the trials to a dask cluster that runs already, in place of
processes of this machine; a rig and a trial are drawn by their seed, so the rows are the same.
"""

from __future__ import annotations

import csv
import json
import math
import random
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from rich.progress import Progress

from ..compiled import NotCompiled
from ..control import modes
from ..control.laws import LAWS, law_of, loaded, variants
from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..control.vertical_settings import VerticalSettings
from ..plant import planar
from ..plant.patient import RIGID, ArmForce, HandPath, resting, soft_grip
from ..plant.settings import WorldSettings, load_world
from ..settings import SettingError
from ..terminal import Console, command
from .carrying import CASES as CARRYING
from .force_error import WALLS, wall, with_damping
from .force_metric import LAST, judged
from .lab import done_by, worker_pool
from .planar_error import CASES as PLANAR_TRIALS
from .planar_error import Case as PlanarCase
from .planar_error import error_of, hand_to, reduced
from .report import shown
from .stand import LoopSettings, SimulatedStand
from .trials import Arm, HandTrial, MotionTrial, PlanarTrial, PlaneLoop

FAMILIES = {"A": "rigid hand", "B": "soft grip"}
THESIS_MODULE = {"T": "the thesis's module"}
MODES = tuple(variants())
CENTRE = 0.18  # centre of the spring [m]
_COUNTS = (2000, 4000, 8192, 20000)
_HAND = Arm()
_HEAVY = Arm(30.0, 300.0, 30.0)
_REACHES = {  # way [m] and time [s] of a minimum-jerk reach
    "reach 0.25 m in 0.6 s": (0.25, 0.6),
    "reach 1 m/s, 10 m/s2": (0.164, 0.308),  # peaks 1.875 d / t, 5.77 d / t^2
}
_AHEAD = 0.02  # distance of an obstacle from the centre [m]
_SUDDEN_S = 0.02
_SCHEDULER_S = 10.0


class Rig(NamedTuple):
    """One robot and its patient's hand; in the plane also where and in which direction he moves it
    [m], [rad]."""

    world: WorldSettings
    loop: Any
    grip: ArmForce
    centre: tuple[float, float] = (0.0, 0.0)
    direction: float = 0.0


def drawn(family: str, seed: int) -> Rig:
    """Return the rig of a family, of `FAMILIES`, and seed; the same for the same seed."""
    if family in THESIS_MODULE:
        return Rig(load_world(), LoopSettings(rate=1000.0, command_delay=0.6e-3), RIGID)
    draw = random.Random(f"study {family} {seed}")
    world = load_world(perturb_seed=seed)
    if draw.random() < 0.5:  # what earlier versions drew, so that seeds still draw the rest
        draw.random()
    world = world._replace(
        sensor=world.sensor._replace(hysteresis=draw.uniform(0.0, 0.1)),
        start=world.start._replace(counts_per_turn=draw.choice(_COUNTS)),
    )
    loop = LoopSettings(rate=1000.0, command_delay=_between(draw, 0.4e-3, 3e-3))
    return Rig(world, loop, _grip(draw, family))


def drawn_plane(family: str, seed: int) -> Rig:
    """Return the rig of a family and seed for the plane."""
    draw = random.Random(f"planar study {family} {seed}")
    world = load_world(perturb_seed=seed)
    robot = world.planar._replace(
        friction=world.planar.friction * _between(draw, 0.7, 1.4),
        module_mass=world.planar.module_mass * _between(draw, 0.85, 1.2),
        viscous=world.planar.viscous * _between(draw, 0.5, 2.0),
        bristle_stiffness=world.planar.bristle_stiffness * _between(draw, 0.5, 2.0),
        bandwidth=_between(draw, 300.0, 1000.0),
        # A stream of its own, so that seeds still draw the other values that they drew before.
        inertia=random.Random(f"planar study, inertia {family} {seed}").choice(planar.INERTIAS),
    )
    radian = 2.0 * math.pi / draw.choice((16384, 32768, 65536))
    world = world._replace(planar=robot, start=world.start._replace(joint_resolution=radian))
    rate = draw.choice((250.0, 500.0, 500.0))
    loop = PlaneLoop(rate, _between(draw, 0.4e-3, 1.8e-3), _between(draw, 1e-3, 3e-3))
    grip = _grip(draw, family)
    centre = draw.uniform(-0.08, 0.08), draw.uniform(-0.1, 0.1)
    return Rig(world, loop, grip, centre, draw.uniform(0.0, math.pi))


def _grip(draw: random.Random, family: str) -> ArmForce:
    grip = soft_grip(_between(draw, 2e3, 2e4), _between(draw, 10.0, 60.0), draw.uniform(0.3, 0.6))
    return grip if family == "B" else RIGID


def _between(draw: random.Random, low: float, high: float) -> float:
    return math.exp(draw.uniform(math.log(low), math.log(high)))


class Case(NamedTuple):
    """One trial. trial: of the case in a mode with a law; first: from when its error counts [s];
    obstacle: above the centre [m], 0 = none; figures: their names, of `FIGURES`."""

    trial: Callable[[int, VerticalSettings], HandTrial]
    figures: tuple[str, ...]
    first: float = 0.0
    obstacle: float = 0.0


def _case(
    figures: str, path: HandPath, seconds: float, arm: Arm = _HAND, first: float = 0.0,
    obstacle: float = 0.0, before: HandPath | None = None, released: float = math.inf,
    from_mode: int | None = None,
) -> Case:  # fmt: skip
    """Return a case; from_mode: that of the trial up to half of its time, None = no change.

    A law of another package takes over from OFF: a trial has one law.
    """

    def trial(mode: int, law: VerticalSettings) -> HandTrial:
        begun = mode if from_mode is None else from_mode if law_of(mode) else modes.OFF
        motion = MotionTrial(
            begun, law, arm=arm, centre=CENTRE, duration=seconds, released_after=released
        )
        changed = math.inf if from_mode is None else 0.5 * seconds
        return HandTrial(
            motion, before or resting(CENTRE), path, switched_after=changed, then_mode=mode
        )

    return Case(trial, tuple(figures.split()), first, obstacle)


def _sine(amplitude: float, omega: float) -> HandPath:
    return HandPath(CENTRE, CENTRE, 0.0, 0.0, amplitude, omega, 0.0)


def _to(way: float, seconds: float = 1.0, start: float = 0.0, begin: float = 0.0) -> HandPath:
    """Return a minimum-jerk path, from `start` by `way`, both from the centre [m]."""
    return HandPath(CENTRE + start, CENTRE + start + way, begin, seconds, 0.0, 0.0, 0.0)


CASES = {
    "slow": _case("rms share", _sine(0.15, 0.8), 15.8),
    "fast": _case("rms share", _sine(0.10, 3.0), 8.4),
    "small": _case("rms share", _sine(0.03, 1.5), 12.6),
    **{
        name: _case("rms share", _to(way, seconds, -0.5 * way, 0.2), seconds + 1.2,
                    before=_to(-0.5 * way))
        for name, (way, seconds) in _REACHES.items()
    },
    "held": _case("rms travel", _to(0.05), 6.0, first=3.0),
    "released": _case("travel", _to(0.05), 11.0, first=5.0, released=3.0),
    "arm of 30 kg": _case("rms share", _sine(0.05, 0.8), 7.9, _HEAVY),
    "arm of 30 kg, held": _case("shaking", _to(0.05), 6.0, _HEAVY, first=1.0),
    **{
        f"{text.replace('a wall of', 'wall')}{end}": _case(
            "shaking peak", path, 5.0, wall(*how), first
        )
        for text, *how in WALLS.values()
        for end, path, first in (("", _to(0.05), 1.0), (", moved", _sine(0.003, 3.0), 0.0))
    },
    "obstacle, not felt": _case("pressed", _to(0.12, 2.0), 4.0, obstacle=_AHEAD),
    "mode changed at rest": _case("sudden", _to(0.05), 6.0, from_mode=modes.IMPEDANCE),
}
"""By name. Each has a hand of 3 kg, 300 N/m and 5 Ns/m, unless it says another."""

_TO_PATIENT = -0.5 * math.pi  # direction of the near edge, where the arm is nearly stretched
PLANAR_CASES = {
    **PLANAR_TRIALS,
    **{
        name: PlanarCase("", PlanarTrial(
            PlanarSettings(), direction=_TO_PATIENT, path=hand_to(way, seconds), duration=3.0
        ), "over blow shaking")
        for name, way, seconds in (
            ("near_edge_slow", 0.30, 2.0), ("near_edge_1.0", 0.26, 0.4),
            ("near_edge_1.3", 0.30, 0.35),
        )
    },
}  # fmt: skip
"""Those of `planar_error`, and a hand that moves from the middle over the edge near the patient, at
0.23 m."""

FIGURES = {
    "rms": "rms [N]",
    "share": "least share",
    "shaking": "over 1.5 N rms [s]",
    "peak": "peak [N]",
    "travel": "last second [mm]",
    "pressed": "pressed [N]",
    "sudden": f"in {_SUDDEN_S * 1e3:g} ms [N]",
    "over": "over the edge [m/s]",
    "blow": "hand's force [N]",
    "sunk": "below [mm]",
    "off": "off its place [mm]",
    "rest": "force less support [N]",
    "error": "the same, rms [N]",
    "flown": "flies [mm]",
    "flying": "fastest [m/s]",
    "lost": "support lost, of 12 s [s]",
    "fallen": "falls in 0.5 s [mm]",
}
"""Texts of the figures. Of the force error: rms, longest time with more than 1.5 N rms above 3 Hz,
largest. Least share of the force gain; travel in the last second; mean force on the obstacle in the
last second; largest change of the hand's force. Of the plane also the largest speed beyond the edge
and the hand's largest force. The larger the worse, but for the share."""
WANTED = {
    "rms": 1.5, "share": 1.0, "shaking": 0.3, "peak": math.inf, "travel": 1.0, "pressed": 40.0,
    "sudden": 5.0, "over": 0.0, "blow": 60.0,
    "sunk": math.inf, "off": 10.0, "rest": 0.5, "error": 1.0, "flown": 60.0, "flying": 0.45,
    "lost": 1.0, "fallen": math.inf,
}  # fmt: skip


def measured(
    family: str, seed: int, mode: int, name: str, laws: tuple[str, ...] = ()
) -> dict[str, float]:
    """Return the figures of one case on one rig in one mode; laws: of other packages."""
    rig, case = drawn(family, seed), CASES[name]
    world = rig.world
    if case.obstacle:  # an end stop in the way: it acts on the carriage, not on the transducer
        travel = CENTRE + case.obstacle
        start = world.start._replace(position=min(world.start.position, travel))
        world = world._replace(vertical=world.vertical._replace(travel=travel), start=start)
    law = with_damping(VerticalSettings(stiffness=100.0), mode)
    trial = case.trial(mode, law)
    if trial.motion.arm.mass:  # a wall has none, and no grip
        trial = trial._replace(grip=rig.grip)
    samples = SimulatedStand(world, rig.loop, seed, laws).record(trial, lambda share: None)
    period = float(samples.time[1] - samples.time[0])
    first = round(case.first / period)
    handle, velocity, force = samples.felt
    found = judged(
        period, handle - CENTRE, velocity, force, samples.share, law.stiffness, law.damping, first
    )
    error = force - law.stiffness * (handle - CENTRE) - law.damping * velocity
    step = round(_SUDDEN_S / period)
    half, last = len(error) // 2, round(LAST / period)
    after = force[half - step :]
    figures = {
        "rms": found.rms,
        "share": float(samples.share[first:].min()),
        "shaking": found.shaking,
        "peak": float(np.abs(error[first:]).max()),
        "travel": 1e3 * found.travel,
        "pressed": world.vertical.stop_stiffness
        * float(np.maximum(handle[-last:] - world.vertical.travel, 0.0).mean()),
        "sudden": float(np.abs(after[step:] - after[:-step]).max()),
    }
    return {figure: figures[figure] for figure in case.figures}


def measured_plane(family: str, seed: int, kind: int, name: str) -> dict[str, float]:
    """Return the figures of one case on one rig, without (kind 0) or with feedback."""
    rig, case, law = drawn_plane(family, seed), PLANAR_CASES[name], PlanarSettings()
    trial = case.trial._replace(
        settings=law._replace(
            force_gain=STUDIED_GAIN if kind else 0.0, stiffness=case.trial.settings.stiffness
        ),
        loop=rig.loop, centre=rig.centre, direction=rig.direction,
    )  # fmt: skip
    if "over" in case.figures:
        trial = trial._replace(centre=(rig.centre[0], 0.0), direction=_TO_PATIENT)
    if trial.arm.mass:  # a wall has none, and no grip
        trial = trial._replace(grip=rig.grip)
    samples = SimulatedStand(rig.world, seed=seed).record(trial, lambda share: None)
    found = error_of(reduced(trial, samples))
    first = round(trial.first / float(samples.time[1] - samples.time[0]))
    place, velocity, force = samples.felt
    error = force - trial.settings.stiffness * place - trial.settings.damping * velocity
    speed, over = np.hypot(*velocity.T), place[:, 1] + trial.centre[1] < -law.half_depth
    figures = {
        "rms": found.rms,
        "share": float(samples.share[first:].min()),
        "shaking": found.shaking,
        "peak": float(np.hypot(*error[first:].T).max()),
        "travel": 1e3 * found.travel,
        "over": float(speed[over].max(initial=0.0)),
        "blow": float(np.hypot(*force.T).max()),
    }
    return {figure: figures[figure] for figure in case.figures.split()}


def measured_carrying(
    family: str, seed: int, mode: int, name: str, laws: tuple[str, ...] = ()
) -> dict[str, float]:
    """Return the figures of one case of a carried arm on one rig; laws: of other packages."""
    rig, case = drawn(family, seed), CARRYING[name]
    stand = SimulatedStand(rig.world, rig.loop, seed, laws)
    return case.judged(stand.record(case.trial(mode, rig.grip), lambda share: None))


class Subject(NamedTuple):
    """What is studied. kinds: number and head of each column; figures: of each case, by name;
    families: of its rigs."""

    kinds: dict[int, str]
    figures: dict[str, tuple[str, ...]]
    measured: Callable[[str, int, int, str], dict[str, float]]
    families: dict[str, str] = FAMILIES


def vertical(laws: tuple[str, ...] = ()) -> Subject:
    """Return the vertical axis with laws of other packages. Raises SettingError for no law."""
    others = loaded(laws)[len(LAWS) :]
    kinds = {mode: f"mode {mode}" for mode in MODES}
    kinds |= {mode: variant.name for mode, variant in variants(others).items()}
    figures = {name: case.figures for name, case in CASES.items()}
    return Subject(kinds, figures, partial(measured, laws=laws) if laws else measured)


def carried(laws: tuple[str, ...] = ()) -> Subject:
    """Return the support in all modes that feed the force back, with laws of other packages.

    Raises SettingError for no law.
    """
    kinds, of_all = vertical(laws).kinds, variants(loaded(laws))
    return Subject(
        {mode: name for mode, name in kinds.items() if of_all[mode].force},
        {name: case.figures for name, case in CARRYING.items()},
        partial(measured_carrying, laws=laws),
        {**THESIS_MODULE, **FAMILIES},
    )


VERTICAL = vertical()
PLANE = Subject(
    {0: "no feedback", 1: "feedback"},
    {name: tuple(case.figures.split()) for name, case in PLANAR_CASES.items()},
    measured_plane,
)
Outcomes = dict[str, dict[str, dict[int, list[float]]]]
"""By case, figure and mode: one value for each rig of a family, in the order of the seeds."""


@command("study", stopped="stopped; nothing is written", narrowest=140)
@click.option("--rigs", default=10, type=click.IntRange(1, 1000), help="Rigs of each family.")
@click.option("--first-seed", default=1, type=click.IntRange(0), help="The first rig's seed.")
@click.option(
    "--mode", "chosen", multiple=True, type=click.IntRange(1),
    help="This mode alone (repeat for more).",
)
@click.option(
    "--law", "laws", multiple=True, metavar="LAW",
    help="A law of another package too, at its default settings: package.module:NAME, or "
         "its entry point (repeat for more).",
)
@click.option("--plane", is_flag=True, help="The plane in place of the vertical modes.")
@click.option("--support", is_flag=True, help="An arm that hangs on the handle and is carried.")
@click.option(
    "--case", "cases", multiple=True, type=click.Choice([*CASES, *PLANAR_CASES, *CARRYING]),
    help="This case alone.",
)
@click.option("--folder", type=click.Path(file_okay=False, path_type=Path),
              default=Path("study_output"), help="Folder of study.md, .json, .csv.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--scheduler", metavar="ADDRESS",
              help="Scheduler of a dask cluster that runs already, in place of processes here.")
def study(
    console: Console, rigs: int, first_seed: int, chosen: tuple[int, ...], laws: tuple[str, ...],
    plane: bool, support: bool, cases: tuple[str, ...], folder: Path, workers: int | None,
    scheduler: str | None,
) -> None:  # fmt: skip
    """Measure every mode on rigs drawn by seed and write one table: median, worst."""
    begun = time.monotonic()
    seeds = range(first_seed, first_seed + rigs)
    if plane and (laws or support):
        raise click.UsageError("--law and --support are for the vertical axis: without --plane")
    try:
        subject = PLANE if plane else carried(laws) if support else vertical(laws)
    except SettingError as error:
        raise click.UsageError(str(error)) from None
    names, kinds = cases or tuple(subject.figures), chosen or tuple(subject.kinds)
    if not set(names) <= set(subject.figures):
        raise click.UsageError(f"--case: one of {', '.join(subject.figures)} goes with the rest")
    if unknown := sorted(set(kinds) - set(subject.kinds)):
        known = ", ".join(map(str, subject.kinds))
        raise click.UsageError(f"--mode {unknown[0]} is none of {known}; --plane has none")
    wanted = [(f, s, m, n) for n in names for m in kinds for f in subject.families for s in seeds]
    folder.mkdir(parents=True, exist_ok=True)
    with executor(workers, scheduler) as pool, Progress(console=console.rich) as bars:
        bar = bars.add_task("trials", total=len(wanted))
        values = {}
        try:
            for each, found_of in done_by(pool, subject.measured, {each: each for each in wanted}):
                values[each] = found_of
                bars.advance(bar)
        except NotCompiled as error:
            raise click.ClickException(str(error)) from None
    figures = {name: subject.figures[name] for name in names}
    found: dict[str, Outcomes] = {
        family: {
            name: {
                figure: {
                    kind: [values[family, seed, kind, name][figure] for seed in seeds]
                    for kind in kinds
                }
                for figure in names_of
            }
            for name, names_of in figures.items()
        }
        for family in subject.families
    }
    seconds = time.monotonic() - begun
    head = f"Rigs {seeds[0]} to {seeds[-1]} of each family: {len(wanted)} trials in {seconds:.0f} s"
    words = [f"--law {law}" for law in laws] + ["--plane"] * plane + ["--support"] * support
    called = " ".join(["study", *words, f"--rigs {rigs} --first-seed {first_seed}"])
    text = [f"# Study\n\n{head}: `{called}`."]
    for family, cases_of in found.items():
        title = f"Family {family}, {subject.families[family]}: median / worst"
        rows = table_rows(cases_of, {kind: subject.kinds[kind] for kind in kinds})
        text.append(f"\n## {title}\n\n{_markdown(rows)}")
        console.show(shown(title, rows[0], rows[1:]))
    (folder / "study.md").write_text("\n".join(text) + "\n", encoding="utf-8")
    (folder / "study.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    with (folder / "study.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows_of_rigs(found, subject.kinds, seeds))
    console.show(f"{head}. The table: {folder / 'study.md'}")


@contextmanager
def executor(workers: int | None, scheduler: str | None) -> Iterator[Executor]:
    """Yield what runs trials: processes of this machine, or a dask cluster that runs already.

    Raises UsageError without the package, or where no scheduler answers.
    """
    if scheduler is None:
        with worker_pool(workers) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise click.UsageError(
            "--scheduler needs the package distributed: pip install screw_module_ros[cluster]"
        ) from None
    try:
        client = Client(scheduler, timeout=_SCHEDULER_S)
    except (OSError, ValueError) as error:
        raise click.UsageError(f"--scheduler {scheduler}: no dask scheduler: {error}") from None
    with client, client.get_executor(pure=False) as pool:
        yield pool


def rows_of_rigs(
    found: dict[str, Outcomes], kinds: dict[int, str], seeds: range
) -> list[tuple[Any, ...]]:
    """Return a table with one row for each rig and kind, the first is its head."""
    columns = [
        (name, figure)
        for name, figures in next(iter(found.values())).items() for figure in figures
    ]  # fmt: skip
    head = ("family", "seed", "kind", *(f"{name}: {FIGURES[figure]}" for name, figure in columns))
    rows: list[tuple[Any, ...]] = [head]
    for family, cases in found.items():
        for kind in next(iter(cases[columns[0][0]].values())):
            for number, seed in enumerate(seeds):
                values = (cases[name][figure][kind][number] for name, figure in columns)
                rows.append((family, seed, kinds[kind], *values))
    return rows


def table_rows(found: Outcomes, kinds: dict[int, str]) -> list[tuple[str, ...]]:
    """Return the rows of a family's table, the first is its head; kinds: as in `Subject`."""
    rows = [("case", "figure", *kinds.values(), "wanted")]
    for name, figures in found.items():
        for figure, by_mode in figures.items():
            limit = WANTED[figure]
            rows.append((
                name,
                FIGURES[figure],
                *(_cell(by_mode[mode], figure == "share") for mode in kinds),
                "" if math.isinf(limit) else f"{limit:g}",
            ))  # fmt: skip
    return rows


def _cell(values: list[float], least: bool) -> str:
    worst = min(values) if least else max(values)
    return f"{np.median(values):.3g} / {worst:.3g}"


def _markdown(rows: list[tuple[str, ...]]) -> str:
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join((head, "|---" * len(rows[0]) + "|", *body))
