# SPDX-License-Identifier: Apache-2.0
"""The notebooks of docs/thesis (appendices A and D, table 5.1): they run, and find what is known.

Their numbers are kept as the experiments `compliant_mounting`, `component_masses` and `back_drive`
found them, from which the notebooks were made. Their functions are held to textbooks and to
equations of motion.
"""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import matplotlib as mpl
import nbformat
import numpy as np
import pytest
from scipy.linalg import eigh
from screw_geometry import (
    INERTIA_ACROSS,
    LEAD,
    REFLECTED,
    TABLE,
    Bar,
    candidates,
    cylinder,
)

from notebooks import EXAMPLES, NOTEBOOKS, ROOT, executed
from screw_module_ros.identification import requirements
from screw_module_ros.identification.report import ELSEWHERE

THIN = Bar(0.6, 0.5, 0.0)
ARRAYS = {
    "appendix_a": ("case1_inertia", "case1_frequency", "case2_frequency", "case3_response",
                   "case3_resonances", "case3_antiresonance"),
    "appendix_d": ("axes_bare", "axes_laden", "points"), "table_5_1": (),
}  # fmt: skip
"""Of a notebook: the data of its figures, kept by their mean size."""


def code_of(name: str) -> str:
    """Return the code of a notebook."""
    notebook = nbformat.read(ROOT / f"docs/thesis/{name}.ipynb", as_version=4)
    return "\n\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")


def run(name: str) -> SimpleNamespace:
    """Return what the cells of a notebook define, carried out in this process."""
    made = {"__name__": name}
    with mpl.rc_context({"backend": "agg"}):
        exec(compile(code_of(name), name, "exec"), made)
    return SimpleNamespace(**made)


@pytest.fixture(scope="module")
def mounting():
    return run("appendix_a")


@pytest.fixture(scope="module")
def drive():
    return run("appendix_d")


@pytest.fixture(scope="module")
def masses():
    return run("table_5_1")


# The notebooks as a reader runs them --------------------------------------------------------------


@pytest.mark.parametrize("file", [*NOTEBOOKS, *EXAMPLES], ids=lambda file: file.stem)
def test_a_notebook_is_stored_without_output(file):
    notebook = nbformat.read(file, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == [None] * len(code)
    assert not any(cell.outputs for cell in code)


def test_the_report_names_every_notebook():
    assert {file.name for file in NOTEBOOKS} == {f"{name}.ipynb" for name in ARRAYS}
    assert all(file.name in ELSEWHERE for file in NOTEBOOKS)


@pytest.mark.long
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs_in_a_kernel_and_finds_what_it_did(file, kept):
    """In order, in a fresh kernel: values, uncertainties, and the mean size of what is drawn."""
    arrays = ", ".join(f"\"{name}\": {name}" for name in ARRAYS[file.stem])
    last = (
        "import json\n"
        f"drawn = {{{arrays}}}\n"
        "sizes = {f\"{n}, mean size\": float(np.abs(v).mean()) for n, v in drawn.items()}\n"
        "print(json.dumps({**{n: float(v) for n, v in found.items()}, **sizes}))"
    )
    (told,) = executed(file, last).cells[-1].outputs
    kept(json.loads(told.text), rel=1e-9)


# What their functions find ------------------------------------------------------------------------


def test_a_thin_bar_on_equal_springs_has_the_textbook_frequencies(mounting):
    found = mounting.profile(THIN, np.array([0.0, THIN.half_length]), 2e6, 2e6)[1]
    expected = np.sqrt(np.array([6.0, 3.0]) * 2e6 / THIN.mass) / (2 * math.pi)
    assert found == pytest.approx(expected)


def test_springs_and_lengths_for_a_wanted_frequency_give_it(mounting):
    softest, z = mounting.found["case2_softest"], mounting.z
    found = mounting.profile(mounting.SCREWS["grooved"], z, softest, softest)[1]
    assert found.min() == pytest.approx(mounting.PRINTED.wanted)
    half = mounting.half_length_for()
    thin = Bar(3 * INERTIA_ACROSS / half**2, 2 * half, 0.0)
    assert mounting.case1(thin, z)[1].min() == pytest.approx(500.0)
    with pytest.raises(ValueError, match="no screw of this inertia"):
        mounting.half_length_for(mounting.PRINTED._replace(wanted=5e4))


@pytest.mark.parametrize("z", [0.0, 0.1, -0.15])
def test_peaks_are_those_of_two_masses_on_three_springs(mounting, z):
    settings = mounting.PRINTED._replace(
        case3_top=4e6, case3_bottom=1e6, case3_ground=2e6, case3_nut=z
    )
    up, down = THIN.half_length - z, THIN.half_length + z
    stiffness = [[4e6 * up**2 + 1e6 * down**2, -4e6 * up], [-4e6 * up, 6e6]]
    inertia = np.diag([THIN.mass * (THIN.length**2 / 12 + z**2), settings.top_mass])
    expected = np.sqrt(eigh(stiffness, inertia, eigvals_only=True))
    assert mounting.resonances(mounting.absorber(THIN, settings)) == pytest.approx(expected)


def test_a_rocking_screw_has_its_limit_cases(mounting):
    """Case 1 without motor is case 2, symmetric about the centre; there f = l1 sqrt(2 k / I)."""
    z, bare = mounting.z, mounting.PRINTED._replace(
        case1_top=2e6, case1_bottom=2e6, top_mass=0.0
    )  # fmt: skip
    found = mounting.case1(THIN, z, bare)[1]
    assert found == pytest.approx(mounting.profile(THIN, z, 2e6, 2e6)[1])
    assert found == pytest.approx(found[::-1])
    inertia = THIN.mass * THIN.length**2 / 12.0
    at_centre = THIN.half_length * math.sqrt(2.0 * 2e6 / inertia) / (2.0 * math.pi)
    assert found[len(z) // 2] == pytest.approx(at_centre)


@pytest.mark.parametrize("z", [0.0, 0.1, -0.15])
def test_an_absorber_dips_at_its_own_frequency_and_on_a_stiff_ground_is_case_2(mounting, z):
    settings = mounting.PRINTED._replace(
        case3_top=4e6, case3_bottom=1e6, case3_ground=2e6, case3_nut=z
    )
    dip = np.array([math.sqrt((4e6 + 2e6) / settings.top_mass)])
    system = mounting.absorber(THIN, settings)
    assert abs(mounting.response(system, dip)) < 1e-6 * abs(mounting.response(system, 0.9 * dip))
    stiff = mounting.resonances(mounting.absorber(THIN, settings._replace(case3_ground=1e12)))
    alone = mounting.profile(THIN, np.array([z]), 4e6, 1e6)[1]
    assert stiff[0] / (2.0 * math.pi) == pytest.approx(alone[0], rel=1e-4)


def test_the_response_is_that_of_the_state_space(mounting):
    system, omega = mounting.absorber(THIN), np.array([150.0, 1500.0, 4000.0])
    expected = [
        (system.C @ np.linalg.solve(1j * w * np.eye(5) - system.A, system.B))[0, 0] for w in omega
    ]
    assert mounting.response(system, omega) == pytest.approx(np.array(expected))


def test_reflected_masses_fall_with_the_square_of_the_lead(masses):
    parts, screws = masses.masses(2.0 * LEAD)
    assert parts["motor_rotor"] == pytest.approx(2.132 / 4, abs=0.001)
    assert screws["table"] == pytest.approx(REFLECTED / 4)
    assert masses.found["sum_computed"] == pytest.approx(sum(masses.ours.values()))


def test_a_known_cylinder_is_found_from_its_inertia():
    mass = 7850.0 * math.pi * 0.01**2 * 0.5
    found = cylinder(0.02, mass * (3 * 0.01**2 + 0.5**2) / 12.0, 7850.0)
    assert (found.length, found.mass, found.diameter) == pytest.approx((0.5, mass, 0.02))
    assert found.half_length == pytest.approx(0.25)


def test_every_candidate_has_the_printed_inertia_across_its_axis():
    """The one that reflects the table's mass is thicker than what was measured."""
    screws = candidates()
    for screw in screws.values():
        across = screw.mass * screw.length**2 / 12.0 + screw.inertia_axis / 2.0
        assert across == pytest.approx(INERTIA_ACROSS)
    assert screws[TABLE].reflected() == pytest.approx(REFLECTED)
    assert screws[TABLE].diameter > 0.015875
    grooved, solid = screws["grooved"], screws["outer"]
    assert 0.90 < (grooved.mass / grooved.length) / (solid.mass / solid.length) < 0.96
    assert grooved.length > solid.length


@pytest.mark.parametrize("degrees", [10.0, 23.0, 40.0])
@pytest.mark.parametrize("friction", [0.0, 0.015, 0.15])
def test_a_square_thread_is_a_block_on_a_slope(drive, degrees, friction):
    slope, grip = math.radians(degrees), math.atan(friction)
    expected = math.tan(slope - grip) / math.tan(slope), math.tan(slope) / math.tan(slope + grip)
    assert drive.Wedge(slope, 0.0).efficiencies(friction) == pytest.approx(expected)


@pytest.mark.parametrize("way", [0, 1])
def test_the_limits_are_where_the_efficiencies_vanish(drive, way):
    screw = drive.wedge()
    assert screw.efficiencies(0.0) == pytest.approx((1.0, 1.0))
    assert screw.efficiencies(0.999 * screw.limits[way])[way] > 0.0
    assert screw.efficiencies(1.001 * screw.limits[way])[way] == 0.0


def test_a_screw_of_the_least_lead_just_turns_and_one_that_sticks_loses_all(drive):
    # The flank's angle across the thread depends on the lead: keep it, as the thread angle.
    steep = math.atan(drive.found["least_lead_plastic"] / drive.around)
    screw = drive.Wedge(steep, drive.found["thread_angle"])
    assert screw.limits[0] == pytest.approx(drive.PLASTIC)
    stuck = drive.losses(drive.wedge(), plastic=0.9)
    assert (stuck["back_loss_plastic"], stuck["back_gain"]) == (1.0, math.inf)


@pytest.fixture(scope="module")
def belt(drive):
    return drive.Belt(1e-3, 3e-3, 0.5, 0.02, 0.05)


def test_two_free_inertias_twist_at_the_textbook_frequency(drive, belt):
    reduced = belt.motor * belt.load / (belt.motor + belt.load)
    natural = math.sqrt(belt.stiffness / reduced)
    expected = natural / (2 * math.pi), belt.damping / (2 * natural * reduced)
    assert drive.mode(belt._replace(ground=0.0)) == pytest.approx(expected)


@pytest.mark.parametrize("without", [{}, {"ground": 0.0}, {"damping": 0.0, "ground": 0.0}])
def test_the_gain_is_that_of_the_equations_of_motion_and_ends_at_the_level(drive, belt, without):
    """Eqs 1 to 3 for a torque of 1 Nm: both speeds and the twist, solved at one frequency."""
    belt = belt._replace(**without)
    omega = 2.0 * math.pi * drive.bandwidth(belt)
    coupled = belt.damping + belt.stiffness / (1j * omega)
    both = [[1j * omega * belt.motor + belt.ground + coupled, -coupled],
            [-coupled, 1j * omega * belt.load + belt.ground + coupled]]  # fmt: skip
    load = abs(np.linalg.solve(both, [1.0, 0.0])[1])
    found = drive.gain(belt, np.array([omega]))
    assert found == pytest.approx(load) == pytest.approx(drive.LEVEL)
    assert drive.gain(belt, np.array([1.5 * omega])) < drive.LEVEL


def test_a_mass_at_the_tip_adds_every_way_and_evens_out(drive):
    least = drive.found["anisotropy_least"]
    assert drive.axes_laden == pytest.approx(drive.axes_bare + drive.MODULE)
    assert (drive.anisotropy(drive.laden) < drive.anisotropy(drive.bare)).all()
    best = drive.least_anisotropy()
    assert 0.98 * least < best <= least * (1.0 + 1e-3), "no place in reach is rounder"


def test_the_requirements_are_judged_by_the_numbers_of_the_notebook(drive):
    assert requirements.back_friction() == pytest.approx(drive.found["back_friction_limit"])
    found = drive.found["major_axis_bare"], drive.found["anisotropy_greatest"]
    assert requirements.bare_plane() == pytest.approx(found)
