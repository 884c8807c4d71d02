# SPDX-License-Identifier: Apache-2.0
"""A flaccid arm on the whole simulated robot: weighed, carried in trials and a pause, lowered."""

from __future__ import annotations

import pytest
from screw_module_msgs.msg import ImpedanceState, TherapyState
from screw_module_msgs.srv import StartTherapy
from therapy_run import therapy_run

from screw_module_ros.operator.robot import arm
from screw_module_ros.plant.settings import patients
from screw_module_ros.trials.patient import Hand

pytestmark = [pytest.mark.graph, pytest.mark.long]

FASTEST = "sim_rig:speed:=0.0"
BRAKES = "amplifier:stop_reaction:=brake"
WEIGH, LEFT = "therapy_session/weigh", {"patient": "P-7K3QX", "side": "left"}
ARM = patients()["flaccid"]


def test_a_flaccid_arm_is_weighed_carried_and_lowered(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with therapy_run(tmp_path, "-p", FASTEST, "-p", BRAKES) as (robot, patient):
        hand = Hand(robot, arm(patient="flaccid"))
        hand.take_hold()

        def told(text: str, seconds: float = 60.0) -> TherapyState:
            patient.until(lambda: text in patient.states[-1].arm, seconds, f"not told: {text}")
            return patient.states[-1]

        def weigh() -> None:
            robot.ask(StartTherapy, WEIGH, StartTherapy.Request(**LEFT))

        weigh()
        assert "take everything off the handle" in told("empty cradle shows").arm
        hand.let_go()
        robot.pause(1.0)
        weigh()
        told("strap the arm in")
        hand.take_hold()
        robot.pause(1.0)
        weigh()
        told("brought back")
        patient.until(lambda: "brought" not in patient.states[-1].arm, 20.0, "it is not over")
        weighed = patient.states[-1]
        assert weighed.arm_weight == pytest.approx(ARM.weight, abs=1.0), weighed.arm

        robot.ask(StartTherapy, "therapy_session/start", StartTherapy.Request(
            protocol="elevator", **LEFT))  # fmt: skip
        patient.until(lambda: patient.results, 60.0, "no trial comes to its end")
        assert patient.results[-1].side == "left"
        assert patient.results[-1].support == pytest.approx(weighed.arm_weight, abs=0.5)
        robot.trigger("therapy_session/pause")
        patient.until_state(TherapyState.PAUSED)
        robot.pause(2.0)
        assert robot.state(ImpedanceState).support == pytest.approx(weighed.arm_weight, abs=0.1)
        height = robot.state(ImpedanceState).position
        assert height > 0.1, "it has not fallen"

        robot.trigger("therapy_session/lower")
        robot.wait_until(
            lambda: robot.state(ImpedanceState).support == 0.0, 20.0, "it stays carried"
        )
        assert robot.state(ImpedanceState).position < 0.08
