# SPDX-License-Identifier: Apache-2.0
"""Ten faults of a first start, each of which `check_hardware` has to name; and a healthy rig."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from typing import ClassVar

import pytest
from click.testing import CliRunner
from loop_parts import twin_of

from screw_module_ros.can_io.bus import BusSettings, where
from screw_module_ros.clock import ManualClock
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.force_base import ForceSensor
from screw_module_ros.devices.life import Phase
from screw_module_ros.devices.makes import node_parameters
from screw_module_ros.graph import bus_of as bus_of_node
from screw_module_ros.hardware import command, devices, exchange, machine
from screw_module_ros.hardware.command import NODES, form, settings, values_of
from screw_module_ros.hardware.devices import Bus
from screw_module_ros.hardware.finding import OK, TO_DO, UNKNOWN, Finding, table
from screw_module_ros.locks import AlreadyRunning, lock_device
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.resources import resource_path
from screw_module_ros.rig.canopen_device import PRE_OPERATIONAL
from screw_module_ros.settings import SettingError
from screw_module_ros.trials.one_thread import OneThreadRobot

PERIOD_NS = 1_000_000


def bus_of(bench, name, *devices_):
    return Bus(name, bench.ports[name], 1_000_000, devices_)


def open_points(findings):
    return {each.what for each in findings if each.verdict == TO_DO}


def everything(bench):
    """What the command looks at, on the bench: traffic, ids, configuration."""
    buses = [
        bus_of(bench, "encoder", bench.encoder),
        bus_of(bench, "drive", bench.drive),
        bus_of(bench, "force_sensor", bench.force_sensor),
        bus_of(bench, "planar", *bench.planar_drives),
    ]
    found = []
    for bus in buses:
        found += [*devices.traffic(bus, devices.listen(bus)), devices.node_ids(bus)]
        for device in bus.devices:
            found += devices.configured(device, f"{bus.name} device")
    return found


def sampled(bench, seconds=0.5):
    parts = {"encoder": (bench.encoder, bench.ports["encoder"]),
             "force_sensor": (bench.force_sensor, bench.ports["force_sensor"])}  # fmt: skip
    return devices.sampled(parts, bench.clock, PERIOD_NS, seconds)


def moved(bench, height=0.1):
    """Compare the directions while the patient lifts the handle."""
    for device in bench.devices:
        device.configure()
    bench.world.set_arm(ArmSettings(kind="active", target=(0, 0, bench.home + height),
                                    duration=0.5))  # fmt: skip
    return devices.directions(bench.encoder, bench.drive, bench.clock, 1.5)


def test_a_healthy_rig_has_nothing_to_do(bench):
    found = everything(bench)
    assert open_points(found) == set()
    assert open_points(sampled(bench)) == set()
    assert not any(drive.phase is Phase.RUNNING for drive in (bench.drive, *bench.planar_drives))


def test_a_drive_is_never_enabled(bench):
    everything(bench)
    sampled(bench)
    for name in ("drive", "shoulder", "elbow"):
        assert not bench.rig.devices[name].machine.driving
    assert bench.drive.counters["writes"] == 0


def test_cable_out(bench):
    bench.rig.inject("drive", "cable_out", 0.0, 0.0, bench.now_ns)
    found = everything(bench)
    line = next(each for each in found if each.what == "drive node ids")
    assert line.found == "nobody answers"
    assert "cable, 120 ohm at both ends, bit rate" in line.todo


def test_wrong_node_id(bench):
    bench.encoder = Encoder(bench.ports["encoder"], bench.encoder.settings._replace(node_id=9))
    line = devices.node_ids(bus_of(bench, "encoder", bench.encoder))
    assert line.found == "2: CiA 406"
    assert "node id 9" in line.todo


def test_wrong_rating(bench):
    bench.drive.settings = bench.drive.settings._replace(rated_torque=0.5)
    (line,) = devices.configured(bench.drive, "amplifier")
    assert "says a rated torque (6076) of 420" in line.found
    assert line.verdict == TO_DO


def test_another_make_is_named(bench):
    dictionary = bench.rig.devices["drive"].node.object_dictionary
    for index, subindex in ((0x1801, 5), (0x1400, 5)):
        dictionary[index].subindices.pop(subindex)
    dictionary[0x1018][1].default = 0xFB
    line = next(f for f in devices.configured(bench.drive, "amplifier") if f.verdict == TO_DO)
    assert "1400:05" in line.found
    assert "epos4" in line.todo


def test_missing_guard(bench):
    bench.rig.inject("drive", "refuse_guards", 0.0, 0.0, bench.now_ns)
    found = devices.configured(bench.drive, "amplifier")
    assert "amplifier guards" in open_points(found)
    assert "1016" in next(each.found for each in found if each.what == "amplifier guards")


def test_missing_sensor(bench):
    bench.rig.inject("force_sensor", "mute", 0.0, 0.0, bench.now_ns)
    (line,) = devices.configured(bench.force_sensor, "force_sensor")
    assert "does not answer" in line.found
    assert line.verdict == TO_DO


def test_second_master(bench):
    """Somebody sends our drive's commands, at 1 kHz."""
    far = bench.rig.devices["drive"].link
    serve = bench.clock.rounds.serve

    def command_too(now_ns):
        far.send(0x201, b"\x06\x00\x00\x00")
        serve(now_ns)

    bench.clock.rounds.serve = command_too
    (line,) = devices.configured(bench.drive, "amplifier")
    assert "somebody already commands" in line.found


def test_busy_bus(bench):
    bench.rig.inject("encoder", "flood", 4.0, 0.0, bench.now_ns)
    bus = bus_of(bench, "encoder", bench.encoder)
    heard = devices.listen(bus)
    assert open_points(devices.traffic(bus, heard)) == {"encoder traffic"}
    assert heard.used_by == "", "a babbling device is no master"


def talker(bench, bus, *frames):
    """Let somebody send these frames (identifier, data) on a bus, each millisecond."""
    far, serve = bench.rig.devices[bus].link.port, bench.clock.rounds.serve
    due_ns = bench.now_ns

    def talk(now_ns):
        nonlocal due_ns
        if now_ns >= due_ns:
            due_ns = now_ns + PERIOD_NS
            for frame in frames:
                far.send(*frame)
        serve(now_ns)

    bench.clock.rounds.serve = talk


@pytest.mark.parametrize(
    ("frame", "name"),
    [((0x080, b""), "SYNC"), ((0x281, bytes(7)), "0x281"), ((0x201, bytes(4)), "0x201"),
     ((0x601, bytes(8)), "0x601"), ((0x770, b"\x05"), "0x770"), ((0x000, b"\x01\x01"), "0x000")],
)  # fmt: skip
def test_a_bus_with_traffic_is_only_listened_to(bench, monkeypatch, frame, name):
    """A running robot would take the question for a second SDO client, and stop."""
    talker(bench, "drive", frame)
    monkeypatch.setattr(command, "open_port", lambda bus, clock: bench.ports["drive"])
    before = bench.ports["drive"].counters["sent"]
    found = command.check({"amplifier": {}}, ["amplifier"], bench.clock, 0, 0, print)
    (line,) = [each for each in found if "in use" in each.what]
    assert line.found.startswith(f"{name}: only listened to, none of its devices was asked")
    assert line.verdict == TO_DO
    assert bench.ports["drive"].counters["sent"] == before


def test_a_device_that_waits_is_no_traffic(bench):
    """Its heartbeat in PRE-OPERATIONAL, an emergency, its boot-up; our drive in any state."""
    talker(bench, "drive", (0x709, b"\x7f"), (0x709, b"\0"), (0x089, bytes(8)), (0x701, b"\x05"))
    assert devices.listen(bus_of(bench, "drive", bench.drive)).used_by == ""


def test_a_device_that_a_node_drives_is_not_asked(bench, monkeypatch):
    """Nor are others on its bus, which is silent as long as the node is not active."""
    monkeypatch.setattr(command, "open_port", lambda bus, clock: bench.ports["planar"])
    settings_ = BusSettings(channel=bus_of_node("manus"))
    before = bench.ports["planar"].counters["sent"]
    held = lock_device(where(settings_), "drive node 4")
    try:
        found = command.check({"manus": {}}, ["manus"], bench.clock, 0, 0, print)
    finally:
        held.release()
    (line,) = [each for each in found if "in use" in each.what]
    assert line.found.startswith("a node drives drive node 4: only listened to")
    assert bench.ports["planar"].counters["sent"] == before
    assert not any(each.what in command.JOINTS for each in found)


def test_no_node_starts_meanwhile(bench, monkeypatch):
    monkeypatch.setattr(command, "open_port", lambda bus, clock: bench.ports["planar"])
    with ExitStack() as stack:
        command.DeviceSet({"manus": {}}, ["manus"], bench.clock, stack)
        stack.callback(lambda: None)
        for claim in ("drive node 3", "drive node 4", "master 113"):
            with pytest.raises(AlreadyRunning, match=claim):
                lock_device(where(BusSettings(channel=bus_of_node("manus"))), claim)


def test_two_devices_with_one_node_id(bench):
    twin_of(bench)
    bus = bus_of(bench, "drive", bench.drive)
    line = devices.node_ids(bus)
    assert line.found == "1: CiA 402 (more than one device)"
    assert "more than one device answers at node id 1: leave one of them" in line.todo
    (line,) = devices.configured(bench.drive, "amplifier")
    assert "more than one device answers as the drive (node id 1)" in line.found


def test_stuck_count(bench):
    bench.rig.inject("encoder", "freeze", 0.0, 0.0, bench.now_ns)
    assert open_points(moved(bench)) == {"encoder direction", "encoder and drive"}


def test_handle_at_rest_says_what_to_do(bench):
    assert all("move the handle by hand" in each.todo for each in moved(bench, 0.0))


def test_directions_that_agree(bench):
    assert open_points(moved(bench)) == set()


def test_direction_of_the_drive(bench):
    bench.drive._position_of = -bench.drive._position_of
    (_, together) = moved(bench)
    assert "amplifier's direction" in together.todo


def test_noisy_gauge(bench):
    everything(bench)
    bench.rig.inject("force_sensor", "noise", 2000.0, 0.0, bench.now_ns)
    assert "force sensor noise" in open_points(sampled(bench))


def test_lost_answers(bench):
    everything(bench)
    bench.rig.inject("encoder", "drop", 0.05, 0.0, bench.now_ns)
    assert "encoder lost answers" in open_points(sampled(bench))


def test_no_rights_and_kernel(tmp_path):
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/version").write_text("Linux 6.1 SMP PREEMPT_DYNAMIC")
    found = machine.machine(tmp_path, limit=0)
    assert open_points(found) == {"real-time priority", "kernel"}
    assert "--cap-add=sys_nice" in found[0].todo
    (tmp_path / "proc/version").write_text("Linux 6.1 SMP PREEMPT_RT")
    assert open_points(machine.machine(tmp_path, limit=99)) == set()


def interface(tmp_path, flags="0x1043", queue="1000", shown=()):
    folder = tmp_path / "sys/class/net/can0"
    folder.mkdir(parents=True)
    (folder / "flags").write_text(flags)
    (folder / "tx_queue_len").write_text(queue)
    return machine.interface(BusSettings("socketcan", "can0"), tmp_path, list(shown))


def state(rate, state="ERROR-ACTIVE"):
    return [{"linkinfo": {"info_data": {"bittiming": {"bitrate": rate}, "state": state}}}]


def test_an_interface_in_order(tmp_path):
    assert open_points(interface(tmp_path, shown=state(1_000_000))) == set()


def test_wrong_bit_rate(tmp_path):
    (line,) = [f for f in interface(tmp_path, shown=state(500_000)) if f.verdict == TO_DO]
    assert (line.what, line.found) == ("can0 bit rate", "500000")
    assert "bitrate 1000000" in line.todo


def test_interface_down_short_queue_and_errors(tmp_path):
    found = interface(tmp_path, "0x1042", "10", state(1_000_000, "BUS-OFF"))
    assert open_points(found) == {"can0", "can0 txqueuelen", "can0 controller"}


def test_interface_without_iproute_or_not_there(tmp_path):
    assert interface(tmp_path)[-1].verdict == UNKNOWN
    (line,) = machine.interface(BusSettings("socketcan", "can7"), tmp_path)
    assert "no such interface" in line.found
    assert machine.interface(BusSettings("rig", "encoder"), tmp_path) == []


@pytest.mark.parametrize("name", ["hardware.yaml", "sim.yaml"])
def test_the_packaged_parameters_are_read(name):
    values = values_of(str(resource_path(f"params/{name}")))
    assert set(values) == {*NODES, "impedance_controller"}
    bus = settings(BusSettings, values["amplifier"], "can.")
    assert bus.channel == {"hardware.yaml": "can0", "sim.yaml": "drive"}[name]
    assert values["manus"]["shoulder.node_id"] == 3


TWO_ROBOTS = """
/left/encoder:
  ros__parameters: {can.channel: can0, node_id: 5}
left:
  amplifier:
    ros__parameters: {can: {channel: can2}, node_id: 6}
/right/encoder:
  ros__parameters: {can: {channel: can7}, node_id: 8}
/**/force_sensor:
  ros__parameters: {can.channel: can3}
/**:
  ros__parameters: {can.interface: virtual}
"""


@pytest.fixture
def two_robots(tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(TWO_ROBOTS)
    return str(file)


@pytest.mark.parametrize(
    ("namespace", "wanted"),
    [
        ("/left",
         {"encoder": ("can0", 5), "amplifier": ("can2", 6), "force_sensor": ("can3", None)}),
        ("/right", {"encoder": ("can7", 8), "force_sensor": ("can3", None)}),
        ("", {"force_sensor": ("can3", None)}),
    ],
)  # fmt: skip
def test_the_devices_of_the_robot_in_this_namespace_are_looked_at(two_robots, namespace, wanted):
    """Of two encoders in one file, by full names and nested ones; what no section names is told."""
    values = values_of(two_robots, namespace)
    found = {
        node: (given["can.channel"], given.get("node_id"))
        for node, given in values.items() if "can.channel" in given
    }  # fmt: skip
    assert found == wanted
    assert {given["can.interface"] for given in values.values()} == {"virtual"}


def test_a_namespace_that_the_file_does_not_have_is_told(two_robots):
    told = command.sections(two_robots, "/middle", values_of(two_robots, "/middle"), NODES)
    assert [each.verdict for each in told if each.what == "parameter file"] == [UNKNOWN] * 3
    assert any("left/amplifier: is no node of this robot" in each.found for each in told)


def test_a_node_without_a_section_is_to_do(tmp_path):
    file = tmp_path / "left.yaml"
    file.write_text("/left/encoder: {ros__parameters: {node_id: 5}}")
    values = values_of(str(file))
    told = command.sections(str(file), "", values, ["encoder"])
    assert [each.verdict for each in told] == [UNKNOWN, TO_DO]
    assert told[1].found == f"no section of {file} is for /encoder"
    assert "give --namespace" in told[1].todo


def test_the_simulated_buses_are_those_of_the_namespace(bench, monkeypatch):
    opened = []

    def note(bus, clock):
        opened.append(bus.channel)
        return bench.ports["encoder"]

    monkeypatch.setattr(command, "open_port", note)
    with ExitStack() as stack:
        command.DeviceSet({"encoder": {}}, ["encoder"], bench.clock, stack, "/left")
        stack.pop_all()
    assert opened == ["left/encoder"]


def test_both_planar_drives_get_what_they_share(bench, monkeypatch):
    """What `manus` shares between its drives counts here too, as the operator's waivers."""
    monkeypatch.setattr(command, "open_port", lambda bus, clock: bench.ports["planar"])
    shared = {"master_id": 99, "waived": "torque_limit", "rate": 250.0, "shoulder.node_id": 7}
    with ExitStack() as stack:
        found = command.DeviceSet({"manus": shared}, ["manus"], bench.clock, stack)
        stack.pop_all()
    shoulder, elbow = (found.devices[joint].settings for joint in command.JOINTS)
    assert (shoulder.node_id, elbow.node_id) == (7, 4)
    for each in (shoulder, elbow):
        assert (each.master_id, each.waived, each.rate) == (99, "torque_limit", 250.0)


def test_table_reads_like_a_list_of_things_to_do():
    text = table([Finding("can0", "up", "up"), Finding("can0 txqueuelen", "10", "100", "longer")])
    assert text.splitlines() == [
        f"{OK:6} can0: up",
        "TO DO  can0 txqueuelen: 10 (wanted: 100)",
        "       -> longer",
    ]
    assert table([Finding("a", "b", "", "c\n  d  e")]).splitlines()[1:] == [
        "       -> c", "            d  e",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["drive", "encoder"])
def test_a_device_that_answers_sync_is_told_and_left_as_it_was(bench, name):
    device = getattr(bench, name)
    device.configure()
    line = exchange.answer_to_sync(device, name, bench.ports[name])
    assert (line.verdict, line.found) == (OK, f"frame 0x{device.answer_id:X}")
    bench.clock.sleep_until(bench.now_ns + PERIOD_NS)  # until it has got the last command
    simulated = bench.rig.devices[name]
    assert simulated.state == PRE_OPERATIONAL
    assert device.configured
    if name == "drive":
        assert not simulated.machine.driving
        assert device.counters["writes"] == 0


def test_a_device_that_does_not_answer_sync_is_told_with_its_emergency(bench):
    """Its SYNC has a counter again, by somebody who came after us."""
    bench.drive.configure()
    node = bench.rig.devices["drive"].node
    bench.rig.devices["drive"]._sync_length = 1
    line = exchange.answer_to_sync(bench.drive, "amplifier", bench.ports["drive"])
    assert line.verdict == TO_DO
    assert "none to 3 SYNCs; its emergency: 0x8240" in line.found
    assert "1005, 1007 and 1019" in line.todo
    assert node.value(0x6041) & 0x4F == 0x40  # switch on disabled


def test_what_an_earlier_master_left_is_told(bench):
    node = bench.rig.devices["drive"].node
    node.variable(0x1005, 0).default = 0x81
    found = devices.configured(bench.drive, "amplifier")
    line = next(each for each in found if each.what == "amplifier set back")
    assert (line.verdict, "0x81 in object 1005:00" in line.found) == (OK, True)


@pytest.mark.parametrize("make", ["epos2", "ipos", "kinco"])
def test_a_drive_without_a_rating_is_seen_before_the_first_start(make):
    bench = OneThreadRobot(1, drive_profile=make)
    try:
        told = " ".join(each.found for each in devices.configured(bench.drive, "amplifier"))
        assert "does not tell its rated torque" in told
        bench.drive.settings = bench.drive.settings._replace(rated_command=0)
        (line,) = devices.configured(bench.drive, "amplifier")
        assert line.verdict == TO_DO and "set `rated_command`" in line.found
    finally:
        bench.close()


def test_a_make_that_needs_parameters_in_the_simulation_gets_them_in_each_node():
    found = node_parameters("epos2,sick_ahm36", simulation=True)
    assert found["amplifier"] == {"profile": "epos2", "rated_command": 2625}
    assert found["manus"] == {
        "profile": "epos2", "shoulder.rated_command": 2625, "elbow.rated_command": 2625
    }  # fmt: skip
    assert found["encoder"] == {"profile": "sick_ahm36"}
    assert node_parameters("epos2", simulation=False)["amplifier"] == {"profile": "epos2"}


class OwnLine:
    """A line that is no bus: each request is answered at the next look."""

    name, failed, bus_off = "its own line", False, False

    def __init__(self, clock):
        self.clock, self.counters, self.closed = clock, Counter(), False
        self.asked, self.device = 0, None

    def pump(self, until_ns=0):
        asked, self.asked = self.asked, 0
        if asked:
            self.device.take(0, (0.0, 0.0, 1e-3 * (self.clock.now_ns() // PERIOD_NS % 7), 0, 0, 0))
        self.clock.sleep_until(until_ns)
        return asked

    def restore(self):
        """Nothing fails here."""

    def close(self):
        self.closed = True


class OffCan(ForceSensor):
    """A force sensor that no bus reaches."""

    SATURATED = 1000.0
    lines: ClassVar[list[OwnLine]] = []

    @classmethod
    def opened(cls, settings, own, open_port, clock):
        cls.lines.append(OwnLine(clock))
        cls.lines[-1].device = sensor = cls(cls.lines[-1], settings, own=own)
        return sensor

    def identify(self):
        self.identity = "a sensor off CAN"
        return [tuple(float(row == column) for column in range(6)) for row in range(6)]

    def ask(self, monotonic_ns):
        self.port.asked = 1


def profile_of(folder, kind):
    """Return the parameters of a robot whose force sensor has this driver."""
    file = folder / "off_can.yaml"
    file.write_text(
        "format: screw_module_ros/device\nversion: 1\nkind: force_sensor\nmake: theirs\n"
        "tried: nowhere\nsources: []\n"
        f"force_sensor: {{protocol: '{__name__}:{kind.__name__}'}}\n"
    )
    return {"force_sensor": {"profile": str(file)}}


def test_a_force_sensor_that_is_not_on_can_is_looked_at_on_its_own_line(tmp_path):
    values = profile_of(tmp_path, OffCan)
    clock = ManualClock(10**12)
    found = command.check(values, ["force_sensor"], clock, 0, 0.2, lambda text: None)
    shown = {each.what: each for each in found}
    assert shown["force_sensor"].found == "a sensor off CAN"
    assert shown["force_sensor lost answers"].verdict == OK
    assert shown["force sensor noise"].verdict == OK
    assert not any("load" in what for what in shown), "it loads no bus"
    assert OffCan.lines[-1].closed


class AtOpening(OffCan):
    """A driver with a mistake where it opens its line."""

    @classmethod
    def opened(cls, settings, own, open_port, clock):
        raise KeyError("address")


class AtConfiguration(OffCan):
    """A driver with a mistake where it looks for its device."""

    def identify(self):
        return [][0]


class Taken(OffCan):
    """A driver whose line a node has."""

    @classmethod
    def opened(cls, settings, own, open_port, clock):
        raise AlreadyRunning("the node force_sensor has it: end it first")


@pytest.mark.parametrize(
    ("kind", "told"),
    [(AtOpening, "its driver failed: KeyError: 'address'"), (Taken, "end it first"),
     (AtConfiguration, "its driver failed: IndexError: list index out of range")],
)  # fmt: skip
def test_whatever_a_driver_of_others_raises_is_a_thing_to_do(tmp_path, kind, told):
    values = profile_of(tmp_path, kind)
    found = command.check(values, ["force_sensor"], ManualClock(10**12), 0, 0.2, lambda text: None)
    assert [each.verdict for each in found if told in each.found] == [TO_DO]


def test_the_form_of_an_acceptance_has_the_limits_of_this_robot(tmp_path):
    """Each limit comes from its owner or from the file, and no place is left without one."""
    path = resource_path("params/hardware.yaml")
    page = form(path, values_of(str(path)))
    law, drive = VerticalSettings(), DriveSettings()
    assert f"{law.force_up} N,\n{law.force_down} N" in page
    assert f"within {drive.heartbeat_timeout} s" in page
    assert not set("{}") & set(page.partition("</style>")[2]) and "<td class=\"signed\">" in page
    values = values_of(str(path))
    values["impedance_controller"]["force_up"] = 31.5
    values["manus"]["shoulder.heartbeat_timeout"] = 0.2
    changed = form(path, values)
    assert f"31.5 N,\n{law.force_down} N" in changed
    assert "(plane\n0.2 s)" in changed
    values["impedance_controller"]["force_up"] = 999.0
    with pytest.raises(SettingError, match="force_up"):
        form(path, values)


def test_the_form_is_printed_and_nothing_is_looked_at(monkeypatch):
    monkeypatch.setattr(command, "check", None)
    result = CliRunner().invoke(command.command, ["--acceptance"])
    assert result.exit_code == 0
    assert result.output.startswith("<!doctype html>")
