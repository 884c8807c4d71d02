# SPDX-License-Identifier: Apache-2.0
"""The plane's linear loop against the plant, and what its structure takes from the force gain."""

import math

import numpy as np
import pytest

from screw_module_ros import geometry
from screw_module_ros.calibration.plane_limits import load_plane_limits
from screw_module_ros.control.planar_settings import STUDIED_GAIN, PlanarSettings
from screw_module_ros.identification import planar_stability
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.planar_sampled_loop import (
    MOST,
    Plane,
    first_modes,
    largest_gain,
    planar_law,
    radius,
    sampled_plane,
)
from screw_module_ros.identification.rigs import drawn_plane
from screw_module_ros.identification.stand import SimulatedStand
from screw_module_ros.identification.trials import PLANE, Arm, PlanarTrial, PlaneLoop

LAW, LOOP, HAND = PlanarSettings(), PlaneLoop(), Arm()
HEAVY, GRIP = Arm(30.0, 300.0, 30.0), Arm(0.45, 1e4, 30.0)


def robot_of(module, stiffness=2e5, ratio=0.02, **more):
    return module.planar._replace(
        structure_stiffness=stiffness, structure_damping_ratio=ratio, **more
    )


def grown(module, plane, loop, law):
    """Return the growth per tick of a hand's force, simulated, without dry friction and guard.

    It begins with the noise of the force, and is judged before the law's limits act.
    """
    quiet = module._replace(
        planar=plane.robot._replace(friction=0.001, bristle_stiffness=1.0, bristle_damping=0.0),
        start=module.start._replace(joint_resolution=1e-7),
    )
    law = law._replace(
        chatter_limit=50.0, feedback_limit=150.0, force_limit=150.0, torque_rate=1e5
    )
    trial = PlanarTrial(
        law, arm=plane.environment, centre=(plane.x, plane.y), loop=loop, duration=8.0
    )
    samples = SimulatedStand(quiet).record(trial, lambda share: None)
    size = np.hypot(*samples.true_force.T)
    block = round(0.1 * loop.rate)
    peaks = size[: len(size) // block * block].reshape(-1, block).max(axis=1)
    first, last = int(np.argmax(peaks > 0.2)), int(np.argmax(peaks > 4.0))
    assert last - first >= 8, peaks
    slope = np.polyfit(np.arange(first, last), np.log(peaks[first:last]), 1)[0]
    return math.exp(slope / block)


def gain_that_grows(plane, loop, rate):
    """Return the gain with which the linear loop grows by exp(rate) in a second."""
    plant, low, high = sampled_plane(plane, loop), 0.0, MOST
    for _ in range(40):
        middle = 0.5 * (low + high)
        grows = radius(plant, plane, loop, LAW._replace(force_gain=middle)) ** loop.rate
        low, high = (low, middle) if grows > math.exp(rate) else (middle, high)
    return low


@pytest.mark.long
@pytest.mark.parametrize(
    ("stiffness", "environment", "loop"),
    [
        (5e4, HAND, LOOP),
        (1e5, HAND, LOOP),
        (2e5, HAND, LOOP),
        (1e5, HEAVY, LOOP),
        (1e5, GRIP, LOOP),
        (4e5, HEAVY, LOOP),
        (1e5, HAND, PlaneLoop(500.0, 1.5e-3, 3e-3)),
        (1e5, HAND, PlaneLoop(250.0, 0.4e-3, 1e-3)),
    ],
)
def test_unstable_loops_grow_as_their_eigenvalue_says(module, stiffness, environment, loop):
    plane = Plane(robot_of(module, stiffness), environment, 0.03, -0.05)
    gain = gain_that_grows(plane, loop, 1.0)
    assert 1.0 < gain / largest_gain(plane, loop, LAW) < 2.0
    found = grown(module, plane, loop, LAW._replace(force_gain=gain))
    # Half a substep of the plant turns the phase of 80 Hz by 0.7 degrees: 0.35 1/s, 1 % of a gain.
    assert loop.rate * math.log(found) == pytest.approx(1.0, abs=0.4)


@pytest.mark.long
def test_the_linear_law_is_impedance_and_feedback_through_the_jacobian():
    """Without a filter's delay the torques are J^T of (1 + k) Fpd + k F for slow inputs."""
    a, b, c, d = planar_law(LAW._replace(force_gain=4.0), LOOP, 0.05, -0.1)
    slow = d + c @ np.linalg.solve(np.eye(len(a)) - a, b)
    jacobian = np.array(geometry.jacobian(*geometry.inverse(0.05, -0.1))).reshape(2, 2)
    wanted = np.hstack((-5.0 * LAW.stiffness * jacobian.T @ jacobian, 4.0 * jacobian.T))
    assert slow == pytest.approx(wanted, rel=1e-4, abs=1e-3)


def test_first_modes_are_those_of_two_masses(module):
    """At the centre the arm is about 1 kg: 5.5 kg and 1 kg on a spring of 1e5 N/m."""
    low, high = first_modes(Plane(robot_of(module, 1e5)))
    light, heavy = (1e5 / (2.0 * math.pi * hz) ** 2 for hz in (high, low))
    for mass in (light, heavy):
        assert 0.7 < 1.0 / (1.0 / mass - 1.0 / 5.5) < 1.4
    stiff = first_modes(Plane(robot_of(module, 4e5)))
    assert stiff == pytest.approx((2.0 * low, 2.0 * high))


def test_the_structure_decides_in_a_hand_and_the_grip_in_a_grip(module):
    """Twice the damping bears about twice the gain; a soft grip's limit is its own."""

    def limit(environment, stiffness, ratio=0.02, **more):
        robot = robot_of(module, stiffness, ratio)
        return largest_gain(Plane(robot, environment, **more), LOOP, LAW)

    soft, firm, stiff = (limit(HAND, stiffness) for stiffness in (5e4, 1e5, 2e5))
    assert soft < firm < stiff < STUDIED_GAIN < limit(HAND, 4e5)
    assert limit(HAND, 1e5, 0.04) > 1.6 * firm > 1.6 * 1.6 * limit(HAND, 1e5, 0.01)
    assert limit(HEAVY, 1e5) < 0.5 * firm
    assert limit(GRIP, 1e5) == pytest.approx(limit(GRIP, 1e9), rel=0.05)
    assert limit(HAND, 1e5, stuck=True) > 2.0 * firm


@pytest.mark.parametrize(
    ("loop", "said"),
    [(PlaneLoop(delay=0.002), "delay = 0.002 s"), (PlaneLoop(force_age=0.0), "force_age = 0 s")],
)
def test_a_loop_that_cannot_be_run_is_refused(module, loop, said):
    with pytest.raises(ValueError, match=said):
        sampled_plane(Plane(module.planar), loop)


def swept(seed, folder):
    """Return what a sweep finds on a drawn rig, and the limits in the file."""
    rig = drawn_plane("A", seed)
    stand = SimulatedStand(rig.world, seed=seed)
    stand.plane = rig.loop
    result = planar_stability.run(Lab(stand, folder), planar_stability.Settings())
    return rig, result, load_plane_limits(folder / planar_stability.FILE, "SIM-0001")


@pytest.mark.long
@pytest.mark.parametrize("seed", [601, 602, 603, 605, 608, 610])
def test_a_sweep_finds_what_the_plant_has(tmp_path, seed):
    """Rigs of 5.7e4 to 4.8e5 N/m, both sets of inertias, 250 and 500 Hz, on none of which anything
    was chosen. The mode is that of module and hand together. On a structure that is badly damped
    the joints' friction at the reversals helps the sweep: there the hand's gain is up to a third
    too large, and the file's limit, an arm's of any mass, is not.
    """
    rig, result, limits = swept(seed, tmp_path)
    plane, law = Plane(rig.world.planar), PlanarSettings(damping=10.0)
    held = plane.robot._replace(module_mass=plane.robot.module_mass + HAND.mass)
    assert result.value("first_mode") == pytest.approx(first_modes(Plane(held))[0], rel=0.03)
    truth = largest_gain(plane, rig.loop, law)
    assert 0.95 < result.value("limit_hand") / truth < 1.36
    heavy = largest_gain(plane._replace(environment=HEAVY), rig.loop, law)
    assert 0.6 * heavy < limits.largest < heavy
    assert (limits.rate, limits.found_by) == (rig.loop.rate, "sweep")
    (figure,) = planar_stability.draw(result).values()
    assert figure.axes[0].get_xlabel() == "frequency [Hz]"


def test_without_a_sweep_a_mode_that_is_given_stands_for_it(module, tmp_path):
    """The lower of both known sets of inertias; a stiffer structure bears more."""
    found = []
    for mode in (55.0, 110.0):
        stand = SimulatedStand(module)
        stand.offers = stand.offers - {PLANE}
        settings = planar_stability.Settings(first_mode=mode)
        result = planar_stability.run(Lab(stand, tmp_path), settings)
        limits = load_plane_limits(tmp_path / planar_stability.FILE, "SIM-0001")
        assert limits.first_mode_Hz == mode and limits.found_by.startswith("linear model")
        assert limits.largest == pytest.approx(result.value("limit_any_arm"), abs=0.01)
        found.append(limits.largest)
        assert planar_stability.draw(result) == {}
    robot = robot_of(module, inertia="inmotion2")
    scale = (55.0 / first_modes(Plane(robot))[0]) ** 2
    bent = robot._replace(structure_stiffness=scale * robot.structure_stiffness)
    law = LAW._replace(damping=10.0)
    assert found[0] == pytest.approx(largest_gain(Plane(bent, HEAVY), LOOP, law), abs=0.01)
    assert 2.0 * found[0] < found[1]
