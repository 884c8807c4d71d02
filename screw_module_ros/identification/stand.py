# SPDX-License-Identifier: Apache-2.0
"""The in-process stand: simulated module and vertical loop, many times faster than real time.

Plant, drivers' scaling and law are those of the rig and the nodes, in one compiled loop
(`vertical_loop`) at the thesis's 2 kHz with the plant's finer substeps. There are no buses and
processes.
"""

from __future__ import annotations

import functools
import hashlib
import math
import zlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..calibration.module import thesis_friction
from ..compiled import compiled, compiling, packed
from ..control import modes
from ..control.envelope import initial_state
from ..control.law import Law
from ..control.laws import law_of, loaded, own_of
from ..control.laws.thesis import THESIS
from ..control.limits import CommandLimits
from ..control.linearization import IDENTITY, default_linearization
from ..control.support import SupportState
from ..control.torque_chain import TorqueChain
from ..control.vertical_settings import VerticalSettings
from ..filters import lowpass_coefficients, velocity_settled
from ..geometry import COUNTS_PER_TURN, SCREW, Screw, counts_to_height
from ..plant.instruments import CurrentSensorState, analyzed, current_sensor_params
from ..plant.module import FREE, HUMAN_ARM, LOCKED_ROTOR, STAGE, resting_state, vertical_params
from ..plant.patient import HandPath, arm_force, held_up, resting
from ..plant.sensor import FORCE_COUNTS, measured_wrench, seeded, sensor_params
from ..plant.settings import WorldSettings, changed_later
from ..settings import Setting, validated
from .plane_loop import plane_samples
from .trials import (
    TRUTH,
    WAY_S,
    WAYS_OUT,
    AnalyzerTrial,
    CarryTrial,
    HandTrial,
    MotionTrial,
    NotPossible,
    OnProgress,
    PlanarTrial,
    PlaneLoop,
    Samples,
    StageTrial,
    TorqueTrial,
    Trial,
    duration_of,
)
from .vertical_loop import (
    COLUMNS,
    LAW,
    REST,
    SINE,
    LoopParams,
    LoopState,
    Transducer,
    ticks_of,
)

LoopTrial = TorqueTrial | StageTrial | MotionTrial
ZERO_S = 0.5  # time over which the transducer's zero is averaged
_CHUNK = 100_000  # ticks between two reports of progress
_HUNG_AT = 0.25  # height at which friction holds the free handle [m]
_SETTLE_S = 3.0  # time for the spring to fade in
_BRAKING_S = 0.05  # time a stage brakes, beyond its way at constant speed


class LoopSettings(NamedTuple):
    """The sampled loop and the electronics around the module."""

    rate: Annotated[
        float, Setting("samples per second", "Hz", 50.0, 10_000.0)
    ] = 2000.0  # thesis: rate
    command_delay: Annotated[
        float, Setting("from a sample to its command", "s", 0.0, 0.02)
    ] = 325e-6  # thesis: table31_output; 4.1.4 advises a designer to assume 500 us
    rated_torque: Annotated[
        float, Setting("of the drive, object 6076", "Nm", 0.01, 10.0)
    ] = 0.42  # thesis: continuous_torque
    torque_constant: Annotated[
        float, Setting("of the motor, from its data sheet", "Nm/A", 0.01, 10.0)
    ] = 0.16  # thesis: torque_constant
    command_up: Annotated[float, Setting("largest command upward", "N", 0.0, 150.0)] = 95.0
    command_down: Annotated[float, Setting("largest command downward", "N", 0.0, 150.0)] = 75.0
    cutoff: Annotated[
        float, Setting("of the velocity filter (3.3)", "Hz", 1.0, 400.0)
    ] = 30.0  # thesis: velocity_cutoff
    force_counts: Annotated[
        float, Setting("of the transducer (3.1.9)", "1/N", 1.0, 1e5)
    ] = FORCE_COUNTS
    torque_counts: Annotated[float, Setting("of the transducer", "1/Nm", 1.0, 1e6)] = 5665.0
    # ours: 12 bit over +-10 V; the thesis prints no resolution of its A/D card (4.1.2)
    volt_counts: Annotated[float, Setting("of the A/D card", "1/V", 1.0, 1e6)] = 204.8


class SimulatedStand:
    """The simulated module `world` as a `trials.Stand`.

    seed: of the noise and of the transducer's zeros. A command acts after a whole number of
    substeps: the delay is rounded up. Torque trials have half the substep, so that it is exact.
    laws: of others, as `control.laws.load` takes them; their modes are for MotionTrials, with the
    laws' default settings. screw: for which encoder and amplifier are set, which may be another
    one than the module has. plane: the loop of its plane, for experiments that choose none.
    """

    plane = PlaneLoop()
    offers = frozenset({*WAYS_OUT, TRUTH})
    serial = ""
    law_settings: Mapping[str, Any] = MappingProxyType({})

    def __init__(
        self,
        world: WorldSettings,
        loop: LoopSettings | None = None,
        seed: int = 1,
        laws: tuple[str, ...] = (),
        screw: Screw = SCREW,
    ):
        self.world = world
        self.loop = validated(loop or LoopSettings())
        self.rate = self.loop.rate
        made_of = (world, self.loop) if screw == SCREW else (world, self.loop, screw)
        digest = hashlib.sha256(repr(made_of).encode()).hexdigest()[:10]
        self.name = f"in process, seed {seed}, {digest}"
        self.seed, self.screw = seed, screw
        self._thesis = thesis_friction()
        self._paths, self.laws = laws, loaded(laws)

    def __reduce__(self) -> tuple[Any, ...]:
        """Let worker processes have one stand each for many trials."""
        return _stand_of_process, (self.world, self.loop, self.seed, self._paths, self.screw)

    def record(self, trial: Trial, on_progress: OnProgress) -> Samples:
        """Do a trial. Raises NotPossible for an impossible rate, and errors of `on_progress`."""
        if isinstance(trial, AnalyzerTrial):
            return analyzer_samples(self.world, trial)
        if isinstance(trial, PlanarTrial):
            return plane_samples(self.world, trial, self.seed, on_progress)
        hand = _hand_in(trial)
        motion: Any = hand.motion if hand else trial
        carries = trial if isinstance(trial, CarryTrial) else None
        modes_of = (motion.mode, hand.then_mode) if hand else ()
        law = next(filter(None, (law_of(mode, self.laws) for mode in modes_of)), THESIS)
        params = self._params(motion, law)
        force, torque, state = self._zero(law, params, self._start(trial, law, params))
        t = params.transducer
        t = t._replace(force_zero=t.force_zero - force, torque_zero=t.torque_zero - torque)
        params = params._replace(transducer=t)
        state = self._placed(params, state)
        if hand:
            arm = params.plant.arm._replace(weight=hand.weight)
            plant = params.plant._replace(grip=hand.grip, arm=arm)
            params = params._replace(plant=plant, path=hand.before, wish=hand.support)
            _, state = self._ticks(law, params, state, _SETTLE_S)
            state = state._replace(ticks=0)
            params = params._replace(path=hand.path)
        if isinstance(trial, StageTrial):
            parts = _driven(trial, params)
        elif carries:
            parts = _carried(carries, params)
        else:
            parts = _moved(duration_of(trial), hand, params)
        rows = []
        for own, seconds in parts:
            samples, state = self._ticks(law, own, state, seconds, on_progress)
            rows.append(samples)
        force, torque, _ = self._zero(law, params, state)
        return samples_of(np.concatenate(rows), params, force, torque)

    def zero(self) -> tuple[float, float, float, float, float, float]:
        """Return the transducer's reading without load, a mean of half a second."""
        own, noise = sensor_params(self.world.sensor, self.seed), list(seeded(self.seed))
        count = round(ZERO_S * self.rate)
        shown = np.empty((count, 6))
        for row in range(count):
            shown[row], *noise = measured_wrench(own, (0.0,) * 6, row / self.rate, *noise)
        return tuple(shown.mean(axis=0).tolist())

    def _params(self, trial: LoopTrial, law: Law) -> LoopParams:
        rate = getattr(trial, "rate", 0.0) or self.rate
        w, loop = self.world, self.loop
        own = sensor_params(w.sensor, self.seed)
        if isinstance(trial, MotionTrial) and trial.changed:
            w = changed_later(w, trial.changed)
        if isinstance(trial, MotionTrial) and trial.preloaded:
            w = w._replace(vertical=w.vertical._replace(play=0.0))
        substep = w.substep / 2.0 if isinstance(trial, TorqueTrial) else w.substep
        steps = round(1.0 / rate / substep)
        if abs(steps * substep * rate - 1.0) > 1e-9:
            raise NotPossible(
                f"{rate:g} samples per second: the period must be a whole number of substeps of "
                f"{substep:g} s; choose 500, 1000, 2000 or 4000"
            )
        arm = held_up(*trial.arm) if isinstance(trial, MotionTrial) else arm_force(w.arm)
        plant = vertical_params(
            w.vertical, w.friction, w.amplifier, w.transducer,
            arm, substep, w.sensor.bandwidth, w.sensor.hysteresis,
        )  # fmt: skip
        quiet = LoopParams(
            plant=plant,
            lead=w.vertical.lead,
            amplifier=w.amplifier,
            sensor=current_sensor_params(substep),
            transducer=Transducer(
                own.force_noise, own.torque_noise, own.bias[2], own.bias[5], own.drift[2],
                own.drift[5], own.drift_time, loop.force_counts, loop.torque_counts,
            ),
            chain=TorqueChain(
                CommandLimits(loop.command_up, loop.command_down), screw=self.screw,
                rated_torque=loop.rated_torque,
            ),
            amperes=1.0 / loop.torque_constant,
            smooth=lowpass_coefficients(loop.cutoff, 1.0 / rate),
            law=VerticalSettings(),
            own=own_of(law, VerticalSettings(), self._thesis),
            path=resting(_HUNG_AT),
            period=steps * substep,
            steps=steps,
            late=math.ceil(loop.command_delay / substep * (1.0 - 1e-9)),
            kind=REST,
            mode=modes.OFF,
            amplitude=0.0,
            omega=0.0,
            centre=_HUNG_AT,
            fixture=FREE,
            upright=1.0,
            stage_speed=0.0,
            stage_target=0.0,
            counts=w.start.counts_per_turn,
            volt_counts=loop.volt_counts,
        )
        if isinstance(trial, MotionTrial):
            settings = trial.settings.validated()
            own = own_of(law, settings, trial.friction or self._thesis)
            quiet = quiet._replace(law=settings, own=own)
        return asked_for(quiet, trial)

    def _start(self, trial: Trial, law: Law, params: LoopParams) -> LoopState:
        """Return the state after power-on, with the handle held by friction.

        Every trial has its own noise, which is the same in each repetition.
        """
        noise = seeded(self.seed + zlib.crc32(repr(trial).encode()))
        memory = packed(initial_state(params.law, law, params.own))
        nothing = np.zeros(params.late // params.steps + 1)
        module = resting_state(self.world.vertical, _HUNG_AT, params.upright)
        return LoopState(
            0, 0.0, module, memory, packed(SupportState()), velocity_settled(_HUNG_AT), 0.0,
            nothing, CurrentSensorState(), 0.0, *noise,
        )  # fmt: skip

    def _zero(
        self, law: Law, params: LoopParams, state: LoopState
    ) -> tuple[float, float, LoopState]:
        """Return the mean force [N] and torque [Nm] without load, and the state after it."""
        quiet = params._replace(kind=REST)
        if params.fixture != LOCKED_ROTOR:
            hung = resting_state(self.world.vertical, _HUNG_AT, params.upright)
            quiet = quiet._replace(fixture=FREE)
            state = state._replace(module=hung)
        rows, state = self._ticks(law, quiet, state, 2.0 * ZERO_S)
        calm = rows[len(rows) // 2 :]  # filters and currents settle in the first half
        return float(calm[:, 2].mean()), float(calm[:, 3].mean()), state

    def _placed(self, params: LoopParams, state: LoopState) -> LoopState:
        """Return the state with the handle at rest where the trial begins."""
        vertical = self.world.vertical
        if params.fixture != LOCKED_ROTOR:
            state = state._replace(module=resting_state(vertical, params.centre, params.upright))
        count = math.floor(params.centre / vertical.lead * COUNTS_PER_TURN)
        shown = counts_to_height(count, self.screw)
        return state._replace(ticks=0, motion=velocity_settled(shown))

    def _ticks(
        self,
        law: Law,
        params: LoopParams,
        state: LoopState,
        seconds: float,
        on_progress: OnProgress = lambda share: None,
    ) -> tuple[np.ndarray, LoopState]:
        rows = np.empty((round(seconds / params.period), COLUMNS))
        ready, run = packed(params), compiled(ticks_of(law))
        with compiling(f"law {law.name}", *law.functions):
            for begin in range(0, len(rows), _CHUNK):
                on_progress(begin / len(rows))
                state = run(ready, state, rows[begin : begin + _CHUNK])
        return rows, state


@functools.lru_cache(maxsize=1)
def _stand_of_process(
    world: WorldSettings, loop: LoopSettings, seed: int, laws: tuple[str, ...], screw: Screw
) -> SimulatedStand:
    return SimulatedStand(world, loop, seed, laws, screw)


def asked_for(quiet: LoopParams, trial: LoopTrial) -> LoopParams:
    """Return the parameters `quiet` with those of the trial."""
    if isinstance(trial, TorqueTrial):
        return quiet._replace(
            kind=SINE,
            fixture=LOCKED_ROTOR,
            amplitude=float(trial.amplitude),
            omega=2.0 * math.pi * trial.frequency,
            chain=quiet.chain._replace(linearization=trial.linearization or IDENTITY),
        )
    if isinstance(trial, StageTrial):
        return quiet._replace(
            fixture=STAGE,
            centre=float(trial.start),
            upright=-1.0 if trial.upside_down else 1.0,
            stage_speed=abs(float(trial.speed)),
            stage_target=float(trial.end),
        )
    return quiet._replace(
        kind=LAW,
        fixture=HUMAN_ARM,
        mode=trial.mode,
        chain=quiet.chain._replace(linearization=trial.linearization or default_linearization()),
        centre=float(trial.centre),
        path=resting(float(trial.centre)),
        side_force=float(trial.side_force),
    )


def _driven(trial: StageTrial, params: LoopParams) -> list[tuple[LoopParams, float]]:
    """Return the parameters of each of the stage's ways, and its time with the braking [s]."""
    seconds = duration_of(trial) / len(trial.ways) + _BRAKING_S
    return [(params._replace(stage_target=float(end)), seconds) for _, end in trial.ways]


def _carried(trial: CarryTrial, params: LoopParams) -> list[tuple[LoopParams, float]]:
    """Return the parameters of each part, and its time [s]."""
    parts, ticks = [], 0
    for part in trial.parts:
        begin = part.path.begin + ticks * params.period
        own = params._replace(
            path=part.path._replace(begin=begin), wish=part.support, powered=part.powered,
            braked=part.braked, fixture=HUMAN_ARM if part.there else FREE,
        )  # fmt: skip
        parts.append((own, part.seconds))
        ticks += round(part.seconds / params.period)
    return parts


def _moved(
    length: float, hand: HandTrial | None, params: LoopParams
) -> list[tuple[LoopParams, float]]:
    """Return the parameters until the hand lets go or the mode changes, and after, with times."""
    until, later = length, params
    if hand and hand.motion.released_after < until:
        until, later = hand.motion.released_after, params._replace(fixture=FREE)
    if hand and hand.switched_after < until:
        until, later = hand.switched_after, params._replace(mode=hand.then_mode)
    return [(params, until), (later, length - until)]


def _hand_in(trial: Trial) -> HandTrial | None:
    """Return what the hand does in a trial, None where there is none."""
    if isinstance(trial, HandTrial):
        return trial
    if isinstance(trial, CarryTrial):
        first = trial.parts[0]
        return HandTrial(
            trial.motion, resting(first.path.start), first.path, trial.grip,
            weight=trial.weight, support=first.support,
        )  # fmt: skip
    if not isinstance(trial, MotionTrial):
        return None
    c, way = float(trial.centre), float(trial.way)
    amplitude, omega, tremor = map(float, (trial.amplitude, trial.omega, trial.tremor))
    path = HandPath(c, c + way, 0.0, WAY_S if way else 0.0, amplitude, omega, tremor)
    return HandTrial(trial, resting(c), path)


def samples_of(rows: np.ndarray, params: LoopParams, force: float, torque: float) -> Samples:
    """Return the rows as samples, without the zeros' drift to `force` [N] and `torque` [Nm]."""
    time = np.arange(len(rows)) * params.period
    drifted = (time + 0.5 * ZERO_S) / (len(rows) * params.period + ZERO_S)
    return Samples(
        time,
        rows[:, 0],
        rows[:, 1],
        rows[:, 2] - drifted * force,
        rows[:, 3] - drifted * torque,
        rows[:, 4],
        *rows[:, 5:].T,
    )


def analyzer_samples(world: WorldSettings, trial: AnalyzerTrial) -> Samples:
    """Return command and current of an amplifier on an analyser; all other samples are zero."""
    command, current = analyzed(
        world.amplifier, trial.frequency, trial.amplitude, trial.duration, trial.rate
    )
    nothing = np.zeros_like(command)
    time = np.arange(len(command)) / trial.rate
    return Samples(time, nothing, nothing, nothing, nothing, command, current)
