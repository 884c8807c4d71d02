# SPDX-License-Identifier: Apache-2.0
"""The guard: a damper and less gain while the robot drives, in proportion; hands keep theirs."""

import math

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.guard import (
    BEGIN,
    END,
    KEPT,
    PASSIVE,
    RETURN,
    Chatter,
    Guard,
    chatter_step,
    damper_force,
    forget,
    forget_chatter,
    guard_step,
    guarded,
    tune_guard,
)
from screw_module_ros.control.vertical import VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings

DT, LIMIT, LEAST = 0.001, 1.2, 0.6
MODEL = thesis_friction()
SETTINGS = VerticalSettings()
AT = 0.18
REST = VerticalInput(modes.IMPEDANCE, AT, 0.0, 0.0, AT, 0.0, True)


def quiet():
    """A guard that has seen nothing."""
    guard = Guard()
    tune_guard(guard, DT)
    return guard


def sine(amplitude, frequency, phase=0.0):
    return lambda t: amplitude * math.sin(2.0 * math.pi * frequency * t + phase)


def nothing(t):
    return 0.0


# -- chatter -------------------------------------------------------------------------------------


def shaken(force, seconds, guard=None):
    """Guard after a force, a function of time, on a nut that does not move."""
    guard = guard or quiet()
    for k in range(round(seconds / DT)):
        guard_step(guard, force(k * DT), 0.0, 0.0, LEAST, LIMIT, DT)
    return guard


@pytest.mark.parametrize("frequency", [90.0, 140.0])
def test_chatter_takes_the_gain_away_within_a_quarter_of_a_second(frequency):
    assert shaken(sine(6.0, frequency), 0.25).share == 0.0


@pytest.mark.parametrize(
    "force",
    [
        sine(40.0, 0.5),  # a hand that works
        sine(5.0, 5.0),  # tremor
        sine(1.0, 100.0),  # noise
        lambda t: 30.0 if 0.3 < t < 0.32 else 0.0,  # a jolt
        lambda t: 12.0 * min(1.0, t / 0.05),  # a hand that grips within 50 ms
    ],
)
def test_what_hands_do_is_no_chatter(force):
    chatter = quiet().chatter
    for k in range(2000):
        chatter_step(chatter, force(k * DT), LIMIT, DT)
        assert chatter.share == 1.0


def test_a_weaker_chatter_takes_longer_and_as_much():
    assert shaken(sine(3.0, 120.0), 0.05).share == 1.0
    assert shaken(sine(3.0, 120.0), 1.5).share == 0.0


def test_the_gain_is_back_soon_after_the_chatter():
    guard = shaken(sine(6.0, 120.0), 1.0)
    assert 0.0 < shaken(nothing, 0.3, guard).share < 1.0
    assert shaken(nothing, 1.5 * RETURN + 0.1, guard).share == 1.0


def test_chatter_can_be_made_to_forget_at_once():
    chatter = shaken(sine(6.0, 120.0), 1.0).chatter
    forget_chatter(chatter)
    assert chatter == quiet().chatter != Chatter()


# -- passivity -----------------------------------------------------------------------------------


def moved(error, speed, seconds, guard=None):
    """Guard after a force beside the impedance's and a speed of the nut, functions of time."""
    guard = guard or quiet()
    for k in range(round(seconds / DT)):
        guard_step(guard, 0.0, error(k * DT), speed(k * DT), LEAST, LIMIT, DT)
    return guard


def shown(resistance, frequency, size=0.05, spring=400.0):
    """Force of a resistance [Ns/m] and a spring [N/m] that a speed [m/s] of this size meets."""
    omega = 2.0 * math.pi * frequency
    speed = sine(size, frequency)
    return lambda t: resistance * speed(t) - spring * size / omega * math.cos(omega * t), speed


@pytest.mark.parametrize("frequency", [6.5, 10.0, 16.0])
@pytest.mark.parametrize("resistance", [-40.0, -60.0, -90.0])
def test_the_need_is_what_is_missing_to_a_passive_robot(resistance, frequency):
    force, speed = shown(resistance, frequency)
    guard = moved(force, speed, 1.0)
    need = guard.passivity.need
    assert need == pytest.approx(PASSIVE - resistance, rel=0.2)
    assert guard.share == pytest.approx((END - need) / (END - BEGIN))


@pytest.mark.parametrize("frequency", [6.5, 10.0, 16.0])
def test_the_damper_takes_as_much_power_as_is_needed(frequency):
    force, speed = shown(-60.0, frequency)
    guard = moved(force, speed, 1.0)
    power = motion = 0.0
    for k in range(1000):
        t = 1.0 + k * DT
        guard_step(guard, 0.0, force(t), speed(t), LEAST, LIMIT, DT)
        power += damper_force(guard.passivity, speed(t), 1.0, 200.0) * speed(t)
        motion += speed(t) ** 2
    assert power / motion == pytest.approx(guard.passivity.need, rel=0.25)


def test_the_damper_has_a_limit_and_a_weight():
    force, speed = shown(-90.0, 10.0)
    guard = moved(force, speed, 1.0)
    guard.passivity.slow = 0.0
    assert damper_force(guard.passivity, 0.1, 1.0, 40.0) == pytest.approx(4.0)
    assert damper_force(guard.passivity, 0.1, 0.5, 40.0) == pytest.approx(2.0)


def test_a_hand_in_motion_hardly_feels_the_damper():
    """At half a hertz a damper of 60 Ns/m would take 20 N."""
    force, speed = shown(-60.0, 12.0)
    guard = moved(force, speed, 1.0)
    hand, largest = sine(0.3, 0.5), 0.0
    for k in range(500):
        guard_step(guard, 0.0, 0.0, hand(k * DT), LEAST, LIMIT, DT)
        largest = max(largest, abs(damper_force(guard.passivity, hand(k * DT), 1.0, 200.0)))
    assert largest < 4.0


@pytest.mark.parametrize(
    ("force", "speed"),
    [
        shown(0.0, 8.0, spring=800.0),  # a spring
        shown(0.0, 8.0, spring=-800.0),  # a mass
        shown(20.0, 5.0),  # a hand that trembles and drives the robot
        shown(-60.0, 8.0, size=0.005),  # too little
        (sine(12.0, 0.5), sine(-0.3, 0.5)),  # a hand at work that is helped
        (sine(10.0, 20.0), nothing),  # a nut that stands
    ],
)
def test_what_hands_and_springs_do_leaves_the_gain(force, speed):
    guard = quiet()
    for k in range(3000):
        guard_step(guard, 0.0, force(k * DT), speed(k * DT), LEAST, LIMIT, DT)
        assert guard.share == 1.0
    assert guard.passivity.need < BEGIN


def test_the_need_is_over_when_its_cause_is_over():
    guard = moved(*shown(-90.0, 10.0), 1.0)
    begun = guard.passivity.need
    moved(nothing, nothing, KEPT, guard)
    assert guard.passivity.need == pytest.approx(begun / math.e, rel=0.2)
    assert moved(nothing, nothing, 2.0 * KEPT, guard).share == 1.0


def test_all_is_forgotten_at_once():
    guard = moved(*shown(-90.0, 10.0), 1.0)
    shaken(sine(6.0, 120.0), 0.5, guard)
    assert guard.share < 1.0
    forget(guard)
    assert guard == quiet()


def test_the_operator_reads_what_is_left():
    assert guarded(0.4).startswith("chatter guard: the robot drives what holds the handle, 40 %")


# -- in the law ----------------------------------------------------------------------------------


def law_after(inp, force, seconds=1.5, settings=SETTINGS):
    """The law's last output for a handle force, a function of time [N]."""
    state = initial_state(settings)
    for tick in range(round(seconds / DT)):
        sample = inp._replace(force=force(tick * DT))
        output = vertical_step(settings, MODEL, state, sample, DT)
    return output


@pytest.mark.parametrize(
    "inp", [REST._replace(mode=modes.OBSERVER, active=False), REST, REST._replace(mode=modes.OFF)]
)
def test_shaking_that_no_gain_causes_takes_no_gain_away(inp):
    """Mounting a handle without torque left mode 5 with 40 % of its gain for a minute."""
    assert law_after(inp, sine(10.0, 120.0)).share == 1.0


@pytest.mark.parametrize(
    "mode",
    [mode for mode in modes.MODE_NAMES if mode not in (modes.OFF, modes.IMPEDANCE)],
)
def test_shaking_in_a_mode_with_a_gain_takes_it_away(mode):
    assert law_after(REST._replace(mode=mode), sine(10.0, 120.0)).share == 0.0


def test_what_the_guard_took_is_forgotten_with_the_gain():
    """A share that stayed in mode 1 warned there, and met the next mode."""
    state = initial_state(SETTINGS)
    for tick in range(3000):
        mode = modes.OBSERVER if tick < 1500 else modes.IMPEDANCE
        force = sine(10.0, 120.0)(tick * DT) if tick < 1500 else 0.0
        inp = REST._replace(mode=mode, force=force)
        output = vertical_step(SETTINGS, MODEL, state, inp, DT)
        if tick == 1499:
            assert output.share == 0.0
            state.guard.passivity.need = 60.0
    assert output.share == 1.0
    assert state.guard.passivity.need == 0.0


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_its_damper_acts_in_a_slot_too(weight):
    """A slot takes the place of spring and damper."""
    state = initial_state(SETTINGS)
    inp = REST._replace(mode=modes.FORCE_FEEDBACK, slot_weight=weight)
    for _ in range(1500):
        vertical_step(SETTINGS, MODEL, state, inp, DT)
    state.guard.passivity.need = 40.0
    moving = inp._replace(velocity=0.1)
    for tick in range(20):
        moving = moving._replace(position=AT + 0.1 * DT * (tick + 1))
        output = vertical_step(SETTINGS, MODEL, state, moving, DT)
    assert output.impedance < -0.5


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.OBSERVER])
def test_a_set_point_that_moves_the_hand_takes_no_gain_away(mode):
    """It gives power to the hand, as an oscillation does that the robot drives."""
    law = SETTINGS._replace(stiffness=800.0, damping=20.0)
    state, height, speed = initial_state(law), AT, 0.0
    for tick in range(2000):
        sought = AT if tick < 1000 else AT + 0.05
        force = -400.0 * (height - AT) - 30.0 * speed  # of a hand on a weightless handle
        inp = VerticalInput(mode, height, speed, force, sought, 0.0, True)
        output = vertical_step(law, MODEL, state, inp, DT)
        speed += DT * (output.impedance + force - 5.0 * speed) / 1.0
        height += DT * speed
        assert output.share == 1.0
    assert height - AT > 0.02


@pytest.mark.parametrize("mode", list(filter(modes.uses_force, modes.MODE_NAMES)))
def test_a_nut_that_stands_against_more_than_friction_is_pressed_by_nothing_else(mode):
    """An obstacle that the transducer does not feel met up to 113 N."""
    hard = law_after(REST._replace(mode=mode), lambda t: 30.0, 3.0)
    assert hard.friction + hard.feedback == pytest.approx(0.0, abs=0.1)
    soft = law_after(REST._replace(mode=mode), lambda t: 8.0, 3.0)
    assert soft.friction + soft.feedback == pytest.approx(SETTINGS.standing_force - 8.0, abs=0.1)
