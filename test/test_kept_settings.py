# SPDX-License-Identifier: Apache-2.0
"""Every setting of the robot: its default, unit and bounds are what launch files and hazards name.

A change here is one that a user's parameter file may meet: it is looked at, and `--write` keeps it.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

import pytest

import screw_module_ros
from screw_module_ros.settings import fields


def records() -> Iterator[type]:
    """Yield the classes that declare settings, each once, but those of experiments."""
    for module in pkgutil.walk_packages(screw_module_ros.__path__, "screw_module_ros."):
        if module.name.startswith("screw_module_ros.identification"):
            continue
        for each in vars(importlib.import_module(module.name)).values():
            own = isinstance(each, type) and each.__module__ == module.name
            if own and hasattr(each, "_field_defaults") and any(
                field.setting.text for field in fields(each).values()
            ):  # fmt: skip
                yield each


RECORDS = {f"{each.__module__.partition('.')[2]}.{each.__name__}": each for each in records()}


@pytest.mark.parametrize("name", sorted(RECORDS))
def test_its_settings_are_the_kept_ones(name, kept):
    record = RECORDS[name]
    kept({
        field.name: " ".join(
            (
                repr(record._field_defaults.get(field.name)),
                field.setting.unit or "-",
                f"from {field.setting.low:g} to {field.setting.high:g}",
                *map(repr, field.setting.choices),
                *(["live"] if field.setting.live else []),
                *(["at start"] if field.setting.at_start else []),
                *([f"formerly {field.setting.formerly}"] if field.setting.formerly else []),
            )
        )
        for field in fields(record).values()
    })  # fmt: skip
