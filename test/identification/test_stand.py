# SPDX-License-Identifier: Apache-2.0
"""The in-process stand agrees with the rig's world, in any chunks, with the zero subtracted."""


import numpy as np
import pytest

from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control import modes
from screw_module_ros.control.envelope import initial_state
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.support import SupportState
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification.stand import LoopSettings, SimulatedStand
from screw_module_ros.identification.trials import (
    Cancelled,
    MotionTrial,
    StageTrial,
    TorqueTrial,
)
from screw_module_ros.identification.vertical_loop import COLUMNS, ticks_of
from screw_module_ros.plant.world import World


def quietly(share):
    """Ignore the progress."""


def without_noise(module):
    """Return the module with a perfect transducer."""
    return module._replace(sensor=type(module.sensor)(*(0.0,) * 6, 900.0, 1e5))


def test_stage_run_shows_what_the_rigs_world_shows(module):
    perfect = without_noise(module)
    samples = SimulatedStand(perfect).record(StageTrial(0.05, 0.1, 0.12), quietly)
    world = World(perfect)
    world.place(0.1)
    world.set_fixture("stage", speed=0.05)
    shown = []
    for _ in range(len(samples.time)):
        shown.append((world.encoder_count * 9.525e-7, world.truth().patient_force))
        world.advance(0.0005)
    there, forces = np.array(shown).T
    before_end = samples.position < 0.119
    assert np.abs(samples.position - there)[before_end].max() < 3e-6
    # The world's encoder and force are read before the last substep of another rounding.
    assert np.abs(samples.force - forces)[before_end].mean() < 0.01


def test_compiled_loop_is_the_plain_one(stand):
    trial = MotionTrial(modes.COMBINED, VerticalSettings())
    params = stand._params(trial, THESIS)
    start = stand._placed(params, stand._start(trial, THESIS, params))
    plain, quick = np.empty((40, COLUMNS)), np.empty((40, COLUMNS))
    run, memory = ticks_of(THESIS), initial_state(params.law, THESIS, params.own)
    run([params], start._replace(law=[memory], support=[SupportState()]), plain)
    compiled(run)(packed(params), start, quick)
    assert quick == pytest.approx(plain, abs=1e-9)


@pytest.mark.parametrize("periods", [1, 2, 20])
def test_a_delay_of_whole_periods_is_kept_whole(module, periods):
    """A sine asked for later by n periods comes n samples later, by the current's own sensor."""
    trial = TorqueTrial(40.0, 0.1, 0.1)
    prompt, late = (
        SimulatedStand(module, LoopSettings(command_delay=100e-6 + n * 500e-6)).record(
            trial, quietly
        )
        for n in (0, periods)
    )
    shifted = late.current[periods:]
    assert np.abs(prompt.current).max() > 1e-3
    assert shifted == pytest.approx(prompt.current[: len(shifted)], abs=1e-9)


def test_chunks_do_not_matter(stand, monkeypatch):
    trial = StageTrial(0.1, 0.1, 0.14)
    whole = stand.record(trial, quietly)
    monkeypatch.setattr("screw_module_ros.identification.stand._CHUNK", 137)
    pieces = stand.record(trial, quietly)
    assert np.array_equal(whole.force, pieces.force)


def test_same_seed_same_samples_another_seed_or_trial_another_noise(module):
    trial = StageTrial(0.1, 0.1, 0.12)
    first, again, other = (SimulatedStand(module, seed=s).record(trial, quietly) for s in (4, 4, 5))
    assert np.array_equal(first.force, again.force)
    longer = SimulatedStand(module, seed=4).record(trial._replace(end=0.13), quietly)
    for another in (other, longer):
        beyond = (first.force[:200] - another.force[:200]).std()
        assert beyond > 0.03, "noise of 0.05 N in each"
    assert np.abs(first.force.mean() - other.force.mean()) < 0.1, "the zero is taken off"


def test_drift_of_the_transducer_is_taken_off(module):
    # Ten minutes of drift; a plateau of zero force stays where it is.
    drifting = without_noise(module)
    drifting = drifting._replace(sensor=drifting.sensor._replace(force_drift=5.0, drift_time=100.0))
    level = without_noise(module)
    trial = StageTrial(0.002, 0.1, 0.2)
    shown = SimulatedStand(drifting).record(trial, quietly).force
    true = SimulatedStand(level).record(trial, quietly).force
    # What is left is how far the exponential bends away from the straight line between both zeros.
    assert np.abs(shown - true)[[50, -50]].max() < 0.15
    assert np.abs(shown - true).max() < 0.6


def test_preloaded_nut_has_no_play_to_cross(module):
    # On a rigid support: that of the module chatters at this gain without any play.
    stiff = module._replace(vertical=module.vertical._replace(support_stiffness=1e12))
    perfect = SimulatedStand(without_noise(stiff))
    law = VerticalSettings(force_gain=20.0)
    play = MotionTrial(modes.FORCE_FEEDBACK, law, duration=4.0)
    loose, tight = (
        np.diff(perfect.record(play._replace(preloaded=preloaded), quietly).force).std()
        for preloaded in (False, True)
    )
    assert tight < 0.5 * loose


def test_a_change_of_the_rig_does_not_persist(stand):
    trial = MotionTrial(modes.OBSERVER, VerticalSettings(), duration=0.5)
    before, changed, after = (
        stand.record(trial._replace(changed=seed), quietly).position for seed in (0, 5, 0)
    )
    assert (before == after).all() and (before != changed).any()


def test_torque_sine_reaches_the_transducer_in_per_mille_of_the_rated_torque(stand):
    trial = TorqueTrial(1.0, 0.3, 1.0, default_linearization())
    samples = stand.record(trial, quietly)
    steps = samples.command / 0.42 * 1000.0
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert samples.torque.max() == pytest.approx(0.3, abs=0.01)
    assert np.isfinite(samples.current).all()


def test_the_transducer_has_the_noise_of_its_settings(stand):
    slow = stand.record(TorqueTrial(1.0, 0.05, 1.0), quietly).torque
    assert np.diff(slow).std() / np.sqrt(2.0) == pytest.approx(
        stand.world.sensor.torque_noise, rel=0.1
    )


@pytest.mark.parametrize("rate", [500.0, 1000.0, 4000.0])
def test_other_rates(stand, rate):
    samples = stand.record(TorqueTrial(5.0, 0.1, 0.4, rate=rate), quietly)
    assert np.diff(samples.time) == pytest.approx(1.0 / rate)
    assert len(samples.time) == round(0.4 * rate)


def test_cancel_ends_a_trial(stand):
    def stop(share):
        if share > 0.0:
            raise Cancelled

    with pytest.raises(Cancelled):
        stand.record(StageTrial(0.001, 0.0, 0.355), stop)
