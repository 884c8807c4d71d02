# SPDX-License-Identifier: Apache-2.0
"""What was asked, against what other experiments found; and what the hand feels in the plane."""

import math

import numpy as np
import pytest
from formula_stand import keep, keep_calibration

from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.identification import (
    delivered_impedance,
    planar_impedance,
    requirements,
)
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.page import html_page
from screw_module_ros.identification.planar_impedance import CASES
from screw_module_ros.identification.requirements import (
    HEAD,
    MET,
    MISSED,
    REQUIREMENTS,
    UNTESTED,
    VERTICAL,
    cells,
    rows,
    sentences,
)
from screw_module_ros.identification.results import Quantity, Result
from screw_module_ros.identification.trials import PlanarTrial, Samples
from screw_module_ros.plant.patient import HandPath

FRICTION = (10.7, 1.2, 1.8, 0.2, -0.01)
INERTIA = (5.5, 5.5, 0.92, 0.92, 0.55)


def found(lab, module, inertia=INERTIA, plane=(6.3, 0.6, 0.6, 0.6)):
    """Return the requirements of a module whose modes and plane have these values."""
    keep_calibration(lab.folder, module)
    pairs = zip(VERTICAL.values(), FRICTION, inertia, strict=True)
    felt, data = {}, {"frequencies": np.array([0.5, 2.0, 8.0])}
    omega = 2.0 * math.pi * data["frequencies"]
    for name, friction, mass in pairs:
        felt |= {f"friction_{name}": friction, f"mass_{name}": 2.0 * mass}
        masses = np.array([0.9, 1.1, 2.0]) * mass
        data[f"reactance_{name}"] = omega * masses - 100.0 / omega
    settings = delivered_impedance.Settings()._asdict()
    quantities = tuple(Quantity(name, value, 0.1, "", name) for name, value in felt.items())
    Result("delivered_impedance", quantities, settings, (), data).save(lab.folder)
    moved = {f"inertia_most_{case}": mass for case, mass in zip(CASES, plane, strict=True)}
    keep(lab.folder, "planar_impedance", **moved, friction_most_none=0.9, friction_most_firm=0.09,
         viscous_to_none=0.0, viscous_to_firm=1.0)  # fmt: skip
    return requirements.run(lab, requirements.Settings())


@pytest.fixture
def lab(tmp_path, stand):
    return Lab(stand, tmp_path)


def verdicts(result):
    return {row.name: row.verdict for row in rows(result)}


def test_each_way_meets_or_misses_its_bound(lab, module):
    told = verdicts(found(lab, module))
    assert told["vertical_friction"] == "met: mode 2, mode 3, mode 4, mode 5; missed: mode 1"
    assert told["vertical_inertia"] == "met: mode 5; missed: mode 1, mode 2, mode 3, mode 4"
    assert told["plane_inertia"].startswith("met: with feedback and an arm, with feedback and a")
    assert told["plane_inertia"].endswith("missed: without feedback")
    assert told["vertical_range"] == told["linear_motor"] == MISSED
    assert told["backlash"] == told["off_axis_moment"] == told["plane_stiffness"] == MET
    assert told["arm_support"] == told["slow_motion"] == UNTESTED


def test_the_sentences_follow_the_values(lab, module):
    vertical, plane = sentences(found(lab, module))
    assert "mode 5 (-0.01 N, 0.55 kg) alone meets" in vertical
    assert "at 4 Hz and above none of those" in vertical
    assert "2.22 N at most" in vertical and "0.75 kg at most" in vertical
    assert "6.3 kg without force feedback, which misses it" in plane
    assert "0.6 kg with force feedback and an arm, which meets it" in plane
    vertical, plane = sentences(found(lab, module, (5.5, 5.5, 0.5, 0.5, 0.8), (6.3, 4.1, 0.6, 0.6)))
    assert "mode 3 (1.80 N, 0.50 kg) and mode 4 (0.20 N, 0.50 kg) meet" in vertical
    assert "4.1 kg with force feedback and an arm, which misses it" in plane
    assert "0.6 kg with force feedback and a firm hand, which meets it" in plane
    vertical, _ = sentences(found(lab, module, (5.5,) * 5))
    assert "none meets" in vertical


def test_arithmetic_on_printed_numbers(lab, module):
    result = found(lab, module)
    assert result.value("design_factor_machine") == pytest.approx(4.43, abs=0.01)
    assert result.quantity("design_factor_machine").thesis.value == 4.4
    assert result.value("off_axis_moment_machine") == pytest.approx(8.76, abs=0.01)
    acceleration = 0.076 * (2.0 * math.pi) ** 2
    assert result.value("plane_sine_machine") == pytest.approx(6.3 * acceleration)
    assert result.value("vertical_range_machine") == module.vertical.travel


def test_the_motor_reaches_65_and_45_n_beyond_weight_and_friction(lab, module):
    """The largest of the map is about 16 N upward with 10 N of weight."""
    result = found(lab, module)
    up, down = result.value("force_up_machine"), result.value("force_down_machine")
    assert 65.0 < up < 95.0 - 10.0
    assert 45.0 < down < 75.0 + 10.0


def test_every_requirement_has_a_row_and_a_source(lab, module, tmp_path):
    table = cells(found(lab, module))
    assert len(table) == len(REQUIREMENTS) and all(len(row) == len(HEAD) for row in table)
    assert all(row[1] and row[2] for row in table)
    assert all(row[-2] for row in table), "a value, or why there is none"
    untested = [row for row in table if row[-1] == UNTESTED]
    assert untested and "html" in html_page("| a |\n|---|\n| met |\n", tmp_path)


# The plane --------------------------------------------------------------------------------------


def test_a_known_mechanism_is_found_along_the_direction():
    """Also when the force has a part across the motion."""
    path, angle = HandPath(0.0, 0.0, 0.0, 0.0, 0.04, 2.0 * math.pi, 0.0), math.radians(30.0)
    trial = PlanarTrial(PlanarSettings(), direction=angle, path=path)
    time = np.arange(0.0, 8.5, 0.002)
    way = 0.04 * np.sin(path.omega * time)
    speed = 0.04 * path.omega * np.cos(path.omega * time)
    force = 100.0 * way + 8.0 * speed - 3.0 * path.omega**2 * way
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-0.5, 0.866])
    position = np.outer(way, along)
    felt = np.outer(force, along) + 5.0 * np.outer(way, across)
    nothing = np.zeros_like(position)
    samples = Samples(time, position, nothing, felt, nothing, nothing, nothing, position,
                      np.outer(speed, along), felt, np.linspace(1.0, 0.4, len(time)))  # fmt: skip
    part = planar_impedance.reduced(trial, samples)
    wanted = 8.0 + 1j * (3.0 * path.omega - 100.0 / path.omega)
    assert complex(part["impedance"]) == pytest.approx(wanted, rel=0.01)
    assert float(part["speed"]) == pytest.approx(0.04 * path.omega, rel=0.01)
    assert float(part["share"]) == pytest.approx(0.4 + 0.3 * 6.0 / 8.5, abs=0.001)


@pytest.fixture(scope="module")
def measured(tmp_path_factory, stand):
    settings = planar_impedance.Settings(frequencies=(1.0, 2.0))
    return planar_impedance.run(Lab(stand, tmp_path_factory.mktemp("plane")), settings)


def test_without_feedback_the_hand_moves_arm_and_module(measured, module):
    """By Lagrange's equations: the tip's inertia from the joints', by a Jacobian of its own.

    The damper's lag of 8 ms takes 0.08 kg of it, and the joints' friction is a spring at first.
    """
    p = module.planar
    reach = math.hypot(p.base_x, p.base_y)
    cosine = (reach**2 - p.upper_arm**2 - p.forearm**2) / (2.0 * p.upper_arm * p.forearm)
    between = math.acos(cosine)
    # A chain of the same reach with its base at the origin: the axes are those of any direction.
    jacobian = np.array([[0.0, -p.forearm * math.sin(between)],
                         [p.upper_arm, p.forearm * cosine]])  # fmt: skip
    of = p.joint_inertia
    across = of.coupling * cosine
    joints = np.array([[of.shoulder, across], [across, of.elbow]])
    back = np.linalg.inv(jacobian)
    least, most = np.linalg.eigvalsh(back.T @ joints @ back) + p.module_mass
    assert 0.94 * most < measured.value("inertia_most_none") < most
    assert 0.94 * least < measured.value("inertia_least_none") < most


@pytest.mark.parametrize("case", ["firm", "stiff"])
def test_feedback_divides_inertia_and_friction_where_it_keeps_its_gain(measured, case):
    """A gain of 9 leaves a tenth, and a little more by its filter."""
    assert measured.value(f"share_{case}") > 0.9
    for what in ("inertia_most", "friction_most"):
        share = measured.value(f"{what}_{case}") / measured.value(f"{what}_none")
        assert 0.03 < share < 0.2, what


def test_where_the_guard_takes_the_gain_the_mass_returns(measured):
    """On the structure as it is estimated an arm of 3 kg bears less gain than the law has."""
    assert measured.value("share_feedback") < 0.5
    assert measured.value("inertia_most_feedback") > 0.5 * measured.value("inertia_most_none")
