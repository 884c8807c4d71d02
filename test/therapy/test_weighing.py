# SPDX-License-Identifier: Apache-2.0
"""The dialogue that weighs an arm: on constructed samples, and on simulated arms and modules."""

import math
import random
import re

import pytest
from weighing_stand import Stand, loose, weighed

from screw_module_ros.control.modes import (
    COMBINED,
    FORCE_FEEDBACK,
    FRICTION_COMPENSATION,
    IMPEDANCE,
    OBSERVER,
    OFF,
)
from screw_module_ros.plant.settings import load_world
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.line import NO_SLOT
from screw_module_ros.therapy.weighing import Weighing, places
from screw_module_ros.therapy.wishes import WishLimits

HOLDING = (IMPEDANCE, FRICTION_COMPENSATION, FORCE_FEEDBACK, COMBINED, OBSERVER)
WHERE = places(WishLimits().ranges())
LYING = (0.0, -0.1, 0.05)


class Dialogue:
    """A weighing, fed with samples at 200 Hz of a hand that follows its slot."""

    def __init__(self, **given):
        self.weighing = Weighing(WHERE, **given)
        self.at_ns = 1_000_000_000
        self.place = LYING
        self.told = []

    def feed(self, seconds, fz=0.0, fx=0.0, stop="", rate=200.0, off=0.0):
        """Feed samples; fz, fx: a force [N] or of the time [s]; off: above the place where it
        is weighed, a way or one of the time [m]."""
        step_ns = round(1e9 / rate)
        for k in range(round(seconds * rate)):
            weighing, self.at_ns = self.weighing, self.at_ns + step_ns
            wish = weighing.wish
            if wish is not NO_SLOT:
                self.place = wish.plane.target_x, wish.plane.target_y, wish.vertical.target_x
            force = fz(k / rate) if callable(fz) else fz
            x, y, z = self.place
            away = off(k / rate) if callable(off) else off
            away = away if "let it hang: " in weighing.told else 0.0
            weighing.take(HandSample(k, self.at_ns, x, y, z + away, 0.0, 0.0, 0.0, fx, 0.0, force,
                                     stop))  # fmt: skip
            self.told += [weighing.told] if weighing.told not in self.told else []
        return self.weighing

    def strapped(self, zero=0.0):
        """Measure the empty cradle and press the button."""
        assert self.feed(1.2, zero).told.startswith("strap")
        self.weighing.press()
        return self


def test_from_the_empty_cradle_to_a_weight():
    dialogue = Dialogue(cradle=2.0).strapped(zero=0.4)
    weighing = dialogue.feed(60.0, fz=-17.6)
    assert not weighing.is_on and weighing.wish is NO_SLOT
    assert weighing.result[0] == pytest.approx(16.0), "less the zero, less the cradle"
    assert weighing.result[1] == pytest.approx(0.0, abs=1e-9)
    assert weighing.told == "the arm weighs 16.0 N"
    assert dialogue.told == [
        "keep off the handle: the empty cradle is measured",
        "strap the arm in and lay it down, then press again and let it hang",
        "let it hang: near, 1 of 3", "let it hang: far, 2 of 3", "let it hang: high, 3 of 3",
        "the arm weighs 16.0 N; the arm is brought back", "the arm weighs 16.0 N",
    ]  # fmt: skip
    assert dialogue.place == pytest.approx(LYING), "it lies again where it was strapped in"


def test_an_arm_that_is_heavier_far_out_is_weighed_with_what_to_expect():
    dialogue = Dialogue().strapped()
    weighing = dialogue.weighing
    while weighing.is_on:
        dialogue.feed(0.1, fz=-18.0 if dialogue.place == WHERE[1] else -12.0)
    assert weighing.result[1] == pytest.approx(6.0)
    assert weighing.told == (
        "the arm weighs 14.0 N; heavier far out: support the mean, expect ±3.0 N"
    )


def test_places_are_near_far_and_high_within_the_workspace():
    (_, near, z), (_, far, level), (_, _, high) = WHERE
    assert -0.15 < near < 0.0 < far < 0.15
    assert 0.03 < z == level < high < 0.33
    flat = places(WishLimits(low=0.2, high=0.2).ranges())
    assert [place[2] for place in flat] == pytest.approx([0.2] * 3)


@pytest.mark.parametrize(("force", "sentence"), [
    (-3.2, r"shows 3\.2 N \(1 N at most\)"),  # an arm lies in it, or it was never tared
    (lambda t: 2.0 * math.sin(20.0 * t), r"varying by 1\.4 N \(0\.7 N at most\)"),
])  # fmt: skip
def test_a_handle_that_is_not_empty_is_no_zero(force, sentence):
    weighing = Dialogue().feed(1.2, force)
    assert not weighing.is_on and weighing.result is None
    assert weighing.told.startswith("not weighed: the empty cradle")
    assert re.search(sentence, weighing.told)


REFUSED = [
    ({"fz": -18.0, "off": -0.15}, "the hand is 150 mm from the place near (60 mm at most)"),
    ({"fz": -18.0, "off": lambda t: 0.01 * (t % 1.0)}, "the hand moves by"),
    ({"fz": lambda t: -9.0 + 2.0 * math.sin(31.0 * t)}, "the weight varies by 1.4 N (0.7 N at"),
    ({"fz": -18.0, "fx": -9.0}, "the arm pulls by 9.0 N to a side (8 N at most)"),
    ({"fz": -1.0}, "1.0 N hang on the handle (from 2 to 25 N wanted)"),
    ({"fz": -31.0}, "31.0 N hang on the handle (from 2 to 25 N wanted)"),
    ({"fz": -18.0, "rate": 20.0}, "61 samples in 3 s (150 at least)"),
]


@pytest.mark.parametrize(("fed", "sentence"), REFUSED)
def test_each_guard_has_its_sentence_and_brings_the_arm_back(fed, sentence):
    dialogue = Dialogue().strapped()
    weighing = dialogue.feed(60.0, **fed)
    assert not weighing.is_on and weighing.result is None
    assert weighing.told.startswith(f"not weighed: {sentence}")
    assert weighing.told.endswith("hen weigh again"), "the way out"
    assert dialogue.place == pytest.approx(LYING)


def test_the_zero_ages():
    dialogue = Dialogue()
    dialogue.feed(1.2)
    dialogue.at_ns += 31 * 60 * 1_000_000_000
    dialogue.weighing.press()
    weighing = dialogue.feed(0.1)
    assert not weighing.is_on and weighing.wish is NO_SLOT
    assert weighing.told.startswith(
        "not weighed: the empty cradle was measured 31 min ago (30 min at most)"
    )


def test_without_torque_it_waits_with_the_arm_and_ends_while_the_arm_hangs():
    dialogue = Dialogue().strapped()
    weighing = dialogue.feed(1.0, stop="the vertical torque is off")
    assert weighing.wish is NO_SLOT
    assert weighing.told == (
        "the robot cannot hold the arm: the vertical torque is off; mend that, then press again"
    )
    assert dialogue.feed(1.0).wish is NO_SLOT, "not by itself"
    weighing.press()
    assert dialogue.feed(1.0, fz=-18.0).wish is not NO_SLOT
    dialogue.feed(0.1, fz=-18.0, stop="the vertical torque is off")
    assert not weighing.is_on and weighing.wish is NO_SLOT
    assert weighing.told == "not weighed: the vertical torque is off"


def test_the_button_ends_it():
    dialogue = Dialogue().strapped()
    dialogue.feed(4.0, fz=-18.0)
    dialogue.weighing.press()
    assert dialogue.feed(0.01, fz=-18.0).told.endswith("the arm is brought back")
    dialogue.weighing.press()  # nothing more to end
    weighing = dialogue.feed(10.0, fz=-18.0)
    assert weighing.told == "not weighed: the therapist ended it" and weighing.result is None
    assert dialogue.place == pytest.approx(LYING)
    empty = Dialogue()
    empty.feed(0.5)
    empty.weighing.press()
    assert not empty.weighing.is_on


@pytest.mark.parametrize("lost", [{"fz": math.nan}, {"fz": -18.0, "off": math.nan}])
def test_what_is_not_known_is_not_weighed(lost):
    dialogue = Dialogue().strapped()
    dialogue.feed(1.0, fz=-18.0)
    weighing = dialogue.feed(0.1, **lost)
    assert not weighing.is_on and weighing.told.startswith("not weighed: where the hand")


@pytest.mark.parametrize("seed", range(20))
def test_twenty_arms_on_twenty_modules_are_weighed_within_a_newton(seed):
    """Of 5 to 24 N, with a spring of their own up to 30 N/m, in any mode that holds."""
    draw = random.Random(seed)
    arm = loose(5.0 + seed, draw.uniform(0.0, 30.0))
    stand = weighed(load_world(perturb_seed=seed), arm, HOLDING[seed % 5], seed=seed)
    result = stand.weighing.result
    assert result is not None, stand.weighing.told
    assert result[0] == pytest.approx(arm.weight, abs=1.0)


@pytest.mark.parametrize("mode", [IMPEDANCE, FORCE_FEEDBACK, OBSERVER])
@pytest.mark.parametrize("helped", [0.5, 0.0])
def test_a_patient_who_helps_with_a_trembling_arm_is_refused(mode, helped):
    arm = loose(18.0, 500.0)._replace(tremor=0.008, carried=helped, damping=20.0)
    weighing = weighed(load_world(), arm, mode).weighing
    assert weighing.result is None and "he helps or trembles" in weighing.told


def test_a_patient_who_pulls_is_refused():
    weighing = weighed(load_world(), loose(18.0), FORCE_FEEDBACK, aside=9.0).weighing
    assert weighing.result is None and "pulls by 9.0 N" in weighing.told


def test_without_a_mode_nothing_holds_the_arm():
    weighing = weighed(load_world(), loose(18.0), OFF).weighing
    assert weighing.result is None and "choose a mode other than 0" in weighing.told


def test_the_arm_is_led_gently():
    """Nothing drops it between the places, and it is laid down as softly."""
    stand = Stand(load_world(), loose(20.0), OBSERVER)
    stand.run(lambda weighing: weighing.told.startswith("strap"))
    stand.strap_in()
    fastest = 0.0
    while stand.weighing.is_on:
        stand.step()
        fastest = max(fastest, abs(stand.state.module.handle_velocity))
    assert stand.weighing.result is not None and fastest < 0.35
