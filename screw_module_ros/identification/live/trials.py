# SPDX-License-Identifier: Apache-2.0
"""Stage and torque trials on the live graph."""

from __future__ import annotations

import numpy as np
from screw_module_msgs.msg import AmplifierState

from screw_module_ros.geometry import force_to_torque
from screw_module_ros.identification.trials import (
    NotPossible,
    Samples,
    StageTrial,
    Told,
    TorqueTrial,
    duration_of,
)
from screw_module_ros.operator.client import RobotError

from .graph import parameters
from .samples import Track, evenly, samples_of
from .session import Session, share_of
from .takeover import AMPLIFIER, Takeover
from .torque_source import Sine

LARGEST_TORQUE = 0.42  # continuous torque of the motor (thesis 3.1.6) [Nm]
_TAIL_S = 0.05  # after the end of a stage run
_SPARE_S = 5.0
_LEAD_S = 0.1
_MOVED = 3e-6  # of the nut [m]


def stage_trial(session: Session, trial: StageTrial, told: Told) -> Samples:
    """Let the stage drive the handle. Raises NotPossible, RobotError, SamplesLost, Cancelled."""
    fixture, loop, seconds = session.fixture, session.loop, duration_of(trial)
    fixture.require("stage")
    session.check_homed()
    session.check_passive()
    session.say(f"carrying the handle to {1e3 * trial.start:.1f} mm")
    fixture.stage_at(trial.start, trial.upside_down)
    session.check_height(trial.start)
    session.say("zero of the transducer, handle unloaded")
    before = session.unloaded_zero()
    fixture.stage_hold()
    session.say(f"stage at {1e3 * trial.speed:+g} mm/s to {1e3 * trial.end:.1f} mm")
    hear = share_of(told, seconds)

    def watch(elapsed: float) -> None:
        session.check_passive()
        hear(elapsed)

    try:
        recording = session.recording(1.5 * seconds + 2.0 * _SPARE_S)
        fixture.stage_go(trial.speed, trial.end)
        deadline = (1.2 if fixture.simulated else 20.0) * seconds + _SPARE_S
        session.wait(recording, lambda: fixture.stage_passed(trial.end), deadline, watch)
        session.robot.pause(2.0 * _TAIL_S)
    finally:
        loop.record(None)
        with session.unhurried():
            fixture.stage_halt()
    began_ns = fixture.stage_began_ns()
    session.say("zero of the transducer again")
    after = session.unloaded_zero()
    fixture.stage_hold()
    track = evenly(recording, session.rate)
    begin = _first_moved(track) if began_ns is None else track.row_at(began_ns, session.rate)
    end = begin + round((seconds + _TAIL_S) * session.rate)
    track = track.cut(begin, end, session.rate)
    track = track._replace(command=np.zeros(len(track.position)))
    return samples_of(track, session.rate, before, after)


def _first_moved(track: Track) -> int:
    """Return the row at which the nut begins to move, 0 when it never does."""
    moved = np.abs(track.position - track.position[0]) > _MOVED
    return max(0, int(np.argmax(moved)) - 1)


def torque_trial(session: Session, takeover: Takeover, trial: TorqueTrial, told: Told) -> Samples:
    """Play a sine of torque on the locked rotor.

    Raises NotPossible, RobotError, SamplesLost, Cancelled; the caller switches the torque off.
    """
    sine = _sine(session, trial)
    session.fixture.require("locked_rotor")
    session.check_homed()
    session.say("taking the controller's place")
    source = takeover.take(sine.peak, session.watch, session.period_ns)
    given = parameters(session.robot, AMPLIFIER, ("gate.ramp_time", "rated_torque"))
    session.say("zero of the transducer")
    before = session.zero()
    source.clear()
    session.robot.pause(_LEAD_S)
    session.say("torque on")
    session.enable()
    session.robot.pause(given["gate.ramp_time"] + 2.0 * _LEAD_S)
    session.say(f"sine of {trial.amplitude:g} Nm, {trial.frequency:.3g} Hz")
    track = _played(session, source, sine, trial, told)
    session.torque_off()
    session.robot.pause(_LEAD_S)
    session.say("zero of the transducer again")
    after = session.zero()
    return samples_of(_as_torque(track, given["rated_torque"]), session.rate, before, after)


def _sine(session: Session, trial: TorqueTrial) -> Sine:
    """Return the sine as ticks. Raises NotPossible when the graph cannot play it."""
    rate = session.rate
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
            f"{trial.amplitude:g} Nm: the motor bears {LARGEST_TORQUE:g} Nm for longer (thesis "
            "3.1.6); ask for less"
        )
    ticks = round(trial.duration * rate)
    return Sine(trial.amplitude, trial.frequency, ticks, rate, trial.linearization)


def _played(session: Session, source, sine: Sine, trial: TorqueTrial, told: Told) -> Track:
    """Play the sine; return the ticks of it, command still as force [N]."""
    hear = share_of(told, trial.duration)

    def watch(elapsed: float) -> None:
        if source.fault:
            raise RobotError(f"torque off: {source.fault}")
        session.check_enabled()
        state = session.robot.state(AmplifierState)
        if state is not None and state.saturated:
            raise RobotError("the amplifier limits the torque: the sine is no longer one")
        hear(elapsed)

    recording = session.recording(trial.duration + _SPARE_S)
    session.robot.pause(_LEAD_S)
    source.begin(sine, recording.begins)
    session.wait(
        recording,
        lambda: not source.busy and not source.fault,
        1.2 * trial.duration + _SPARE_S,
        watch,
    )
    session.robot.pause(_LEAD_S)
    session.loop.record(None)
    track = evenly(recording, session.rate)
    if recording.mark is None:
        raise RobotError("not one sample was answered")
    begin = track.row_of(recording.mark)
    return track.cut(begin, begin + sine.ticks, session.rate)


def _as_torque(track: Track, rated: float) -> Track:
    """Return the track with the command as the drive gets it: per mille of the rated torque."""
    torque = force_to_torque(track.command)
    return track._replace(command=np.round(torque / rated * 1000.0) * rated * 1e-3)
