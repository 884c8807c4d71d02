# SPDX-License-Identifier: Apache-2.0
"""Every make of params/devices: configured, enabled, moved, faulted, recovered, on the rig."""

from __future__ import annotations

import pytest

from screw_module_ros import profiles
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import NotConfigured
from screw_module_ros.devices.force_sensors import PROTOCOLS
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.rig.build import SENSORS
from screw_module_ros.trials.one_thread import Bench

pytestmark = pytest.mark.long

MAKES = {name: profiles.load(name) for name in profiles.NAMES}
DRIVES = [name for name, each in MAKES.items() if each.kind == profiles.DRIVE]
FORCE_SENSORS = [n for n, each in MAKES.items() if each.kind == profiles.FORCE_SENSOR]
ENCODERS = [name for name, each in MAKES.items() if each.kind == profiles.ENCODER]
# What a drive of this make lacks without a substitute; the operator has to say so.
WORDS = {
    "ingenia": DriveSettings(
        waived="command_deadline, lost_connection, quick_stop_reaction, fault_reaction",
        allow_no_heartbeat=True,
    )
}
SILENT_S = 0.25


@pytest.fixture
def robot(request):
    """A robot whose drives and encoder are of the makes that the test names."""
    made = []

    def make(drive=profiles.GENERIC_402, encoder=profiles.GENERIC_406,
             sensor=profiles.NETCANOEM, word=True):  # fmt: skip
        settings = WORDS.get(drive) if word else None
        made.append(Bench(1, settings, drive, encoder, sensor))
        return made[-1]

    yield make
    for bench in made:
        bench.close()


def moved(bench) -> float:
    """Let the patient swing the handle; return how far the vertical axis has gone [m]."""
    bench.controller.mode = 1
    bench.setpoint = (0.18, 0.0)
    bench.world.set_arm(ArmSettings(kind="active", target=(0, 0, 0.18), duration=0.8,
                                    amplitude=(0, 0, 0.1), omega=(0, 0, 1.6)))  # fmt: skip
    rows = bench.seconds(1.0)
    assert all(row.reason == "" for row in rows), next(r.reason for r in rows if r.reason)
    assert max(abs(row.torque) for row in rows) > 0.01
    heights = [row.position for row in rows]
    return max(heights) - min(heights)


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_from_configure_to_recovery(robot, name):
    bench = robot(drive=name)
    bench.ready()
    assert bench.enable() == ""
    assert moved(bench) > 0.04
    assert bench.rig.inject("drive", "fault", 0x7300, 0.05, bench.now_ns)
    bench.seconds(0.3)
    assert "7300" in bench.axis.permit.reason
    assert not bench.torque_passes
    assert bench.clear_fault() == ""
    assert bench.enable() == ""
    bench.seconds(0.2)
    assert bench.torque_passes


@pytest.mark.parametrize("name", [each for each in DRIVES if each != "ingenia"])
def test_a_drive_stops_by_itself_when_this_program_does(robot, name):
    """The loop hangs: no frame of ours any more. The motor is free within the drive's own time."""
    bench = robot(drive=name)
    bench.ready()
    assert bench.enable() == ""
    bench.seconds(0.7)
    motor = bench.rig.devices["drive"].machine
    assert motor.driving
    longest_ns = round(bench.drive.settings.heartbeat_timeout * 1e9)
    begun_ns = bench.now_ns
    while motor.driving and bench.now_ns - begun_ns < SILENT_S * 1e9:
        bench.clock.time_ns += 1_000_000
        bench.rig.process(bench.now_ns)
    assert not motor.driving
    assert bench.now_ns - begun_ns <= longest_ns + 1_000_000
    assert bench.now_ns - begun_ns <= 61_000_000  # whatever stands in for the command deadline


def test_a_drive_without_a_watch_of_our_heartbeat_needs_the_operators_word(robot):
    bench = robot(drive="ingenia", word=False)
    bench.ready()
    refused = bench.enable()
    assert "allow_no_heartbeat" in refused
    assert "command_deadline, lost_connection, quick_stop_reaction, fault_reaction" in refused
    allowed = robot(drive="ingenia")
    allowed.ready()
    assert allowed.enable() == ""
    assert allowed.drive.danger.startswith("DANGER")
    assert any("1016" in warning for warning in allowed.drive.warnings)


@pytest.mark.parametrize(
    ("name", "guards", "substitute"),
    [
        ("epos4", {"command deadline", "torque limit"}, (0x3001, 2, 10_000)),  # 2000 per mille
        ("elmo_gold", {"command deadline"}, (0x2F75, 0, 20)),  # 20 ms at 1 kHz
        ("elmo_simpliq", {"command deadline"}, None),
    ],
)
def test_what_stands_in_for_a_guard_is_written_and_told(robot, name, guards, substitute):
    bench = robot(drive=name)
    bench.ready()
    assert bench.drive.unguarded == ()
    told = [each for each in bench.drive.warnings if "in its place" in each]
    assert len(told) == len(guards)
    assert all(any(guard in each for each in told) for guard in guards)
    if substitute:
        index, subindex, value = substitute
        assert bench.rig.devices["drive"].node.value(index, subindex) == value


def test_a_substitute_that_is_refused_leaves_the_guard_missing(robot):
    bench = robot(drive="epos4")
    bench.rig.devices["drive"].node.variable(0x3001, 2).access_type = "ro"
    bench.ready()
    assert [each.guard for each in bench.drive.unguarded] == ["torque_limit"]
    assert "3001:02" in bench.enable()


def test_a_substitute_that_relies_on_a_missing_guard_does_not_count(robot):
    bench = robot(drive="epos4")
    bench.rig.devices["drive"].node.variable(0x1016, 1).access_type = "ro"
    bench.ready()
    missing = {each.guard for each in bench.drive.unguarded}
    assert missing == {"master_heartbeat", "command_deadline"}


def test_our_heartbeat_stands_in_for_nothing_where_its_loss_is_no_fault(robot):
    """Without 6007 the drive may note the loss and go on."""
    bench = robot(drive="epos4")
    bench.rig.devices["drive"].node.variable(0x6007, 0).access_type = "ro"
    bench.ready()
    missing = {each.guard for each in bench.drive.unguarded}
    assert missing == {"lost_connection", "command_deadline"}


def test_the_mode_is_read_where_the_drive_cannot_map_it(robot):
    """SimplIQ: 603F and 6061 come by SDO. A drive that leaves torque mode is stopped then."""
    bench = robot(drive="elmo_simpliq")
    bench.ready()
    assert bench.enable() == ""
    bench.rig.inject("drive", "mode_lost", 0.0, 1.0, bench.now_ns)
    bench._asking(lambda clock: bench.drive.poll_slow() or "")
    bench.seconds(0.05)
    assert "left torque mode" in bench.axis.permit.reason


def test_nobody_else_commands_a_drive_by_a_pdo_that_cannot_be_disabled(robot):
    """SimplIQ with a fixed mapping of RPDO2: a frame there is another master's."""
    bench = robot(drive="elmo_simpliq")
    node = bench.rig.devices["drive"].node
    node.variable(0x1601, 0).access_type = "ro"
    bench.ready()
    assert bench.enable() == ""
    bench.rig.devices["drive"].link.send(0x301, b"\x0f\x00")
    bench.seconds(0.05)
    assert "somebody else commands the drive" in bench.axis.permit.reason


def test_a_target_stays_in_the_range_of_the_make(robot):
    bench = robot(drive="epos4")
    bench.ready()
    assert bench.drive._per_mille(1.6) == 2000
    assert bench.drive._per_mille(-1.6) == -2000


@pytest.mark.parametrize("name", DRIVES)
def test_the_profile_that_fits_is_found(robot, name):
    bench = robot(drive=name)
    sdo, node = bench.drive.sdo, bench.rig.devices["drive"].node
    bench.rig.process(bench.now_ns + 50_000_000)
    assert sdo.unsigned(0x1000)
    found = profiles.closest(profiles.DRIVE, node.value(0x1018, 1), node.has)
    assert found[0].name == name
    assert found[0].differing == ()
    assert all(each.differing for each in found[1:])


@pytest.mark.parametrize("name", ENCODERS)
def test_an_encoder_from_configure_to_motion(robot, name):
    bench = robot(encoder=name)
    written = []
    bench.rig.devices["encoder"].node.checks.append(lambda *write: written.append(write[0]))
    bench.ready()
    if not MAKES[name].encoder.scaling:
        assert not {0x6000, 0x6001, 0x6002} & set(written)
    assert bench.enable() == ""
    assert moved(bench) > 0.04


def test_an_encoder_that_counts_otherwise_is_told(robot):
    bench = robot(encoder="sick_ahm36")
    bench.encoder.settings = bench.encoder.settings._replace(counts_per_turn=4096)
    with pytest.raises(NotConfigured, match="object 6501.*set it to 20000"):
        bench.connect()


def test_an_encoder_that_scales_already_is_compared_with_its_scale(robot):
    """Nothing is written: who set it up may have had a reason."""
    bench = robot(encoder="baumer_rotary")
    node = bench.rig.devices["encoder"].node
    node.put(0x6000, 0, 1 << MAKES["baumer_rotary"].encoder.scaling_bit)
    node.put(0x6001, 0, 4096)
    with pytest.raises(NotConfigured, match="object 6001, its scaling is on.*set it to 4096"):
        bench.connect()


@pytest.mark.parametrize(("make", "period"), [("epos4", 0.010), ("elmo_gold", 0.015)])
def test_a_make_that_needs_a_short_heartbeat_gets_four_in_its_timeout(robot, make, period):
    bench = robot(drive=make)
    assert bench.drive.settings.heartbeat_period == pytest.approx(period)


def test_every_protocol_has_a_driver_and_a_simulated_sensor():
    assert PROTOCOLS.keys() == SENSORS.keys()
    assert {MAKES[name].force_sensor.protocol for name in FORCE_SENSORS} == PROTOCOLS.keys()


def test_every_force_sensor_measures_as_the_netcanoem_does(robot):
    felt = {}
    for name in FORCE_SENSORS:
        bench = robot(sensor=name)
        bench.ready()
        assert bench.enable() == ""
        assert moved(bench) > 0.04
        felt[name] = [row.patient for row in bench.rows[-500:]]
    wanted = felt[profiles.NETCANOEM]
    assert max(map(abs, wanted)) > 3.0 and len(felt) > 1
    for found in felt.values():  # 1 N: noise and rounding of two electronics
        assert max(abs(a - b) for a, b in zip(wanted, found, strict=True)) < 1.0


def test_a_net_box_that_repeats_a_sample_gives_none(robot):
    bench = robot(sensor="ati_net")
    bench.ready()
    assert bench.enable() == ""
    bench.rig.inject("force_sensor", "freeze", 0.0, 0.0, bench.now_ns)
    bench.seconds(0.1)
    assert bench.force_sensor.counters["repeated"] > 50
    assert "force sensor: no sample" in bench.controller.reason
    assert bench.rows[-1].torque == 0.0


def test_a_net_box_with_an_error_stops_the_robot(robot):
    bench = robot(sensor="ati_net")
    bench.ready()
    assert bench.enable() == ""
    bench.rig.inject("force_sensor", "status", 6.0, 0.0, bench.now_ns)
    bench.seconds(0.1)
    assert "reports an error, status 0x8000" in bench.force_sensor.fault
    assert bench.rows[-1].torque == 0.0


def test_a_net_box_needs_its_counts_per_unit(robot):
    bench = robot(sensor="ati_net")
    bench.force_sensor.settings = bench.force_sensor.settings._replace(counts_per_force=0.0)
    with pytest.raises(NotConfigured, match="counts_per_force"):
        bench.connect()
