# SPDX-License-Identifier: Apache-2.0
"""Controller and amplifier with a module's calibration and gain limits: kept to, or refused."""

from __future__ import annotations

import re
from types import SimpleNamespace
from unittest.mock import patch

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from screw_module_msgs.msg import AmplifierState
from screw_module_msgs.srv import SetControlMode, StartRecording
from services import asked

from screw_module_ros.calibration.gain_limits import Loop, conditions_of
from screw_module_ros.calibration.limits_file import text_checksum
from screw_module_ros.calibration.module import (
    ModuleCalibration,
    SensorBias,
    thesis_friction,
    write_calibration,
)
from screw_module_ros.calibration.version import law_version
from screw_module_ros.control import modes
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.vertical_settings import KNOWN_SHARE, VerticalSettings
from screw_module_ros.recording.decoded import calibrations

OWN_FILE = {"impedance_controller": "friction_file", "amplifier": "linearization_file"}
SERIAL = "SIM-0001"  # that of params/sim.yaml
GRAVITY = 9.25


def words(**named) -> list[str]:
    """Return --ros-args that give these parameters."""
    return [word for key, value in named.items() for word in ("-p", f"{key}:={value}")]


def given(path, serial=SERIAL, **others) -> list[str]:
    """Return --ros-args that name a calibration."""
    return words(calibration_file=path, module_serial=serial, **others)


def refusal(node) -> str:
    """Configure a node that must refuse; return the sentence in its diagnostics."""
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    heard = []
    with patch.object(Publisher, "publish", lambda publisher, message: heard.append(message)):
        node.publish_health()
    (status,) = heard[0].status
    assert status.level == DiagnosticStatus.ERROR
    return status.message


REFUSED = [
    (name, *row) for name in OWN_FILE for row in (
        ({"serial": "SIM-0002"}, "'SIM-0001'.*'SIM-0002'"),
        ({"serial": '""'}, "set module_serial"),
        ({"path": "changed.yaml"}, "was changed after it was written.*identify the module anew"),
        ({OWN_FILE[name]: "own.yaml"}, f"{OWN_FILE[name]}.*own.yaml"),
    )
] + [("amplifier", {"linearize": False, "serial": "other"}, "this is module 'other'")]  # fmt: skip


@pytest.mark.parametrize(("name", "others", "told"), REFUSED)
def test_a_calibration_that_does_not_fit_is_refused(
    make_node, calibration, tmp_path, monkeypatch, name, others, told
):
    monkeypatch.chdir(tmp_path)
    changed = calibration.path.read_text().replace("phase_rad: 0.4", "phase_rad: 0.5")
    (tmp_path / "changed.yaml").write_text(changed)
    said = refusal(make_node(name, *given(**{"path": calibration.path, **others})))
    assert re.search(told, said), said
    assert str(others.get("path", calibration.path)) in said or "calibration_file" in said


def test_refused_and_put_right_the_controller_takes_it(make_node, calibration):
    node = make_node("impedance_controller", *given(calibration.path, "SIM-0002", gravity=12.5))
    refusal(node)
    assert node.get_parameter("gravity").value == 12.5
    node.set_parameters([Parameter("module_serial", value=SERIAL)])
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node._friction.model == calibration.written.friction
    assert node.state.calibration == calibration.identity
    assert node.get_parameter("gravity").value == GRAVITY
    node.trigger_activate()
    assert node.role.settings.gravity == GRAVITY
    assert node.role.settings.observer_inertia == KNOWN_SHARE
    assert node.role.settings.observer_delay == 9e-4
    assert node.health().values["delay off"] == "no"
    slow = AmplifierState(latency_p50=2e-3)
    node.inputs = node.inputs._replace(amplifier=lambda: slow)
    node.read_inputs(node.clock.now_ns())
    told = node.health().values["delay off"]
    assert "after 2.22 ms, in the module's calibration after 0.90" in told
    node.close()


def test_gravity_set_by_hand_is_told_with_the_identity(make_node, calibration):
    """What a bag says of the calibration must be what was in force."""
    node = make_node("impedance_controller", *given(calibration.path))
    node.trigger_configure()
    assert not node.parameters.write(gravity=8.0)
    assert node.state.calibration == f"{calibration.identity}, gravity 8 N by hand"
    node.trigger_activate()
    assert node.role.settings.gravity == 8.0
    assert not node.parameters.write(gravity=GRAVITY)
    assert node.state.calibration == calibration.identity
    node.close()


def test_a_mass_set_by_hand_is_told_and_not_carried(make_node, calibration):
    """OBSERVER carried 0.7 of any mass that somebody set, and with 9 kg left less than none."""
    node = make_node("impedance_controller", *given(calibration.path))
    node.trigger_configure()
    node.trigger_activate()
    assert not node.parameters.write(mass=9.0)
    law = node.role.settings
    assert law.mass == 9.0
    assert law.observer_inertia * law.mass == pytest.approx(KNOWN_SHARE * 5.5)
    assert node.state.calibration == f"{calibration.identity}, mass 9 kg by hand"
    node.trigger_deactivate()
    node.trigger_activate()
    assert node.role.settings == law
    assert not node.parameters.write(mass=5.5)
    assert node.role.settings.observer_inertia == KNOWN_SHARE
    assert node.state.calibration == calibration.identity
    node.close()


@pytest.mark.parametrize("by_hand", [False, True])
def test_the_next_module_does_not_inherit_it(make_node, calibration, by_hand):
    """Cleaned up and configured without a file: weight, mass and carried share are the old ones.

    A mass is carried only where it was measured. What the operator set since then stays.
    """
    names = ("gravity", "mass", "observer_inertia")
    node = make_node("impedance_controller", *given(calibration.path, gravity=12.5, mass=4.0))
    node.trigger_configure()
    assert [node.get_parameter(name).value for name in names] == [GRAVITY, 5.5, KNOWN_SHARE]
    if by_hand:
        assert not node.parameters.write(gravity=8.0)
    node.trigger_cleanup()
    node.set_parameters([Parameter("calibration_file", value="")])
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    wanted = [8.0 if by_hand else 12.5, 4.0, 0.0]
    assert [node.get_parameter(name).value for name in names] == wanted
    node.close()


# The graph -----------------------------------------------------------------------------------


def test_a_bag_of_less_than_a_second_holds_it_too(make_node, tmp_path, wait_until, calibration):
    """No timer runs here: the topic is found when it is heard."""
    node = make_node("session_recorder", *words(folder=tmp_path, topics="[/told_once/state]"))
    publisher = node.create_publisher(AmplifierState, "/told_once/state", 1)
    node.trigger_configure()
    node.trigger_activate()
    assert asked(node, "~/record", StartRecording.Request(name="bag")).success

    def recorded() -> int:
        publisher.publish(AmplifierState(calibration=calibration.identity))
        node._taps.look()
        node.step()
        status = node._taps.recording.status()
        return status.messages + status.waiting

    wait_until(recorded, what="a message in the recorder")
    node.close()
    assert calibrations(tmp_path / "bag") == {"/told_once/state": calibration.identity}


LIMITED = "ARM-0007"
LIMITS = """
  largest_gains_on:
    hand: {force_gain: 14.1, observer_gain: 23.0}
    heavy_arm: {force_gain: 6.28, observer_gain: 16.0}
    wall: {force_gain: 9.5, observer_gain: 12.6}
  exceeds: {soft_grip: {force_gain: 0.92, observer_gain: 0.51}}
"""


def conditions_for(law):
    """Return the conditions of limits that were found with a law's settings."""
    return conditions_of(THESIS, law, law, Loop(1000.0, 1.26e-3, 30.0))


CONDITIONS = conditions_for(VerticalSettings())
CERTIFICATE = """
format: screw_module_ros/certificate
version: 1
permitted_gains: {force_gain: 6.28, observer_gain: 12.6}
"""


@pytest.fixture
def controller(make_node, tmp_path):
    """Return a function that makes a controller with gain limits of 6.28 and 12.6."""
    file = tmp_path / "module_gain_limits.yaml"

    def made(conditions=CONDITIONS, kind="", law=None, **others):
        text = f"serial: {LIMITED}\ndate: '2026-11-22T09:30:00Z'\n{kind}"
        if kind:
            text += yaml.safe_dump({"law": law, "conditions": conditions})
        else:
            thesis = {"version": law or law_version(), "conditions": conditions}
            thesis |= yaml.safe_load(LIMITS)
            text += "format: screw_module_ros/gain_limits\nversion: 3\n"
            text += yaml.safe_dump({"laws": {"thesis": thesis}})
        file.write_text(f"{text}sha256: {text_checksum(text)}\n")
        named = {"gain_limits_file": file, "module_serial": LIMITED, **others}
        return make_node("impedance_controller", *words(**named))

    return made


def changed(node, **values):
    """Set parameters as `ros2 param set` does; return the reason of a refusal."""
    (*results,) = node.set_parameters([Parameter(k, value=v) for k, v in values.items()])
    return "; ".join(result.reason for result in results if not result.successful)


@pytest.mark.parametrize("required", [False, True])
def test_it_starts_with_gains_within_its_modules_limits(controller, required):
    """Smaller ones stay; after the module is gone, those of the parameters are back."""
    node = controller(mode=modes.FORCE_FEEDBACK, force_gain=8.0, gain_limits_required=required)
    for _ in range(2):
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert node.get_parameter("force_gain").value == 6.28
        assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    node.trigger_configure()
    assert node.get_parameter("observer_gain").value == VerticalSettings().observer_gain
    node.trigger_activate()
    assert node.role.settings.force_gain == 6.28
    assert "6.28 at most" in changed(node, force_gain=8.0)
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert not changed(node, gain_limits_file="", gain_limits_required=False)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.get_parameter("force_gain").value == 8.0
    node.close()


def test_it_chooses_the_observer_s_gain_too(controller):
    node = controller(mode=modes.OBSERVER, damping=20.0, observer_gain=20.0)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.get_parameter("observer_gain").value == 12.6
    node.close()


def test_it_does_not_start_in_a_loop_slower_than_that_of_the_limits(controller):
    node = controller(mode=modes.FORCE_FEEDBACK, rate=500.0)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert not changed(node, rate=1000.0)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    node.close()


def test_no_gain_and_no_mode_goes_beyond_it(controller):
    node = controller(mode=modes.FORCE_FEEDBACK)
    node.trigger_configure()
    told = changed(node, force_gain=8.0)
    assert "force_gain is 8" in told and LIMITED in told and "6.28 at most" in told
    assert node.get_parameter("force_gain").value == 5.0
    assert not changed(node, mode=modes.IMPEDANCE)
    assert not changed(node, force_gain=8.0), "this mode does not use it"
    refused = asked(node, "~/set_mode", SetControlMode.Request(mode=modes.COMBINED))
    assert not refused.success and "6.28 at most" in refused.message
    assert "6.28 at most" in changed(node, mode=modes.FORCE_FEEDBACK)
    assert node.get_parameter("mode").value == modes.IMPEDANCE
    node.close()


def test_a_live_parameter_does_not_leave_the_conditions_of_the_limits(controller):
    node = controller(mode=modes.OBSERVER, damping=20.0)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "observer_inertia is 0.3, and the module's gain limits" in changed(
        node, observer_inertia=0.3
    )
    assert not changed(node, mass=6.0), "more than in the file costs no margin"
    assert "mass is 5 kg" in changed(node, mass=5.0)
    node.close()


def test_the_calibrated_mass_counts_at_the_start(controller, tmp_path):
    """The file of a module heavier than the default was refused with its own calibration."""
    heavy = ModuleCalibration(
        LIMITED, "2026-11-22T09:00:00Z", "0.1.0", gravity_N=10.0, mass_kg=6.0,
        sensor_bias=SensorBias((0.0,) * 3, (0.0,) * 3), residuals={}, friction=thesis_friction(),
        linearization=default_linearization(),
    )  # fmt: skip
    write_calibration(tmp_path / "calibration.yaml", heavy)
    known = VerticalSettings().calibrated(heavy.gravity_N, heavy.mass_kg)
    node = controller(
        conditions_for(known), mode=modes.OBSERVER, damping=20.0,
        calibration_file=tmp_path / "calibration.yaml",
    )  # fmt: skip
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "mass is 5.9 kg" in changed(node, mass=5.9)
    node.close()


@pytest.fixture
def logged(monkeypatch):
    """Return a function that has a node log into a list of its warnings, and returns it."""
    said = []

    def listen(node):
        log = SimpleNamespace(info=lambda text: None, warning=said.append)
        monkeypatch.setattr(node, "get_logger", lambda: log)
        return said

    return listen


def diagnosed(node) -> dict[str, str]:
    """Return the values of the node's diagnostics."""
    return {key: str(value) for key, value in node.health().values.items()}


def test_it_says_at_start_and_in_diagnostics_what_the_gains_in_use_exceed(controller, logged):
    node = controller(mode=modes.FORCE_FEEDBACK, force_gain=8.0, observer_gain=0.4)
    said = logged(node)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    exceeded = "force_gain 6.28 (soft grip 0.92)"
    (sentence,) = said
    assert "linear model" in sentence and f": {exceeded};" in sentence
    node.trigger_activate()
    assert diagnosed(node)["unstable in the linear model"] == exceeded
    assert LIMITED in diagnosed(node)["gain limits"]
    assert not changed(node, force_gain=0.9)
    assert diagnosed(node)["unstable in the linear model"] == "none"
    node.close()


def test_beyond_the_limits_it_also_names_the_loads_that_limit(controller, logged):
    node = controller(beyond_gain_limits=True, force_gain=8.0, observer_gain=0.4)
    said = logged(node)
    node.trigger_configure()
    assert "force_gain 8 (heavy arm 6.28, soft grip 0.92);" in said[0]
    node.close()


@pytest.mark.parametrize("required", [True, False])
def test_an_old_file_limits_but_permits_no_force_feedback(controller, logged, required):
    """Its law cannot be compared; where limits are not required it is one warning, no refusal."""
    node = controller(
        kind=CERTIFICATE, law="0123456789ab", force_gain=8.0, gain_limits_required=required
    )
    said = logged(node)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    (sentence,) = said
    assert "is a certificate" in sentence and "module_gain_limits.yaml" in sentence
    assert node.get_parameter("force_gain").value == 6.28
    assert bool(changed(node, mode=modes.FORCE_FEEDBACK)) == required
    assert not changed(node, mode=modes.FRICTION_COMPENSATION)
    node.trigger_activate()
    assert diagnosed(node)["unstable in the linear model"] == "not known"
    node.close()


def test_parameters_of_the_last_release_are_taken_by_their_old_names(make_node):
    node = make_node(
        "impedance_controller",
        *words(certificate_required=False, uncertified_gains=True, certificate_file="old.yaml"),
    )
    values = [
        node.get_parameter(name).value
        for name in ("gain_limits_required", "beyond_gain_limits", "gain_limits_file")
    ]
    assert values == [False, True, "old.yaml"]
    assert not node.has_parameter("certificate_required")
    node.close()


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
def test_where_limits_are_required_feedback_needs_them_or_the_operators_word(controller, mode):
    node = controller(gain_limits_file='""')
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "has no gain limits" in changed(node, mode=mode)
    assert not changed(node, mode=modes.FRICTION_COMPENSATION)
    node.close()


@pytest.mark.parametrize("named", [{}, {"gain_limits_file": '""'}])
def test_the_operators_word_in_place_of_gain_limits(controller, named):
    node = controller(beyond_gain_limits=True, damping=20.0, force_gain=8.0, **named)
    node.trigger_configure()
    assert not changed(node, mode=modes.OBSERVER)
    assert not changed(node, mode=modes.FORCE_FEEDBACK) and not changed(node, force_gain=9.0)
    node.close()


def test_the_damping_that_the_observer_needs_is_kept_as_a_parameter_too(make_node):
    node = make_node("impedance_controller", "-p", "damping:=20.0", "-p", "mode:=5",
                     "-p", "gain_limits_required:=false")  # fmt: skip
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "raise the damping first" in changed(node, damping=0.0)
    assert node.get_parameter("damping").value == 20.0
    node.close()
