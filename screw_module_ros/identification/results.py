# SPDX-License-Identifier: Apache-2.0
"""Results of an experiment: values with uncertainties, the thesis's beside them, data of figures.

An experiment is one file with its settings, `run`, `draw` and the entry `EXPERIMENT`.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from matplotlib.figure import Figure

from ..settings import SettingError, plain, read
from ..settings_file import parse
from ..thesis import fact, figure, unit_of
from .uncertainty import PER_INTERVAL, Source, stated

MEASURED, DERIVED = "measured", "derived"
"""Kinds of a quantity: found from the samples of trials; calculated without one."""


class Published(NamedTuple):
    """The thesis's figure beside a quantity, named by its key in `params/thesis.yaml`.

    tolerance: ours, in the quantity's unit, the largest difference that counts as agreement: the
    thesis's own scatter if printed, else the reading accuracy of a plot, or the effect of a
    deliberate difference of the plant; why: explanation of a larger difference; given_to_plant: the
    value stands in the plant's own file, so that finding it shows that the method works, and
    nothing about the thesis's module; chosen_by: what in the plant's file was chosen so that this
    figure comes out, so that finding it shows nothing; part: which number of a figure that is a
    list; unit: the quantity's, if the thesis prints another; computed: a value in that unit that is
    not printed but follows from what is.
    """

    key: str
    tolerance: float
    why: str = ""
    given_to_plant: bool = False
    chosen_by: str = ""
    part: int | None = None
    unit: str = ""
    computed: float | None = None

    @property
    def value(self) -> float:
        """The thesis's value in the quantity's unit. Raises SettingError as `thesis.figure`."""
        if self.computed is not None:
            return self.computed
        return figure(self.key, self.part, self.unit)

    @property
    def where(self) -> str:
        """Where the thesis has it, and whether its value is computed from what stands there."""
        return fact(self.key).where + (", computed" if self.computed is not None else "")


class Quantity(NamedTuple):
    """One value. uncertainty: one standard deviation in the same unit, NaN = not estimated.

    unit: SI symbol, empty for a pure number; text: description for a table; kind: MEASURED or
    DERIVED; thesis: its figure, None = not printed; sources: of the uncertainty (`from_sources`).
    """

    name: str
    value: float
    uncertainty: float
    unit: str
    text: str
    kind: str = MEASURED
    thesis: Published | None = None
    sources: tuple[Source, ...] = ()

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval, NaN without an uncertainty."""
        half = PER_INTERVAL * self.uncertainty
        return self.value - half, self.value + half


def from_sources(
    name: str, value: float, sources: Iterable[Source], unit: str, text: str
) -> Quantity:
    """Return a measured quantity with the uncertainty that its sources have together."""
    known = tuple(sources)
    return Quantity(name, value, stated(known), unit, text, sources=known)


class Result(NamedTuple):
    """Result of one experiment.

    experiment: its name; quantities; settings: their plain values; notes: sentences for the report;
    data: arrays for figures and for later experiments; bench: name of the one it is from, set by
    `Lab.run`.
    """

    experiment: str
    quantities: tuple[Quantity, ...]
    settings: dict[str, Any]
    notes: tuple[str, ...] = ()
    data: dict[str, np.ndarray] = {}
    bench: str = ""

    def value(self, name: str) -> float:
        """Return the value of a quantity by name. Raises KeyError that lists the names."""
        return self.quantity(name).value

    def quantity(self, name: str) -> Quantity:
        """Return a quantity by name. Raises KeyError that lists the names."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        known = ", ".join(quantity.name for quantity in self.quantities)
        raise KeyError(f"{self.experiment} has no {name!r}; there are {known}")

    def as_yaml(self) -> str:
        """Return the result without the data as YAML."""
        content = {
            "experiment": self.experiment,
            "bench": self.bench,
            "quantities": {q.name: _plain(q) for q in self.quantities},
            "notes": list(self.notes),
            "settings": plain(self.settings),
        }
        return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)

    def save(self, folder: Path) -> list[Path]:
        """Write NAME.yaml and NAME.npz into a folder; return the two paths. Raises OSError."""
        text, arrays = (folder / f"{self.experiment}{end}" for end in (".yaml", ".npz"))
        text.write_text(self.as_yaml(), encoding="utf-8")
        np.savez_compressed(arrays, **dict[str, Any](self.data))
        return [text, arrays]


Drawn = dict[str, Figure]
"""Figures by title."""


class Experiment(NamedTuple):
    """One experiment.

    text: one-line description; settings: NamedTuple of its settings; run: (lab, settings) ->
    Result; draw: of its figures; fixture: required mounting of handle or rotor; needs:
    experiments whose results it reads.
    """

    name: str
    text: str
    settings: type
    run: Callable[[Any, Any], Result]
    draw: Callable[[Result], Drawn]
    fixture: str
    needs: tuple[str, ...] = ()


LOCKED_ROTOR, STAGE, HUMAN_ARM, ANALYZER, NOTHING = (
    "locked_rotor", "stage", "human_arm", "analyzer", "nothing",
)  # fmt: skip


def no_figures(result: Result) -> Drawn:
    """Draw nothing."""
    return {}


def _plain(q: Quantity) -> dict[str, Any]:
    found = {
        "value": plain(q.value),
        "uncertainty": None if math.isnan(q.uncertainty) else plain(q.uncertainty),
        "unit": q.unit,
        "text": q.text,
    }
    if q.kind != MEASURED:
        found["kind"] = q.kind
    if q.thesis:
        known = {"value": q.thesis.value, "where": q.thesis.where}  # for the reader of the file
        found["thesis"] = q.thesis._asdict() | known
    if q.sources:
        found["sources"] = plain(q.sources)
    return found


def _quantity(name: str, content: dict[str, Any]) -> Quantity:
    thesis = content.get("thesis")
    if thesis:
        thesis = {name: thesis[name] for name in Published._fields if name in thesis}
    return Quantity(
        name,
        float(content["value"]),
        math.nan if content["uncertainty"] is None else float(content["uncertainty"]),
        content["unit"],
        content["text"],
        content.get("kind", MEASURED),
        read(Published, thesis, "thesis") if thesis else None,
        tuple(Source(**source) for source in content.get("sources", ())),
    )


def load_result(folder: Path, experiment: str) -> Result:
    """Read a result from the files of `Result.save`. Raises OSError, ValueError if damaged."""
    text, file = (folder / f"{experiment}{end}" for end in (".yaml", ".npz"))
    content = parse(text.read_bytes().decode(), str(text))
    try:
        found = content["quantities"].items()
        quantities = tuple(_quantity(name, quantity) for name, quantity in found)
        notes, settings = tuple(content["notes"]), content["settings"]
        bench = content.get("bench", "")
    except (KeyError, TypeError, AttributeError, SettingError) as error:
        raise ValueError(f"{text}: not the result of an experiment: {error}") from error
    try:
        with np.load(file) as arrays:
            data = dict(arrays)
    except (EOFError, zipfile.BadZipFile) as error:  # cut off by a full disk or a kill
        raise ValueError(f"{file}: damaged: {error}") from error
    return Result(experiment, quantities, settings, notes, data, bench)


def beside(
    thesis: Mapping[str, Published], quantities: Iterable[Quantity], kind: str = MEASURED
) -> tuple[Quantity, ...]:
    """Return the quantities with the thesis's figures beside them; kind: of all of them.

    Raises SettingError if the figure's unit is not the quantity's.
    """
    found = tuple(q._replace(thesis=thesis.get(q.name), kind=kind) for q in quantities)
    for q in found:
        if q.thesis and q.thesis.computed is None:
            unit = q.thesis.unit or fact(q.thesis.key).unit
            if unit_of(unit) != unit_of(q.unit):
                raise SettingError(f"{q.name} is in {q.unit or '1'}, {q.thesis.key} in {unit}")
    return found
