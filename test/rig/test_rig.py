# SPDX-License-Identifier: Apache-2.0
"""One loop over all buses: time, order, requests from other threads, broken buses."""

import threading
import uuid

import can
import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.conductor import Conductor
from screw_module_ros.lockstep.page import Page
from screw_module_ros.rig.build import RigSettings
from screw_module_ros.rig.physics import Physics
from screw_module_ros.rig.rig import Rig
from screw_module_ros.rig.rig_bus import RigBus
from screw_module_ros.rig.rig_hub import RigHub

MS = 1_000_000


def test_wall_clock_is_followed(make_bench, world):
    bench = make_bench("encoder")
    bench.run(10)
    assert world.time == pytest.approx(0.010)


def test_a_stall_is_given_up_and_counted(make_bench, world):
    bench = make_bench("encoder")
    bench.now_ns += 25 * MS
    bench.run(0)
    assert world.time == pytest.approx(0.005)
    assert bench.rig.counters["slipped"] == 20
    bench.run(4)
    assert world.time == pytest.approx(0.009)


def test_a_rig_that_was_not_run_has_not_slipped(world):
    physics = Physics(world, False, MS, 0)
    physics.advance(1)
    physics.resume()
    physics.advance(90_000 * MS)
    physics.advance(90_001 * MS)
    assert physics.slipped == 0
    assert world.time == pytest.approx(0.001)


def test_time_that_goes_backwards_changes_nothing(make_bench, world):
    bench = make_bench("encoder")
    bench.run(2)
    bench.now_ns -= 5 * MS
    bench.run(1)
    assert world.time == pytest.approx(0.002)


def test_position_is_latched_at_the_sync(make_bench, world):
    bench = make_bench("encoder")
    bench.start(2)
    bench.drain()
    world.counts_per_second = 1e6
    bench.now_ns += 2 * MS
    assert bench.ask(0x080)[0] == (0x282, "D0 07 00 00")


def test_in_steps_the_world_goes_exactly_as_far_as_the_time(make_bench, world):
    bench = make_bench("encoder", clock=ManualClock())
    bench.run(7)
    assert world.steps == pytest.approx([0.001] * 7)
    bench.now_ns += 50 * MS
    bench.run(0)
    assert world.time == pytest.approx(0.057)
    assert bench.rig.counters["slipped"] == 0


@pytest.mark.parametrize("latency", [0.0, 0.6e-3, 1.7e-3])
def test_in_steps_a_command_acts_its_latency_after_the_sync(make_bench, world, latency):
    settings = RigSettings(command_latency=latency)
    bench = make_bench("drive", clock=ManualClock(), settings=settings)
    bench.write(1, "6060:00", "0A")
    bench.start(1)
    bench.run(1)
    begun = world.time
    bench.ask(0x080)
    commands = []
    world.watch = lambda: commands.append((world.time - begun, world.vertical_command))
    for controlword in ("0600", "0700", "0F00"):
        bench.write(1, "6040:00", controlword)
    bench.write(1, "6071:00", "E803")
    bench.run(3)
    acted = [time for time, command in commands if command == pytest.approx(2.625)]
    assert acted[0] == pytest.approx(latency)


def test_a_reader_gets_a_world_of_a_quarter_of_a_millisecond_ago(world):
    physics = Physics(world, False, MS, 0)
    physics.advance(MS)
    physics.look(MS + 249_999)
    assert world.steps == []
    physics.look(MS + 250_000)
    assert world.steps == pytest.approx([250e-6])


def test_a_command_acts_as_soon_as_its_latency_is_over(world):
    physics, said = Physics(world, True, MS, MS), []
    physics.advance(MS)
    physics.sync(b"", MS)
    physics.act(lambda: said.append("after it"))
    physics.advance(2 * MS - 1)
    assert said == []
    physics.advance(2 * MS)
    assert said == ["after it"]
    physics.act(lambda: said.append("late"))  # 1 ms after the last SYNC: at once
    assert said == ["after it", "late"]


def test_commands_do_not_overtake_each_other(world):
    physics = Physics(world, True, MS, 600_000)
    said = []
    physics.advance(MS)
    physics.sync(b"", MS)
    physics.act(lambda: said.append("on"))
    physics.advance(1_300_000)
    physics._latency_ns = 0
    physics.act(lambda: said.append("off"))
    assert said == []
    physics.advance(2 * MS)
    assert said == ["on", "off"]


def test_frames_of_several_buses_are_taken_in_turn(world, request):
    names = [f"{request.node.nodeid}/{i}" for i in range(2)]
    near = [can.Bus(interface="virtual", channel=name) for name in names]
    far = [can.Bus(interface="virtual", channel=name) for name in names]
    rig = Rig({"force_sensor": far[0], "encoder": far[1]}, world)
    order = []
    for port in {id(d.link.port): d.link.port for d in rig.devices.values()}.values():
        port.first[0x123] = lambda _data, _now, port=port: order.append(port)
        port.rebuild()
    for bus in near:
        for _ in range(3):
            bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    assert rig.process(0) == 6
    assert order[:2] != [order[0]] * 2
    for bus in near + far:
        bus.shutdown()


def test_requests_of_other_threads_run_between_frames(make_bench):
    bench = make_bench("encoder")
    seen = []
    bench.rig.call(lambda: seen.append(threading.current_thread()))
    assert seen == []
    bench.run(0)
    assert seen == [threading.current_thread()]


class RealTime(ManualClock):
    """Wall clock by hand; `select` waits by it, or finds frames after 0.1 ms each time."""

    simulated = False

    def select(self, descriptors, _writes, _errors, pause_s):
        if self.frames:
            self.time_ns += MS // 10
            return list(descriptors), (), ()
        self.time_ns += round(pause_s * 1e9)
        return [], (), ()


@pytest.fixture
def timers(make_bench, monkeypatch):
    """Return when a rig with nodes of a period [ns] looks at its timers, from 1 ms on [us]."""
    def looked(period_ns: int, looks: int, frames: bool = False) -> list[int]:
        clock, found = RealTime(MS), []
        clock.frames = frames
        rig = make_bench("encoder", booted=False, clock=clock, period_ns=period_ns).rig
        monkeypatch.setattr("select.select", clock.select)
        monkeypatch.setattr(rig.devices["encoder"].link.port, "fileno", lambda: 7)
        monkeypatch.setattr(rig, "_housekeep", lambda now_ns: found.append(now_ns // 1000))
        asked = []
        rig.call(lambda: asked.append(True))
        rig.run(lambda: len(found) == looks)
        assert asked == [True]
        return found

    return looked


def test_a_bus_without_a_descriptor_is_looked_at_now_and_then(make_bench):
    clock = RealTime(MS)
    turns = iter(range(5))
    make_bench("encoder", booted=False, clock=clock).rig.run(lambda: next(turns) == 4)
    assert clock.time_ns == MS + 4 * 200_000


def test_a_rig_that_goes_on_after_a_pause_has_not_slipped(make_bench):
    clock = RealTime(3 * MS)
    rig = make_bench("encoder", booted=False, clock=clock).rig
    rig.process(3 * MS)
    clock.time_ns += 10_000 * MS
    turns = iter(range(5))
    rig.run(lambda: next(turns) == 4)
    assert rig.counters["slipped"] == 0


@pytest.mark.parametrize(("period_ns", "looks_us"), [
    (MS, [1000, 1600, 2600, 3600]),
    (4 * MS, [1000, 1600, 2600, 3600]),
    (MS // 4, [1000, 1150, 1400, 1650]),
])  # fmt: skip
def test_timers_come_when_the_nodes_have_written(timers, period_ns, looks_us):
    assert timers(period_ns, 4) == looks_us


def test_frames_come_before_the_timers_but_not_more_than_65(timers):
    assert timers(MS, 3, frames=True) == [1000 + 6500, 1000 + 13000, 1000 + 19500]


def test_the_world_is_looked_at_each_2_ms_though_nobody_asks(make_bench, world):
    bench = make_bench("encoder")
    bench.now_ns += 2 * MS - 1
    bench.run(0)
    assert world.steps == []
    bench.now_ns += 1
    bench.run(0)
    assert world.steps == pytest.approx([0.002])


def test_run_serves_until_it_is_told_to_stop(make_bench, wait_until):
    bench = make_bench("encoder")
    stop = threading.Event()
    thread = threading.Thread(target=bench.rig.run, args=(stop.is_set,))
    thread.start()
    try:
        bench.send(0x602, "40 00 10 00 00 00 00 00")
        answers = []
        wait_until(lambda: answers.extend(bench.drain()) or answers)
        assert answers[0] == (0x582, "43 00 10 00 96 01 02 00")
    finally:
        stop.set()
        thread.join(5.0)
    assert not thread.is_alive()


def test_a_bus_that_refuses_frames_is_counted(make_bench):
    bench = make_bench("encoder")

    def refuse(_message, timeout=None):
        raise can.CanOperationError("bus off")

    bench.rig.devices["encoder"].link.port.bus.send = refuse
    bench.send(0x602, "40 00 10 00 00 00 00 00")
    bench.run(1)
    assert bench.rig.counters["send_errors"] == 1
    assert bench.rig.counters["lost"] == 0  # only a simulated bus counts them


def test_a_frame_that_cannot_be_read_is_counted(make_bench, monkeypatch):
    bench = make_bench("encoder")
    bus = bench.rig.devices["encoder"].link.port.bus
    with monkeypatch.context() as patch:

        def broken(timeout=None):
            raise can.CanOperationError("could not unpack received message")

        patch.setattr(bus, "recv", broken)
        bench.run(0)
    assert bench.rig.counters["receive_errors"] == 1
    assert bench.read(2, "1000:00") == "96010200"


def test_a_flood_does_not_starve_the_timers(make_bench):
    bench = make_bench("encoder")
    bench.write(2, "1017:00", "0100")
    for _ in range(2000):
        bench.send(0x001, "FF")
    assert bench.rig.serve(bench.now_ns) == 256
    assert (0x702, "7F") in bench.run(1)


def test_close_lets_go_of_the_motors(torque_drive):
    for rpdo in ("06 00 00 00", "07 00 00 00", "0F 00 F4 01"):
        torque_drive.ask(0x201, rpdo)
    torque_drive.rig.close()
    assert not torque_drive.world.vertical_powered and not torque_drive.world.vertical_braked
    assert torque_drive.ask(0x601, "40 00 10 00 00 00 00 00") == []


def test_ids_are_settings(make_bench):
    settings = RigSettings(encoder_node=9, sensor_base=0x68)
    bench = make_bench("encoder", "force_sensor", settings=settings)
    assert bench.ask(0x609, "40 00 10 00 00 00 00 00") == [(0x589, "43 00 10 00 96 01 02 00")]
    assert bench.ask(0x688) == [(0x688, "02 03")]


@pytest.mark.parametrize(
    ("keys", "options", "said"),
    [
        (("spindle",), {}, "spindle"),
        ((), {}, "none"),
        (("encoder",), {"settings": RigSettings(encoder_node=128)}, "encoder_node = 128"),
    ],
)
def test_nonsense_is_refused(make_bench, keys, options, said):
    with pytest.raises(ValueError, match=said):
        make_bench(*keys, **options)


def test_short_steps_are_saved_up(world):
    physics = Physics(world, False, MS, 0)
    for now_ns in range(0, 200_000, 10_000):
        physics.advance(now_ns)
    assert world.steps == pytest.approx([50e-6] * 3)


class Steps:
    """A rig in a thread of its own, which moves simulated time; reached_ns: each new time."""

    def __init__(self, world):
        self.clock = SimulatedClock(Page(f"test_{uuid.uuid4().hex}"), "test")
        self.hub = RigHub(f"bus_{uuid.uuid4().hex[:8]}")
        self.reached_ns: list[int] = []
        self.conductor = Conductor(self.clock.page, 0.0, pytest.fail)
        self.rig = Rig({"encoder": self.hub}, world, self.clock)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def _serve(self):
        self.rig.run_in_steps(self.conductor, self._stop.is_set, self.reached_ns.append)

    def start(self):
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join(5.0)
        self.hub.shutdown()
        self.conductor.close()
        self.clock.leave()
        self.clock.page.close()


@pytest.fixture
def steps(world):
    made = Steps(world)
    yield made
    made.close()


def test_a_bus_is_joined_by_who_holds_simulated_time(steps):
    """Time stands still until the driver goes on, and he goes on when the rig has admitted him."""
    begin_ns = steps.clock.now_ns()
    with steps.clock.working():
        steps.start()
        driver = RigBus(steps.hub.channel_info.removeprefix("rig "))
        driver.shutdown()
        assert steps.clock.now_ns() == begin_ns


def test_time_that_is_early_waits(steps, monkeypatch):
    early_s, slept_s = iter((0.5, 0.5)), []
    monkeypatch.setattr(steps.conductor, "too_early", lambda: next(early_s, 0.0))
    sleep = steps.conductor.sleep
    monkeypatch.setattr(
        steps.conductor, "sleep", lambda seconds: slept_s.append(seconds) or sleep(0.0)
    )
    with steps.clock.working():
        steps.start()
        steps.clock.sleep_until(steps.clock.now_ns() + MS)
    assert slept_s.count(0.5) == 2


def test_a_request_in_simulated_time_is_answered_before_time_goes_on(steps, monkeypatch):
    with steps.clock.working():
        steps.start()
        driver = RigBus(steps.hub.channel_info.removeprefix("rig "))
        arrivals = steps.clock.arrivals(driver)
        begin_ns = steps.clock.now_ns() + MS
        steps.clock.sleep_until(begin_ns)  # the device boots
        # Members are expected; only foreign frames are looked for now and then.
        monkeypatch.setattr(steps.rig, "_serve_uncounted", lambda now_ns: None)
        driver.send_frame(0x602, bytes.fromhex("4000100000000000"))
        arrivals.sent()
        answers = []
        while (frame := arrivals.receive(begin_ns + MS)) is not None:
            answers.append((frame[0], frame[1].hex(), steps.clock.now_ns() - begin_ns))
        arrivals.close()
        driver.shutdown()
    assert (0x582, "4300100096010200", 0) in answers


@pytest.mark.parametrize("first_ns", [MS // 2, MS])
def test_the_world_begins_with_the_rig_whoever_waits_first(steps, world, wait_until, first_ns):
    """It began with the first time that anybody waited for: two runs were half a tick apart."""
    begin_ns = steps.clock.now_ns()
    with steps.clock.working():
        steps.start()
        steps.clock.sleep_until(begin_ns + first_ns)
        steps.clock.sleep_until(begin_ns + 5 * MS)
        wait_until(lambda: begin_ns + 5 * MS in steps.reached_ns)  # told when the world is there
        assert sum(world.steps) == pytest.approx(5e-3)


def test_the_world_begins_before_the_rig_s_own_loop_runs(steps, world, wait_until):
    """In one process the main thread may wait, for a lock, before the rig is active."""
    begin_ns = steps.clock.now_ns()
    steps.rig.turn(steps.conductor, steps.reached_ns.append, until_ns=begin_ns + MS // 2)
    with steps.clock.working():
        assert steps.reached_ns == [begin_ns + MS // 2]
        steps.start()
        steps.clock.sleep_until(begin_ns + 5 * MS)
        wait_until(lambda: begin_ns + 5 * MS in steps.reached_ns)
        assert sum(world.steps) == pytest.approx(5e-3)


def test_time_goes_from_period_to_period_or_to_whoever_waits_for_less(steps, wait_until):
    begin_ns = steps.clock.now_ns()
    assert begin_ns % MS == 0
    with steps.clock.working():
        steps.start()
        steps.clock.sleep_until(begin_ns + 5 * MS // 2)
        wait_until(lambda: len(steps.reached_ns) >= 3)  # it tells of a step when all know the time
        reached_ns = [now_ns - begin_ns for now_ns in steps.reached_ns]
    assert reached_ns == [MS, 2 * MS, 5 * MS // 2]
