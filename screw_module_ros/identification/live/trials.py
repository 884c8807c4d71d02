# SPDX-License-Identifier: Apache-2.0
"""Stage and torque trials on the live graph."""

from __future__ import annotations

import numpy as np
from screw_module_msgs.msg import AmplifierState

from screw_module_ros.geometry import force_to_torque
from screw_module_ros.identification.trials import (
    NotPossible,
    OnProgress,
    Samples,
    StageTrial,
    TorqueTrial,
    duration_of,
)
from screw_module_ros.operator.client import RobotError

from .experiment import Experiment, check_screw, share_of
from .graph import parameters
from .samples import Track, evenly, samples_of
from .takeover import AMPLIFIER, Takeover
from .torque_source import Sine

LARGEST_TORQUE = 0.42  # continuous torque of the motor (thesis 3.1.6) [Nm]
_TAIL_S = 0.05  # after the end of a stage run
_SPARE_S = 5.0
_LEAD_S = 0.1
_MOVED = 3e-6  # of the nut [m]


def stage_trial(experiment: Experiment, trial: StageTrial, on_progress: OnProgress) -> Samples:
    """Let the stage drive the handle. Raises NotPossible, RobotError, SamplesLost, Cancelled."""
    fixture, loop, seconds = experiment.fixture, experiment.loop, duration_of(trial)
    fixture.require("stage")
    experiment.check_homed()
    experiment.check_passive()
    experiment.say(f"carrying the handle to {1e3 * trial.start:.1f} mm")
    fixture.stage_at(trial.start, trial.upside_down)
    experiment.check_height(trial.start)
    experiment.say("zero of the transducer, handle unloaded")
    before = experiment.unloaded_zero()
    fixture.stage_hold()
    experiment.say(f"stage at {1e3 * trial.speed:+g} mm/s to {1e3 * trial.end:.1f} mm")
    on_elapsed = share_of(on_progress, seconds)

    def watch(elapsed: float) -> None:
        experiment.check_passive()
        experiment.check_homed()
        on_elapsed(elapsed)

    try:
        recording = experiment.recording(1.5 * seconds + 2.0 * _SPARE_S)
        fixture.stage_go(trial.speed, trial.end)
        deadline = (1.2 if fixture.simulated else 20.0) * seconds + _SPARE_S
        experiment.wait(recording, lambda: fixture.stage_passed(trial.end), deadline, watch)
        experiment.robot.pause(2.0 * _TAIL_S)
    finally:
        loop.record(None)
        with experiment.unhurried():
            fixture.stage_halt()
    began_ns = fixture.stage_began_ns()
    experiment.say("zero of the transducer again")
    after = experiment.unloaded_zero()
    fixture.stage_hold()
    track = evenly(recording, experiment.rate)
    begin = _first_moved(track) if began_ns is None else track.row_at(began_ns, experiment.rate)
    end = begin + round((seconds + _TAIL_S) * experiment.rate)
    track = track.cut(begin, end, experiment.rate)
    track = track._replace(command=np.zeros(len(track.position)))
    return samples_of(track, experiment.rate, before, after)


def _first_moved(track: Track) -> int:
    """Return the row at which the nut begins to move, 0 without motion."""
    moved = np.abs(track.position - track.position[0]) > _MOVED
    return max(0, int(np.argmax(moved)) - 1)


def torque_trial(
    experiment: Experiment, takeover: Takeover, trial: TorqueTrial, on_progress: OnProgress
) -> Samples:
    """Play a sine of torque on the locked rotor.

    Raises NotPossible, RobotError, SamplesLost, Cancelled; the caller switches the torque off.
    """
    check_screw(experiment.robot, AMPLIFIER)
    sine = _sine(experiment, trial)
    experiment.fixture.require("locked_rotor")
    experiment.check_homed()
    experiment.say("taking the controller's place")
    source = takeover.take(sine.peak, experiment.watch, experiment.period_ns)
    values = parameters(experiment.robot, AMPLIFIER, ("gate.ramp_time", "rated_torque"))
    experiment.say("zero of the transducer")
    before = experiment.zero()
    source.clear()
    experiment.robot.pause(_LEAD_S)
    experiment.say("torque on")
    experiment.enable()
    experiment.robot.pause(values["gate.ramp_time"] + 2.0 * _LEAD_S)
    experiment.say(f"sine of {trial.amplitude:g} Nm, {trial.frequency:.3g} Hz")
    track = _played(experiment, source, sine, trial, on_progress)
    experiment.torque_off()
    experiment.robot.pause(_LEAD_S)
    experiment.say("zero of the transducer again")
    after = experiment.zero()
    return samples_of(_as_torque(track, values["rated_torque"]), experiment.rate, before, after)


def _sine(experiment: Experiment, trial: TorqueTrial) -> Sine:
    """Return the sine in ticks. Raises NotPossible if the graph cannot generate it."""
    rate = experiment.rate
    if trial.rate not in (0.0, rate):
        raise NotPossible(
            f"the trial wants {trial.rate:g} samples per second, the graph ticks at {rate:g}: start"
            f" it with rate:={trial.rate:g} for all vertical nodes"
        )
    if not trial.frequency < 0.5 * rate:
        raise NotPossible(
            f"a sine of {trial.frequency:g} Hz needs more than {rate:g} samples per second: start "
            "the graph with a higher rate, or ask for lower frequencies"
        )
    if trial.amplitude > LARGEST_TORQUE:
        raise NotPossible(
            f"amplitude {trial.amplitude:g} Nm exceeds the motor's continuous torque of "
            f"{LARGEST_TORQUE:g} Nm (thesis 3.1.6): choose a smaller one"
        )
    ticks = round(trial.duration * rate)
    return Sine(trial.amplitude, trial.frequency, ticks, rate, trial.linearization)


def _played(
    experiment: Experiment, source, sine: Sine, trial: TorqueTrial, on_progress: OnProgress
) -> Track:
    """Play the sine; return the ticks of it, command still as force [N]."""
    on_elapsed = share_of(on_progress, trial.duration)

    def watch(elapsed: float) -> None:
        if source.fault:
            raise RobotError(f"torque off: {source.fault}")
        experiment.check_enabled()
        state = experiment.robot.state(AmplifierState)
        if state is not None and state.saturated:
            raise RobotError("the amplifier limits the torque: the sine is distorted")
        on_elapsed(elapsed)

    recording = experiment.recording(trial.duration + _SPARE_S)
    experiment.robot.pause(_LEAD_S)
    source.begin(sine, recording.begins)
    experiment.wait(
        recording,
        lambda: not source.busy and not source.fault,
        1.2 * trial.duration + _SPARE_S,
        watch,
    )
    experiment.robot.pause(_LEAD_S)
    experiment.loop.record(None)
    track = evenly(recording, experiment.rate)
    if recording.mark is None:
        raise RobotError("the excitation did not start: no sample was used")
    begin = track.row_of(recording.mark)
    return track.cut(begin, begin + sine.ticks, experiment.rate)


def _as_torque(track: Track, rated: float) -> Track:
    """Return the track with the drive's command [Nm], in steps of a per mille of rated torque."""
    torque = force_to_torque(track.command)
    return track._replace(command=np.round(torque / rated * 1000.0) * rated * 1e-3)
