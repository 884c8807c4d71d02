# SPDX-License-Identifier: Apache-2.0
"""The demo's table from a bag with known contents."""

import math

import pytest
import yaml
from rclpy.serialization import serialize_message
from rich.console import Console
from screw_module_msgs.msg import AmplifierState, EncoderSample, EndpointState, ForceSample

from screw_module_ros.identification.force_position import Spring
from screw_module_ros.identification.recorded_session import Part
from screw_module_ros.recording.bag import Bag, Message, Topic
from screw_module_ros.recording.definitions import Definitions
from screw_module_ros.recording.recorder import Recording
from screw_module_ros.trials.demo_report import (
    FORCE_FEEDBACK,
    FRICTION_COMPENSATION,
    IMPEDANCE,
    evaluated,
)

SPRING = Spring(100.0, 0.18)
MS = 1_000_000
START = 1_700_000_000_000 * MS
MODE_MS = 400
MODES = (IMPEDANCE, FRICTION_COMPENSATION, FORCE_FEEDBACK)
TARGETS = [(0.1, 0.0), (0.0, 0.1)]


def samples(tick: int, beyond: float):
    """Return the four messages of one tick; the handle swings once in 200 ms."""
    angle = 2 * math.pi * tick / 200
    position, velocity = 0.18 + 0.05 * math.sin(angle), 0.6 * math.cos(angle)
    force = 100.0 * (position - 0.18) + math.copysign(beyond, velocity)
    yield EncoderSample(sequence=tick, position=position, velocity=velocity, homed=True)
    yield ForceSample(sequence=tick, fz=force)
    state = EndpointState(sequence=tick, valid=[True] * 3)
    state.position.z = position
    yield state
    yield AmplifierState(commands=tick, lost=tick // 100, latency_p50=2e-4, latency_p99=3e-4)


def write_bag(folder, beyond, skip=()):
    """Write three modes with these offsets [N]; ticks in `skip` have no force sample."""
    writer, definitions = Recording(Bag(folder)), Definitions()
    names = {
        EncoderSample: "/screw/encoder",
        ForceSample: "/handle/force",
        EndpointState: "/endpoint_state",
        AmplifierState: "/screw/amplifier_state",
    }
    channels = {}
    for kind, name in names.items():
        type_name = f"screw_module_msgs/msg/{kind.__name__}"
        channels[kind] = writer.add_topic(Topic(name, type_name, definitions.find(type_name)))
    for tick in range(len(beyond) * MODE_MS):
        time = START + tick * MS
        writer.put([
            Message(channels[type(message)], time, time, tick + 1, serialize_message(message))
            for message in samples(tick, beyond[tick // MODE_MS])
            if not (tick in skip and isinstance(message, ForceSample))
        ])  # fmt: skip
    writer.close()
    return folder


def parts():
    begins = [START + number * MODE_MS * MS for number in range(len(MODES))]
    return [
        Part(name, begin, begin + MODE_MS * MS - 1)
        for name, begin in zip(MODES, begins, strict=True)
    ]


def shown(results) -> str:
    console = Console(width=140, record=True, file=open("/dev/null", "w", encoding="utf-8"))
    for item in results.tables():
        console.print(item)
    return console.export_text()


def lines(text: str, word: str) -> str:
    return "\n".join(line for line in text.splitlines() if word in line)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A run that met everything but the deadline: one tick in a hundred was lost."""
    folder = tmp_path_factory.mktemp("good")
    bag = write_bag(folder / "session", (9.5, 4.0, 1.5), skip=range(100, 110))
    return folder, evaluated(bag, parts(), SPRING, TARGETS, folder)


def test_offsets_stand_beside_the_thesis(good):
    text = shown(good[1])
    assert "9.5 N" in lines(text, IMPEDANCE)
    assert "about 10 N" in lines(text, IMPEDANCE)
    assert "1.5 N" in lines(text, FORCE_FEEDBACK)
    assert "reached" in lines(text, FORCE_FEEDBACK)


def test_a_friction_compensation_has_no_verdict(good):
    line = lines(shown(good[1]), FRICTION_COMPENSATION)
    assert "4.0 N" in line
    assert "reached" not in line


def test_gaps_of_the_recording_are_listed_by_topic(good):
    table = shown(good[1]).partition("Topics with missing messages")[2]
    assert lines(table, "/handle/force").split()[3:6:2] == ["1190", "10"]
    assert "/screw/encoder" not in table


def test_the_definition_of_motion_is_stated(good):
    assert "faster than 20 mm/s" in shown(good[1])


def test_a_missed_deadline_is_said_plainly(good):
    results = good[1]
    assert results.evaluation.timing.in_time == pytest.approx(0.99, abs=1e-3)
    missed = results._replace(
        evaluation=results.evaluation._replace(
            timing=results.evaluation.timing._replace(late=results.evaluation.timing.commands)
        )
    )
    assert "MISSED" in lines(shown(missed), "deadline")
    assert not missed.accepted


@pytest.mark.parametrize("beyond", [(6.0, 4.0, 1.5), (14.0, 4.0, 1.5), (9.5, 4.0, 3.5)])
def test_an_offset_out_of_bounds_is_said_plainly(tmp_path, beyond):
    bag = write_bag(tmp_path / "session", beyond)
    results = evaluated(bag, parts(), SPRING, TARGETS, tmp_path)
    assert "MISSED" in shown(results)
    assert not results.accepted


def test_figures_and_numbers_are_written(good):
    folder, results = good
    assert [file.name for file in results.files] == ["force_position.png", "path.png"]
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in results.files)
    told = yaml.safe_load((folder / "results.yaml").read_text())
    assert told["modes"][0]["offset"]["mean"] == pytest.approx(9.5)
    assert told["recorded"]["/handle/force"]["lost"] == 10


def test_the_bag_is_dropped_only_when_asked_for(good, tmp_path):
    assert good[1].bag.is_dir()
    bag = write_bag(tmp_path / "session", (9.5, 4.0, 1.5))
    results = evaluated(bag, parts(), SPRING, TARGETS, tmp_path, keep_bag=False)
    assert not bag.exists()
    assert "Bag: deleted" in shown(results)
