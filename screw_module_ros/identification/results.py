# SPDX-License-Identifier: Apache-2.0
"""Results of an experiment: values with units and uncertainties, and the data of the figures."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from ..settings import parse, plain


class Quantity(NamedTuple):
    """One value. uncertainty: one standard deviation in the same unit, NaN = not estimated.

    unit: SI symbol, empty for a pure number; text: description for a table.
    """

    name: str
    value: float
    uncertainty: float
    unit: str
    text: str


class Result(NamedTuple):
    """Result of one experiment.

    experiment: its name in the catalogue; quantities; settings: their plain values; notes:
    sentences for the report; data: arrays for figures and for later experiments.
    """

    experiment: str
    quantities: tuple[Quantity, ...]
    settings: dict[str, Any]
    notes: tuple[str, ...] = ()
    data: dict[str, np.ndarray] = {}

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
        return yaml.safe_dump(
            {
                "experiment": self.experiment,
                "quantities": {
                    q.name: {
                        "value": plain(q.value),
                        "uncertainty": None if math.isnan(q.uncertainty) else plain(q.uncertainty),
                        "unit": q.unit,
                        "text": q.text,
                    }
                    for q in self.quantities
                },
                "notes": list(self.notes),
                "settings": plain(self.settings),
            },
            sort_keys=False,
            allow_unicode=True,
        )

    def save(self, folder: Path) -> list[Path]:
        """Write NAME.yaml and NAME.npz into a folder; return the two paths. Raises OSError."""
        text, arrays = (folder / f"{self.experiment}{end}" for end in (".yaml", ".npz"))
        text.write_text(self.as_yaml(), encoding="utf-8")
        np.savez_compressed(arrays, **self.data)
        return [text, arrays]


def load_result(folder: Path, experiment: str) -> Result:
    """Read a result from the files of `Result.save`. Raises OSError, ValueError if damaged."""
    text = folder / f"{experiment}.yaml"
    content = parse(text.read_bytes().decode(), str(text))
    try:
        quantities = tuple(
            Quantity(
                name,
                float(q["value"]),
                math.nan if q["uncertainty"] is None else float(q["uncertainty"]),
                q["unit"],
                q["text"],
            )
            for name, q in content["quantities"].items()
        )
        notes, settings = tuple(content["notes"]), content["settings"]
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{text}: not the result of an experiment: {error}") from error
    file = folder / f"{experiment}.npz"
    try:
        with np.load(file) as arrays:
            data = dict(arrays)
    except (EOFError, zipfile.BadZipFile) as error:  # cut off by a full disk or a kill
        raise ValueError(f"{file}: damaged: {error}") from error
    return Result(experiment, quantities, settings, notes, data)
