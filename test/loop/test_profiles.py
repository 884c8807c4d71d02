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
from screw_module_ros.settings import SettingError
from screw_module_ros.trials.one_thread import OneThreadRobot

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


def missing(bench):
    return {each.guard for each in bench.drive.unguarded}


@pytest.fixture
def unready():
    """Return a maker of robots whose drives, encoder and force sensor are of the makes it is told.

    lacking: object of the vertical drive that cannot be written.
    """
    made = []

    def make(drive=profiles.GENERIC_402, encoder=profiles.GENERIC_406,
             sensor=profiles.NETCANOEM, word=True, lacking=None):  # fmt: skip
        made.append(OneThreadRobot(1, WORDS.get(drive) if word else None, drive, encoder, sensor))
        if lacking:
            made[-1].rig.devices["drive"].node.variable(*lacking).access_type = "ro"
        return made[-1]

    yield make
    for bench in made:
        bench.close()


@pytest.fixture
def ready(unready):
    """Return a maker of robots that are connected, homed and tared."""

    def make(**makes):
        bench = unready(**makes)
        bench.ready()
        return bench

    return make


@pytest.fixture
def robot(ready):
    """Return a maker of robots that are enabled."""

    def make(**makes):
        bench = ready(**makes)
        assert bench.enable() == ""
        return bench

    return make


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
    assert moved(bench) > 0.04
    assert bench.rig.inject("drive", "fault", 0x7300, 0.05, bench.now_ns)
    bench.seconds(0.3)
    assert "7300" in bench.axis.permit.reason
    assert not bench.axis.permit.enabled
    assert bench.clear_fault() == ""
    assert bench.enable() == ""
    bench.seconds(0.2)
    assert bench.axis.permit.enabled


@pytest.mark.parametrize("name", [each for each in DRIVES if each != "ingenia"])
def test_a_drive_stops_by_itself_when_this_program_does(robot, name):
    """The loop hangs: no frame of ours any more. The motor is free within the drive's own time."""
    bench = robot(drive=name)
    bench.seconds(0.55)
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


def test_a_drive_without_a_watch_of_our_heartbeat_needs_the_operators_word(ready, robot):
    refused = ready(drive="ingenia", word=False).enable()
    assert "allow_no_heartbeat" in refused
    assert "command_deadline, lost_connection, quick_stop_reaction, fault_reaction" in refused
    allowed = robot(drive="ingenia").drive
    assert allowed.danger.startswith("DANGER")
    assert any("1016" in warning for warning in allowed.warnings)


@pytest.mark.parametrize(
    ("name", "guards", "substitute"),
    [
        ("epos4", {"command deadline", "torque limit"}, (0x3001, 2, 10_000)),  # 2000 per mille
        ("elmo_gold", {"command deadline"}, (0x2F75, 0, 20)),  # 20 ms at 1 kHz
        ("elmo_simpliq", {"command deadline"}, None),
    ],
)
def test_what_stands_in_for_a_guard_is_written_and_told(ready, name, guards, substitute):
    bench = ready(drive=name)
    assert bench.drive.unguarded == ()
    told = [each for each in bench.drive.warnings if "in its place" in each]
    assert len(told) == len(guards)
    assert all(any(guard in each for each in told) for guard in guards)
    if substitute:
        index, subindex, value = substitute
        assert bench.rig.devices["drive"].node.value(index, subindex) == value


def test_a_guard_that_a_word_replaces_is_a_danger_told_at_each_enabling(ready):
    """EPOS4: our heartbeat has to do for the command deadline; its current limit is written."""
    told = ready(drive="epos4").drive.danger
    assert told.startswith("DANGER") and told.count("DANGER") == 1
    assert "without command deadline 1400:05; in its place only: our heartbeat" in told
    assert ready(drive=profiles.GENERIC_402).drive.danger == ""


def test_words_alone_enable_no_drive(unready):
    """Seven texts for seven guards, in place of what holds the torque back."""
    bench = unready(drive="ingenia", word=False)
    words = tuple(profiles.Substitute(guard, "the maker says so") for guard in profiles.GUARDS)
    profile = bench.drive.profile
    bench.drive.profile = profile._replace(drive=profile.drive._replace(substitutes=words))
    bench.ready()
    assert "master_heartbeat" in missing(bench)
    assert "allow_no_heartbeat" in bench.enable()
    assert not bench.axis.permit.enabled


@pytest.mark.parametrize(
    ("substitute", "wrong"),
    [
        ("{guard: fault_reaction, text: so}", "fault_reaction: a text alone holds no torque back"),
        ("{guard: master_heartbeat, text: so, relies_on: [lost_connection]}",
         "master_heartbeat: only a deadline for commands replaces watching our heartbeat"),
        ("{guard: master_heartbeat, text: so, relies_on: [command_deadline]}", ""),
        ("{guard: master_heartbeat, text: so, objects: "
         "[{object: '2F75', size: 2, quantity: deadline_periods}]}", ""),
    ],
)  # fmt: skip
def test_what_a_profile_may_put_in_place_of_a_guard(tmp_path, substitute, wrong):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "format: screw_module_ros/device\nversion: 1\nkind: drive\nmake: mine\ntried: nowhere\n"
        f"sources: []\ndrive:\n  substitutes:\n    - {substitute}\n"
    )
    if wrong:
        with pytest.raises(SettingError, match=wrong):
            profiles.load(str(file))
    else:
        assert profiles.load(str(file)).drive.substitutes[0].guard == "master_heartbeat"


def test_a_substitute_that_is_refused_leaves_the_guard_missing(ready):
    bench = ready(drive="epos4", lacking=(0x3001, 2))
    assert missing(bench) == {"torque_limit"}
    assert "3001:02" in bench.enable()


def test_a_substitute_that_relies_on_a_missing_guard_does_not_count(ready):
    bench = ready(drive="epos4", lacking=(0x1016, 1))
    assert missing(bench) == {"master_heartbeat", "command_deadline"}


def test_our_heartbeat_stands_in_for_nothing_where_its_loss_is_no_fault(ready):
    """Without 6007 the drive may note the loss and go on."""
    bench = ready(drive="epos4", lacking=(0x6007, 0))
    assert missing(bench) == {"lost_connection", "command_deadline"}


def test_the_mode_is_read_where_the_drive_cannot_map_it(robot):
    """SimplIQ: 603F and 6061 come by SDO. A drive that leaves torque mode is stopped then."""
    bench = robot(drive="elmo_simpliq")
    bench.rig.inject("drive", "mode_lost", 0.0, 1.0, bench.now_ns)
    bench.seconds(0.5)
    assert "is not in torque mode 4" in bench.axis.permit.reason


def test_nobody_else_commands_a_drive_by_a_pdo_that_cannot_be_disabled(robot):
    """SimplIQ with a fixed mapping of RPDO2: a frame there is another master's."""
    bench = robot(drive="elmo_simpliq", lacking=(0x1601, 0))
    bench.rig.devices["drive"].link.send(0x301, b"\x0f\x00")
    bench.seconds(0.05)
    assert "somebody else commands the drive" in bench.axis.permit.reason


@pytest.mark.parametrize(("asked", "per_mille"), [(1.6, 2000), (-1.6, -2000)])
def test_a_target_stays_in_the_range_of_the_make(ready, asked, per_mille):
    assert ready(drive="epos4").drive._per_mille(asked) == per_mille


@pytest.mark.parametrize("name", DRIVES)
def test_the_profile_that_fits_is_found(unready, name):
    bench = unready(drive=name)
    sdo, node = bench.drive.sdo, bench.rig.devices["drive"].node
    bench.rig.process(bench.now_ns + 50_000_000)
    assert sdo.unsigned(0x1000)
    found = profiles.closest(profiles.DRIVE, node.value(0x1018, 1), node.has)
    assert found[0].name == name
    assert found[0].differing == ()
    assert all(each.differing for each in found[1:])


@pytest.mark.parametrize("name", ENCODERS)
def test_an_encoder_from_configure_to_motion(unready, name):
    bench, written = unready(encoder=name), []
    bench.rig.devices["encoder"].node.checks.append(lambda *write: written.append(write[0]))
    bench.ready()
    assert MAKES[name].encoder.scaling or not {0x6000, 0x6001, 0x6002} & set(written)
    assert bench.enable() == ""
    assert moved(bench) > 0.04


def test_an_encoder_that_counts_otherwise_is_told(unready):
    bench = unready(encoder="sick_ahm36")
    bench.encoder.settings = bench.encoder.settings._replace(counts_per_turn=4096)
    with pytest.raises(NotConfigured, match="object 6501.*set it to 20000"):
        bench.connect()


def test_an_encoder_that_scales_already_is_compared_with_its_scale(unready):
    """Nothing is written: who set it up may have had a reason."""
    bench = unready(encoder="baumer_rotary")
    node = bench.rig.devices["encoder"].node
    node.put(0x6000, 0, 1 << MAKES["baumer_rotary"].encoder.scaling_bit)
    node.put(0x6001, 0, 4096)
    with pytest.raises(NotConfigured, match="object 6001, its scaling is on.*set it to 4096"):
        bench.connect()


@pytest.mark.parametrize(("make", "period"), [("epos4", 0.010), ("elmo_gold", 0.015)])
def test_a_make_that_needs_a_short_heartbeat_gets_four_in_its_timeout(unready, make, period):
    assert unready(drive=make).drive.settings.heartbeat_period == pytest.approx(period)


def test_every_protocol_has_a_driver_and_a_simulated_sensor():
    assert PROTOCOLS.keys() == SENSORS.keys()
    assert {MAKES[name].force_sensor.protocol for name in FORCE_SENSORS} == PROTOCOLS.keys()


def test_every_force_sensor_measures_as_the_netcanoem_does(robot):
    felt = {}
    for name in FORCE_SENSORS:
        bench = robot(sensor=name)
        assert moved(bench) > 0.04
        felt[name] = [row.patient for row in bench.rows[-500:]]
    wanted = felt[profiles.NETCANOEM]
    assert max(map(abs, wanted)) > 3.0 and len(felt) > 1
    for found in felt.values():  # 1 N: noise and rounding of two electronics
        assert max(abs(a - b) for a, b in zip(wanted, found, strict=True)) < 1.0


@pytest.mark.parametrize(
    ("fault", "size", "said"),
    [
        ("freeze", 0.0, "force sensor: no sample"),  # it repeats a sample
        ("status", 6.0, "reports an error, status 0x8000"),
    ],
)
def test_a_net_box_that_fails_stops_the_robot(robot, fault, size, said):
    bench = robot(sensor="ati_net")
    bench.rig.inject("force_sensor", fault, size, 0.0, bench.now_ns)
    bench.seconds(0.1)
    assert said in f"{bench.controller.reason}, {bench.force_sensor.fault}"
    assert (bench.force_sensor.counters["repeated"] > 50) == (fault == "freeze")
    assert bench.rows[-1].torque == 0.0


def test_a_net_box_needs_its_counts_per_unit(unready):
    bench = unready(sensor="ati_net")
    bench.force_sensor.settings = bench.force_sensor.settings._replace(counts_per_force=0.0)
    with pytest.raises(NotConfigured, match="counts_per_force"):
        bench.connect()


# What an earlier master left, and what a make does otherwise --------------------------------------


@pytest.fixture
def like(tmp_path):
    """Return a maker of profiles like the generic drive's, but for the lines given.

    Devices of the simulation differ by `objects` and `simulated`, the driver's part is `drive`.
    """

    def make(objects="{}", simulated="{}", drive="{}"):
        file = tmp_path / "mine.yaml"
        file.write_text(
            "format: screw_module_ros/device\nversion: 1\nkind: drive\nmake: mine\ntried: nowhere\n"
            f"sources: []\nobjects: {objects}\nsimulated: {simulated}\ndrive: {drive}\n"
        )
        return str(file)

    return make


def test_what_an_earlier_master_left_in_a_drive_is_set_back(robot, like):
    """Another SYNC, a counter in it, a period, emergencies switched off: each would silence it."""
    make = like("{'1005': {value: 0x81}, '1019': {size: 1, value: 10}, '1014': {value: 0x80000085},"
                " '1006': {size: 4, value: 20000}, '1007': {size: 4, value: 100}}")  # fmt: skip
    bench = robot(drive=make)
    node = bench.rig.devices["drive"].node
    assert [node.value(index) for index in (0x1005, 0x1006, 0x1007, 0x1014, 0x1019)] == [
        0x80, 1000, 0, 0x81, 0
    ]  # fmt: skip
    assert len(bench.drive.set_back) == 5
    assert moved(bench) > 0.04


def test_a_drive_that_keeps_another_sync_is_told_by_its_object(unready, like):
    bench = unready(drive=like("{'1005': {value: 0x81, read_only: true}}"))
    with pytest.raises(NotConfigured, match="0x81 in object 1005.*would not answer our SYNC"):
        bench.connect()


@pytest.mark.parametrize(
    ("objects", "simulated", "kind", "told"),
    [
        ("{}", "{transmission_types: [1, 253, 255]}", 255, 0),
        ("{'1801:05': {absent: true}}", "{transmission_types: [1, 253, 255]}", 1, 1),
        ("{'1801:05': {absent: true}}", "{}", 100, 0),
        ("{'603F': {absent: true}}", "{}", 255, 1),
        ("{'603F': {mappable: false}, '6061': {mappable: false}, '60FD': {absent: true}}", "{}",
         None, 1),
    ],
    ids=["types of the standard", "each SYNC", "no timer", "no error code", "nothing"],
)  # fmt: skip
def test_a_slow_status_is_best_effort(robot, like, objects, simulated, kind, told):
    bench = robot(drive=like(objects, simulated))
    node = bench.rig.devices["drive"].node
    assert bool(node.value(0x1801, 1) >> 31) == (kind is None)
    assert kind in (None, node.value(0x1801, 2))
    assert len([each for each in bench.drive.warnings if "TPDO2" in each]) == told
    assert moved(bench) > 0.04
    bench.rig.inject("drive", "mode_lost", 0.0, 1.0, bench.now_ns)
    bench.seconds(0.55)
    assert "is not in torque mode 10" in bench.axis.permit.reason


def test_a_slow_status_of_nothing_is_asked_for(robot, like):
    """Without a timer in TPDO2 this was an IndexError."""
    bench = robot(drive=like("{'1801:05': {absent: true}}", drive="{slow_status: []}"))
    assert moved(bench) > 0.04
    assert not any("TPDO2" in each for each in bench.drive.warnings)


def test_the_load_of_a_bus_counts_a_slow_status_at_each_sync(ready, like):
    """Seven bytes at 1 kHz in place of ten times a second."""
    found = ready(drive=like("{'1801:05': {absent: true}}", "{transmission_types: [1, 255]}"))
    (slow,) = [each for each in found.drive.traffic if "TPDO2" in each.name]
    assert (slow.data_bytes, slow.rate) == (7, pytest.approx(1000.0))


@pytest.mark.parametrize("state", [profiles.READY, profiles.ENABLED])
def test_a_drive_that_shows_its_mode_late_gives_no_torque_before(ready, like, state):
    bench = ready(drive=like("{}", f"{{mode_shown: {state}}}", f"{{mode_shown: {state}}}"))
    motor = bench.rig.devices["drive"]
    bench.controller.mode, bench.setpoint = 1, (bench.home + 0.05, 0.0)
    before = len(bench.rows)
    assert bench.enable() == ""
    bench.seconds(0.5)
    assert bench.drive.mode_confirmed and bench.axis.permit.enabled
    assert max(abs(row.torque) for row in bench.rows[before:]) > 0.01
    assert motor.machine.driving


def test_a_drive_that_shows_its_mode_late_is_not_configured_as_any_other(unready, like):
    bench = unready(drive=like("{}", "{mode_shown: enabled}"))
    with pytest.raises(NotConfigured, match=r"6061 shows 0; .*`mode_shown` of its profile"):
        bench.connect()


@pytest.mark.parametrize("state", [profiles.READY, profiles.ENABLED])
def test_a_drive_that_comes_up_in_another_mode_gives_no_torque(ready, like, state):
    """It is enabled, and 6061 shows no torque mode: nothing passes, and it is latched."""
    bench = ready(drive=like("{}", f"{{mode_shown: {state}}}", f"{{mode_shown: {state}}}"))
    bench.rig.inject("drive", "mode_lost", 0.0, 0.0, bench.now_ns)
    bench.seconds(0.5)
    bench.controller.mode, bench.setpoint = 1, (bench.home + 0.05, 0.0)
    before = len(bench.rows)
    assert bench.enable()
    bench.seconds(1.2)
    assert all(row.torque == 0.0 for row in bench.rows[before:])
    assert not bench.rig.devices["drive"].machine.driving


def test_a_drive_that_is_enabled_in_another_mode_is_not_at_rest(ready, like):
    """Nothing may be written to it, and no home taken, before it has gone off."""
    bench = ready(drive=like("{}", "{mode_shown: enabled}", "{mode_shown: enabled}"))
    permit = bench.axis.permit
    assert permit.at_rest(bench.now_ns)
    bench.rig.inject("drive", "mode_lost", 0.0, 0.0, bench.now_ns)
    bench.drive.request_enable()
    bench.ticks(20)
    assert not bench.drive.is_on(bench.now_ns) and not permit.enabled
    assert not permit.at_rest(bench.now_ns)


CURRENT_DRIVES = ("epos2", "ipos", "kinco")
#: Where each keeps the command at its limit of 1.6 Nm, and what it is then.
LIMITS = {"epos2": ((0x6410, 2), 10_000), "ipos": ((0x207F, 0), 32_767 - 16_381)}


@pytest.fixture
def pushed(robot):
    """Return a function: what the motor of a make gives, and what it reports, on one way [Nm]."""

    def push(name):
        bench = robot(drive=name)
        bench.controller.mode, bench.setpoint = 1, (bench.home + 0.05, 0.0)
        bench.seconds(0.3)
        return bench.rig.devices["drive"].axis.torque(), bench.drive.reading.torque

    return push


@pytest.mark.parametrize("name", CURRENT_DRIVES)
def test_a_drive_that_is_commanded_by_a_current_gives_the_torque_of_any_other(pushed, name):
    given, reported = pushed(name)
    wanted, _ = pushed(profiles.GENERIC_402)
    count = 0.42 / MAKES[name].simulated.parameters["rated_command"]
    assert wanted > 0.01
    assert given == pytest.approx(wanted, abs=2 * count, rel=0.05)
    assert reported == pytest.approx(given, abs=2 * count, rel=0.05)


@pytest.mark.parametrize("name", LIMITS)
def test_the_current_limit_of_such_a_drive_is_written_and_read_back(ready, name):
    bench = ready(drive=name)
    (index, subindex), value = LIMITS[name]
    assert bench.rig.devices["drive"].node.value(index, subindex) == value
    assert bench.drive.unguarded == ()


@pytest.mark.parametrize("name", CURRENT_DRIVES)
def test_a_drive_without_a_rating_needs_the_parameter(unready, name):
    bench = unready(drive=name)
    bench.drive.settings = bench.drive.settings._replace(rated_command=0)
    with pytest.raises(NotConfigured, match="set `rated_command` to what its command is at"):
        bench.connect()


@pytest.mark.parametrize("name", CURRENT_DRIVES)
def test_a_rating_that_nobody_checks_is_told(ready, name):
    told = " ".join(ready(drive=name).drive.warnings)
    assert "does not tell its rated torque: 0.42 Nm is the parameter's word alone" in told


def test_a_drive_without_a_rating_and_without_a_profile_gets_one_plain_sentence(unready, like):
    bench = unready(drive=like("{'6076': {absent: true}}"))
    with pytest.raises(NotConfigured) as refused:
        bench.connect()
    assert str(refused.value).count("6076") == 1
    assert "only a `profile` of its make can say it (`rating`, `rated_" in str(refused.value)


def test_per_mille_of_a_rating_that_the_drive_does_not_tell(robot, like):
    """Nanotec PD4-E and Kollmorgen AKD: 6071 in per mille, no 6076."""
    bench = robot(drive=like("{'6076': {absent: true}}", drive="{rating: ''}"))
    assert moved(bench) > 0.04


@pytest.mark.parametrize(
    ("drive", "wrong"),
    [
        ("{modes: [1]}", "1 is no torque mode"),
        ("{mode_bits: 0x81}", "bits 0 to 3 and 7 belong to the state machine"),
        ("{command: '2030'}", "only 6071 is per mille of object 6076"),
    ],
)
def test_what_does_not_fit_together_in_a_profile_is_told(like, drive, wrong):
    with pytest.raises(SettingError, match=wrong):
        profiles.load(like(drive=drive))
