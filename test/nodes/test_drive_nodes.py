# SPDX-License-Identifier: Apache-2.0
"""What `amplifier` and `manus` refuse, hand on and report; no graph, no devices."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample, SafetyState
from services import asked, served
from std_srvs.srv import SetBool
from wired import Topics

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import NotAnswering, Refused
from screw_module_ros.geometry import Screw
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.drives import PLANAR, VERTICAL, Permission
from screw_module_ros.nodes.support.topics import too_many_senders
from screw_module_ros.safety.permit import OPEN, Permit, PermitSettings
from screw_module_ros.settings import SettingError
from screw_module_ros.trials.one_thread import OneThreadRobot

EARLY = "asked for while the drive was made ready: call ~/enable again"
LONGEST_S = 20.0
MS = 1_000_000


@pytest.fixture
def amplifier(make_node):
    """An amplifier that is not configured, and a client of its ~/enable in another node."""
    node = make_node("amplifier")
    asker = Node("asker")
    client = asker.create_client(SetBool, "amplifier/enable")
    assert client.wait_for_service(LONGEST_S)
    yield node, asker, client
    asker.destroy_node()


def waits(node: Node, service) -> bool:
    """Wait until a request waits at a service that nobody serves; return whether one does."""
    wait_set = _rclpy.WaitSet(0, 0, 0, 0, 1, 0, node.context.handle)
    wait_set.clear_entities()
    with service.handle:
        wait_set.add_service(service.handle)
        wait_set.wait(int(LONGEST_S * 1e9))
        return bool(wait_set.get_ready_entities("service"))


def answer(asker: Node, future):
    executor = SingleThreadedExecutor()
    executor.add_node(asker)
    executor.spin_until_future_complete(future, LONGEST_S)
    executor.remove_node(asker)
    return future.result()


@pytest.mark.parametrize("busy", ["clear_fault", "activate"])
def test_an_enabling_that_waited_is_refused(amplifier, busy):
    node, asker, client = amplifier
    future = client.call_async(SetBool.Request(data=True))
    assert waits(node, served(node, "~/enable"))
    if busy == "activate":
        node.connect = node.begin = lambda: None  # there are no devices here
        node.trigger_configure()
        node.trigger_activate()
        assert node.active
    else:
        asked(node, "~/clear_fault")
    told = answer(asker, future)
    assert (told.success, told.message) == (False, EARLY)


def test_a_disabling_that_waited_is_carried_out(amplifier):
    node, asker, client = amplifier
    future = client.call_async(SetBool.Request(data=False))
    assert waits(node, served(node, "~/enable"))
    asked(node, "~/clear_fault")
    assert "not active" in answer(asker, future).message  # what ~/disable says before configuring


def publish(node, kind, topic, count):
    return [node.create_publisher(kind, topic, topics.SAMPLE) for _ in range(count)]


@pytest.mark.parametrize(
    ("kind", "topic"), [(EncoderSample, "screw/encoder"), (ForceSample, "handle/force")]
)
def test_the_controller_holds_its_force_at_zero_while_there_are_two(make_node, kind, topic):
    node = make_node("impedance_controller")
    ends = Topics(node)
    node.connect()
    node.begin()
    voices = publish(node, kind, topic, 1)
    ends.count()
    node.read_inputs(MS)
    assert "publish" not in node.role.reason
    voices += publish(node, kind, topic, 1)
    ends.count()
    node.read_inputs(2 * MS)
    assert f"2 nodes publish {topic}: one is allowed (/impedance_controller)" in node.role.reason
    assert node.role.faulted
    node.destroy_publisher(voices.pop())
    ends.count()
    node.role.reset(3 * MS)
    node.read_inputs(3 * MS)
    assert not node.role.faulted
    node.close()


def test_in_one_process_with_the_sensors_their_topics_do_not_matter(make_node):
    node = make_node("impedance_controller")
    node.direct = ("screw/encoder", "handle/force", "screw/amplifier_state")
    ends = Topics(node)
    node.connect()
    voices = publish(node, ForceSample, "handle/force", 2)
    ends.count()
    assert [each.warning for each in ends.senders] == ["", ""] and len(voices) == 2
    node.close()


@pytest.mark.parametrize(
    ("name", "kind", "topic"),
    [("amplifier", ForceCommand, "screw/force_command"),
     ("manus", ForceSample, "handle/force")],
)  # fmt: skip
def test_a_drive_node_stops_while_open_and_refuses_to_open(make_node, name, kind, topic):
    node = make_node(name)
    ends = Topics(node)
    node.follow(node.new_inbox(), VERTICAL, alone=topic)
    permit = Permit([], PermitSettings(), MS)
    publish(node, kind, topic, 2)
    ends.count()
    node.permission(permit, MS)
    assert permit.fault.reason == "", "nothing passes: the next enable is refused"
    assert node.enable() == too_many_senders(node, topic) != ""
    permit.phase = OPEN
    node.permission(permit, 2 * MS)
    assert permit.fault.reason.startswith(f"2 nodes publish {topic}")
    node.close_topics()


def refused(field: str, safety: SafetyState) -> str:
    """Return what `~/enable` says after this safety_state."""
    waiting = [safety]
    inbox = SimpleNamespace(subscribe=lambda *_: lambda: waiting.pop() if waiting else None)
    node = SimpleNamespace(senders=lambda topic: SimpleNamespace(warning=""))
    permit = Permit([], PermitSettings(), MS)
    Permission(node, inbox, field).pass_on(permit, MS)
    permit.step(MS, MS)
    return permit.open(MS)


@pytest.mark.parametrize(
    ("field", "safety", "told"),
    [
        (VERTICAL, SafetyState(reasons=["emergency stop"], vertical_locked=True),
         "not permitted: emergency stop"),
        (VERTICAL, SafetyState(motion_permitted=True, planar_permitted=True, vertical_locked=True),
         "not permitted: the vertical axis is locked"),
        (PLANAR, SafetyState(motion_permitted=True, vertical_locked=True),
         "not permitted: the supervisor's parameter `required` does not name"),
        (PLANAR, SafetyState(motion_permitted=True, planar_permitted=True, vertical_locked=True),
         ""),
    ],
)  # fmt: skip
def test_a_refused_permission_has_its_reason(field, safety, told):
    said = refused(field, safety)
    assert said.startswith(told) and bool(said) == bool(told)


@pytest.mark.parametrize(
    "wrong", [("arm.elbow", "left"), ("arm.base_y", "-0.60"), ("between_high", "-1.9")]
)
def test_an_arm_that_its_joint_limits_do_not_fit_is_refused(make_node, wrong):
    """Base, side of the elbow and limits come in one file, and may come from two robots."""
    node = make_node("manus", "-p", ":=".join(wrong))
    with pytest.raises(SettingError, match="there, with arm.elbow = .* must fit together"):
        node.connect()


class Command(NamedTuple):
    sequence: int
    monotonic_ns: int
    force: float


class Inbox:
    """A command that is there when the wait ends."""

    def __init__(self, clock: ManualClock, comes_ns: int):
        self._clock, self._comes_ns = clock, comes_ns

    def wait(self, until_ns: int) -> None:
        self._clock.sleep_until(min(until_ns, self._comes_ns))


@pytest.mark.parametrize(("comes_ns", "taken"), [(9_300_000, True), (10 * MS, False)])
def test_a_command_of_the_next_tick_waits_for_its_sync(make_node, comes_ns, taken):
    node = make_node("amplifier")
    node.clock = ManualClock(9 * MS)
    node._commands = Inbox(node.clock, comes_ns)
    node._take_command = lambda early: Command(9, 9 * MS, 1.0) if early else None
    found = node.take_command(10 * MS)
    assert (found is not None) == taken


def test_a_hot_motor_stays_hot_and_says_so(make_node, monkeypatch):
    node = make_node("amplifier")
    drive = SimpleNamespace(
        brakes=False,
        settings=DriveSettings(), state=lambda now_ns: SimpleNamespace(text="on"), counters={}
    )
    node._chain, node.drives, node.period_ns = TorqueChain(), (drive,), MS
    node.port = SimpleNamespace(clock=node.clock, close=lambda: None)
    node._screw = Screw()
    node._heat = lambda now_ns: 0.1

    def silent():
        raise NotAnswering("the drive has no supply")

    monkeypatch.setattr(node, "start_drives", silent)
    for _ in range(2):
        with pytest.raises(NotAnswering):
            node.begin()
    assert node.role.heat(node.clock.now_ns()) == 0.1
    monkeypatch.setattr(node, "port_values", lambda skipped: {})
    monkeypatch.setattr(node, "drive_health", lambda values, state: values)
    share = 0.1 / node._chain.limits.continuous**2
    assert node.health()["motor heat [%]"] == f"{100.0 * share:.0f}"


def test_the_table_of_profiles_is_told_once(make_node, monkeypatch):
    """A node tries to configure its devices again each second."""
    told = []
    node = make_node("amplifier")
    monkeypatch.setattr(node.get_logger(), "error", told.append)
    bench = OneThreadRobot()
    del bench.rig.devices["drive"].node.object_dictionary.indices[0x6502]
    bench.clock.sleep(0.1)
    try:
        for _ in range(3):
            with pytest.raises(Refused, match="6502"):
                node.configure_device(bench.drive)
    finally:
        bench.close()
    (table,) = told
    assert "profiles closest to the drive" in table
