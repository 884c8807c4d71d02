# SPDX-License-Identifier: Apache-2.0
"""What a run found: beside the thesis's figures, beside the simulated module's hidden values.

A figure of the thesis beside ours is one of four things. A *prediction* follows from plant and
law; only predictions say whether the simulation behaves as the thesis's module did. An *input* is a
value of the plant's own file: to recover it shows that the method of identification works. A
*chosen* one is an outcome by which a value of the plant's file was chosen: it had to come out. A
*calculation* is arithmetic on printed values, without a trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table

from ..plant.settings import WorldSettings
from . import force_error
from .planar_sampled_loop import Plane, first_modes
from .results import MEASURED, Published, Quantity, Result
from .stand import LoopSettings
from .trials import Arm

PREDICTION, INPUT, CHOSEN, CALCULATION = "prediction", "input", "chosen", "calculation"
AGREES, COMPATIBLE, DIFFERS = "agrees", "compatible", "differs"
LOOSE = 0.3
"""With a tolerance above this share of the figure, a match counts as compatible only."""
FARTHEST = 3.0
"""Stated standard deviations between an identified and a hidden value: beyond, the statement is
wrong. One honest value of 370 lies farther away by chance."""


class Outcome(NamedTuple):
    """Outcome of one experiment: its result or the failure; seconds: duration [s]."""

    result: Result | None
    failure: str
    seconds: float


class Module(NamedTuple):
    """One module and its outcomes. seed: None = the thesis's module; folder: of the results."""

    seed: int | None
    world: WorldSettings
    loop: LoopSettings
    folder: Path
    outcomes: dict[str, Outcome]

    @property
    def name(self) -> str:
        """Its name in the tables."""
        return "the thesis's" if self.seed is None else f"seed {self.seed}"

    def result(self, experiment: str) -> Result | None:
        """Return the result of an experiment, None when there is none."""
        outcome = self.outcomes.get(experiment)
        return outcome.result if outcome else None


class Criterion(NamedTuple):
    """One criterion of the identification of a simulated module.

    truth: the module's hidden value, None for a mark: a share or a correlation that must reach
    `limit`, or with `most` an error that may reach it; limit: largest difference from the truth, in
    the unit, or as a share of the truth (relative).
    """

    experiment: str
    quantity: str
    truth: Callable[[Module], float] | None
    limit: float
    relative: bool = False
    most: bool = False


def _first_mode(module: Module) -> float:
    """Return the first mode of the plane's structure with a hand of 3 kg at the handle [Hz]."""
    robot = module.world.planar
    held = robot._replace(module_mass=robot.module_mass + Arm().mass)
    return first_modes(Plane(held))[0]


WANTED = (
    Criterion("static_torque", "largest_at_handle", None, 1.5, most=True),
    Criterion("static_torque", "correlation", None, 0.9999),
    Criterion(
        "static_torque", "torque_constant", lambda m: m.world.amplifier.torque_constant, 0.01, True
    ),
    Criterion("static_torque", "dead_zone", lambda m: m.world.amplifier.dead_zone, 0.15, True),
    Criterion("amplifier_response", "pole", lambda m: m.world.amplifier.bandwidth, 0.05, True),
    Criterion("amplifier_response", "delay", lambda m: m.world.amplifier.delay, 0.05, True),
    Criterion("current_response", "delay", lambda m: m.loop.command_delay, 250e-6),
    Criterion("torque_response", "delay", lambda m: m.loop.command_delay, 250e-6),
    Criterion("torque_response", "damping", lambda m: m.world.transducer.damping, 0.10, True),
    Criterion(
        "gravity", "gravity",
        lambda m: m.world.vertical.moving_mass * m.world.vertical.gravity, 0.3,
    ),
    Criterion("gravity", "guide", lambda m: m.world.vertical.rail_friction, 0.05),
    Criterion("gravity", "film", lambda m: m.world.vertical.film_damping, 0.10, True),
    Criterion("gravity", "play", lambda m: m.world.vertical.play, 2e-5),
    Criterion("friction_model", "within", None, 0.9),
    Criterion(
        "inertia", "mass",
        lambda m: m.world.vertical.moving_mass + m.world.vertical.turning_mass, 0.10, True,
    ),
    Criterion("planar_stability", "first_mode", _first_mode, 0.05, True),
)  # fmt: skip
"""Hidden values and marks; no experiment sees them. Gravity 0.3 N, mass 10 %, friction 90 % within
2 N, correlation 0.9999, pole 5 %, delay half a sample; the others are ours."""


class Compared(NamedTuple):
    """A figure of the thesis beside ours."""

    experiment: str
    ours: Quantity
    thesis: Published

    @property
    def group(self) -> str:
        """PREDICTION, INPUT, CHOSEN or CALCULATION."""
        if self.ours.kind != MEASURED:
            return CALCULATION
        if self.thesis.chosen_by:
            return CHOSEN
        return INPUT if self.thesis.given_to_plant else PREDICTION

    @property
    def verdict(self) -> str:
        """AGREES, COMPATIBLE (see `LOOSE`) or DIFFERS."""
        within = abs(self.ours.value - self.thesis.value)
        if not within <= self.thesis.tolerance * (1.0 + 1e-9):
            return DIFFERS
        return COMPATIBLE if self.thesis.tolerance > LOOSE * abs(self.thesis.value) else AGREES


class Checked(NamedTuple):
    """A criterion of a module and our quantity. truth: NaN if the criterion has none."""

    module: Module
    wanted: Criterion
    ours: Quantity
    truth: float

    @property
    def met(self) -> bool:
        """Whether the criterion is met."""
        if self.wanted.most:
            return self.ours.value <= self.wanted.limit
        if self.wanted.truth is None:
            return self.ours.value >= self.wanted.limit
        scale = abs(self.truth) if self.wanted.relative else 1.0
        return abs(self.ours.value - self.truth) <= self.wanted.limit * scale

    @property
    def sigmas(self) -> float:
        """Distance from the truth in stated standard deviations, with its sign.

        NaN for a mark, infinite where no uncertainty is stated.
        """
        if self.wanted.truth is None:
            return math.nan
        stated = self.ours.uncertainty
        off = self.ours.value - self.truth
        return off / stated if stated > 0.0 else math.copysign(math.inf, off)

    @property
    def honest(self) -> bool:
        """Whether the truth is within `FARTHEST` stated standard deviations; so is a mark."""
        return not abs(self.sigmas) > FARTHEST

    @property
    def limit_text(self) -> str:
        """The criterion as text for a table."""
        if self.wanted.most:
            return f"at most {like(self.ours, self.wanted.limit)}"
        if self.wanted.truth is None:
            return f"at least {self.wanted.limit:g}"
        if self.wanted.relative:
            return f"within {100.0 * self.wanted.limit:g} %"
        return f"within {like(self.ours, self.wanted.limit)}"


class Miss(NamedTuple):
    """One miss. serious: nothing explains it."""

    text: str
    serious: bool


COMPARED_HEAD = (
    "experiment", "quantity", "figure", "thesis", "tolerance", "ours", "difference", "verdict",
)  # fmt: skip
CHECKED_HEAD = (
    "module", "experiment", "quantity", "truth", "identified", "off, in sigma", "wanted", "verdict",
)  # fmt: skip
RECOVERED, NOT_RECOVERED, WRONGLY_STATED = "recovered", "MISSED", "BEYOND 3 SIGMA"
CLOSING_HEAD = ("module", "PD", "thesis's model", "identified", "ratio", "with feedback")
GROUPS = {
    PREDICTION: "Predictions beside the thesis",
    INPUT: "Inputs recovered",
    CHOSEN: "Outcomes by which the plant was chosen",
    CALCULATION: "Calculations on printed values",
}
"""Groups of compared figures, with the titles of their tables."""


ELSEWHERE = (
    "Appendices A and D and Table 5.1 are calculated in notebooks of the repository: "
    "appendix_a.ipynb, appendix_d.ipynb and table_5_1.ipynb of docs/thesis."
)
"""What the thesis calculates without a trial, and where that is."""


class Report(NamedTuple):
    """What a run found on its modules, the thesis's first."""

    modules: Sequence[Module]

    @property
    def compared(self) -> list[Compared]:
        """The thesis's figures beside those of its module."""
        results = (outcome.result for outcome in self.modules[0].outcomes.values())
        return [
            Compared(result.experiment, quantity, quantity.thesis)
            for result in results if result
            for quantity in result.quantities if quantity.thesis
        ]  # fmt: skip

    @property
    def checked(self) -> list[Checked]:
        """The criteria of the experiments done on the modules."""
        return [
            Checked(module, wanted, quantity, wanted.truth(module) if wanted.truth else math.nan)
            for module in self.modules
            for wanted in WANTED
            if (result := module.result(wanted.experiment))
            for quantity in result.quantities if quantity.name == wanted.quantity
        ]  # fmt: skip

    @property
    def misses(self) -> list[Miss]:
        """What was wanted and is not there, the serious ones first."""
        return sorted(self._misses(), key=lambda miss: not miss.serious)

    def _misses(self) -> Iterator[Miss]:
        for module in self.modules:
            for name, outcome in module.outcomes.items():
                if outcome.failure:
                    yield Miss(f"{module.name} module, {name}: {outcome.failure}", True)
            result = module.result("compensation")
            if result and result.value("ratio") >= 1.0:
                text = "feed-forward with the identified model is no better than with the default"
                yield Miss(f"{module.name} module: {text}", True)
        for row in self.checked:
            if not row.met:
                truth = "" if math.isnan(row.truth) else f", truth {like(row.ours, row.truth)}"
                yield Miss(f"{row.module.name} module, {row.wanted.experiment}, {row.ours.text}: "
                           f"{value_text(row.ours)}{truth}, wanted {row.limit_text}",
                           True)  # fmt: skip
            elif not row.honest:
                yield Miss(f"{row.module.name} module, {row.wanted.experiment}, {row.ours.text}: "
                           f"{value_text(row.ours)} is stated, {like(row.ours, row.truth)} hidden, "
                           f"{abs(row.sigmas):.1f} sigma apart: the uncertainty lacks a source",
                           True)  # fmt: skip
        order = list(GROUPS)
        for one in sorted(self.compared, key=lambda one: order.index(one.group)):
            if one.verdict == DIFFERS:
                why = one.thesis.why or "no explanation is known"
                yield Miss(f"{one.experiment}, {one.ours.text}: thesis "
                           f"{like(one.ours, one.thesis.value)}, ours {value_text(one.ours)}: "
                           f"{why}", not one.thesis.why)  # fmt: skip

    def counts(self, group: str) -> dict[str, int]:
        """Return how many figures of a group have each verdict."""
        found = [row.verdict for row in self.compared if row.group == group]
        return {verdict: found.count(verdict) for verdict in (AGREES, COMPATIBLE, DIFFERS)}

    @property
    def headline(self) -> str:
        """One sentence that counts predictions alone."""
        counts = self.counts(PREDICTION)
        return (
            f"Predictions: {counts[AGREES]} of {sum(counts.values())} agree with the thesis, "
            f"{counts[COMPATIBLE]} more within a wide tolerance only, {counts[DIFFERS]} "
            f"differ{'s' if counts[DIFFERS] == 1 else ''}"
        )

    def tables(self) -> list[Table | str]:
        """Return the tables for a terminal."""
        found: list[Table | str] = [
            shown(title, COMPARED_HEAD, compared_rows(self.compared, group, brief=True))
            for group, title in GROUPS.items()
        ]
        truth = "Identified and hidden truth"
        found.append(shown(truth, CHECKED_HEAD, checked_rows(self.checked, brief=True)))
        if closing := closing_rows(self.modules):
            found.append(shown("The loop closed", CLOSING_HEAD, closing))
        if changed := robustness_rows(self.modules):
            title = "rms [N]: not calibrated / calibrated / changed since"
            found.append(shown(title, robustness_head(self.modules), changed))
        found.append("\n".join(f"missed: {miss.text}" for miss in self.misses) or "Nothing missed.")
        return [*found, ELSEWHERE, f"{self.headline}."]


def compared_rows(
    rows: Iterable[Compared], group: str, brief: bool = False
) -> list[tuple[str, ...]]:
    """Return the cells of a group's table; brief: names, no texts."""
    cells: list[tuple[str, ...]] = []
    for row in (row for row in rows if row.group == group):
        experiment, ours, thesis = row
        times, _ = scaled(ours.value, ours.unit)
        cells.append((
            experiment, _label(ours, brief), thesis.where, like(ours, thesis.value),
            f"± {number(thesis.tolerance * times)}", value_text(ours),
            f"{(ours.value - thesis.value) * times:+.3g}", row.verdict,
        ))  # fmt: skip
    return cells


def checked_rows(rows: Iterable[Checked], brief: bool = False) -> list[tuple[str, ...]]:
    """Return the cells of the table of hidden values and identified ones."""
    return [
        (
            row.module.name,
            row.wanted.experiment,
            _label(row.ours, brief),
            "" if math.isnan(row.truth) else like(row.ours, row.truth),
            value_text(row.ours),
            "" if math.isnan(row.sigmas) else f"{row.sigmas:+.1f}",
            row.limit_text,
            (RECOVERED if row.honest else WRONGLY_STATED) if row.met else NOT_RECOVERED,
        )
        for row in rows
    ]


def closing_rows(modules: Iterable[Module]) -> list[tuple[str, ...]]:
    """Return the offsets of feed-forward on every module with both models."""
    names = (
        "offset_pd_default",
        "offset_feed_forward_default",
        "offset_feed_forward_identified",
        "ratio",
        "offset_combined_identified",
    )
    return [
        (module.name, *(value_text(result.quantity(name)) for name in names))
        for module in modules
        if (result := module.result("compensation"))
    ]


def robustness_rows(modules: Iterable[Module]) -> list[tuple[str, ...]]:
    """Return the force error on every module without calibration, with it and on changed rigs."""
    rows = []
    for module in modules:
        if result := module.result("robustness"):
            for mode in result.settings["modes"]:
                cells = [
                    " / ".join(f"{rms:.2f}" for rms in force_error.rms_of(result, mode, case))
                    for case in result.settings["cases"]
                ]
                rows.append((module.name, force_error.names_in(result)[mode], *cells))
    return rows


def robustness_head(modules: Iterable[Module]) -> tuple[str, ...]:
    """Return the head of the robustness table, with the measured cases."""
    found = (module.result("robustness") for module in modules)
    cases = next((result.settings["cases"] for result in found if result), ())
    return ("module", "mode", *cases)


def _label(quantity: Quantity, brief: bool) -> str:
    return quantity.name if brief else f"*{quantity.name}*: {quantity.text}"


def shown(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table for the terminal."""
    table = Table(title=title, title_justify="left")
    for name in head:
        table.add_column(name)
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def value_text(quantity: Quantity) -> str:
    """Return value, uncertainty and unit as text."""
    times, unit = scaled(quantity.value, quantity.unit)
    value, spread = quantity.value * times, quantity.uncertainty * times
    if math.isnan(spread) or spread <= 0.0 or not math.isfinite(value):
        return f"{number(value)} {unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(spread)))
    if digits > 6 or abs(value) >= 1e5:
        return f"{number(value)} ± {spread:.2g} {unit}".strip()
    return f"{value:.{digits}f} ± {spread:.{digits}f} {unit}".strip()


def scaled(value: float, unit: str) -> tuple[float, str]:
    """Return the factor and the unit of the most readable form of a value."""
    if unit == "s" and abs(value) < 1e-2:
        return 1e6, "us"
    if unit in ("m", "m/s") and abs(value) < 0.5:
        return 1e3, f"m{unit}"
    return 1.0, unit


def number(value: float) -> str:
    """Return a value with the digits of a table."""
    return f"{value:.6g}" if abs(value) < 10.0 and abs(value - 1.0) < 0.01 else f"{value:.4g}"


def like(quantity: Quantity, value: float) -> str:
    """Return another value of a quantity as text, without uncertainty."""
    return value_text(quantity._replace(value=value, uncertainty=math.nan))
