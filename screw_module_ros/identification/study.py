# SPDX-License-Identifier: Apache-2.0
"""The command `study`: every mode on rigs drawn by seed, one table of medians and worst cases.

A law is judged on rigs that it was not tuned on (`rigs`). The trials are those in which a
force-feedback law fails: reaches, walls that stand or are pushed, a heavy arm, an arm that hangs on
the handle and is carried, an obstacle that the transducer does not feel, an end of travel, a change
of mode, besides slow and small motion, holding and letting go. *A second after* is the oscillation
that is left a second after its cause has ended, in newtons: what a table of millimetres hides. No
mode is calibrated, but for mode 5 in two more columns: one knows its delay, one all that a
calibration measures. In process, no ROS, no hardware.

With `--support` it is an arm that hangs on the handle and is carried (`carrying`), in the modes
that feed the force back, on the same rigs and on the thesis's module, where the seed is the
noise's. With `--plane` it is the plane, without and with force feedback. With `--impedance` it is
what a control engineer asks for (`impedance`), on the vertical axis or, with `--plane`, there.

`--law` adds a law of another package: its modes stand beside the shipped ones, on the same rigs and
in the same trials. `--beside` shows an earlier run of the same rigs beside this one, such as one of
the law before a change. `--scheduler` sends the trials to a dask cluster that runs already, in
place of processes of this machine; a rig and a trial are drawn by their seed, so the rows are the
same.
"""

from __future__ import annotations

import csv
import json
import math
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
from ..control.planar_settings import PlanarSettings
from ..control.vertical_settings import VerticalSettings
from ..plant.patient import RIGID, HandPath, resting
from ..settings import SettingError
from ..terminal import Console, command
from . import impedance
from .carrying import CASES as CARRYING
from .carrying import CENTRE
from .figures import save
from .force_error import WALLS, wall
from .force_metric import LAST, lasting, shaking
from .lab import done_by, worker_pool
from .planar_error import CASES as PLANAR_TRIALS
from .planar_error import Case as PlanarCase
from .planar_error import hand_to
from .report import shown
from .rigs import (
    DELAY,
    FAMILIES,
    MODULE,
    THESIS_MODULE,
    Kind,
    Rig,
    drawn,
    drawn_plane,
)
from .stand import SimulatedStand
from .trials import HEAVY, Arm, HandTrial, MotionTrial, PlanarTrial

MODES = tuple(variants())
_REACHES = {  # way [m] and time [s] of a minimum-jerk reach
    "reach 0.25 m in 0.6 s": (0.25, 0.6),
    "reach 1 m/s, 10 m/s2": (0.164, 0.308),  # peaks 1.875 d / t, 5.77 d / t^2
}
_AHEAD = 0.02  # distance of an obstacle from the centre [m]
_SUDDEN_S = 0.02
_SCHEDULER_S = 10.0


class Case(NamedTuple):
    """One trial of the vertical axis.

    figures: their names, of `FIGURES`; path: of the hand, before: in the 3 s before; arm: None =
    the rig's hand; first: from when the error counts, ended: when what could shake has ended [s];
    obstacle: above the centre [m], 0 = none; released: when the hand lets go [s]; before_mode,
    after_mode: of the two halves of the trial, 0 = the one that is studied; carried: the rig's
    weight hangs on the handle and is carried; play: the nut has its own, else none.
    """

    figures: tuple[str, ...]
    path: HandPath
    seconds: float
    arm: Arm | None = None
    first: float = 0.0
    ended: float = math.inf
    obstacle: float = 0.0
    before: HandPath = resting(CENTRE)
    released: float = math.inf
    before_mode: int = 0
    after_mode: int = 0
    carried: bool = False
    play: bool = True

    def trial(self, rig: Rig, kind: Kind) -> HandTrial:
        """Return the trial on a rig. A law of another package takes over from OFF, and makes room
        for it: a trial has one law."""
        own = bool(law_of(kind.mode))
        begun, then = (
            (mode if own else modes.OFF) if mode else kind.mode
            for mode in (self.before_mode, self.after_mode)
        )
        arm = self.arm or rig.hand
        motion = MotionTrial(
            begun, rig.law(kind, VerticalSettings(stiffness=100.0)), arm=arm, centre=CENTRE,
            duration=self.seconds, released_after=self.released, preloaded=not self.play,
        )  # fmt: skip
        weight = rig.weight if self.carried else 0.0
        return HandTrial(
            motion, self.before, self.path, rig.grip if arm.mass else RIGID,
            0.5 * self.seconds if begun != then else math.inf, then, weight, weight,
        )  # fmt: skip


def _case(figures: str, path: HandPath, seconds: float, **more: Any) -> Case:
    return Case(tuple(figures.split()), path, seconds, **more)


def _sine(amplitude: float, omega: float) -> HandPath:
    return HandPath(CENTRE, CENTRE, 0.0, 0.0, amplitude, omega, 0.0)


def _to(way: float, seconds: float = 1.0, start: float = 0.0, begin: float = 0.0) -> HandPath:
    """Return a minimum-jerk path, from `start` by `way`, both from the centre [m]."""
    return HandPath(CENTRE + start, CENTRE + start + way, begin, seconds, 0.0, 0.0, 0.0)


_ONE = modes.IMPEDANCE
_WALLS = (  # one that is well damped takes energy enough, but for the stiffest
    "wall_1e3_badly", "wall_1e4_badly", "wall_1e5_badly", "wall_1e6_well", "wall_1e6_badly",
)  # fmt: skip
CASES = {
    "slow": _case("rms share", _sine(0.15, 0.8), 15.8),
    "fast": _case("rms share", _sine(0.10, 3.0), 8.4),
    "small": _case("rms share", _sine(0.03, 1.5), 12.6),
    **{
        name: _case("rms share", _to(way, seconds, -0.5 * way, 0.2), seconds + 1.2,
                    before=_to(-0.5 * way))
        for name, (way, seconds) in _REACHES.items()
    },
    "held": _case("rms chatter travel share", _to(0.05), 6.0, first=3.0, ended=1.0),
    "released": _case("chatter travel", _to(0.05), 11.0, first=5.0, ended=3.0, released=3.0),
    "arm of 30 kg": _case("rms share", _sine(0.05, 0.8), 7.9, arm=HEAVY),
    "arm of 30 kg, held": _case("chatter shaking", _to(0.05), 6.0, arm=HEAVY, first=1.0,
                                ended=1.0),
    "carried arm, moved": _case("rms share", _sine(0.10, 0.84), 7.5, carried=True),
    "carried arm, held": _case("rms chatter", _to(0.05), 6.0, first=3.0, ended=1.0, carried=True),
    **{
        f"{text.replace('a wall of', 'wall')}{end}": _case(
            "chatter shaking peak", path, 5.0, arm=wall(*how), first=first, ended=ended
        )
        for text, *how in map(WALLS.__getitem__, _WALLS)
        for end, path, first, ended in (
            ("", _to(0.05), 1.0, 1.0), (", moved", _to(0.003, 0.3, 0.0, 0.2), 0.0, 0.5)
        )
    },
    "obstacle, not felt": _case("pressed", _to(0.12, 2.0), 4.0, obstacle=_AHEAD),
    "end of travel, 0.9 m/s": _case("over blow", _to(0.24, 0.5, -0.05, 0.2), 2.0,
                                    before=_to(-0.05)),
    "mode begun at rest": _case("sudden", _to(0.05), 6.0, before_mode=_ONE),
    "mode begun at rest, no play": _case("sudden", _to(0.05), 6.0, before_mode=_ONE, play=False),
    "mode left at rest, no play": _case("sudden", _to(0.05), 6.0, after_mode=_ONE, play=False),
}  # fmt: skip
"""By name. Each has the rig's hand, unless it says another. A wall that is moved is pushed 3 mm
towards the handle, once."""

_TO_PATIENT = -0.5 * math.pi  # direction of the near edge, where the arm is nearly stretched
_ONE_WAY = ("slow_y", "fast_y", "fast_between")  # a rig has a direction of its own
PLANAR_CASES = {
    **{name: case for name, case in PLANAR_TRIALS.items() if name not in _ONE_WAY},
    "spastic": PLANAR_TRIALS["fast_y"],
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
"""Those of `planar_error`, an arm with tone, and a hand that moves from the middle over the edge
near the patient, at 0.23 m."""

FIGURES = {
    "rms": "rms [N]",
    "share": "least share",
    "chatter": "a second after, rms [N]",
    "shaking": "over 1.5 N rms [s]",
    "peak": "peak [N]",
    "travel": "last second [mm]",
    "pressed": "pressed [N]",
    "sudden": f"in {_SUDDEN_S * 1e3:g} ms [N]",
    "over": "beyond the edge [m/s]",
    "blow": "hand's force [N]",
    "sunk": "below [mm]",
    "off": "off its place [mm]",
    "rest": "force less support [N]",
    "error": "the same, rms [N]",
    "flown": "flies [mm]",
    "flying": "fastest [m/s]",
    "lost": "support lost, of 12 s [s]",
    "fallen": "falls in 0.5 s [mm]",
    "apart": "off what is asked [Ns/m]",
    "resistance": "least Re Z [Ns/m]",
    "mass": "apparent mass [kg]",
    "stiffest": "stiffest spring [N/m]",
    "kept": "the same, gain kept [N/m]",
}
"""Texts of the figures. Of the force error: rms; the largest rms above 3 Hz over half a second,
from a second after the end of its cause on; longest time with more than 1.5 N rms above 3 Hz;
largest. Least share of the force gain; travel in the last second; mean force on the obstacle in the
last second; largest change of the hand's force; largest speed beyond an edge, where the soft stop
begins, and the hand's largest force. The larger the worse, but for `_LEAST`."""
_LEAST = ("share", "resistance", "stiffest", "kept")
WANTED = {
    "rms": 1.5, "share": 1.0, "chatter": 0.5, "shaking": 0.3, "peak": math.inf,
    "travel": 1.0, "pressed": 40.0, "sudden": 5.0, "over": 0.0, "blow": 60.0,
    "sunk": math.inf, "off": 10.0, "rest": 0.5, "error": 1.0, "flown": 60.0, "flying": 0.45,
    "lost": 1.0, "fallen": math.inf, "apart": math.inf, "resistance": 0.0, "mass": math.inf,
    "stiffest": math.inf, "kept": math.inf,
}  # fmt: skip


def measured(
    family: str, seed: int, kind: Kind, name: str, laws: tuple[str, ...] = ()
) -> dict[str, float]:
    """Return the figures of one case on one rig; laws: of other packages."""
    rig, case = drawn(family, seed), CASES[name]
    world = rig.world
    if case.obstacle:  # an end stop in the way: it acts on the carriage, not on the transducer
        travel = CENTRE + case.obstacle
        start = world.start._replace(position=min(world.start.position, travel))
        world = world._replace(vertical=world.vertical._replace(travel=travel), start=start)
    trial = case.trial(rig, kind)
    law = trial.motion.settings
    samples = SimulatedStand(world, rig.loop, seed, laws).record(trial, lambda share: None)
    period = float(samples.time[1] - samples.time[0])
    handle, velocity, force = samples.felt
    error = force + samples.support - law.stiffness * (handle - CENTRE) - law.damping * velocity
    step, half = round(_SUDDEN_S / period), len(error) // 2
    after, last = force[half - step :], round(LAST / period)
    figures = _figures(case.first, case.ended, period, error, handle, samples.share) | {
        "pressed": world.vertical.stop_stiffness
        * float(np.maximum(handle[-last:] - world.vertical.travel, 0.0).mean()),
        "sudden": float(np.abs(after[step:] - after[:-step]).max()),
        "over": _beyond(np.abs(velocity), handle > law.travel_high - law.soft_stop_zone),
        "blow": float(np.abs(force).max()),
    }
    return {figure: figures[figure] for figure in case.figures}


def measured_plane(family: str, seed: int, kind: Kind, name: str) -> dict[str, float]:
    """Return the figures of one case on one rig."""
    rig, case = drawn_plane(family, seed), PLANAR_CASES[name]
    asked = PlanarSettings(stiffness=case.trial.settings.stiffness)
    trial = case.trial._replace(
        settings=rig.plane_law(kind, asked), loop=rig.loop, centre=rig.centre,
        direction=rig.direction,
    )  # fmt: skip
    if name == "spastic":  # his flexors pull along y alone
        trial = trial._replace(direction=case.trial.direction, tone=rig.tone)
    if "over" in case.figures:
        trial = trial._replace(centre=(rig.centre[0], 0.0), direction=_TO_PATIENT)
    if trial.arm == Arm():
        trial = trial._replace(arm=rig.hand)
    if trial.arm.mass:  # a wall has none, and no grip
        trial = trial._replace(grip=rig.grip)
    samples = SimulatedStand(rig.world, seed=seed).record(trial, lambda share: None)
    period = float(samples.time[1] - samples.time[0])
    place, velocity, force = samples.felt
    error = force - asked.stiffness * place - asked.damping * velocity
    over = place[:, 1] + trial.centre[1] < -asked.half_depth
    figures = _figures(trial.first, case.ended, period, error, place, samples.share) | {
        "over": _beyond(np.hypot(*velocity.T), over),
        "blow": float(np.hypot(*force.T).max()),
    }
    return {figure: figures[figure] for figure in case.figures.split()}


def _figures(
    first: float, ended: float, period: float, error: np.ndarray, place: np.ndarray,
    share: np.ndarray,
) -> dict[str, float]:  # fmt: skip
    """Return what both axes have: error [N] and place [m], one column or two, by their names."""
    begun, last = round(first / period), round(LAST / period)
    size = np.sqrt((error.reshape(len(error), -1) ** 2).sum(axis=1))
    return {
        "rms": float(np.sqrt(np.mean(size[begun:] ** 2))),
        "share": float(share[begun:].min()),
        "chatter": lasting(period, error, round((ended + 1.0) / period))
        if math.isfinite(ended)
        else 0.0,
        "shaking": shaking(period, error, begun),
        "peak": float(size[begun:].max()),
        "travel": 1e3 * float(np.ptp(place[-last:], axis=0).max()),
    }


def _beyond(speed: np.ndarray, over: np.ndarray) -> float:
    return float(speed[over].max(initial=0.0))


def measured_carrying(
    family: str, seed: int, kind: Kind, name: str, laws: tuple[str, ...] = ()
) -> dict[str, float]:
    """Return the figures of one case of a carried arm on one rig; laws: of other packages."""
    rig, case = drawn(family, seed), CARRYING[name]
    stand = SimulatedStand(rig.world, rig.loop, seed, laws)
    return case.judged(stand.record(case.made(kind.mode, rig.grip), lambda share: None))


class Subject(NamedTuple):
    """What is studied. kinds: the columns; figures: of each case, by name; families: of its rigs;
    drawn: a figure of each kind is drawn."""

    kinds: tuple[Kind, ...]
    figures: dict[str, tuple[str, ...]]
    measured: Callable[[str, int, Kind, str], dict[str, float]]
    families: dict[str, str] = FAMILIES
    drawn: bool = False


def kinds_of(laws: tuple[str, ...] = ()) -> tuple[Kind, ...]:
    """Return every mode, mode 5 also as it knows its rig, and those of laws of other packages.

    Raises SettingError for no law.
    """
    own = [Kind(f"mode {mode}", mode) for mode in MODES]
    own += [
        Kind("mode 5, delay known", modes.OBSERVER, DELAY),
        Kind("mode 5, calibrated", modes.OBSERVER, MODULE),
    ]
    others = variants(loaded(laws)[len(LAWS) :])
    return (*own, *(Kind(variant.name, mode) for mode, variant in others.items()))


def vertical(laws: tuple[str, ...] = ()) -> Subject:
    """Return the vertical axis with laws of other packages. Raises SettingError for no law."""
    figures = {name: case.figures for name, case in CASES.items()}
    return Subject(kinds_of(laws), figures, partial(measured, laws=laws))


def carried(laws: tuple[str, ...] = ()) -> Subject:
    """Return the support in all modes that feed the force back, with laws of other packages.

    Nothing is calibrated. Raises SettingError for no law.
    """
    of_all = variants(loaded(laws))
    return Subject(
        tuple(kind for kind in kinds_of(laws) if of_all[kind.mode].force and not kind.knows),
        {name: case.figures for name, case in CARRYING.items()},
        partial(measured_carrying, laws=laws),
        {**THESIS_MODULE, **FAMILIES},
    )


def delivered(laws: tuple[str, ...] = (), plane: bool = False) -> Subject:
    """Return the impedance delivered over frequency, and its range. Raises SettingError."""
    if plane:
        return PLANE._replace(
            figures=impedance.CASES, measured=impedance.measured_plane, drawn=True
        )
    own = partial(impedance.measured, laws=laws)
    return Subject(kinds_of(laws), impedance.CASES, own, drawn=True)


PLANE = Subject(
    (Kind("no feedback", 0), Kind("feedback", 1), Kind("feedback, within its limits", 1, MODULE)),
    {name: tuple(case.figures.split()) for name, case in PLANAR_CASES.items()},
    measured_plane,
)
Outcomes = dict[str, dict[str, dict[str, list[float]]]]
"""By case, figure and kind: one value for each rig of a family, in the order of the seeds."""


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
@click.option("--impedance", "width", is_flag=True,
              help="The impedance delivered over frequency, and its stable range, drawn.")
@click.option("--beside", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="study.json of an earlier run of the same rigs, shown beside this one.")
@click.option(
    "--case", "cases", multiple=True, help="This case alone.",
    type=click.Choice([*CASES, *PLANAR_CASES, *CARRYING, *impedance.CASES]),
)
@click.option("--folder", type=click.Path(file_okay=False, path_type=Path),
              default=Path("study_output"), help="Folder of study.md, .json, .csv.")  # fmt: skip
@click.option("--workers", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--scheduler", metavar="ADDRESS",
              help="Scheduler of a dask cluster that runs already, in place of processes here.")
def study(
    console: Console, rigs: int, first_seed: int, chosen: tuple[int, ...], laws: tuple[str, ...],
    plane: bool, support: bool, width: bool, beside: Path | None, cases: tuple[str, ...],
    folder: Path, workers: int | None, scheduler: str | None,
) -> None:  # fmt: skip
    """Measure every mode on rigs drawn by seed and write one table: median, worst."""
    begun = time.monotonic()
    seeds = range(first_seed, first_seed + rigs)
    if plane and (laws or support) or support and width:
        raise click.UsageError("--law and --support are for the vertical axis: without --plane")
    try:
        subject = (
            delivered(laws, plane) if width
            else PLANE if plane else carried(laws) if support else vertical(laws)
        )  # fmt: skip
    except SettingError as error:
        raise click.UsageError(str(error)) from None
    names = cases or tuple(subject.figures)
    if not set(names) <= set(subject.figures):
        raise click.UsageError(f"--case: one of {', '.join(subject.figures)} goes with the rest")
    known = dict.fromkeys(kind.mode for kind in subject.kinds if not plane)
    if unknown := sorted(set(chosen) - set(known)):
        listed = ", ".join(map(str, known))
        raise click.UsageError(f"--mode {unknown[0]} is none of {listed}; --plane has none")
    kinds = [kind for kind in subject.kinds if not chosen or kind.mode in chosen]
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
    found: dict[str, Outcomes] = {
        family: {
            name: {
                figure: {
                    kind.name: [values[family, seed, kind, name][figure] for seed in seeds]
                    for kind in kinds
                }
                for figure in subject.figures[name]
            }
            for name in names
        }
        for family in subject.families
    }
    seconds = time.monotonic() - begun
    head = f"Rigs {seeds[0]} to {seeds[-1]} of each family: {len(wanted)} trials in {seconds:.0f} s"
    words = [f"--law {law}" for law in laws] + ["--plane"] * plane + ["--support"] * support
    words += ["--impedance"] * width
    called = " ".join(["study", *words, f"--rigs {rigs} --first-seed {first_seed}"])
    text = [f"# Study\n\n{head}: `{called}`."]
    (folder / "study.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    with (folder / "study.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows_of_rigs(found, seeds))
    for kind in kinds if subject.drawn else ():
        picture = impedance.draw(found, kind, subject.families)
        name = f"{'plane ' * plane}{kind.name}.png"
        save(picture, folder / name.replace(" ", "_").replace(",", ""))
    if beside:
        with_earlier(found, json.loads(beside.read_text(encoding="utf-8")))
    for family, cases_of in found.items():
        title = f"Family {family}, {subject.families[family]}: median / worst"
        rows = table_rows(cases_of)
        text.append(f"\n## {title}\n\n{_markdown(rows)}")
        console.show(shown(title, rows[0], rows[1:]))
    (folder / "study.md").write_text("\n".join(text) + "\n", encoding="utf-8")
    console.show(f"{head}. The table: {folder / 'study.md'}")


def with_earlier(found: dict[str, Outcomes], earlier: dict[str, Outcomes]) -> None:
    """Put the columns of an earlier run beside those that are there, as "before".

    Raises UsageError where it has other cases or another number of rigs.
    """
    for family, cases in found.items():
        for name, figures in cases.items():
            for figure, by_kind in figures.items():
                old = earlier.get(family, {}).get(name, {}).get(figure, {})
                for kind, values in list(by_kind.items()):
                    if len(old.get(kind, ())) != len(values):
                        raise click.UsageError(
                            f"--beside: {family}, {name}, {FIGURES[figure]}, {kind} is not there "
                            f"for {len(values)} rigs: run the same study there"
                        )
                    by_kind[f"{kind}, before"] = old[kind]


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


def rows_of_rigs(found: dict[str, Outcomes], seeds: range) -> list[tuple[Any, ...]]:
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
                rows.append((family, seed, kind, *values))
    return rows


def table_rows(found: Outcomes) -> list[tuple[str, ...]]:
    """Return the rows of a family's table, the first is its head."""
    first = next(iter(next(iter(found.values())).values()))
    rows = [("case", "figure", *first, "wanted")]
    for name, figures in found.items():
        for figure, by_kind in figures.items():
            limit = WANTED[figure]
            rows.append((
                name,
                FIGURES[figure],
                *(_cell(values, figure in _LEAST) for values in by_kind.values()),
                "" if math.isinf(limit) else f"{limit:g}",
            ))  # fmt: skip
    return rows


def _cell(values: list[float], least: bool) -> str:
    worst = np.nanmin(values) if least else np.nanmax(values)
    return f"{_said(float(np.nanmedian(values)))} / {_said(float(worst))}"


def _said(value: float) -> str:
    """Return a value with two digits, or whole from 10 on."""
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.0f}"


def _markdown(rows: list[tuple[str, ...]]) -> str:
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join((head, "|---" * len(rows[0]) + "|", *body))
