# SPDX-License-Identifier: Apache-2.0
"""The whole rig over many substeps as one function, which `World` compiles."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from .module import HUMAN_ARM, ModuleInput, ModuleState, VerticalParams
from .muscles import Muscles, muscles_step, pull
from .patient import HandPath, HumanArm, hand_point
from .planar import ManusInput, ManusState
from .vertical import vertical_step

HAND_EVERY = 20  # substeps of the muscles, and between exact points of the hand's path


class SimulationParams(NamedTuple):
    """Both mechanisms, the plane's of its plant, the paths of the virtual hand, the patient."""

    vertical: VerticalParams
    planar: Any
    path_x: HandPath
    path_y: HandPath
    path_z: HandPath
    arm: HumanArm
    effort: float


class SimulationState(NamedTuple):
    """ticks: substeps since the start; the mechanisms; the virtual hand [m] and its velocity; the
    patient's muscles."""

    ticks: int
    vertical: ModuleState
    planar: ManusState
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    muscles: Muscles


# Where its parts begin in `numbers_of` a state; those of a part follow in the order of its fields.
VERTICAL = 1
PLANAR = VERTICAL + len(ModuleState._fields)
_HAND = PLANAR + len(ManusState._fields)
_MUSCLES = _HAND + 6


@cache
def advancing(planar_step: Callable) -> Callable:
    """Return the function that takes the whole rig over many substeps; planar_step: of its plane.
    """

    def advance(
        parameters: Any,
        numbers: Any,
        vertical_input: ModuleInput,
        planar_input: ManusInput,
        steps: int,
    ) -> None:
        """Take the state `steps` substeps further with the same inputs, in place.

        parameters: SimulationParams from `compiled.packed`. numbers: an array with those of
        `numbers_of` the state. The hand's position in the inputs is ignored: it comes from the
        paths.
        """
        n, p = numbers, parameters[0]
        ticks = int(n[0])
        vertical = ModuleState(
            n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11], n[12], n[13],
            n[14], n[15], n[16], n[17], n[18], n[19], n[20], n[21], n[22], n[23], n[24],
        )  # fmt: skip
        planar = ManusState(
            n[25], n[26], n[27], n[28], n[29], n[30], n[31], n[32], n[33], n[34], n[35], n[36],
            n[37], n[38],
        )  # fmt: skip
        x, y, z, vx, vy, vz = n[39], n[40], n[41], n[42], n[43], n[44]
        muscles = Muscles(n[45], n[46], n[47], n[48])
        dt = p.vertical.dt
        u, w = vertical_input, planar_input
        away, load, vigour = pull(p.arm, p.effort, muscles, y)
        for _ in range(steps):
            if ticks % HAND_EVERY == 0:
                time = ticks * dt
                x, vx = hand_point(p.path_x, time)
                y, vy = hand_point(p.path_y, time)
                z, vz = hand_point(p.path_z, time)
                held = 1.0 if w.attached and u.fixture == HUMAN_ARM else 0.0
                muscles = muscles_step(
                    p.arm, p.effort, muscles, held * planar.force_x, held * planar.force_y,
                    held * vertical.patient_force, held * planar.handle_vy, HAND_EVERY * dt,
                )  # fmt: skip
                away, load, vigour = pull(p.arm, p.effort, muscles, y)
            side = (planar.force_x * planar.force_x + planar.force_y * planar.force_y) ** 0.5
            on_module = ModuleInput(
                u.current, u.powered, u.braked, u.fixture, u.locked, u.upright,
                z, vz, u.stage_speed, u.stage_target, side, load, vigour,
            )  # fmt: skip
            on_plane = ManusInput(
                w.shoulder_torque, w.elbow_torque, w.shoulder_powered, w.elbow_powered,
                w.shoulder_braked, w.elbow_braked, w.attached, x, y, vx, vy,
                away, vigour,
            )  # fmt: skip
            vertical = vertical_step(p.vertical, vertical, on_module)
            planar = planar_step(p.planar, planar, on_plane)
            x += vx * dt
            y += vy * dt
            z += vz * dt
            ticks += 1
        n[0] = ticks
        for i in range(PLANAR - VERTICAL):
            n[VERTICAL + i] = vertical[i]
        for i in range(_HAND - PLANAR):
            n[PLANAR + i] = planar[i]
        n[39], n[40], n[41], n[42], n[43], n[44] = x, y, z, vx, vy, vz
        n[45], n[46], n[47], n[48] = muscles

    return advance


def numbers_of(s: SimulationState) -> list[float]:
    """Return the numbers of a state in the order of its fields."""
    return [float(s.ticks), *s.vertical, *s.planar, *s[3:-1], *s.muscles]


def state_of(numbers: list[float]) -> SimulationState:
    """Return the state with these numbers."""
    new = tuple.__new__  # each millisecond: without the calls of their constructors
    vertical = new(ModuleState, numbers[VERTICAL:PLANAR])
    planar = new(ManusState, numbers[PLANAR:_HAND])
    x, y, z, vx, vy, vz = numbers[_HAND:_MUSCLES]
    muscles = new(Muscles, numbers[_MUSCLES:])
    return SimulationState(int(numbers[0]), vertical, planar, x, y, z, vx, vy, vz, muscles)
