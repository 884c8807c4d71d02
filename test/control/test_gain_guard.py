# SPDX-License-Identifier: Apache-2.0
"""The guard: a damper, a higher corner and less gain while the robot drives; hands keep theirs."""

import math

import pytest
from law_runs import DT, VERTICAL, initial_state, vertical_outputs

from screw_module_ros.control import modes
from screw_module_ros.control.gain_guard import (
    BEGIN,
    END,
    FORGOTTEN,
    GROWTH,
    KEPT,
    PASSIVE,
    PER_NEED,
    RETURN,
    GainGuard,
    damper_force,
    forget,
    guard_step,
    guarded,
    largest_raise,
    raise_corner,
    tune_guard,
)
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.vertical import VerticalInput

LIMIT, LEAST = 1.2, 0.6
AT = 0.18
REST = VerticalInput(modes.IMPEDANCE, AT, 0.0, 0.0, AT, 0.0, True)


def quiet():
    """A guard that has seen nothing."""
    guard = GainGuard()
    tune_guard(guard, DT)
    return guard


def sine(amplitude, frequency, phase=0.0):
    return lambda t: amplitude * math.sin(2.0 * math.pi * frequency * t + phase)


def nothing(t):
    return 0.0


def after(force, error, speed, seconds, guard=None):
    """A guard after the handle's force, one beside the impedance's, and a speed of the nut.

    All three are functions of time; the least share that it left comes second.
    """
    guard, least = guard or quiet(), 1.0
    for k in range(round(seconds / DT)):
        t = k * DT
        guard_step(guard, force(t), error(t), speed(t), LEAST, LIMIT, DT)
        least = min(least, guard.share)
    return guard, least


def shaken(force, seconds, guard=None):
    """A guard after a force on a nut that does not move."""
    return after(force, nothing, nothing, seconds, guard)[0]


def moved(error, speed, seconds, guard=None):
    """A guard after a force beside the impedance's and a speed of the nut."""
    return after(nothing, error, speed, seconds, guard)[0]


# -- chatter -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "frequency", "seconds", "share"),
    [
        (6.0, 90.0, 0.25, 0.0),  # a quarter of a second takes the gain away
        (6.0, 140.0, 0.25, 0.0),
        (3.0, 120.0, 0.05, 1.0),  # a weaker one takes longer, and as much
        (3.0, 120.0, 1.5, 0.0),
    ],
)
def test_chatter_takes_the_gain_away(size, frequency, seconds, share):
    assert shaken(sine(size, frequency), seconds).share == share


def jolt(t):
    return 30.0 if 0.3 < t < 0.32 else 0.0


def grip(t):
    """A hand that grips within 50 ms [N]."""
    return 12.0 * min(1.0, t / 0.05)


@pytest.mark.parametrize(
    "force",
    [sine(40.0, 0.5), sine(5.0, 5.0), sine(1.0, 100.0), jolt, grip],
    ids=["a hand that works", "tremor", "noise", "jolt", "grip"],
)
def test_what_hands_do_is_no_chatter(force):
    assert after(force, nothing, nothing, 2.0)[1] == 1.0


def test_the_gain_is_back_soon_after_the_chatter():
    guard = shaken(sine(6.0, 120.0), 1.0)
    assert 0.0 < shaken(nothing, 0.3, guard).share < 1.0
    assert shaken(nothing, 1.5 * RETURN + 0.1, guard).share == 1.0


# -- passivity -----------------------------------------------------------------------------------


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
        power += damper_force(guard, speed(t), 1.0, 200.0) * speed(t)
        motion += speed(t) ** 2
    assert power / motion == pytest.approx(guard.passivity.need, rel=0.25)


def test_the_damper_has_a_limit_and_a_weight():
    force, speed = shown(-90.0, 10.0)
    guard = moved(force, speed, 1.0)
    guard.passivity.slow = 0.0
    assert damper_force(guard, 0.1, 1.0, 40.0) == pytest.approx(4.0)
    assert damper_force(guard, 0.1, 0.5, 40.0) == pytest.approx(2.0)


def test_a_hand_in_motion_hardly_feels_the_damper():
    """At half a hertz a damper of 60 Ns/m would take 20 N."""
    force, speed = shown(-60.0, 12.0)
    guard = moved(force, speed, 1.0)
    hand, largest = sine(0.3, 0.5), 0.0
    for k in range(500):
        guard_step(guard, 0.0, 0.0, hand(k * DT), LEAST, LIMIT, DT)
        largest = max(largest, abs(damper_force(guard, hand(k * DT), 1.0, 200.0)))
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
    guard, least = after(nothing, force, speed, 3.0)
    assert least == 1.0
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


# -- corner --------------------------------------------------------------------------------------

MOST, ROUGH = 3.5, 0.24
SWINGS = shown(-60.0, 10.0)  # as a soft grip does


def raised(error, speed, seconds, guard=None, force=nothing):
    """A guard after a force beside the impedance's and a speed of the nut, with a leaky gain."""
    guard = guard or quiet()
    for k in range(round(seconds / DT)):
        t = k * DT
        guard_step(guard, force(t), error(t), speed(t), LEAST, LIMIT, DT)
        raise_corner(guard, MOST, ROUGH, DT)
    return guard


def test_a_robot_that_drives_raises_the_corner_and_a_hand_that_drives_does_not():
    assert raised(*SWINGS, 0.5).corner == pytest.approx(MOST)
    assert raised(*shown(20.0, 5.0), 0.5).corner == 1.0


def test_a_corner_rises_in_proportion_to_what_is_missing():
    for missing in (2.0, 4.0, 8.0):
        guard = raised(*shown(-missing, 10.0, size=2.0, spring=0.0), 0.5)
        assert guard.corner == pytest.approx(1.0 + (PASSIVE + missing) / PER_NEED, rel=0.1)


def test_rapid_force_takes_the_corner_back_before_any_gain():
    """A heavy hand with a long delay chatters with a corner that a soft grip wants."""
    guard = raised(*SWINGS, 0.5)
    rough = sine(1.2, 80.0)
    raised(nothing, nothing, 20.0 / GROWTH, guard, rough)
    assert guard.corner < 1.2
    assert guard.chatter.share == 1.0
    assert raised(*SWINGS, 0.3, guard).corner < 1.5, "nor soon again"
    raised(nothing, nothing, 2.0 * FORGOTTEN, guard)
    assert raised(*SWINGS, 0.5, guard).corner == pytest.approx(MOST)


def test_a_corner_comes_back_slowly():
    guard = raised(*SWINGS, 0.5)
    raised(nothing, nothing, FORGOTTEN, guard)
    assert guard.corner - 1.0 == pytest.approx((MOST - 1.0) / math.e, rel=0.1)


def test_a_loop_that_turns_too_far_keeps_the_corner_that_was_set():
    assert largest_raise(9.0, 9.0, 0.01, DT) == 1.0
    assert largest_raise(9.0, 9.0, 1.4e-3, DT) == pytest.approx(3.1, abs=0.02)


# -- in the law ----------------------------------------------------------------------------------


def law_after(inp, force, seconds=1.5, state=None):
    """The law's last output for a handle force, a function of time [N]."""
    times = [tick * DT for tick in range(round(seconds / DT))]
    inputs = [inp._replace(force=force(time)) for time in times]
    return vertical_outputs(inputs, VERTICAL, state)[-1]


@pytest.mark.parametrize(
    "inp", [REST._replace(mode=modes.OBSERVER, active=False), REST, REST._replace(mode=modes.OFF)]
)
def test_shaking_that_no_gain_causes_takes_no_gain_away(inp):
    """Mounting a handle without torque left mode 5 with 40 % of its gain for a minute."""
    assert law_after(inp, sine(10.0, 120.0)).share == 1.0


@pytest.mark.parametrize("mode", [mode for mode in THESIS.variants if mode != modes.IMPEDANCE])
def test_shaking_in_a_mode_with_a_gain_takes_it_away(mode):
    assert law_after(REST._replace(mode=mode), sine(10.0, 120.0)).share == 0.0


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
def test_a_handle_that_rests_may_chatter_with_less_than_one_that_moves(mode):
    """In motion the play of the screw knocks, and a knock is no chatter."""
    inp = REST._replace(mode=mode)
    shakes = sine(1.2, 120.0)
    assert law_after(inp, shakes, 3.0).share < 1.0
    moving = [
        inp._replace(
            force=shakes(tick * DT), velocity=0.1, position=AT + 0.1 * DT * tick,
            setpoint_position=AT + 0.1 * DT * tick, setpoint_velocity=0.1,
        )
        for tick in range(1500)
    ]  # fmt: skip
    assert vertical_outputs(moving, VERTICAL)[-1].share == 1.0


def test_a_raised_corner_ends_with_its_mode():
    state = initial_state(VERTICAL)
    law_after(REST._replace(mode=modes.OBSERVER), nothing, state=state)
    state.guard.corner = 2.0
    law_after(REST, nothing, state=state)
    assert state.guard.corner == 1.0


def test_what_the_guard_took_is_forgotten_with_the_gain():
    """A share that stayed in mode 1 warned there, and met the next mode."""
    state = initial_state(VERTICAL)
    shaking = REST._replace(mode=modes.OBSERVER)
    assert law_after(shaking, sine(10.0, 120.0), state=state).share == 0.0
    state.guard.passivity.need = 60.0
    assert law_after(REST, nothing, state=state).share == 1.0
    assert state.guard.passivity.need == 0.0


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_its_damper_acts_in_a_slot_too(weight):
    """A slot takes the place of spring and damper."""
    state = initial_state(VERTICAL)
    inp = REST._replace(mode=modes.FORCE_FEEDBACK, slot_weight=weight)
    law_after(inp, nothing, state=state)
    state.guard.passivity.need = 40.0
    places = [AT + 0.1 * DT * tick for tick in range(1, 21)]
    moving = [inp._replace(velocity=0.1, position=place) for place in places]
    assert vertical_outputs(moving, VERTICAL, state)[-1].impedance < -0.5


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.OBSERVER])
def test_a_set_point_that_moves_the_hand_takes_no_gain_away(mode):
    """It gives power to the hand, as an oscillation does that the robot drives."""
    law = VERTICAL._replace(stiffness=800.0, damping=20.0)
    state, height, speed = initial_state(law), AT, 0.0
    for sought in [AT] * 1000 + [AT + 0.05] * 1000:
        force = -400.0 * (height - AT) - 30.0 * speed  # of a hand on a weightless handle
        inp = VerticalInput(mode, height, speed, force, sought, 0.0, True)
        (output,) = vertical_outputs([inp], law, state)
        assert output.share == 1.0
        speed += DT * (output.impedance + force - 5.0 * speed) / 1.0
        height += DT * speed
    assert height - AT > 0.02


@pytest.mark.parametrize("mode", [mode for mode, each in THESIS.variants.items() if each.gains])
@pytest.mark.parametrize(("hand", "left"), [(30.0, 0.0), (8.0, VERTICAL.standing_force - 8.0)])
def test_a_nut_that_stands_against_more_than_friction_is_pressed_by_nothing_else(mode, hand, left):
    """An obstacle that the transducer does not feel met up to 113 N."""
    output = law_after(REST._replace(mode=mode), lambda t: hand, 3.0)
    assert output.friction + output.feedback == pytest.approx(left, abs=0.1)
