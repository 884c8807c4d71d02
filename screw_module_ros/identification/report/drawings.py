# SPDX-License-Identifier: Apache-2.0
"""Which figures belong to which experiment."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from screw_module_ros.figure_style import save

from ..figures import (
    analysis,
    certificate,
    friction_maps,
    friction_model,
    friction_spectrum,
    inertia,
    planar,
    stability,
    torque,
)
from ..figures import curves as chapter_6
from ..results import Result

Drawn = dict[str, Figure]

_DRAWINGS: dict[str, Callable[[Result], Drawn]] = {
    "static_torque": torque.static_torque_figures,
    "amplifier_response": torque.amplifier_figures,
    "current_response": torque.current_figures,
    "torque_response": torque.torque_figures,
    "force_position": chapter_6.force_position_figures,
    "force_gain": lambda result: {"force_gain": chapter_6.force_gain_figure(result)},
    "force_error": stability.force_error_figures,
    "planar_error": planar.planar_error_figures,
    "stability": stability.stability_figures,
    "delivered_impedance": certificate.certificate_figures,
    "friction_spectrum": friction_spectrum.spectrum_figures,
    "friction_map": friction_maps.friction_map_figures,
    "gravity": friction_model.gravity_figures,
    "friction_model": friction_model.friction_model_figures,
    "repeatability": friction_spectrum.repeatability_figures,
    "inertia": inertia.inertia_figures,
    "compliant_mounting": analysis.mounting_figures,
    "back_drive": analysis.back_drive_figures,
    "compensation": lambda result: {"compensation": chapter_6.compensation_figure(result)},
}


def draw(experiment: str, result: Result, folder: Path, prefix: str = "") -> dict[str, str]:
    """Draw an experiment's figures into a folder; return title -> file, beside the page.

    prefix: of the files' names. Raises OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = _DRAWINGS.get(experiment, lambda result: {})(result)
    files = {}
    for name, figure in drawn.items():
        file = folder / f"{prefix}{experiment}-{name.replace(' ', '_')}.png"
        save(figure, file)
        title = figure.axes[0].get_title("left") if figure.axes else name
        files[title or f"{experiment}, {name}"] = f"{folder.name}/{file.name}"
    return files
