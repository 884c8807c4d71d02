# SPDX-License-Identifier: Apache-2.0
"""The controller keeps to the gains of its module's certificate, at start and at run time."""

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from screw_module_msgs.srv import SetControlMode

from screw_module_ros.calibration.certificate_conditions import conditions_of
from screw_module_ros.calibration.certificate_file import text_checksum
from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings

SERIAL = "ARM-0007"
CONDITIONS = conditions_of(VerticalSettings(), 1000.0, 1.26e-3, 30.0)


@pytest.fixture
def controller(make_node, tmp_path):
    """Return a function that makes a controller with a certificate of 6.28 and 12.6."""
    text = (
        f"format: screw_module_ros/certificate\nversion: 1\nserial: {SERIAL}\n"
        "date: '2026-11-22T09:30:00Z'\n"
        "permitted_gains: {force_gain: 6.28, observer_gain: 12.6}\n"
    )
    text += yaml.safe_dump({"conditions": CONDITIONS._asdict()})
    file = tmp_path / "module_certificate.yaml"
    file.write_text(f"{text}sha256: {text_checksum(text)}\n")

    def made(**others):
        named = {"certificate_file": file, "module_serial": SERIAL, **others}
        words = [word for key, value in named.items() for word in ("-p", f"{key}:={value}")]
        return make_node("impedance_controller", *words)

    return made


def changed(node, **values):
    """Set parameters as `ros2 param set` does; return the reason of a refusal."""
    (*results,) = node.set_parameters([Parameter(k, value=v) for k, v in values.items()])
    return "; ".join(result.reason for result in results if not result.successful)


@pytest.mark.parametrize(
    ("beyond", "within"),
    [({"force_gain": 8.0}, {"force_gain": 6.0}), ({"rate": 500.0}, {"rate": 1000.0})],
    ids=["gain", "a loop slower than the certificate's"],
)
def test_it_does_not_start_beyond_the_certificate(controller, beyond, within):
    node = controller(mode=modes.FORCE_FEEDBACK, **beyond)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert not changed(node, **within)
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


def test_uncertified_gains_lifts_the_limit(controller):
    node = controller(mode=modes.FORCE_FEEDBACK, force_gain=8.0, uncertified_gains=True)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert not changed(node, force_gain=9.0)
    node.close()


def test_the_damping_that_the_observer_needs_is_kept_as_a_parameter_too(make_node):
    node = make_node("impedance_controller", "-p", "damping:=20.0", "-p", "mode:=5")
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert "raise the damping first" in changed(node, damping=0.0)
    assert node.get_parameter("damping").value == 20.0
    node.close()
