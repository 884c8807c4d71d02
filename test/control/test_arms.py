# SPDX-License-Identifier: Apache-2.0
"""Arms of other packages: what is taken, what does not fit together, what answers no number."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import metadata
from typing import Annotated, NamedTuple

import pytest
from law_runs import PLANE_DT

from screw_module_ros import plugins
from screw_module_ros.calibration.plane_version import arm_version
from screw_module_ros.control import arms
from screw_module_ros.control.arms import FIVE_BAR
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.planar import PlanarInput
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.plane_envelope import ARM, enveloped, initial_state
from screw_module_ros.geometry import MANUS
from screw_module_ros.settings import Setting, SettingError

NO_ARM = 3.0


class Moving(NamedTuple):
    """Settings of an arm that changes while it moves."""

    upper: Annotated[float, Setting("length of the upper arm", "m", 0.05, 2.0, live=True)] = 0.42


@pytest.fixture
def serial(importing):
    """The example's arm."""
    return importing("own_arm", "serial_arm").SERIAL


def test_an_arm_is_found_by_its_name_by_module_and_by_entry_point(serial, monkeypatch):
    assert arms.load("five_bar") is FIVE_BAR
    assert arms.load("serial_arm:SERIAL") is serial
    point = metadata.EntryPoint("serial", "serial_arm:SERIAL", arms.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point])
    assert arms.load("serial") is serial


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("six_bar", "neither package.module:NAME nor an entry point of screw_module_ros.arms"),
        ("no_such_module:ARM", "ModuleNotFoundError: No module named"),
        (f"{__name__}:NO_ARM", "is no screw_module_ros.control.arms.Arm"),
    ],
)
def test_what_is_no_arm_is_told_in_a_sentence(named, said):
    with pytest.raises(SettingError, match=said) as caught:
        arms.load(named)
    assert str(caught.value).startswith(f"arm {named}: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "five_bar"}, "is the name of this package's own"),
        ({"name": "my arm"}, "'my arm', is also the prefix of its parameters"),
        ({"inverse": None}, "its inverse is no function"),
        ({"settings": dict}, "its settings are no NamedTuple"),
        ({"settings": Moving}, "its setting upper is live"),
        ({"limits": {"wrist_low": 0.0}}, "its limit wrist_low is none of shoulder_low"),
        ({"limits": {"elbow_low": "none"}}, "its limit elbow_low is 'none', no angle"),
    ],
)
def test_an_arm_that_cannot_be_taken_is_told_in_a_sentence(serial, change, said):
    assert arms.flaw(serial) == ""
    assert said in arms.flaw(replace(serial, **change))


def shifted(shoulder, elbow, own):
    """Return a Jacobian of another place."""
    return FIVE_BAR.jacobian(shoulder + 0.01, elbow, own)


def turned(shoulder, elbow, own):
    """Return a Jacobian of the wrong sign beside the middle."""
    sign = 1.0 if abs(FIVE_BAR.forward(shoulder, elbow, own)[0]) < 1e-3 else -1.0
    return tuple(sign * each for each in FIVE_BAR.jacobian(shoulder, elbow, own))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"jacobian": shifted}, "at x, y = -0.1905, -0.2286 m its jacobian is not how its forward"),
        ({"jacobian": lambda s, e, own: (math.nan,) * 4}, "its jacobian is not how its forward"),
        (
            {"inverse": lambda x, y, own: FIVE_BAR.inverse(-x, y, own), "jacobian": turned},
            "its jacobian is not how its forward",
        ),
        ({"between": lambda s, e, own: (e - s, 1.0, 1.0)}, "the changes that its between tells"),
        ({"inverse": lambda x, y, own: (0.0, 0.0)}, "its inverse leads to no point"),
        ({"singular": lambda own: math.nan}, "its singular is nan, no size"),
        ({"singular": lambda own: 1.0}, "its singular, 1 m^2, is more than its jacobian's determ"),
        ({"forward": lambda s, e, own: {}[s]}, "KeyError"),
    ],
    ids=["jacobian", "jacobian nan", "jacobian beside", "between", "inverse", "singular nan",
         "singular", "raises"],
)
def test_functions_that_do_not_fit_together_are_found_before_any_torque(change, said):
    """A wrong Jacobian would turn the force on the hand into another direction."""
    law = PlanarSettings()
    assert arms.kinematics_flaw(FIVE_BAR, MANUS, law.half_width, law.half_depth) == ""
    wrong = arms.kinematics_flaw(replace(FIVE_BAR, **change), MANUS, law.half_width, law.half_depth)
    assert said in wrong


def settings_of(arm):
    return PlanarSettings(arm=arm.settings(), **arm.limits)


def test_a_serial_arm_presses_with_the_same_force_on_the_hand(serial):
    """Other torques, same law: J^-T of both arms' torques is the one force."""
    law = settings_of(serial)
    assert arms.kinematics_flaw(serial, law.arm, law.half_width, law.half_depth) == ""
    forces = []
    for arm, p in ((serial, law), (FIVE_BAR, PlanarSettings())):
        step, state = enveloped(PLANE_IMPEDANCE, arm), initial_state(p, PLANE_IMPEDANCE, p)
        inp = PlanarInput(*arm.inverse(0.03, -0.05, p.arm), 0.0, 0.0, 0.1, 0.05, 0.0, 0.0, True)
        for _ in range(1500):
            output = step(p, p, state, inp, PLANE_DT)
        x_s, x_e, y_s, y_e = arm.jacobian(inp.shoulder, inp.elbow, p.arm)
        s, e, det = output.shoulder_torque, output.elbow_torque, x_s * y_e - x_e * y_s
        forces.append(((y_e * s - y_s * e) / det, (x_s * e - x_e * s) / det))
    assert forces[0] == pytest.approx((7.0, 10.0), abs=1e-6)
    assert forces[0] == pytest.approx(forces[1], abs=1e-9)


@pytest.mark.parametrize("stretched", [-0.01, -0.5, -2.6, -3.1])
def test_the_stop_between_the_links_of_a_serial_arm_keeps_to_45_newtons(serial, stretched):
    """The stop turns the motor in the elbow alone, and what it presses on the hand is bounded."""
    law = settings_of(serial)
    step, state = enveloped(PLANE_IMPEDANCE, serial), initial_state(law, PLANE_IMPEDANCE, law)
    inp = PlanarInput(-0.6, stretched, 0.0, 0.0, math.nan, math.nan, 0.0, 0.0, True)
    for _ in range(1000):
        output = step(law, law, state, inp, PLANE_DT)
    x_s, x_e, y_s, y_e = serial.jacobian(inp.shoulder, inp.elbow, law.arm)
    s, e = output.shoulder_torque, output.elbow_torque
    det = max(abs(x_s * y_e - x_e * y_s), serial.singular(law.arm))
    assert math.hypot(y_e * s - y_s * e, x_s * e - x_e * s) / det <= law.force_limit + 1e-6
    assert max(abs(s), abs(e)) > 0.0


@pytest.mark.parametrize("where", arms.FUNCTIONS)
def test_an_arm_that_raises_or_answers_nan_is_no_torque(serial, where):
    """Of `inverse` only the home is made, which refuses NaN."""
    law = settings_of(serial)
    wrong = arms.answering(replace(serial, **{where: lambda *given: {}["no such joint"]}))
    step, state = enveloped(PLANE_IMPEDANCE, wrong), initial_state(law, PLANE_IMPEDANCE, law)
    angles = serial.inverse(0.0, 0.0, law.arm)
    inp = PlanarInput(*angles, 0.0, 0.0, 0.1, 0.1, 0.0, 0.0, True)
    for _ in range(100):
        output = step(law, law, state, inp, PLANE_DT)
    if where in ("inverse", "singular"):  # no torque comes of either
        assert state.wrong == 0 and output.shoulder_torque != 0.0
        return
    assert state.wrong == ARM
    assert (output.shoulder_torque, output.elbow_torque) == (0.0, 0.0)


def test_a_changed_arm_has_another_version(serial):
    assert arm_version(FIVE_BAR) != arm_version(serial) != "unknown"
    assert arm_version(replace(FIVE_BAR, jacobian=shifted)) != arm_version(FIVE_BAR)
