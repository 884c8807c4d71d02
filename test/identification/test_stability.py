# SPDX-License-Identifier: Apache-2.0
"""The sampled loop against integration in time, and against what is known in closed form."""

import math

import numpy as np
import pytest

from screw_module_ros.calibration.certificate import (
    FEEDBACK,
    LEAST,
    MOST,
    OBSERVED,
    Conditions,
    conditions_of,
    load_certificate,
)
from screw_module_ros.control.vertical_settings import KNOWN_SHARE, VerticalSettings
from screw_module_ros.identification import certificate, stability
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import Quantity, Result
from screw_module_ros.identification.sampled_loop import (
    Environment,
    Feedback,
    Mechanism,
    Observer,
    Sampling,
    _feedback,
    _observer,
    _radius,
    largest_gain,
    sampled,
)
from screw_module_ros.identification.trials import WAYS_OUT

pytestmark = pytest.mark.long

HAND = Environment()


def integrated(mechanism, environment, sampling, law, ticks=500):
    """Growth per tick of the loop, integrated in small steps; written out again."""
    dt = 1e-6
    steps = round(1.0 / sampling.rate / dt)
    late = round(sampling.delay / dt)
    build = _observer if isinstance(law, Observer) else _feedback
    a, b, c, d = build(law, 1.0 / sampling.rate)
    inner, history = np.zeros(len(a)), [0.0] * 10
    nut, nut_v, handle, handle_v, made, shown = 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0
    m, e = mechanism, environment
    sizes = []
    for _ in range(ticks):
        seen = np.array([nut, shown])
        history.insert(0, float(c @ inner + d @ seen))
        inner = a @ inner + b @ seen
        for step in range(steps):
            age = (step - late) // steps  # 0: this period's command, -1: the one before
            command = history[-age] if age > -9 else 0.0
            made += dt * 2 * math.pi * m.amplifier * (command - made)
            contact = m.contact_stiffness * (handle - nut) + m.contact_damping * (handle_v - nut_v)
            held = -e.stiffness * handle - e.damping * handle_v
            handle_a = (held - contact) / (m.handle_mass + e.mass)
            nut_v += dt * (made + contact) / m.nut_mass
            handle_v += dt * handle_a
            nut += dt * nut_v
            handle += dt * handle_v
            shown += dt * 2 * math.pi * m.transducer * (held - e.mass * handle_a - shown)
        sizes.append(abs(shown) + abs(made))
    late_size, early = max(sizes[-40:]), max(sizes[-240:-200])
    return (late_size / early) ** (1 / 200)


@pytest.mark.parametrize(
    ("law", "sampling"),
    [
        (Feedback(30.0), Sampling(1000.0, 1.26e-3)),
        (Feedback(40.0), Sampling(2000.0, 0.385e-3)),
        (Observer(60.0), Sampling(1000.0, 1.26e-3)),
        (Observer(60.0, inertia=0.7), Sampling(1000.0, 1.26e-3)),
    ],
)
def test_unstable_loops_grow_as_their_eigenvalue_says(law, sampling):
    soft = Mechanism(contact_stiffness=1e6, contact_damping=500.0)
    radius = _radius(sampled(soft, HAND, sampling), sampling, law)
    assert radius > 1.005
    assert integrated(soft, HAND, sampling, law) == pytest.approx(radius, abs=0.002)


def test_published_study_of_this_loop():
    """Four cases found by another program, which also had the amplifier's 0.22 ms of lag."""
    stiff = Mechanism()
    assert largest_gain(stiff, HAND, Sampling(2000.0, 0.385e-3), Feedback(1.0)) == pytest.approx(
        22.1, rel=0.1
    )
    assert largest_gain(stiff, HAND, Sampling(1000.0, 1.26e-3), Feedback(1.0)) == pytest.approx(
        14.7, rel=0.1
    )
    heavy = Environment(30.0, 300.0, 30.0)
    assert largest_gain(stiff, heavy, Sampling(1000.0, 1.26e-3), Feedback(1.0)) == pytest.approx(
        5.5, rel=0.1
    )


def test_hand_formula_is_on_the_safe_side_and_near_where_the_contact_is_stiff():
    stiff = Mechanism(contact_stiffness=1e9, contact_damping=3e4, transducer=1e5)
    for mass in (3.0, 10.0, 30.0):
        arm = Environment(mass, 0.0, 20.0)
        for sampling in (Sampling(1000.0, 1.26e-3), Sampling(2000.0, 0.385e-3)):
            exact = largest_gain(stiff, arm, sampling, Feedback(1.0, stiffness=20.0))
            by_hand = stability.hand_formula(stiff, arm, sampling, 30.0)
            assert 0.7 * exact < by_hand < 1.1 * exact


def test_hand_formula_says_when_it_does_not_hold():
    soft = Mechanism(contact_stiffness=1e5)
    assert math.isnan(stability.hand_formula(soft, HAND, Sampling(), 30.0))
    assert math.isnan(stability.hand_formula(Mechanism(), Environment(0.0), Sampling(), 30.0))
    light_wall = Environment(1.0, 1e5, 30.0)
    assert largest_gain(Mechanism(), light_wall, Sampling(), Feedback(1.0)) < 1.0
    assert math.isnan(stability.hand_formula(Mechanism(), light_wall, Sampling(), 30.0))


def test_observer_default_gain_has_a_margin_with_hand_and_heavy_arm():
    law = Observer(10.0, stiffness=100.0, damping=6.0)
    for environment, margin in ((HAND, 2.0), (Environment(30.0, 300.0, 30.0), 1.2)):
        assert largest_gain(Mechanism(), environment, Sampling(), law) > margin * law.gain


def test_carried_mass_leaves_the_margin_of_the_default_gain():
    """All of the share in, as for a firm hand; the observer assumes 0.9 kg too much."""
    light = Mechanism(nut_mass=3.6)
    for environment, margin in ((HAND, 2.0), (Environment(30.0, 300.0, 30.0), 1.2)):
        for inertia in (0.0, 0.7):
            law = Observer(9.0, inertia=inertia)
            assert largest_gain(light, environment, Sampling(), law) > margin * law.gain


@pytest.mark.parametrize("rest_damping", [40.0, 80.0])
def test_damper_at_rest_costs_hardly_any_gain(rest_damping):
    """Default and largest value of the parameter; 30 is the largest gain of the law."""
    most = VerticalSettings(rest_damping=rest_damping)
    moving, resting = stability._observers(most)
    assert resting.damping == moving.damping + rest_damping
    for soft in (1e6, 20e6):
        for name, least in (("hand", 0.94), ("heavy_arm", 0.99), ("wall", 1.0)):
            _, on = stability.ENVIRONMENTS[name]
            given = (Mechanism(contact_stiffness=soft), on, Sampling())
            assert largest_gain(*given, resting) >= least * largest_gain(*given, moving)
            assert stability.weakest(*given, (moving, resting))[0] <= largest_gain(*given, moving)
        released = (Mechanism(contact_stiffness=soft), Environment(0.0, 0.0, 0.0), Sampling())
        assert largest_gain(*released, resting) > 30.0


def test_what_limits_is_what_helps_most_when_taken_away():
    slow = Sampling(1000.0, 6e-3)
    costs = stability.limits(Mechanism(), Environment(1.0, 300.0, 5.0), slow, Feedback(1.0))
    assert costs["the delay"] > 1.3
    assert costs["the contact"] == pytest.approx(1.0, abs=0.2)


class Nothing:
    """A bench without a module."""

    rate, name, offers = 1000.0, "no module", frozenset(WAYS_OUT)


def test_experiment_predicts_without_a_simulated_module(tmp_path):
    result = stability.run(Lab(Nothing(), tmp_path), stability.Settings())
    assert result.value("feedback_hand") == pytest.approx(14.1, rel=0.05)
    assert result.value("observer_hand") > result.value("feedback_hand")
    assert result.value("formula_hand") == pytest.approx(result.value("feedback_hand"), rel=0.35)
    with pytest.raises(KeyError):
        result.quantity("formula_wall")
    assert any("limited by" in note for note in result.notes)
    assert stability.draw(result)["stability"].axes
    assert_certified(result, tmp_path)


def assert_certified(result, folder):
    """Check that the certificate permits what is stable on hand, heavy arm and damped wall."""
    result.save(folder)
    delivered = Result("delivered_impedance", (), {"stiffness": 100.0}, (), {})
    certificate.write(Lab(Nothing(), folder), delivered, "ARM-0007")
    permitted = load_certificate(folder / certificate.FILE, "ARM-0007")
    assert permitted.conditions == conditions_of(VerticalSettings(), 1000.0, 1.26e-3, 30.0)
    for law, gain in zip(("feedback", "observer"), permitted.permitted_gains, strict=True):
        stable = [result.value(f"{law}_{met}") for met in ("hand", "heavy_arm", "wall")]
        assert min(stable) - 0.01 <= gain <= min(stable)


SLOW_LOOP = conditions_of(VerticalSettings(observer_inertia=0.35), 1000.0, 1.26e-3, 30.0)


def permitted_with(conditions: Conditions) -> dict[str, float]:
    """Return the largest gains that are stable on hand, heavy arm and damped wall, by setting."""
    c, usual = conditions, VerticalSettings()
    laws = {
        FEEDBACK: Feedback(1.0, c.force_cutoff, velocity_cutoff=c.velocity_cutoff),
        OBSERVED: Observer(1.0, c.observer_cutoff, c.observer_bandwidth, c.mass, c.observer_delay,
                           usual.stiffness, usual.least_damping, c.observer_inertia),
    }  # fmt: skip
    met = [stability.ENVIRONMENTS[name][1] for name in ("hand", "heavy_arm", "wall")]
    return {
        setting: min(largest_gain(Mechanism(), on, Sampling(c.rate, c.delay), law) for on in met)
        for setting, law in laws.items()
    }


@pytest.mark.parametrize("loop", [SLOW_LOOP, SLOW_LOOP._replace(rate=2000.0, delay=0.385e-3)])
def test_what_a_certificate_refuses_costs_margin(loop):
    """More delay too, which the controller does not know; the velocity filter costs nothing.

    A slower loop has the same number of periods of delay, and with that more of it.
    """
    usual = permitted_with(loop)
    for name, gains in {**LEAST, **MOST, "delay": (FEEDBACK, OBSERVED)}.items():
        share = 0.6 if name in LEAST else 1.8
        other = loop._replace(**{name: share * getattr(loop, name)})
        if name == "rate":
            other = other._replace(delay=loop.delay / share)
        found = permitted_with(other)
        for gain in (FEEDBACK, OBSERVED):
            assert (found[gain] < usual[gain]) == (gain in gains), (name, gain)
    for cutoff in (10.0, 100.0):
        assert permitted_with(loop._replace(velocity_cutoff=cutoff)) == usual


def test_the_certificate_is_for_the_law_that_the_calibration_makes(tmp_path, monkeypatch):
    """The mass that it carries costs margin; on a light wall no gain is left, which is said."""
    light = {"light_wall": stability.ENVIRONMENTS["light_wall"]}
    monkeypatch.setattr(stability, "ENVIRONMENTS", light)
    for name, quantity in (("gravity", "gravity"), ("inertia", "mass")):
        Result(name, (Quantity(quantity, 5.1, 0.1, "", ""),), {}).save(tmp_path)
    found = stability.run(Lab(Nothing(), tmp_path), stability.Settings())
    assert (found.settings["mass"], found.settings["observer_inertia"]) == (5.1, KNOWN_SHARE)
    assert found.value("observer_light_wall") == 0.0 < found.value("feedback_light_wall")
    assert any("1 kg against a wall" in n and "no gain is stable" in n for n in found.notes)


@pytest.mark.parametrize("mass", [4.5, 7.0])
def test_the_certificate_is_for_the_mass_that_was_identified(tmp_path, monkeypatch, mass):
    """At the wall a module of 7 kg was permitted 6.3: its own law on the thesis's masses."""
    wall = stability.ENVIRONMENTS["wall"]
    monkeypatch.setattr(stability, "ENVIRONMENTS", {"wall": wall})
    for name, quantity, value in (("gravity", "gravity", 10.04), ("inertia", "mass", mass)):
        Result(name, (Quantity(quantity, value, 0.1, "", ""),), {}).save(tmp_path)
    found = stability.run(Lab(Nothing(), tmp_path), stability.Settings())
    own = Mechanism()._replace(nut_mass=mass - 10.04 / 9.81, handle_mass=10.04 / 9.81)
    laws = stability._observers(VerticalSettings().calibrated(10.04, mass))
    expected = min(largest_gain(own, wall[1], Sampling(1000.0, 1.26e-3), law) for law in laws)
    assert found.value("observer_wall") == pytest.approx(expected, rel=0.02)
    assert found.settings["nut_mass"] == own.nut_mass


def test_a_counterbalanced_handle_counts_with_the_least_mass(tmp_path):
    for name, quantity, value in (("gravity", "gravity", -0.2), ("inertia", "mass", 5.0)):
        Result(name, (Quantity(quantity, value, 0.1, "", ""),), {}).save(tmp_path)
    found = stability._weighed(Lab(Nothing(), tmp_path), stability.Settings())
    assert (found.nut_mass, found.handle_mass) == (4.95, 0.05)
