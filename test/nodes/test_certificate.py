# SPDX-License-Identifier: Apache-2.0
"""The controller keeps to the gains of its module's certificate, at start and at run time."""

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from screw_module_msgs.srv import SetControlMode

from screw_module_ros.calibration.certificate import conditions_of, law_version, text_checksum
from screw_module_ros.calibration.module import (
    ModuleCalibration,
    SensorBias,
    thesis_friction,
    write_calibration,
)
from screw_module_ros.control import modes
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.vertical_settings import VerticalSettings

SERIAL = "ARM-0007"
CONDITIONS = conditions_of(VerticalSettings(), 1000.0, 1.26e-3, 30.0)


@pytest.fixture
def controller(make_node, tmp_path):
    """Return a function that makes a controller with a certificate of 6.28 and 12.6."""
    file = tmp_path / "module_certificate.yaml"

    def made(conditions=CONDITIONS, **others):
        text = (
            f"format: screw_module_ros/certificate\nversion: 1\nserial: {SERIAL}\n"
            f"date: '2026-11-22T09:30:00Z'\nlaw: '{law_version()}'\n"
            "permitted_gains: {force_gain: 6.28, observer_gain: 12.6}\n"
        )
        text += yaml.safe_dump({"conditions": conditions._asdict()})
        file.write_text(f"{text}sha256: {text_checksum(text)}\n")
        named = {"certificate_file": file, "module_serial": SERIAL, **others}
        words = [word for key, value in named.items() for word in ("-p", f"{key}:={value}")]
        return make_node("impedance_controller", *words)

    return made


def changed(node, **values):
    """Set parameters as `ros2 param set` does; return the reason of a refusal."""
    (*results,) = node.set_parameters([Parameter(k, value=v) for k, v in values.items()])
    return "; ".join(result.reason for result in results if not result.successful)


@pytest.mark.parametrize("required", [False, True])
def test_it_is_configured_again_with_its_module_s_gains(controller, required):
    node = controller(
        mode=modes.FORCE_FEEDBACK, force_gain=8.0, certificate_required=required
    )
    for _ in range(2):
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert node.get_parameter("force_gain").value == 6.28
        assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    node.close()


def test_it_starts_with_the_gains_that_its_module_permits(controller):
    """Smaller ones stay; after the module is gone, those of the parameters are back."""
    node = controller(mode=modes.FORCE_FEEDBACK, force_gain=8.0, certificate_required=False)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.get_parameter("force_gain").value == 6.28
    assert node.get_parameter("observer_gain").value == VerticalSettings().observer_gain
    node.trigger_activate()
    assert node.part.settings.force_gain == 6.28
    assert "6.28 at most" in changed(node, force_gain=8.0)
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert not changed(node, certificate_file="")
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.get_parameter("force_gain").value == 8.0
    node.close()


def test_it_chooses_the_observer_s_gain_too(controller):
    node = controller(mode=modes.OBSERVER, damping=20.0, observer_gain=20.0)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.get_parameter("observer_gain").value == 12.6
    node.close()


def test_it_does_not_start_in_a_loop_slower_than_the_certificate_s(controller):
    node = controller(mode=modes.FORCE_FEEDBACK, rate=500.0)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert not changed(node, rate=1000.0)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    node.close()


def test_no_gain_and_no_mode_goes_beyond_it(controller):
    node = controller(mode=modes.FORCE_FEEDBACK)
    node.trigger_configure()
    told = changed(node, force_gain=8.0)
    assert "force_gain is 8" in told and SERIAL in told and "6.28 at most" in told
    assert node.get_parameter("force_gain").value == 5.0
    assert not changed(node, mode=modes.IMPEDANCE)
    assert not changed(node, force_gain=8.0), "this mode does not use it"
    refused = node._set_mode(SetControlMode.Request(mode=modes.COMBINED))
    assert "6.28 at most" in refused
    assert "6.28 at most" in changed(node, mode=modes.FORCE_FEEDBACK)
    assert node.get_parameter("mode").value == modes.IMPEDANCE
    node.close()


def test_a_live_parameter_does_not_leave_the_certificate_s_conditions(controller):
    node = controller(mode=modes.OBSERVER, damping=20.0)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "observer_inertia is 0.3, and the module's certificate" in changed(
        node, observer_inertia=0.3
    )
    assert not changed(node, mass=6.0), "more than in the certificate costs no margin"
    assert "mass is 5 kg" in changed(node, mass=5.0)
    node.close()


def test_the_calibrated_mass_counts_at_the_start(controller, tmp_path):
    """A certificate of a module heavier than the default was refused with its own calibration."""
    heavy = ModuleCalibration(
        SERIAL, "2026-11-22T09:00:00Z", "0.1.0", gravity_N=10.0, mass_kg=6.0,
        sensor_bias=SensorBias((0.0,) * 3, (0.0,) * 3), residuals={}, friction=thesis_friction(),
        linearization=default_linearization(),
    )  # fmt: skip
    write_calibration(tmp_path / "calibration.yaml", heavy)
    known = VerticalSettings().calibrated(heavy.gravity_N, heavy.mass_kg)
    node = controller(
        conditions_of(known, 1000.0, 1.26e-3, 30.0), mode=modes.OBSERVER, damping=20.0,
        calibration_file=tmp_path / "calibration.yaml",
    )  # fmt: skip
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "mass is 5.9 kg" in changed(node, mass=5.9)
    node.close()


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
def test_where_a_certificate_is_required_feedback_needs_one_or_the_operators_word(controller, mode):
    node = controller(certificate_file='""')
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "has no certificate" in changed(node, mode=mode)
    assert not changed(node, mode=modes.FRICTION_COMPENSATION)
    node.close()


def test_the_operators_word_in_place_of_a_certificate(controller):
    node = controller(certificate_file='""', uncertified_gains=True, damping=20.0)
    node.trigger_configure()
    assert not changed(node, mode=modes.OBSERVER)
    node.close()


def test_uncertified_gains_lifts_the_limit(controller):
    node = controller(mode=modes.FORCE_FEEDBACK, force_gain=8.0, uncertified_gains=True)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert not changed(node, force_gain=9.0)
    node.close()


def test_the_damping_that_the_observer_needs_is_kept_as_a_parameter_too(make_node):
    node = make_node("impedance_controller", "-p", "damping:=20.0", "-p", "mode:=5",
                     "-p", "certificate_required:=false")  # fmt: skip
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "raise the damping first" in changed(node, damping=0.0)
    assert node.get_parameter("damping").value == 20.0
    node.close()
