# SPDX-License-Identifier: Apache-2.0
"""Silence of what a loop compares or measures with: how long it is tolerated, and what follows.

Also of a drive that restarts meanwhile: no torque without its guards, and a way back.
"""

from __future__ import annotations

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.devices.errors import NotAnswering
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings
from screw_module_ros.safety.checks import AgreementSettings, WatchSettings
from screw_module_ros.trials.one_thread import PERIOD_NS

MS = 1_000_000


def cable(bench, device: str, fault: str = "cable_out") -> None:
    bench.rig.inject(device, fault, 0.0, 0.0, bench.now_ns)


@pytest.mark.parametrize(("silence", "goes_on"), [(5.0, False), (30.0, True)])
def test_how_long_a_joint_may_be_silent_is_a_setting(bench, silence, goes_on):
    """The command's age, five periods, used to stop the plane whatever was set."""
    old = bench.plane
    bench.plane = Plane(
        bench.planar_drives, bench.ports["planar"], PERIOD_NS, old.controller.settings,
        JointSettings(silence=silence), old.drives.permit.settings,
    )  # fmt: skip
    bench.ticks(30)
    assert bench.plane.take_home(bench.now_ns) == ""
    assert bench.enable_plane() == ""
    bench.ticks(20)
    cable(bench, "elbow")
    bench.ticks(9)
    cable(bench, "elbow", "clear")
    bench.ticks(3)
    assert bench.plane.drives.permit.enabled == goes_on


def test_an_enabled_drive_that_says_nothing_is_a_fault_of_the_controller(enabled):
    """The encoder was compared with nothing from then on, while the law went on."""
    controller, now_ns = enabled.controller, enabled.now_ns
    assert controller.reason == ""
    controller.end_tick(now_ns + 199_000_000)
    assert controller.reason == ""
    controller.end_tick(now_ns + 201_000_000)
    assert "amplifier: no state for 200 ms" in controller.reason
    controller.on_drive(False, 0.0, now_ns + 202_000_000)
    assert controller.faulted, "until a reset"
    controller.reset(now_ns)
    assert controller.reason == ""


def test_no_force_before_the_drive_has_said_that_it_gives_torque(enabled):
    """Nothing to compare the encoder with: frozen, it would go unseen."""
    controller = enabled.controller
    controller._enabled = None
    sample = controller.answered
    later = sample._replace(sequence=sample.sequence + 1, monotonic_ns=sample.monotonic_ns + MS)
    controller.wanted.ask((enabled.home + 0.05,), (0.0,), later.monotonic_ns)
    output = controller.on_encoder(later, later.monotonic_ns)
    assert (controller.reason, output.force) == ("", 0.0)


def test_its_silence_clears_no_fault_of_the_operation(enabled):
    """A fault while torque passed stays until a reset, whatever the drive does then."""
    controller, now_ns = enabled.controller, enabled.now_ns
    controller.set_fault("a fault in operation")
    controller.on_drive(False, 0.0, now_ns)
    controller.end_tick(now_ns + 201_000_000)
    assert controller.reason == "a fault in operation"


def test_its_silence_ends_a_fault_from_before_the_torque(bench):
    controller, now_ns = bench.controller, bench.now_ns
    controller.on_drive(False, 0.0, now_ns)
    controller.set_fault("a fault at rest")
    controller.end_tick(now_ns + 201_000_000)
    assert controller.reason != "a fault at rest"


def test_a_silent_plane_shows_the_whole_gain(bench):
    cable(bench, "elbow")
    bench.ticks(10)
    assert (bench.plane.controller.output, bench.plane.controller.share) == (None, 1.0)


def test_a_controller_that_has_heard_nothing_commands_nothing():
    controller = VerticalController(
        VerticalSettings(), thesis_friction(), WatchSettings(), AgreementSettings(), PERIOD_NS
    )
    assert not controller.may_act


def test_a_controller_without_an_amplifier_waits_without_a_fault(bench):
    bench.controller._enabled = None
    bench.controller._drive.note(0)
    bench.controller.end_tick(bench.now_ns)
    assert not bench.controller.faulted


def watches_our_heartbeat(bench) -> bool:
    return bench.rig.devices["drive"].node.value(0x1016, 1) != 0


@pytest.mark.parametrize("how", ["cable_out", "bus_off"])
def test_clear_fault_configures_a_drive_that_restarted_unheard_anew(enabled, how):
    cable(enabled, "drive", how)
    cable(enabled, "drive", "reset")
    enabled.seconds(0.3)
    with pytest.raises(NotAnswering):
        enabled.clear_fault()
    assert enabled.enable() != "", "while it cannot be reached it stays off"
    cable(enabled, "drive", "clear")
    assert not watches_our_heartbeat(enabled)
    assert enabled.clear_fault() == ""
    assert watches_our_heartbeat(enabled)
    assert enabled.enable() == ""


def test_a_drive_that_keeps_its_pdos_over_a_restart_is_configured_anew_too(enabled):
    """It speaks again as if nothing had been; its guards and limits are gone all the same."""
    cable(enabled, "drive")
    enabled.rig.devices["drive"].node.put(0x1016, 1, 0)
    enabled.seconds(0.3)
    cable(enabled, "drive", "clear")
    enabled.seconds(0.1)
    assert enabled.clear_fault() == ""
    assert watches_our_heartbeat(enabled)
