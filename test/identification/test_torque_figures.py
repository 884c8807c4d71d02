# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 4 are drawn from a kept result alone."""

from __future__ import annotations

import pytest
from sampled_bench import SampledBench, keep_linearization

from screw_module_ros.figure_style import save
from screw_module_ros.identification import current_response, torque_response
from screw_module_ros.identification.figures import torque
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import load_result


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    keep_linearization(folder)
    lab = Lab(SampledBench(), folder)
    current_response.run(lab, current_response.Settings(count=6)).save(folder)
    torque_response.run(lab, torque_response.Settings(count=6)).save(folder)
    return folder


def titles(figures):
    return {name: figure.axes[0].get_title("left") for name, figure in figures.items()}


def test_current_figures(folder):
    figures = torque.current_figures(load_result(folder, "current_response"))
    assert all(title.startswith(f"Fig. {name}: ") for name, title in titles(figures).items())
    assert list(figures) == ["4-7", "4-8"]
    labels = [text.get_text() for text in figures["4-8"].axes[1].get_legend().get_texts()]
    assert labels[1] == "model, software delay 280 us"


def test_torque_figures(folder):
    figures = torque.torque_figures(load_result(folder, "torque_response"))
    assert list(figures) == [
        "4-9", "4-10", "4-11", "4-12", "4-13", "4-14", "resonance", "delay",
    ]  # fmt: skip
    for name, figure in figures.items():
        assert all(axes.get_ylabel() for axes in figure.axes), name
        assert figure.axes[-1].get_xlabel(), name


def test_it_is_written(folder, tmp_path):
    figures = torque.current_figures(load_result(folder, "current_response"))
    assert save(figures["4-7"], tmp_path / "4-7.png").stat().st_size > 10_000
