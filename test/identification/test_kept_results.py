# SPDX-License-Identifier: Apache-2.0
"""What each fit finds and draws, on benches by formulas: nothing may change.

Kept are values, uncertainties, and of each line of a figure its label and its mean size, all within
a thousandth. A change on purpose is renewed with
`make test ARGS="test/identification/test_kept_results.py --write"`; the commit says what changed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from formula_stand import FormulaBench, keep_line

from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import Result

SPEEDS = (0.005, 0.010, 0.020, 0.030, 0.050, 0.100, 0.150)
SETTINGS = {
    "static_torque": {}, "amplifier_response": {"low": 500.0, "per_decade": 4},
    "current_response": {"count": 6}, "torque_response": {"count": 6}, "friction_spectrum": {},
    "friction_map": {"speeds": SPEEDS, "inverted_speeds": SPEEDS[::3]}, "gravity": {},
    "friction_model": {}, "repeatability": {}, "inertia": {"duration": 4.0},
}  # fmt: skip
SAMPLED = ("current_response", "torque_response")
SIMULATED = ("static_torque", "amplifier_response")
# Of torques rounded to the drive's steps: the last bit of a sine, which is the processor's, decides
# about the largest and about what lacks to 1. `test_static_torque` holds their bounds.
OF_THE_LAST_BIT = ("largest_left", "largest_at_handle", "correlation, uncertainty", "lack")


def measured(name: str, folder: Path, stand: object) -> Result:
    """Run an experiment after those that it needs, as far as the folder lacks their results."""
    experiment = EXPERIMENTS[name]
    if name not in SIMULATED:
        stand = FormulaBench()
    if name in SAMPLED:
        keep_line(folder)
    else:
        for need in experiment.needs:
            if not (folder / f"{need}.yaml").exists():
                measured(need, folder, stand)
    settings = experiment.settings()._replace(**SETTINGS[name])
    result = experiment.run(Lab(stand, folder), settings)
    result.save(folder)
    return result


def digest(result: Result) -> dict[str, float]:
    found = {}
    for q in result.quantities:
        found[f"{q.name} [{q.unit}], {q.text}"] = float(q.value)
        found[f"{q.name}, uncertainty"] = float(q.uncertainty)
    for number, figure in EXPERIMENTS[result.experiment].draw(result).items():
        for part, axes in enumerate(figure.axes):
            words = axes.get_title("left"), axes.get_xlabel(), axes.get_ylabel()
            where = f"{number}.{part}: {', '.join(words)}"
            found[where] = float(np.abs([axes.get_xlim(), axes.get_ylim()]).sum())
            for line in axes.lines:
                data = np.abs(np.asarray(line.get_data(), float))
                found[f"{where}; {line.get_label()}"] = np.nansum(data) / max(data.shape[1], 1)
            shapes = [patch.get_patch_transform().get_matrix() for patch in axes.patches]
            found[f"{where}; patches"] = float(np.abs(shapes).sum())
    return found


@pytest.mark.parametrize("name", SETTINGS)
def test_it_finds_and_draws_what_it_did(name, tmp_path, stand, kept):
    found = digest(measured(name, tmp_path, stand))
    kept({key: v for key, v in found.items() if not key.startswith(OF_THE_LAST_BIT)}, rel=1e-3)
