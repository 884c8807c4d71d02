# SPDX-License-Identifier: Apache-2.0
"""What an experiment could not restore is told, however the experiment ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from screw_module_msgs.action import RunExperiment

from screw_module_ros.identification.live import characterize
from screw_module_ros.identification.live.characterize import CharacterizeNode

LEFT = "amplifier not disabled: amplifier did not switch off"


class Node:
    """The parts of the node around an experiment that `measured` replaces."""

    _work = CharacterizeNode._work

    def __init__(self, measured: Any):
        self._measured = measured
        self.clock = SimpleNamespace(leave=lambda: None)
        self.parameters = SimpleNamespace(read=lambda kind: SimpleNamespace(folder="~"))
        self.get_logger = lambda: SimpleNamespace(
            info=lambda text: None, warning=lambda text: None, error=lambda text: None
        )


@pytest.fixture
def message(monkeypatch, tmp_path):
    """Return a function that returns the message of the experiment that `measured` stands for."""
    monkeypatch.setattr(characterize, "_checked", lambda *asked: (None, None, tmp_path))

    def run(measured: Any) -> str:
        request = RunExperiment.Goal(experiment="gravity", folder="x")
        goal = SimpleNamespace(request=request, is_cancel_requested=False)
        outcome = Node(measured)._work(goal)
        assert not outcome.succeeded
        return outcome.result.message

    return run


def _cannot_be_saved(error: Exception) -> Any:
    def save(folder: Any) -> list:
        raise error

    def measured(goal: Any, experiment: Any, settings: Any, folder: Any, left: list[str]) -> Any:
        left.append(LEFT)
        return SimpleNamespace(save=save)

    return measured


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), TypeError("odd")])
def test_after_a_result_that_cannot_be_saved(message, error):
    said = message(_cannot_be_saved(error))
    assert LEFT in said
    assert str(error) in said


def test_after_an_experiment_that_failed_in_its_computation(message):
    def measured(goal: Any, experiment: Any, settings: Any, folder: Any, left: list[str]) -> Any:
        left.append(LEFT)
        raise ZeroDivisionError("division by zero")

    assert message(measured) == f"gravity: ZeroDivisionError: division by zero; {LEFT}"
