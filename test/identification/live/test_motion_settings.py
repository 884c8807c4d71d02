# SPDX-License-Identifier: Apache-2.0
"""The controller's settings and its torque in a motion trial, without a graph."""

from __future__ import annotations

import contextlib
from types import SimpleNamespace
from typing import Any

import pytest

from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.live import motion
from screw_module_ros.identification.live.graph import ACTIVE, UNCONFIGURED
from screw_module_ros.identification.trials import Cancelled, MotionTrial
from screw_module_ros.operator.client import RobotError

CERTIFIED_CUTOFF = 50.0  # [Hz]


class Controller:
    """An impedance_controller with a certificate: refuses as the node does.

    As in the node, the certificate is known only while it is configured.
    """

    def __init__(self, **values: Any):
        self.values = {**VerticalSettings()._asdict(), "mode": modes.OFF, **values}
        self.state = ACTIVE

    def _refusal(self, values: dict[str, Any], certified: bool) -> str:
        mode = values["mode"]
        law = VerticalSettings(*(values[name] for name in VerticalSettings._fields))
        if certified and modes.uses_feedback(mode) and law.force_cutoff > CERTIFIED_CUTOFF:
            return f"the certificate is for {CERTIFIED_CUTOFF:g} Hz at most"
        return law.refusal(mode)

    def bring(self, robot: Any, node: str, wanted: int) -> None:
        if wanted == ACTIVE and (refused := self._refusal(self.values, certified=True)):
            raise RobotError(f"{node} stays unconfigured, active was wanted: {refused}")
        self.state = wanted

    def parameters(self, robot: Any, node: str, names: Any) -> dict[str, Any]:
        return {name: self.values[name] for name in names}

    def set_parameters(self, node: str, values: dict[str, Any]) -> None:
        if self.state != UNCONFIGURED and not values.keys() <= {*motion._LIVE, "mode"}:
            raise RobotError("fixed while the node is configured")
        wanted = {**self.values, **values}
        if refused := self._refusal(wanted, certified=self.state == ACTIVE):
            raise RobotError(f"{node} refused: {refused}")
        self.values = wanted


@pytest.fixture
def beside(monkeypatch):
    """Return a maker: motion trials beside a controller."""

    def make(controller: Controller) -> motion.Motion:
        monkeypatch.setattr(motion, "bring", controller.bring)
        monkeypatch.setattr(motion, "parameters", controller.parameters)
        return motion.Motion(SimpleNamespace(robot=controller))

    return make


def test_settings_that_the_certificate_refuses_are_put_back(beside):
    """The controller stayed unconfigured, with the trial's cut-off and without chatter guard."""
    controller = Controller(mode=modes.FORCE_FEEDBACK)
    found, trials = dict(controller.values), beside(controller)
    law = VerticalSettings(force_cutoff=100.0, chatter_limit=50.0)
    with pytest.raises(RobotError, match="certificate"):
        trials._prepare(MotionTrial(modes.FORCE_FEEDBACK, law))
    assert trials.put_back() == []
    assert (controller.values, controller.state) == (found, ACTIVE)


def test_an_observer_s_trial_with_less_damping_than_the_robot_s_own_is_put_back(beside):
    """Fixed settings came back first, and the trial's mode and damping did not fit them."""
    controller = Controller()
    found, trials = dict(controller.values), beside(controller)
    trials._prepare(MotionTrial(modes.OBSERVER, VerticalSettings(observer_damping_ratio=0.0)))
    assert controller.values["mode"] == modes.OBSERVER
    assert trials.put_back() == []
    assert (controller.values, controller.state) == (found, ACTIVE)


def test_a_robot_in_observer_does_a_trial_of_another_mode(beside):
    controller = Controller(mode=modes.OBSERVER, damping=1.0, observer_damping_ratio=0.0)
    found, trials = dict(controller.values), beside(controller)
    wanted = MotionTrial(modes.FORCE_FEEDBACK, VerticalSettings(chatter_limit=50.0, damping=0.5))
    trials._prepare(wanted)
    assert controller.values == {**wanted.settings._asdict(), "mode": modes.FORCE_FEEDBACK}
    assert trials.put_back() == []
    assert (controller.values, controller.state) == (found, ACTIVE)


@pytest.mark.parametrize("where", ["wait", "check_homed"])
@pytest.mark.parametrize("error", [Cancelled("cancelled"), RobotError("the encoder is silent")])
def test_the_torque_goes_off_before_the_hand_comes_to_rest(error, where):
    """It stayed on for more than a second after a cancellation, until the hand was at rest."""
    done = []

    def failing(*_: Any) -> None:
        raise error

    experiment = SimpleNamespace(
        fixture=SimpleNamespace(
            hand_moves=lambda trial: None, hand_rests=lambda centre: done.append("hand at rest")
        ),
        loop=SimpleNamespace(record=lambda recording: None),
        say=lambda text: None,
        recording=lambda seconds: SimpleNamespace(full=False),
        wait=lambda recording, full, deadline_s, watch: watch(0.1),
        unhurried=contextlib.nullcontext,
        torque_off=lambda: done.append("torque off"),
    )
    setattr(experiment, where, failing)
    trial = MotionTrial(modes.FORCE_FEEDBACK, VerticalSettings())
    with pytest.raises(type(error)):
        motion.Motion(experiment)._moved(trial, lambda share: None)
    assert done == ["torque off", "hand at rest"]
