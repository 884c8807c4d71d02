# SPDX-License-Identifier: Apache-2.0
"""A robot may run without a force sensor, but then no mode feeds back a force that nobody measures.

A handle force of zero tells the feedback that nothing resists the spring: the command was 75 N
down, 85 N at the hand with the weight, where 45 N are the limit.
"""

from __future__ import annotations

import pytest
from laws_of_others import ODD, THE_ODD

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.laws import LAWS, names, variants
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.safety.checks import AgreementSettings, WatchSettings
from screw_module_ros.samples import EncoderReading, ForceReading

MS = 1_000_000


def controller_in(mode: int, laws=LAWS) -> VerticalController:
    """Return a controller whose spring would press with all that it may."""
    law = VerticalSettings(stiffness=1000.0, damping=40.0)
    watch = WatchSettings(force_required=False)
    agreement = AgreementSettings()
    made = VerticalController(law, thesis_friction(), watch, agreement, MS, mode, laws=laws)
    made.wanted.ask((0.02,), (0.0,), MS)
    return made


def position(tick: int, place: float = 0.18, speed: float = 0.0) -> EncoderReading:
    return EncoderReading(tick, tick * MS, 0, 0, place, speed, True)


def force_sample(tick: int, force: float = 0.0, status: int = 0) -> ForceReading:
    return ForceReading(tick, tick * MS, 0, 0.0, 0.0, force, 0.0, 0.0, 0.0, status)


def run(controller: VerticalController, ticks: range, force: float | None = None) -> None:
    """Let a nut at rest go by, with a force on the handle [N] or without a force sensor."""
    for tick in ticks:
        controller.on_drive(True, 0.0, tick * MS)
        if force is not None:
            controller.on_force(force_sample(tick, force), tick * MS)
        assert controller.on_encoder(position(tick), tick * MS)


@pytest.mark.parametrize("mode", [mode for mode, variant in variants().items() if variant.gains])
def test_no_force_is_fed_back_that_nobody_measures(mode):
    controller = controller_in(mode)
    run(controller, range(1, 3000))
    assert controller.output.force == 0.0
    assert names()[mode] in controller.reason and "force sensor" in controller.reason
    assert not controller.faulted
    controller.mode = modes.IMPEDANCE
    controller.wanted.ask((0.02,), (0.0,), 3000 * MS)  # forgotten while the law gave no force
    run(controller, range(3000, 6000))
    assert controller.reason == ""
    assert controller.output.force - controller.output.gravity == pytest.approx(-45.0)


def test_a_law_of_others_that_needs_the_force_waits_for_a_sample():
    controller = controller_in(ODD, (*LAWS, THE_ODD))
    run(controller, range(1, 100))
    assert "mode ODD feeds its force back" in controller.reason
    run(controller, range(100, 200), force=0.0)
    assert controller.reason == ""


def test_a_force_sensor_that_is_not_required_may_be_used():
    controller = controller_in(modes.FORCE_FEEDBACK)
    run(controller, range(1, 3000), force=45.0)
    assert controller.reason == ""
    assert controller.output.force - controller.output.gravity == pytest.approx(-45.0)


def test_a_fault_before_any_torque_ends_with_its_cause():
    """In operation it would stay until a reset."""
    controller = controller_in(modes.OFF)
    for tick in range(1, 60):
        controller.on_drive(False, 0.0, tick * MS)
        controller.on_encoder(position(tick, speed=2.0 if 20 <= tick < 25 else 0.0), tick * MS)
        assert tick != 20 or "faster" in controller.reason
    assert controller.reason == ""


AT = 1000 * MS


@pytest.mark.parametrize(
    ("method", "arguments"),
    [
        ("on_force", (force_sample(1000, status=1 << 4), AT)),
        ("on_encoder", (position(1000, place=0.30), AT)),
        ("on_encoder", (position(1000)._replace(monotonic_ns=10**15), AT)),
        ("set_fault", ("from elsewhere",)),
        ("stop_when_silent", (1100 * MS,)),
    ],
)
def test_a_fault_in_operation_stays_though_the_drive_goes_off_before_the_next_sample(
    method, arguments
):
    """Each input of the controller may be the last one before the drive reports that it is off."""
    made = controller_in(modes.IMPEDANCE)
    run(made, range(1, 1000), force=0.0)
    assert not made.faulted
    getattr(made, method)(*arguments)
    made.on_drive(False, 0.0, AT)
    assert made.faulted and made.reason


def test_after_its_reset_a_fault_without_torque_ends_with_its_cause_again():
    made = controller_in(modes.IMPEDANCE)
    run(made, range(1, 1000), force=0.0)
    made.stop_when_silent(1100 * MS)
    made.on_drive(False, 0.0, AT)
    made.reset(AT)
    made.set_fault("anything")
    made.on_drive(False, 0.0, AT + MS)
    assert made.fault.reason != "anything"
