# SPDX-License-Identifier: Apache-2.0
"""A robot may run without a force sensor, but then no mode feeds back a force that nobody measures.

A handle force of zero tells the feedback that nothing resists the spring: the command was 75 N
down, 85 N at the hand with the weight, where 45 N are the limit.
"""

from __future__ import annotations

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.safety.checks import AgreementSettings, WatchSettings
from screw_module_ros.samples import EncoderReading, ForceReading

MODEL = thesis_friction()
MS = 1_000_000


def controller_in(mode: int) -> VerticalController:
    """Return a controller whose spring would press with all that it may."""
    made = VerticalController(
        VerticalSettings(stiffness=1000.0, damping=40.0),
        MODEL,
        WatchSettings(force_required=False),
        AgreementSettings(),
        MS,
        mode,
    )
    made.wanted.ask((0.02,), (0.0,), MS)
    return made


def run(controller: VerticalController, ticks: range, force: float | None = None) -> None:
    """Let a nut at rest go by, with a force on the handle [N] or without a force sensor."""
    for tick in ticks:
        now = tick * MS
        controller.on_drive(True, 0.0, now)
        if force is not None:
            reading = ForceReading(tick, now, 0, 0.0, 0.0, force, 0.0, 0.0, 0.0, 0)
            controller.on_force(reading, now)
        assert controller.on_encoder(EncoderReading(tick, now, 0, 0, 0.18, 0.0, True), now)


@pytest.mark.parametrize("mode", list(filter(modes.uses_force, modes.MODE_NAMES)))
def test_no_force_is_fed_back_that_nobody_measures(mode):
    controller = controller_in(mode)
    run(controller, range(1, 3000))
    assert controller.output.force == 0.0
    assert modes.MODE_NAMES[mode] in controller.reason and "force sensor" in controller.reason
    assert not controller.faulted
    controller.mode = modes.IMPEDANCE
    controller.wanted.ask((0.02,), (0.0,), 3000 * MS)  # forgotten while the law gave no force
    run(controller, range(3000, 6000))
    assert controller.reason == ""
    assert controller.output.force - controller.output.gravity == pytest.approx(-45.0)


def test_a_force_sensor_that_is_not_required_may_be_used():
    controller = controller_in(modes.FORCE_FEEDBACK)
    run(controller, range(1, 3000), force=45.0)
    assert controller.reason == ""
    assert controller.output.force - controller.output.gravity == pytest.approx(-45.0)


def test_a_fault_before_any_torque_ends_with_its_cause():
    """In operation it would stay until a reset."""
    controller = controller_in(modes.IMPEDANCE)
    controller.mode = modes.OFF
    for tick in range(1, 60):
        now, speed = tick * MS, 2.0 if 20 <= tick < 25 else 0.0
        controller.on_drive(False, 0.0, now)
        sample = EncoderReading(tick, now, 0, 0, 0.18, speed, True)
        controller.on_encoder(sample, now)
        if tick == 20:
            assert "faster" in controller.reason
    assert controller.reason == ""


def test_a_fault_in_operation_stays_though_the_drive_goes_off_before_the_next_sample():
    """Each input of the controller may be the last one before the drive reports that it is off."""
    bad = ForceReading(1000, 1000 * MS, 0, *[0.0] * 6, 1 << 4)
    later = EncoderReading(1000, 1000 * MS, 0, 0, 0.30, 0.0, True)
    future = EncoderReading(1000, 10**15, 0, 0, 0.18, 0.0, True)
    for comes in (
        lambda made: made.on_force(bad, 1000 * MS),
        lambda made: made.on_encoder(later, 1000 * MS),
        lambda made: made.on_encoder(future, 1000 * MS),
        lambda made: made.set_fault("from elsewhere"),
        lambda made: made.idle(1100 * MS),
    ):
        made = controller_in(modes.IMPEDANCE)
        run(made, range(1, 1000), force=0.0)
        assert not made.faulted
        comes(made)
        made.on_drive(False, 0.0, 1000 * MS)
        assert made.faulted and made.reason
    # After its reset, a fault without torque ends with its cause again.
    made.reset(1000 * MS)
    made.set_fault("from elsewhere")
    made.on_drive(False, 0.0, 1001 * MS)
    assert made.fault.reason != "from elsewhere"
