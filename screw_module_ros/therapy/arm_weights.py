# SPDX-License-Identifier: Apache-2.0
"""Weights of the patients' arms, kept from session to session in one file of its owner alone.

    {"patients": {"P-7K3QX": {"left": {"weight": 18.4, "spread": 1.2, "weighed_s": 1796000000}}}}
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, NamedTuple

from ..files import PRIVATE_FOLDER, replace, state_folder
from ..settings import Setting, SettingError
from ..settings_file import read_file

LASTS_S = 14 * 86_400
"""Age from which an arm is weighed again [s]. The value is ours."""


class WeightsError(OSError):
    """The file cannot be used, and was not touched; the message says why and the way out."""


class ArmWeight(NamedTuple):
    """What was weighed, mean and spread of its places, and when, on the system clock."""

    weight: Annotated[float, Setting("of the arm", "N", 0.0, 60.0)]
    spread: Annotated[float, Setting("largest less smallest of its places", "N", 0.0, 60.0)]
    weighed_s: Annotated[int, Setting("when, on the system clock", "s", 0, 1 << 40)]

    def is_old(self, now_s: float) -> bool:
        """Return whether the arm must be weighed again; now_s: system clock [s]."""
        return not 0.0 <= now_s - self.weighed_s <= LASTS_S


class Arms(NamedTuple):
    """Both arms of a patient, None for one that was not weighed."""

    left: ArmWeight | None = None
    right: ArmWeight | None = None


class _Weights(NamedTuple):
    patients: dict[str, Arms]


def weights_file() -> Path:
    """Return the file in which `therapy_session` has them."""
    return state_folder() / "therapy_session" / "arm_weights.json"


def arms_of(file: Path, patient: str) -> Arms:
    """Return what is known of a patient's arms. Raises WeightsError."""
    return weights_in(file).get(patient, Arms())


def keep(file: Path, patient: str, side: str, weight: ArmWeight) -> None:
    """Keep a weight in place of an earlier one. Raises WeightsError; then the file is as it was."""
    patients = weights_in(file)
    patients[patient] = patients.get(patient, Arms())._replace(**{side: weight})
    _write(file, patients)


def forget(file: Path, patient: str) -> None:
    """Leave out a patient. Raises WeightsError; then the file is as it was."""
    patients = weights_in(file)
    if patients.pop(patient, None) is not None:
        _write(file, patients)


def _write(file: Path, patients: dict[str, Arms]) -> None:
    rows = {
        who: {of: arm._asdict() for of, arm in arms._asdict().items() if arm is not None}
        for who, arms in patients.items()
    }
    try:
        file.parent.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
        replace(file, json.dumps({"patients": rows}, indent=1, sort_keys=True), private=True)
    except OSError as error:
        raise WeightsError(f"{file}: the arms' weights are not kept: {error.strerror}") from None


def weights_in(file: Path) -> dict[str, Arms]:
    """Return the arms of each patient. Raises WeightsError."""
    try:
        return read_file(file, _Weights).patients if file.exists() else {}
    except (OSError, SettingError) as error:
        raise WeightsError(f"{error}; mend that file, or move it away and weigh again") from None
