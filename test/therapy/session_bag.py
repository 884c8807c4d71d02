# SPDX-License-Identifier: Apache-2.0
"""Bags of simulated sessions, with the messages that the nodes write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import yaml
from rclpy.serialization import serialize_message
from screw_module_msgs.msg import EndpointState, TherapyState
from simulated_patient import Person, Simulation

from screw_module_ros import graph
from screw_module_ros.nodes.therapy_messages import change_message, result_message
from screw_module_ros.recording.bag import Bag, Message, Topic
from screw_module_ros.recording.definitions import Definitions
from screw_module_ros.resources import resource_path
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.protocol_file import parse_protocol, sha256
from screw_module_ros.therapy.session import Session, State

TOPICS = (
    graph.ENDPOINT_STATE, graph.THERAPY_STATE, graph.THERAPY_TRIAL, graph.THERAPY_ASSISTANCE
)  # fmt: skip
_S = 1_000_000_000


class Played(NamedTuple):
    """A session that was played: whose, the protocol's YAML, samples, and the messages beside.

    robot: what stands before the topics' names.
    """

    patient: str
    definition: str
    samples: list[HandSample]
    told: list[tuple[int, str, object]]
    robot: str = "/"


def short_text(name: str = "clock_adaptive", count: int = 2) -> str:
    """YAML of a protocol with a circuit without and one with assistance, of few targets."""
    content = yaml.safe_load(resource_path(f"params/therapy/{name}.yaml").read_text())
    content["blocks"] = content["blocks"][:2]
    for block in content["blocks"]:
        block["circuits"], block["targets"] = 1, {**block["targets"], "count": count, "rounds": 1}
    content["rules"]["give_up"] = 4.0
    return yaml.safe_dump(content)


def played(
    person: Person,
    seed: int,
    definition: str,
    patient: str = "P-7K3QX",
    begin_s: int = 0,
    clock_set: tuple[int, float] | None = None,
) -> Played:
    """Play a session. begin_s: after the epoch [s].

    clock_set: sample before which the system clock is set, and by how much [s].
    """
    session = Session(parse_protocol(definition, "test"))
    simulation = Simulation(session, person, seed)
    simulation.now_ns = begin_s * _S
    first = simulation.sample()
    samples, told = [first], [(first.stamp_ns, graph.THERAPY_STATE, _state(
        session, patient, definition, first.sequence - 1, definition, first.time_ns))]  # fmt: skip
    name, results, changes = session.protocol.name, 0, 0
    session.take(first)
    while session.state == State.RUNNING:
        simulation.step()
        simulation.step()
        if clock_set is not None and len(samples) == clock_set[0]:
            simulation.clock_set_ns = round(clock_set[1] * _S)
        sample = simulation.sample()
        samples.append(sample)
        session.take(sample)
        simulation.look()
        for result in session.results[results:]:
            message = result_message(result, patient, name)
            told.append((sample.stamp_ns, graph.THERAPY_TRIAL, message))
        for change in session.changes[changes:]:
            message = change_message(change, patient, name, 2)
            told.append((sample.stamp_ns, graph.THERAPY_ASSISTANCE, message))
        results, changes = len(session.results), len(session.changes)
    last = samples[-1]
    ends = _state(session, patient, "", last.sequence, definition, last.time_ns)
    told.append((last.stamp_ns, graph.THERAPY_STATE, ends))
    return Played(patient, definition, samples, told)


def write_bag(
    folder: Path,
    sessions: list[Played],
    keep: Callable[[HandSample], bool] = lambda _: True,
    notes: dict[str, dict[str, str]] | None = None,
) -> Path:
    """Write sessions into one bag, one after the other. keep: of the samples; notes: as recorded.

    Messages are in the order of the system clock, as a recorder of an older version sorted them.
    """
    writer, definitions = Bag(folder), Definitions()
    for note in (notes or {}).items():
        writer.note(*note)
    kinds = {name: graph.TOPICS[name].type for name in TOPICS}
    channels = {
        robot + name: writer.add_topic(Topic(robot + name, kind, definitions.find(kind)))
        for robot in dict.fromkeys(session.robot for session in sessions)
        for name, kind in kinds.items()
    }
    for session in sessions:
        kept = [sample for sample in session.samples if keep(sample)]
        hands = [(sample.stamp_ns, graph.ENDPOINT_STATE, _endpoint(sample)) for sample in kept]
        for time_ns, name, message in sorted([*hands, *session.told], key=lambda each: each[0]):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, _S)
            data = bytes(serialize_message(message))
            writer.write([Message(channels[session.robot + name], time_ns, time_ns, 0, data)])
    writer.close()
    return folder


def _endpoint(sample: HandSample) -> EndpointState:
    message = EndpointState(
        sequence=sample.sequence,
        monotonic_ns=sample.time_ns,
        valid=[True] * 3,
        enabled=[True] * 2,
        vertical_locked=False,
    )
    for part, values in (("position", sample.position), ("velocity", sample.velocity),
                         ("force", sample.force)):  # fmt: skip
        point = getattr(message, part)
        point.x, point.y, point.z = values
    return message


def _state(
    session: Session, patient: str, told: str, since: int, definition: str, time_ns: int
) -> TherapyState:
    return TherapyState(
        monotonic_ns=time_ns,
        state=session.state, state_since=since, sequence=since, reason=session.reason,
        patient=patient, definition=told,
        protocol=session.protocol.name, definition_sha256=sha256(definition), recorded=True,
    )  # fmt: skip
