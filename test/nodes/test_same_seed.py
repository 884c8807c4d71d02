# SPDX-License-Identifier: Apache-2.0
"""Runs with one seed and commands bound to ticks: the same samples, bit for bit.

Apart twice; in one process twice, and as composed: there too the drive's state reaches the
controller by a call, apart by a topic.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message
from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample, SimTruth

from screw_module_ros.graph import MODULE, WHOLE, Entry
from screw_module_ros.lockstep.page import START_NS
from screw_module_ros.operator.robot import Robot, arm
from screw_module_ros.recording.records import File
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

TOPICS = {
    "screw/encoder": EncoderSample, "handle/force": ForceSample,
    "screw/force_command": ForceCommand, "sim/truth": SimTruth,
}  # fmt: skip
BETWEEN_TICKS_NS = 500_000
S = 1_000_000_000
READY_S = 2.0  # at the speed of the start 100 s of wall clock
RECORDED_S, ENABLED_S, END_S = READY_S + 1.1, READY_S + 1.3, READY_S + 1.9
STILL = (0.0, 0.0, 0.0)


class Script:
    """Commands at times that were fixed before, between two ticks [s since the rig's start]."""

    def __init__(self, robot: Robot):
        self.robot = robot

    def at(self, seconds: float) -> Robot:
        due_ns = START_NS + round(seconds * S) + BETWEEN_TICKS_NS
        assert self.robot.clock.now_ns() <= due_ns, "the machine was too slow for this script"
        self.robot.pause_until(due_ns)
        return self.robot


def played(folder: Path, seed: int, shared: Entry | None = None) -> Path:
    """Run the script; return the bag. shared: as of `graph.table`."""
    extra = ["-p", f"session_recorder:folder:={folder}", "-p", "session_recorder:name:=session"]
    extra += ["-p", f"sim_rig:seed:={seed}"]
    extra += ["-p", "sim_rig:speed:=0.02"]  # the graph starts before the first time of the script
    with (
        GraphRun(extra=extra, shared=shared) as graph,
        Robot("script", watch=graph.watch, simulated=True) as robot,
    ):
        robot.wait_until_ready(graph.names)
        robot.set_parameter("sim_rig", "speed", 0.0)
        script = Script(robot)
        script.at(READY_S).set_fixture("free")
        script.at(READY_S + 0.1).clear_faults()
        script.at(READY_S + 0.2).home()
        script.at(READY_S + 0.3).tare()
        script.at(READY_S + 0.55).set_fixture("human_arm")
        script.at(READY_S + 0.6).set_arm(arm((0.0, 0.0, 0.25), 0.3, STILL, STILL, kind="active"))
        script.at(READY_S + 0.65).set_impedance(100.0, 5.0)
        script.at(READY_S + 0.7).set_mode(ForceCommand.FORCE_FEEDBACK)
        script.at(READY_S + 0.75).permit()
        script.at(READY_S + 0.8).start_recording()
        script.at(READY_S + 1.1).enable()
        script.at(READY_S + 1.2).enable_plane()
        script.at(ENABLED_S).set_arm(
            arm(amplitude=(0.02, 0.03, 0.1), omega=(3.0, 2.0, 4.0), target=(0.0, 0.0, 0.2))
        )
        for number in range(7):
            angle = 2.0 * math.pi * number / 7.0
            script.at(ENABLED_S + 0.02 + 0.04 * number).set_setpoint(
                0.03 * math.sin(angle), 0.0, 0.25 - 0.02 * math.sin(angle)
            )
        script.at(ENABLED_S + 0.3).set_mode(ForceCommand.COMBINED)
        script.at(ENABLED_S + 0.45).set_impedance(200.0, 5.0)
        script.at(END_S).check_enabled()
        robot.stop_recording()
    assert_of_simulated_time(folder / "session")
    return folder / "session"


def samples(bag: Path) -> dict[str, list[str]]:
    """Return the messages of each topic between enabling and the end, in order."""
    found: dict[str, list[str]] = {topic: [] for topic in TOPICS}
    begin, end = (START_NS + round(t * S) for t in (RECORDED_S, END_S))
    for topic, message in File(bag / "session_0.mcap").messages():
        name = topic.name.lstrip("/")
        if name in found and begin <= message.log_time < end:
            found[name].append(exact(deserialize_message(message.data, TOPICS[name])))
    return found


def exact(value: Any) -> str:
    """Return all bits of a message's fields, in words.

    Not its bytes: the middleware leaves what was in its buffer where it fills up to a whole word.
    """
    if hasattr(value, "get_fields_and_field_types"):
        names = value.get_fields_and_field_types()
        return ", ".join(f"{name} ({exact(getattr(value, name))})" for name in names)
    return repr(value.tolist() if hasattr(value, "tolist") else value)


def assert_of_simulated_time(bag: Path) -> None:
    """No message is noted by wall clock, also what rclpy stamps with it."""
    newest = max(m.log_time for _, m in File(bag / "session_0.mcap").messages())
    assert START_NS < newest < START_NS + 1000 * S


def assert_same(one: dict[str, list[str]], other: dict[str, list[str]]) -> None:
    for topic in TOPICS:
        per_second = 100 if topic == "sim/truth" else 1000
        assert len(one[topic]) == round(per_second * (END_S - RECORDED_S)), topic
        assert len(one[topic]) == len(other[topic])
        pairs = zip(one[topic], other[topic], strict=True)
        differing = [number for number, (first, second) in enumerate(pairs) if first != second]
        assert not differing, (topic, differing[:3])


def test_two_runs_with_one_seed_are_the_same_bit_for_bit(tmp_path):
    assert_same(*(samples(played(tmp_path / name, seed=3)) for name in ("one", "other")))


def test_one_process_is_the_same_twice_and_as_composed(tmp_path):
    whole = samples(played(tmp_path / "whole", 3, WHOLE))
    assert_same(whole, samples(played(tmp_path / "again", 3, WHOLE)))
    assert_same(whole, samples(played(tmp_path / "composed", 3, MODULE)))
