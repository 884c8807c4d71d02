# SPDX-License-Identifier: Apache-2.0
"""A therapist's day faster than real time: session, bridge and robot in one thread, without ROS.

The robot is the compiled loop of `screw_module_ros.gym`: its laws, slots, support and plant. Node
and bridge are the ones that run, the pages are clients of the bridge that speak their protocol,
and the bags have what a recorder would take. Not here: buses, drivers, guards, supervisor, the
recorder's own node, the middleware, a browser. Those are in `test_therapists_day.py`.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import defaultdict, deque
from collections.abc import Callable
from concurrent.futures import Future
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from played_recorder import PlayedRecorder
from rclpy.serialization import serialize_message
from screw_module_msgs.msg import EndpointState, ImpedanceState, SafetyState, TherapySlot
from services import asked
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.bridge.client import Client
from screw_module_ros.bridge.rights import Rights
from screw_module_ros.bridge.settings import Limits
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.slot import Slot
from screw_module_ros.gym.course import Course
from screw_module_ros.gym.loop import PERIOD, ROW_TICKS, Goal, Order
from screw_module_ros.nodes.bridge_gateway import BridgeGateway
from screw_module_ros.nodes.simulated_patient import SimulatedPatient
from screw_module_ros.nodes.support.law_inputs import slot_of
from screw_module_ros.plant.patient import ArmSettings, changed_patient, resting_patient
from screw_module_ros.plant.settings import arm_of, load_world
from screw_module_ros.recording.bag import Bag, Message, Topic
from screw_module_ros.recording.definitions import Definitions
from screw_module_ros.software import software
from screw_module_ros.therapy.protocol import Protocol
from screw_module_ros.therapy.session import UNDER_WAY

S, MS = 1_000_000_000, 1_000_000
BEGUN_NS = 100 * S
SAMPLE_S, IDLE_S = ROW_TICKS * PERIOD, 0.05
LEASE_NS = 300 * MS
FREE = Slot(back_stiffness=0.0, side_stiffness=0.0, damping=0.0)
_NOWHERE = (0.0, 0.0, 0.0)
NEVER = Goal(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE, -1.0, 0, math.inf, math.inf, 1 << 40)


class Robot:
    """The three axes and the patient at their handle."""

    def __init__(self, protocol: Protocol, seed: int):
        self._course = Course(
            protocol, protocol.blocks[0], arm_of("healthy"), load_world(), seed, THESIS
        )
        self.patient = resting_patient(arm_of("healthy"), *protocol.centre)
        self._slot, self._slot_ns = TherapySlot(), 0

    @property
    def now_ns(self) -> int:
        """Time of the newest sample."""
        return BEGUN_NS + self._course.now * MS

    def change(self, change: ArmSettings) -> None:
        """Change the patient, or send his hand on its way."""
        now_s = self._course.state.ticks * PERIOD
        self.patient = changed_patient(self.patient, change, now_s, self._course.hand)
        self._course.send(change)

    def guide(self, slot: TherapySlot) -> None:
        """Take a new slot, for as long as its lease lasts."""
        self._slot, self._slot_ns = slot, self.now_ns

    def go_on(self, seconds: float) -> EndpointState:
        """Move on; return the newest sample of the hand."""
        is_fresh = self.now_ns - self._slot_ns < LEASE_NS
        (plane, plane_ns), (vertical, vertical_ns) = (
            slot_of(self._slot, axis) if is_fresh else (None, 0) for axis in (False, True)
        )
        support = self._slot.support if is_fresh and math.isfinite(self._slot.support) else 0.0
        order = Order(
            bool(plane or vertical), plane or FREE, vertical or FREE, _tick(plane_ns),
            _tick(vertical_ns), support, NEVER, self._course.now,
        )  # fmt: skip
        row = self._course.run(order, seconds)[-1].tolist()
        hand = EndpointState(
            sequence=self._course.now // ROW_TICKS, monotonic_ns=self.now_ns, valid=[True] * 3,
            force_valid=True, enabled=[True] * 2, safety=SafetyState.OK,
        )  # fmt: skip
        for point, first in ((hand.position, 1), (hand.velocity, 4), (hand.force, 7)):
            point.x, point.y, point.z = row[first : first + 3]
        self.support = row[13]
        return hand


def _tick(start_ns: int) -> int:
    return (start_ns - BEGUN_NS) // MS if start_ns else -1


class Recorder(PlayedRecorder):
    """A recorder that answers with bags."""

    def __init__(self, folder: Path, clock: Any):
        super().__init__()
        self._folder, self._clock, self._definitions = folder, clock, Definitions()
        self._bag: Bag | None = None
        self._channels: dict[str, int] = {}

    def answer_all(self) -> None:
        """Carry out what was asked."""
        for service, act in (("record", lambda: self._begin(self.names[-1])), ("stop", self._end)):
            while self.asked[service]:
                self.answer(service, Trigger.Response(success=True, message=act()))

    def _begin(self, name: str) -> str:
        self._bag, self._channels = Bag(self._folder / name), {}
        self._bag.note("clock", {"begun": datetime.now().astimezone().isoformat()})
        self._bag.note("parameters", {"/endpoint_state": json.dumps({"use_sim_time": True})})
        self.write(graph.SAFETY_STATE, SafetyState(software=software()))
        return str(self._folder / name)

    def _end(self) -> str:
        assert self._bag is not None
        self._bag.close()
        self._bag = None
        return "closed"

    def write(self, topic: str, message: Any) -> None:
        """Write a message, while it records."""
        if self._bag is None:
            return
        if topic not in self._channels:
            kind = graph.TOPICS[topic].type
            made = Topic(f"/{topic}", kind, self._definitions.find(kind))
            self._channels[topic] = self._bag.add_topic(made)
        now_ns, data = self._clock.stamp_ns(), bytes(serialize_message(message))
        self._bag.write([Message(self._channels[topic], now_ns, now_ns, 0, data)])

    def report_to(self, heard: list) -> None:
        """Report, as each second."""
        self.report(self._bag is not None)
        heard.append(self.told.pop())


class BridgeNode:
    """The node of a BridgeGateway: topics are queues, services those of the session's node.

    heard: takes what is published, by topic; count: returns the sessions of a patient.
    """

    def __init__(self, session: Any, heard: Callable, count: Callable[[str], int]):
        self._session, self._heard, self._count = session, heard, count
        self.queues: dict[str, deque] = defaultdict(lambda: deque(maxlen=200))
        self.stamp = session.stamp

    def create_subscription(self, kind: type, name: str, *given: Any, **more: Any) -> Any:
        """Return a subscription whose messages are put into `queues`."""
        queue = self.queues[name.lstrip("/")]
        came = {"received_timestamp": 0}

        def take_message(kind: type, raw: bool) -> Any:
            came["received_timestamp"] = time.time_ns()
            return (queue.popleft(), came) if queue else None

        return SimpleNamespace(handle=SimpleNamespace(take_message=take_message))

    def create_publisher(self, kind: type, name: str, profile: Any) -> Any:
        """Return a publisher to `heard`."""
        return SimpleNamespace(
            msg_type=kind, publish=lambda message: self._heard(name.lstrip("/"), message)
        )

    def create_client(self, kind: type, name: str) -> Any:
        """Return a client whose calls are carried out at once."""
        def call_async(request: Any) -> Future:
            future: Future = Future()
            _, node, service = name.split("/")
            future.set_result(
                asked(self._session, f"~/{service}", request) if node == "therapy_session"
                else kind.Response(success=True, sessions=self._count(request.patient))
            )  # fmt: skip
            return future

        return SimpleNamespace(
            srv_type=kind, call_async=call_async, remove_pending_request=lambda future: None
        )


class Page:
    """A page: a client of the bridge. state: the newest `therapy/state` that it was told."""

    def __init__(self, day: FastDay, role: str):
        self.state: dict[str, Any] = {}
        self._day, self._calls = day, 0
        self._client = Client(role, day.rights, day.gateway, Limits(), day.clock.now_ns())
        self.send(op="subscribe", topic="/therapy/state")

    def send(self, **content: Any) -> None:
        """Send an operation."""
        self._client.take(json.dumps(content), self._day.clock.now_ns())

    def publish(self, topic: str, **content: Any) -> None:
        """Publish on a topic."""
        self.send(op="publish", topic=f"/{topic}", msg=content)

    def call(self, service: str, **arguments: Any) -> dict[str, Any]:
        """Call a service; return its response."""
        self._calls += 1
        asks = {"op": "call_service", "service": f"/{service}", "args": arguments}

        async def answered() -> dict[str, Any]:
            self.send(**asks, id=str(self._calls))
            while not (found := [each for each in self.read() if each.get("id")]):
                await asyncio.sleep(0)
            assert found[0]["result"], found
            return found[0]["values"]

        return self._day.loop.run_until_complete(answered())

    def read(self) -> list[dict[str, Any]]:
        """Read what has come; nothing of it is an error."""
        came = [json.loads(text) for text in self._client.texts(self._day.clock.now_ns())]
        assert not [each for each in came if each["op"] == "status"], came
        for each in came:
            self.state = each["msg"] if each["op"] == "publish" else self.state
        return came


class FastDay:
    """Everything in turn, a sample of the hand at a time; 50 ms where no session is under way.

    node, ends: of the session, and its topics (`wired.Topics`); clock: its ManualClock. page: of
    the therapist, None while there is none; screen: of the patient.
    """

    def __init__(self, node: Any, ends: Any, recorder: Recorder, clock: Any, robot: Robot,
                 count: Callable[[str], int]):  # fmt: skip
        self.node, self.ends, self.recorder, self.clock, self.robot = (
            node, ends, recorder, clock, robot
        )  # fmt: skip
        self.loop, self.rights = asyncio.new_event_loop(), Rights(["/"])
        self._bridge = BridgeNode(node, self._hear, count)
        self.gateway = BridgeGateway(self._bridge, self.rights, 5.0)
        sees = SimpleNamespace(clock=clock, create_subscription=lambda *given: None)
        self._eyes = SimulatedPatient(sees, lambda: robot.patient.arm, robot.change)
        self._attended_ns = self._reported_ns = 0
        self.page: Page | None = Page(self, "therapist")
        self.screen = Page(self, "patient")

    def _hear(self, topic: str, message: Any) -> None:
        self.recorder.write(topic, message)
        self.ends.heard[topic].append(message)

    def go_on(self) -> None:
        """Let a moment pass."""
        is_on = self.screen.state.get("state") in UNDER_WAY
        hand = self.robot.go_on(SAMPLE_S if is_on else IDLE_S)
        self.clock.time_ns = self.robot.now_ns
        told = ImpedanceState(support=self.robot.support, support_limit=25.0, law="thesis day")
        for topic, message in ((graph.ENDPOINT_STATE, hand), (graph.CONTROLLER_STATE, told)):
            self.node.stamp(message.header)
            self._hear(topic, message)
        if self.clock.time_ns - self._reported_ns >= S:
            self._reported_ns = self.clock.time_ns
            self.recorder.report_to(self.ends.heard["session_recorder/status"])
        self.node.step()
        self.recorder.answer_all()
        self._pass_on()

    def _pass_on(self) -> None:
        """Take what the session has told to robot, patient, recorder and pages."""
        for topic, messages in self.ends.told.items():
            for message in messages:
                self.recorder.write(topic, message)
                self._bridge.queues[topic].append(message)
                if topic == graph.THERAPY_SLOT:
                    self.robot.guide(message)
                elif topic == graph.THERAPY_STATE:
                    self._eyes.hear_state(message)
            messages.clear()
        self.gateway.poll()
        for page in filter(None, (self.page, self.screen)):
            page.read()
        if self.page and self.clock.time_ns - self._attended_ns >= S // 2:
            self._attended_ns = self.clock.time_ns
            self.page.publish(graph.THERAPY_ATTENDANCE)

    def until(self, condition: Callable[[], Any], seconds: float = 900.0) -> None:
        """Let time pass until something is so. Raises AssertionError if it does not come."""
        end_ns = self.clock.time_ns + round(seconds * S)
        while not condition():
            assert self.clock.time_ns < end_ns, self.screen.state
            self.go_on()

    def wait(self, seconds: float) -> None:
        """Let some time pass."""
        end_ns = self.clock.time_ns + round(seconds * S)
        self.until(lambda: self.clock.time_ns >= end_ns, seconds + 1.0)
