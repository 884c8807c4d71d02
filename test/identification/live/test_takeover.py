# SPDX-License-Identifier: Apache-2.0
"""Taking the controller's place, and giving it back, without a graph."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from screw_module_msgs.msg import AmplifierState, SafetyState

from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.identification.live import takeover
from screw_module_ros.identification.live.graph import ACTIVE
from screw_module_ros.identification.live.takeover import AMPLIFIER, CONTROLLER, Takeover
from screw_module_ros.identification.trials import NotPossible
from screw_module_ros.safety.checks import WatchSettings

OWN = {"linearize": True, "command_up": 95.0, "command_down": 75.0, "command_rate": 4000.0}


class Robot:
    """A robot with the two nodes, as far as the takeover sees and changes them."""

    def __init__(self):
        self.node = SimpleNamespace(get_namespace=lambda: "/")
        self.values = dict(OWN)
        self.states = {AMPLIFIER: ACTIVE, CONTROLLER: ACTIVE}

    def met(self, condition: Any, seconds: float) -> bool:
        return bool(condition())

    def state(self, kind: type) -> Any:
        if kind is AmplifierState:
            calibration = "own" if self.values["linearize"] else "none"
            return kind(state=AmplifierState.SWITCHED_ON, calibration=calibration)
        return kind(level=SafetyState.OK) if kind is SafetyState else None

    newest = state

    def set_parameters(self, node: str, values: dict[str, Any]) -> None:
        assert self.states[node] != ACTIVE
        self.values |= values


class Loop:
    """The hot loop of `characterize`; taken: it commands the amplifier."""

    def __init__(self):
        self.taken = False

    def take_place(self, watch: Any, period_ns: int) -> Any:
        self.taken = True
        return SimpleNamespace()

    def leave_place(self, *_: Any) -> None:
        self.taken = False


@pytest.fixture
def robot(monkeypatch):
    robot = Robot()
    monkeypatch.setattr(
        takeover, "bring", lambda client, node, wanted: client.states.update({node: wanted})
    )
    monkeypatch.setattr(takeover, "lifecycle_state", lambda client, node: client.states[node])
    monkeypatch.setattr(
        takeover, "parameters", lambda client, node, names: {n: client.values[n] for n in names}
    )
    return robot


def take(robot: Robot, loop: Loop) -> Takeover:
    taken = Takeover(robot, loop)
    taken.take(0.3, WatchSettings(), 1_000_000)
    return taken


def test_what_was_found_is_given_back(robot):
    loop = Loop()
    taken = take(robot, loop)
    assert loop.taken and robot.values != OWN
    assert taken.give_back() == []
    assert not loop.taken
    assert robot.values == OWN
    assert robot.states == {AMPLIFIER: ACTIVE, CONTROLLER: ACTIVE}


def test_limits_that_a_killed_experiment_left_are_not_taken_for_the_robot_s_own(robot):
    """The next experiment "restored" them: 150 N and no limit of the rate, for every sender."""
    take(robot, Loop())  # and killed
    robot.states[CONTROLLER] = ACTIVE  # by the operator
    with pytest.raises(NotPossible, match="amplifier.* killed.*start .* anew"):
        take(robot, Loop())


def test_a_rig_that_pauses_keeps_nothing_from_being_given_back(robot):
    """Amplifier and controller stayed unconfigured, and nobody said so."""

    class Paused(Loop):
        def leave_place(self, *_: Any) -> None:
            raise TimeStandsStill("simulated time stands still: sim_rig has stopped")

    said = take(robot, Paused()).give_back()
    assert "sim_rig has stopped" in " ".join(said)
    assert robot.values == OWN
    assert robot.states == {AMPLIFIER: ACTIVE, CONTROLLER: ACTIVE}
