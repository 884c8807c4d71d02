# SPDX-License-Identifier: Apache-2.0
"""Drivers of force sensors from other packages: what the base does for them, and who is refused."""

from __future__ import annotations

import sys
from collections import Counter
from types import ModuleType

import pytest
from talk import SENSOR

from screw_module_ros.clock import ManualClock
from screw_module_ros.devices import force_sensors
from screw_module_ros.devices.errors import BusError, NotConfigured
from screw_module_ros.devices.force_base import ForceSensor
from screw_module_ros.devices.force_frames import FrameSensor
from screw_module_ros.loop.sensor import PolledSensor
from screw_module_ros.loop.ticker import Tick
from screw_module_ros.settings import SettingError

MS = 1_000_000


@pytest.fixture
def chosen(tmp_path, monkeypatch):
    """Return a maker of settings whose profile names an object, as `package.module:NAME`."""

    def choose(found: object, settings: str = "{}"):
        module = ModuleType("somebodys")
        module.Sensor = found
        monkeypatch.setitem(sys.modules, "somebodys", module)
        file = tmp_path / "theirs.yaml"
        file.write_text(
            "format: screw_module_ros/device\nversion: 1\nkind: force_sensor\nmake: theirs\n"
            "tried: nowhere\nsources: []\n"
            f"force_sensor: {{protocol: 'somebodys:Sensor', settings: {settings}}}\n"
        )
        return SENSOR._replace(profile=str(file))

    return choose


def driver(settings, open_port=pytest.fail, clock=None):
    return force_sensors.driver(settings, open_port, clock or ManualClock())


def unit():
    return [tuple(float(row == column) for column in range(6)) for row in range(6)]


class OneFrame(FrameSensor):
    """A sensor that answers one frame with one: six signed bytes."""

    REQUEST, SIZES, SATURATED = b"\x01", (6,), 127

    def __init__(self, port, settings, label="force sensor", own=None):
        super().__init__(port, settings, label, own, 0x701, (0x702,))

    def identify(self):
        return unit()

    def values(self, *frames):
        values = tuple(int.from_bytes(frames[0][n : n + 1], "big", signed=True) for n in range(6))
        return 0, tuple(10 // value for value in values[:1]) + values[1:]  # 0 is its mistake


def answered(wire, sensor, frame):
    """One tick, in which the device answers; return the sample."""
    sensor.request(1, wire.advance(), 5)
    wire.emit(0x702, frame)
    wire.port.pump()
    return sensor.reading()


def test_an_answer_of_one_frame_is_a_sample(wire, chosen):
    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    sensor.configure()
    sensor.start()
    assert answered(wire, sensor, "05 01 02 03 04 FF")[3:9] == (2.0, 1.0, 2.0, 3.0, 4.0, -1.0)
    assert wire.sent(0x701) == [b"\x01"]


def test_a_driver_without_a_hook_that_it_needs_is_refused_when_it_is_made(wire, chosen):
    """Not by the first answer, with a hand on the handle."""

    class Half(FrameSensor):
        REQUEST, SIZES, SATURATED, identify = b"\x01", (6,), 127, OneFrame.identify

    with pytest.raises(TypeError, match="values"):
        driver(chosen(Half), lambda *claims: wire.port)


def test_a_driver_that_raises_is_a_latched_fault_and_no_sample(wire, chosen):
    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    sensor.configure()
    sensor.start()
    assert answered(wire, sensor, "00 01 02 03 04 05") is None
    assert sensor.fault.startswith("the driver of the force sensor failed: ZeroDivisionError")
    assert answered(wire, sensor, "05 01 02 03 04 05") is None, "until it is configured again"
    sensor.clear_fault()
    assert answered(wire, sensor, "05 01 02 03 04 06") is not None


FLAWED = {
    "five values": (1.0,) * 5,
    "a value that is no number": (1.0, 2.0, None, 4.0, 5.0, 6.0),
    "not a number": (1.0, 2.0, 3.0, 4.0, 5.0, float("nan")),
    "infinite": (1.0, float("-inf"), 3.0, 4.0, 5.0, 6.0),
}


@pytest.mark.parametrize("values", FLAWED.values(), ids=FLAWED)
def test_values_that_are_not_six_finite_numbers_are_a_latched_fault_and_no_sample(
    wire, chosen, monkeypatch, values
):
    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    sensor.configure()
    sensor.start()
    with monkeypatch.context() as patch:
        patch.setattr(OneFrame, "values", lambda *_: (0, values))
        assert answered(wire, sensor, "05 01 02 03 04 05") is None
    assert sensor.fault.startswith("the driver of the force sensor ")
    sensor.clear_fault()
    assert answered(wire, sensor, "05 01 02 03 04 06") is not None


@pytest.mark.parametrize("row", [(0.0,) * 6, (1.0,) * 5, (float("nan"), 1.0, 1.0, 1.0, 1.0, 1.0)])
def test_a_matrix_that_makes_no_sense_configures_nothing(wire, chosen, monkeypatch, row):
    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    monkeypatch.setattr(OneFrame, "identify", lambda _: [*unit()[:5], row])
    with pytest.raises(NotConfigured, match="six rows of six finite numbers"):
        sensor.configure()
    with pytest.raises(NotConfigured):
        sensor.start()


def test_a_start_that_fails_leaves_the_fault_and_the_next_clearing_tries_again(
    wire, chosen, monkeypatch
):
    def fails(_):
        raise BusError("its start was not sent")

    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    sensor.configure()
    sensor.start()
    sensor.lose("its supply dipped")
    with monkeypatch.context() as patch:
        patch.setattr(OneFrame, "start", fails)
        with pytest.raises(BusError):
            sensor.clear_fault()
    assert sensor.fault == "its supply dipped"
    sensor.clear_fault()
    assert sensor.fault == "" and answered(wire, sensor, "05 01 02 03 04 06") is not None


def test_a_driver_that_ends_the_program_does_not_end_the_loop(wire, chosen, monkeypatch):
    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    sensor.configure()
    sensor.start()
    monkeypatch.setattr(OneFrame, "values", lambda *_: sys.exit("not licensed"))
    assert answered(wire, sensor, "05 01 02 03 04 05") is None
    assert sensor.fault == "the driver of the force sensor failed: SystemExit: not licensed"


@pytest.mark.parametrize("sizes", [(), (6, 2)])
def test_frames_without_a_length_or_an_identifier_are_refused(wire, chosen, monkeypatch, sizes):
    monkeypatch.setattr(OneFrame, "SIZES", sizes)
    with pytest.raises(ValueError, match=f"{len(sizes)} SIZES and 1 answer_ids"):
        driver(chosen(OneFrame), lambda *claims: wire.port)


def test_a_silence_may_be_a_restart_that_has_lost_all_settings(wire, chosen):
    sensor = driver(chosen(OneFrame), lambda *claims: wire.port)
    sensor.configure()
    sensor.start()
    for _ in range(25):
        sensor.request(1, wire.advance(), 5)
    wire.advance()
    for _ in range(3):  # what may still be an old answer is not used
        sample = answered(wire, sensor, "05 01 02 03 04 05")
    assert sample is None
    assert "was silent and may have restarted" in sensor.fault and not sensor.tared


@pytest.mark.parametrize("found", [object(), dict, lambda *_: None])
def test_what_is_no_driver_is_refused(chosen, found):
    with pytest.raises(SettingError, match="somebodys:Sensor: .* is no subclass of .*ForceSensor"):
        driver(chosen(found))


def test_a_protocol_that_nobody_brings_is_told_with_the_ways_there_are(chosen):
    file = chosen(object()).profile
    text = open(file).read().replace("somebodys:Sensor", "nobodys")
    open(file, "w").write(text)
    with pytest.raises(SettingError, match="protocol nobodys: neither package.module:NAME nor an "
                       "entry point of screw_module_ros.force_sensors"):  # fmt: skip
        driver(SENSOR._replace(profile=file))


def test_a_setting_that_the_driver_does_not_know_is_told(chosen):
    with pytest.raises(SettingError, match=r"force_sensor.settings.node is unknown"):
        driver(chosen(OneFrame, "{node: 5}"))


class Wireless:
    """A line that is no bus; what waits in it comes at the next look."""

    name, failed, bus_off = "its own line", False, False

    def __init__(self, clock):
        self.clock, self.counters, self.waiting, self.device = clock, Counter(), [], None

    def pump(self, until_ns=0):
        self.clock.time_ns = max(self.clock.time_ns, until_ns)
        waiting, self.waiting = self.waiting, []
        for values in waiting:
            self.device.heard()
            self.device.take(0, values)
        return len(waiting)

    def restore(self):
        self.failed = False

    def close(self):
        self.failed = True


class OffCan(ForceSensor):
    """A sensor that is asked for a sample by its own line."""

    SATURATED = 1000

    @classmethod
    def opened(cls, settings, own, open_port, clock):
        sensor = cls(Wireless(clock), settings, own=own)
        sensor.port.device = sensor
        return sensor

    def identify(self):
        self.identity = "off CAN"
        return unit()

    def ask(self, monotonic_ns):
        self.port.waiting.append((1.0, 2.0, float(monotonic_ns // MS % 10), 0.0, 0.0, 0.0))


def test_a_sensor_that_is_not_on_can_opens_its_own_line(chosen):
    clock = ManualClock(1_000_000 * MS)
    sensor = driver(chosen(OffCan), clock=clock)
    sensor.configure()
    sensor.start()
    loop, found = PolledSensor(sensor, sensor.port, clock), []
    for sequence in range(5):
        now_ns = clock.now_ns()
        loop.begin(Tick(sequence, now_ns, now_ns, 0))
        found.append(loop.answer(now_ns + MS))
        clock.time_ns = now_ns + MS
    assert [(each.sequence, each.fx, each.fz) for each in found] == [
        (n, 1.0, float(n)) for n in range(5)
    ]
    assert sensor.tare(found[1:3])[2] == pytest.approx(1.5) and sensor.traffic == []
