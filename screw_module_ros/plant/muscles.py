# SPDX-License-Identifier: Apache-2.0
"""What a patient's muscles do from millisecond to millisecond: tone, lifting, synergy, fatigue.

Tone pulls towards the body where a movement away from it stretches the flexors faster than
`tone_speed` (the form of mcpherson2018 and mccrea2003):

    tone -> tone_gain max(0, v_y - tone_speed), first order

Of the arm's weight he lifts what he is able to, less what he relies on the handle to bear; the rest
hangs on the handle. In a synergy lifting pulls the hand to the body, the more the farther out he
reaches, so that support frees his reach (sukal2007 has the effect, the form is ours: with the same
pull everywhere the area that he covers would move and not shrink):

    able = weight carried effort,    lift = able - relief
    F_y = -synergy lift (1/2 + y / 0.4 m), the bracket between 0 and 1

Fatigue has the three compartments of xia2008: muscle at rest, active (as much as he pushes or
pulls, over his strength) and tired, which recovers faster where he rests (looft2018). What is
tired lacks in his strength. Holding the arm up tires nobody and stays as it is (ours): else no
break would be one while he holds it.
"""

from __future__ import annotations

from typing import NamedTuple

from .patient import HumanArm

DRIVE = 10.0  # [1/s] work: xia2008; development of and relaxation from force
REST_GAIN = 15.0  # work: looft2018; recovery at rest over that at work
_AT_REST = 0.15  # ours: share of the strength below which he rests
_RELIEF_S = 0.5  # ours: until he relies on a support
_DEPTH = 0.4  # [m] ours: from where a synergy pulls not at all to where it pulls with all it has


class Muscles(NamedTuple):
    """tone, relief [N]; active, tired: shares of the muscle."""

    tone: float
    relief: float
    active: float
    tired: float


RESTED = Muscles(0.0, 0.0, 0.0, 0.0)


def pull(arm: HumanArm, effort: float, s: Muscles, y: float) -> tuple[float, float, float]:
    """Return what the muscles add to spring and damper of the hand.

    That is a force away from the body [N], a load that hangs on the handle beyond the share of the
    weight that he does not carry [N], and the share of his strength that is not tired. effort: the
    patient's; y: of the virtual hand from the workspace's centre [m].
    """
    far = min(max(0.5 + y / _DEPTH, 0.0), 1.0)
    lift = max(arm.weight * arm.carried * effort - s.relief, 0.0)
    return -s.tone - arm.synergy * lift * far, arm.weight * arm.carried - lift, 1.0 - s.tired


def muscles_step(
    arm: HumanArm, effort: float, s: Muscles, fx: float, fy: float, fz: float, away: float,
    dt: float,
) -> Muscles:  # fmt: skip
    """Return the muscles after dt [s].

    effort: the patient's; fx, fy, fz: patient on robot [N]; away: his hand's vy [m/s].
    """
    stretched = arm.tone * max(away - arm.tone_speed, 0.0)
    tone = s.tone + (stretched - s.tone) * dt / (arm.tone_delay + dt)
    able = arm.weight * arm.carried * effort
    borne = arm.relies * min(max(able - arm.weight - fz, 0.0), able)
    relief = s.relief + (borne - s.relief) * dt / (_RELIEF_S + dt)
    if arm.fatigue == 0.0:
        return Muscles(tone, relief, 0.0, 0.0)
    muscle_z = fz + arm.weight - max(able - s.relief, 0.0)  # without what hangs on the handle
    pushes = (fx * fx + fy * fy + muscle_z * muscle_z) ** 0.5
    wanted = min(pushes / max(arm.strength, 1e-9), 1.0)
    more = min(wanted - s.active, 1.0 - s.active - s.tired)
    tiring = arm.fatigue * s.active
    recovers = arm.recovery * (REST_GAIN if wanted < _AT_REST else 1.0) * s.tired
    return Muscles(
        tone,
        relief,
        s.active + dt * (DRIVE * more - tiring),
        s.tired + dt * (tiring - recovers),
    )
