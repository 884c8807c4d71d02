# SPDX-License-Identifier: Apache-2.0
"""Stability of the vertical loop as a linear sampled system with contact (after 7.1; ours).

The law is the one that the robot executes: `linear_law` settles it in its envelope about a pressed
handle and takes differences of the step. The module is two masses in permanent contact, without
play and friction, and the screw, which its axial support (ours, not in the thesis) lets move along
its axis. The environment, an arm or a wall, is a mass, a spring and a damper at the handle (`Arm`).
Amplifier pole and transducer filter are continuous; sampling, hold and delay are exact. The loop is
stable if the spectral radius is below one. Friction stabilises and play destabilises the real loop,
so the result is neither a lower nor an upper bound of the real gain, but the limit of the linear
loop.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import cont2discrete

from ..calibration.module import thesis_friction
from ..compiled import compiled, compiling, packed
from ..control.envelope import enveloped, initial_state
from ..control.law import Law
from ..control.laws import own_of, settings_of
from ..control.laws.thesis import THESIS
from ..control.limits import clamp
from ..control.vertical import VerticalInput
from ..control.vertical_settings import VerticalSettings
from ..filters import lowpass_coefficients, velocity_settled
from .linearized import Linear, answers_of, filtered, floats_in, largest_stable, linear_of
from .trials import Arm

MOST = 100.0
"""Largest gain of a search."""
_N, _S, _H, _C, _F = 0, 2, 4, 6, 7  # nut, screw, handle, amplifier, transducer filter in the state
_STATES = 8
_AT, _PRESSED = 0.18, 5.0  # of the handle about which the law is linear [m], [N]
_MOST_PRESSED = 20.0  # [N] that the hand presses against any law
_SETTLE_S = 3.0


class Mechanism(NamedTuple):
    """nut_mass, handle_mass [kg]; contact_stiffness [N/m], contact_damping, film_damping [Ns/m]
    between them; support_stiffness [N/m], support_damping_ratio, screw_mass [kg]: of the screw
    along its axis, assumed as in params/plant.yaml; amplifier: its pole [Hz]; transducer: its
    filter [Hz]."""

    nut_mass: float = 4.4666
    handle_mass: float = 1.0234
    contact_stiffness: float = 20e6
    contact_damping: float = 3000.0
    film_damping: float = 700.0
    support_stiffness: float = 1e7
    support_damping_ratio: float = 0.05
    screw_mass: float = 0.6
    amplifier: float = 1000.0
    transducer: float = 1000.0


class Sampling(NamedTuple):
    """rate [Hz]; delay: from a sample to the amplifier's answer, its pole not counted [s]."""

    rate: float = 1000.0
    delay: float = 1.26e-3


class LawInMode(NamedTuple):
    """A law in one of its modes.

    settings: of the envelope, of a law of this package its own too; velocity_cutoff: of the
    encoder's filter [Hz]; law; own: settings of a law of others, None = its defaults; named: gain
    of the mode, empty = its first.
    """

    mode: int
    settings: VerticalSettings
    velocity_cutoff: float = 30.0
    law: Law = THESIS
    own: Any = None
    named: str = ""

    @property
    def gain_name(self) -> str:
        """Name of the force gain. Raises ValueError for a mode that has none."""
        if self.named:
            return self.named
        if not (gains := self.law.variants[self.mode].gains):
            raise ValueError(f"mode {self.law.variants[self.mode].name} names no force gain")
        return gains[0]

    @property
    def chosen(self) -> Any:
        """The settings of the law."""
        return settings_of(self.law, self.settings, self.own)

    def with_gain(self, gain: float) -> LawInMode:
        """Return the law with another force gain."""
        changed = self.chosen._replace(**{self.gain_name: gain})
        if self.law.settings is VerticalSettings:
            return self._replace(settings=changed)
        return self._replace(own=changed)


@functools.lru_cache(maxsize=8192)  # gain limits ask for 1 200, by the same steps of gain
def linear_law(looped: LawInMode, period: float) -> Linear:
    """Return the law about a handle that is pressed with 5 N, by differences of its step.

    Inputs: height of the nut [m], force [N]; output: command [N].
    Friction model, stiction's dead band and chatter guard, which the linear loop leaves out, are
    off. The hand presses as much as the law does. Only states are kept that the inputs reach and
    the command depends on.
    """
    settings = looped.settings._replace(
        friction_fraction=0.0, observer_friction=0.0, observer_rest=0.0, chatter_limit=math.inf
    )
    pressed = min(_PRESSED, 0.1 * settings.stiffness)  # the set point stays within the travel
    target = _AT + pressed / settings.stiffness if settings.stiffness else _AT
    own = own_of(looped.law, settings, thesis_friction(), looped.own)
    memory = packed(initial_state(settings, looped.law, own))
    motions = np.array([velocity_settled(_AT)])
    places = floats_in(memory.dtype)
    smooth = lowpass_coefficients(looped.velocity_cutoff, period)
    given = packed(settings), packed(own), looped.mode, target, period, smooth
    with compiling(f"law {looped.law.name}", *looped.law.functions):
        answers = compiled(answers_of(_tick_of(looped.law), 1))(
            given, memory, memory.view(np.float64), places, motions, np.array((_AT, -pressed)),
            round(_SETTLE_S / period),
        )  # fmt: skip
    a, b, c, d = linear_of(answers, len(places) + motions.size)
    return a, b, c[0], d[0]


@functools.cache
def _tick_of(law: Law) -> Callable[..., None]:
    """Return the tick of a law for `answers_of`: height of the nut and force in, command out."""
    step = enveloped(law)

    def tick(
        given: Any, memory: Any, motions: np.ndarray, seen: np.ndarray, settles: bool,
        made: np.ndarray,
    ) -> None:  # fmt: skip
        settings, own, mode, target, period, smooth = given
        velocity = filtered(smooth, motions[0], seen[0], period)
        inp = VerticalInput(mode, seen[0], velocity, seen[1], target, 0.0, True, 0.0, 0.0, 0.0)
        output = step(settings[0], own[0], memory[0], inp, period)
        made[0] = output.force
        if settles:
            seen[1] = clamp(-output.impedance, -_MOST_PRESSED, _MOST_PRESSED)

    return tick


def radius(plant: Linear, sampling: Sampling, law: LawInMode) -> float:
    """Return the spectral radius of the closed loop; plant: of `sampled`."""
    step, before, after, outputs = plant
    a, b, c, d = linear_law(law, 1.0 / sampling.rate)
    waiting = int(sampling.delay * sampling.rate * (1.0 + 1e-12)) + 1
    n, m = _STATES, len(a)
    size = n + m + waiting
    closed, waits = np.zeros((size, size)), np.eye(size)[n + m :]
    command = np.concatenate((d @ outputs, c, np.zeros(waiting)))
    # The first waiting command is the newest; the last two act within this period.
    closed[:n, :n] = step
    new = command if waiting == 1 else waits[-2]
    closed[:n] += np.outer(before, waits[-1]) + np.outer(after, new)
    closed[n : n + m, :n] = b @ outputs
    closed[n : n + m, n : n + m] = a
    closed[n + m] = command
    closed[n + m + 1 :, n + m : -1] = np.eye(waiting - 1)
    return float(np.abs(np.linalg.eigvals(closed)).max())


def sampled(mechanism: Mechanism, environment: Arm, sampling: Sampling) -> Linear:
    """Return (A, B before, B after, C) over one period; outputs: nut's height [m], force [N].

    A command arrives a part of a period (the delay modulo the period) after a sample; B before and
    B after are the input matrices of the commands before and after the arrival.
    """
    dynamics, push = _continuous(mechanism, environment)
    period = 1.0 / sampling.rate
    part = math.fmod(sampling.delay, period)
    outputs = np.eye(_STATES)[[_N, _F]]
    (first, before), (second, after) = (
        cont2discrete((dynamics, push[:, None], outputs, np.zeros((2, 1))), time)[:2]
        for time in (part, period - part)
    )
    return second @ first, second @ before[:, 0], after[:, 0], outputs


def _continuous(m: Mechanism, e: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Return dynamics and input [per N of command] of nut, screw, handle, amplifier and filter.

    The encoder turns with the screw: it does not see the deflection of the support.
    """
    a = np.zeros((_STATES, _STATES))
    contact = np.zeros(_STATES)  # force of the handle on the nut
    damping = m.contact_damping + m.film_damping
    contact[[_H, _H + 1]] = m.contact_stiffness, damping
    contact[[_N, _N + 1]] = -m.contact_stiffness, -damping
    contact[[_S, _S + 1]] = -m.contact_stiffness, -damping
    support = math.sqrt(m.support_stiffness / m.screw_mass)  # [rad/s] of the screw alone
    held = np.zeros(_STATES)  # of spring and damper of the environment on the handle
    held[[_H, _H + 1]] = -e.stiffness, -e.damping
    a[_N, _N + 1] = a[_S, _S + 1] = a[_H, _H + 1] = 1.0
    a[_N + 1] = contact / m.nut_mass
    a[_N + 1, _C] += 1.0 / m.nut_mass
    a[_S + 1] = contact / m.screw_mass
    a[_S + 1, _S] -= support**2
    a[_S + 1, _S + 1] -= 2.0 * m.support_damping_ratio * support
    a[_H + 1] = (held - contact) / (m.handle_mass + e.mass)
    pole = 2.0 * math.pi * m.amplifier
    a[_C, _C] = -pole
    lag = 2.0 * math.pi * m.transducer
    a[_F] = lag * (held - e.mass * a[_H + 1])
    a[_F, _F] -= lag
    push = np.zeros(_STATES)
    push[_C] = pole
    return a, push


def largest_gain(
    mechanism: Mechanism, environment: Arm, sampling: Sampling, law: LawInMode, most: float = MOST
) -> float:
    """Return the largest gain with a stable loop, 0 for less than 1e-3; its relative error is 1 %.

    law: its gain is varied; most: largest gain of the search; infinite if that is stable.
    """
    plant = sampled(mechanism, environment, sampling)
    return largest_stable(lambda gain: radius(plant, sampling, law.with_gain(gain)), most)
