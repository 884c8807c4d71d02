# SPDX-License-Identifier: Apache-2.0
"""Motion trials on the live graph, with the running law; its settings are restored afterwards."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import numpy as np
from screw_module_msgs.msg import ImpedanceState

from screw_module_ros.calibration.module import (
    load_friction_model,
    load_linearization,
    load_module_calibration,
    thesis_friction,
)
from screw_module_ros.control.friction import FrictionModel
from screw_module_ros.control.limits import CommandLimits, TorqueLimits
from screw_module_ros.control.linearization import (
    IDENTITY,
    Linearization,
    default_linearization,
)
from screw_module_ros.control.modes import COMBINED, FRICTION_COMPENSATION, MODE_NAMES, OFF
from screw_module_ros.control.torque_chain import COLD, TorqueChain, commanded, on_the_wire
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import Screw
from screw_module_ros.identification.trials import MotionTrial, NotPossible, OnProgress, Samples
from screw_module_ros.operator.client import RobotError
from screw_module_ros.operator.robot import Robot
from screw_module_ros.settings import fields

from .experiment import Experiment, share_of
from .graph import ACTIVE, UNCONFIGURED, bring, parameters
from .samples import Track, evenly, samples_of
from .takeover import AMPLIFIER, CONTROLLER, check_disabled, check_not_stopped

_LIVE = {name for name, field in fields(VerticalSettings).items() if field.setting.live}
_SAG = 0.05  # largest sag of the handle in a hand [m]
_CALM = 1e-3  # [m/s]
_CALM_S, _SETTLE_S, _REST_LIMIT_S = 0.5, 1.5, 5.0
_SPARE_S = 5.0


class Motion:
    """The controller's settings, from the first motion trial until `put_back`."""

    def __init__(self, experiment: Experiment):
        self._experiment = experiment
        self._found: dict[str, Any] = {}

    def trial(self, trial: MotionTrial, on_progress: OnProgress) -> Samples:
        """Do a trial. Raises NotPossible, RobotError, SamplesLost, Cancelled.

        The caller switches the torque off.
        """
        experiment = self._experiment
        fixture, robot = experiment.fixture, experiment.robot
        fixture.require("human_arm")
        check_possible(trial, fixture.simulated)
        experiment.check_homed()
        check_disabled(robot)
        linearization = self._fitting_linearization(trial)
        self._check_friction(trial)
        experiment.say("zero of the transducer, handle unloaded")
        fixture.unload()
        robot.tare()  # as in process: the laws feel an old zero as a force
        before = experiment.zero()
        experiment.say(f"the hand goes to {1e3 * trial.centre:.0f} mm")
        fixture.hand_at(trial.arm, trial.centre)
        experiment.check_height(trial.centre, _SAG)
        self._prepare(trial)
        if trial.mode != OFF:
            experiment.say("torque on")
            check_not_stopped(robot)
            experiment.enable()
        self._come_to_rest(trial)
        track = self._moved(trial, on_progress)
        state = robot.newest(ImpedanceState)
        experiment.torque_off()
        robot.set_mode(OFF)
        experiment.say("zero of the transducer again")
        after = experiment.unloaded_zero()
        fixture.reload()
        track = track._replace(command=self._commands(track.command, linearization, trial.mode))
        samples = samples_of(track, experiment.rate, before, after)
        return samples._replace(share=np.full(len(samples.time), state.gain_share))

    def _moved(self, trial: MotionTrial, on_progress: OnProgress) -> Track:
        experiment, on_elapsed = self._experiment, share_of(on_progress, trial.duration)

        held = True

        def watch(elapsed: float) -> None:
            nonlocal held
            experiment.check_homed()
            if trial.mode != OFF:
                experiment.check_enabled()
            if held and elapsed >= trial.released_after:
                held = False
                experiment.say("the hand lets go")
                experiment.fixture.hand_lets_go()
            on_elapsed(elapsed)

        experiment.say(f"the hand moves, {MODE_NAMES[trial.mode]}")
        try:
            experiment.fixture.hand_moves(trial)
            recording = experiment.recording(trial.duration)
            deadline = 1.5 * trial.duration + _SPARE_S
            experiment.wait(recording, lambda: recording.full, deadline, watch)
        except Exception:  # the torque may be why somebody cancels: off before the hand rests
            with experiment.unhurried(), contextlib.suppress(RobotError):  # tried again later
                experiment.torque_off()
            raise
        finally:
            experiment.loop.record(None)
            with experiment.unhurried():
                experiment.fixture.hand_rests(trial.centre)
        return evenly(recording, experiment.rate)

    def _come_to_rest(self, trial: MotionTrial) -> None:
        """Wait until the spring has faded in and the handle is at rest, at most 5 s."""
        experiment = self._experiment
        experiment.say("waiting until the handle is at rest")
        experiment.robot.set_setpoint(z=trial.centre)
        experiment.robot.pause(_SETTLE_S)
        calm = 0.0

        def at_rest() -> bool:
            nonlocal calm
            experiment.robot.pause(0.1)
            calm = calm + 0.1 if abs(experiment.loop.sample.velocity) < _CALM else 0.0
            return calm >= _CALM_S

        experiment.robot.met(at_rest, _REST_LIMIT_S)  # a chattering handle never is

    # The controller ------------------------------------------------------------------------

    def _prepare(self, trial: MotionTrial) -> None:
        robot = self._experiment.robot
        if not self._found:
            self._found = parameters(robot, CONTROLLER, (*VerticalSettings._fields, "mode"))
        self._apply({**trial.settings._asdict(), "mode": trial.mode})

    def _apply(self, wanted: dict[str, Any]) -> None:
        """Set the parameters that differ; for those fixed in operation, clean the controller up.

        It comes back in mode OFF, which every law permits: settings and mode may fit each other
        only when all are set, and then they are set together.
        """
        robot = self._experiment.robot
        now = parameters(robot, CONTROLLER, wanted)
        fixed = {n: v for n, v in wanted.items() if n not in {*_LIVE, "mode"} and v != now[n]}
        if fixed:
            bring(robot, CONTROLLER, UNCONFIGURED)
            robot.set_parameters(CONTROLLER, {**fixed, "mode": OFF})
            bring(robot, CONTROLLER, ACTIVE)
            now = parameters(robot, CONTROLLER, wanted)  # a calibration may have set its gravity
        changed = {name: value for name, value in wanted.items() if value != now[name]}
        robot.set_parameters(CONTROLLER, changed)

    def put_back(self) -> list[str]:
        """Restore the controller's settings; return sentences about what could not be restored."""
        if not self._found:
            return []
        try:
            bring(self._experiment.robot, CONTROLLER, ACTIVE)
            self._apply(self._found)
            now = parameters(self._experiment.robot, CONTROLLER, self._found)
            wrong = [name for name, value in self._found.items() if now[name] != value]
            self._found = {}
        except RobotError as error:
            return [f"controller's settings not restored: {error}"]
        return [f"controller's settings not restored: {', '.join(wrong)}"] if wrong else []

    # Calibrations: only the graph's own; a trial with another one is refused ----------------

    def _fitting_linearization(self, trial: MotionTrial) -> Linearization | None:
        robot = self._experiment.robot
        used, name = linearization_of(robot)
        if trial.linearization not in (None, used):
            raise NotPossible(
                f"the trial wants another linearization than the amplifier runs with ({name}): "
                "start the amplifier with it (linearization_file or calibration_file)"
            )
        if trial.linearization is None:
            self._note(f"The amplifier's linearization: {name}.")
        return used

    def _check_friction(self, trial: MotionTrial) -> None:
        if trial.mode not in (FRICTION_COMPENSATION, COMBINED):
            return
        used, name = friction_of(self._experiment.robot)
        if trial.friction not in (None, used):
            raise NotPossible(
                f"the trial wants another friction model than the controller runs with ({name}): "
                "start the controller with it (friction_file or calibration_file)"
            )
        if trial.friction is None:
            self._note(f"The controller's friction model: {name}.")

    def _note(self, text: str) -> None:
        if text not in self._experiment.notes:
            self._experiment.notes.append(text)

    def _commands(
        self, force: np.ndarray, linearization: Linearization | None, mode: int
    ) -> np.ndarray:
        """Convert force commands [N] to torque commands of the drive [Nm]."""
        if mode == OFF:
            return np.zeros(len(force))
        names = CommandLimits._fields + Screw._fields + ("rated_torque",)
        limits = [f"torque.{name}" for name in TorqueLimits._fields]
        values = parameters(self._experiment.robot, AMPLIFIER, [*names, *limits])
        chain = TorqueChain(
            CommandLimits(*(values[name] for name in CommandLimits._fields)),
            TorqueLimits(*(values[name] for name in limits)),
            Screw(values["lead"]),
            linearization or IDENTITY,
            values["rated_torque"],
        )
        heat, commands = COLD, np.empty(len(force))
        for row, newtons in enumerate(force):
            made, heat = commanded(chain, heat, float(newtons), 1.0, 1.0 / self._experiment.rate)
            commands[row] = on_the_wire(chain, made.command)
        return commands


def check_possible(trial: MotionTrial, simulated: bool) -> None:
    """Raise NotPossible with the way out for a trial that a live module cannot do.

    simulated: the rig's hand can hold off the centre and let go; a person cannot do so in a second.
    """
    if trial.side_force or trial.tremor or trial.changed:
        raise NotPossible(
            "a hand that presses sideways or trembles and a rig that changed are only there in "
            "process: run this experiment with `make reproduce`, or choose other cases and states, "
            "with side_force: 0.0"
        )
    if trial.preloaded:
        raise NotPossible(
            "a nut without backlash is only there in process: leave it out with the goal's "
            "settings '{preloaded: false}', or run this experiment with `make reproduce`"
        )
    if not simulated and (trial.way or math.isfinite(trial.released_after)):
        raise NotPossible(
            "a hand that holds off the centre or lets go needs the simulated rig: choose cases in "
            "which the hand moves"
        )


def linearization_of(robot: Robot) -> tuple[Linearization | None, str]:
    """Return the linearization the amplifier runs with, None for none, and its name."""
    names = ("linearize", "linearization_file", "calibration_file", "module_serial")
    values = parameters(robot, AMPLIFIER, names)
    if not values["linearize"]:
        return None, "none"
    if file := values.get("calibration_file"):
        return load_module_calibration(file, values["module_serial"]).linearization, file
    if file := values["linearization_file"]:
        return load_linearization(file), file
    return default_linearization(), "of the thesis"


def friction_of(robot: Robot) -> tuple[FrictionModel, str]:
    """Return the friction model the controller runs with, and its name."""
    names = ("friction_file", "calibration_file", "module_serial")
    values = parameters(robot, CONTROLLER, names)
    if file := values.get("calibration_file"):
        return load_module_calibration(file, values["module_serial"]).friction, file
    if file := values["friction_file"]:
        return load_friction_model(file), file
    return thesis_friction(), "of the thesis"
