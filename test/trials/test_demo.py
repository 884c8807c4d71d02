# SPDX-License-Identifier: Apache-2.0
"""The demo's table from a bag with known contents."""

import math

import numpy as np
import pytest
import yaml
from rclpy.serialization import serialize_message
from rich.console import Console
from screw_module_msgs.msg import AmplifierState, EncoderSample, EndpointState, ForceSample

from screw_module_ros.control.laws.thesis import refusal
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.recording.bag import Bag, BagError, Message, Topic
from screw_module_ros.recording.definitions import Definitions
from screw_module_ros.recording.recorder import Recording
from screw_module_ros.trials import demo
from screw_module_ros.trials.demo import (
    COMMANDED,
    FORCE_FEEDBACK,
    IMPEDANCE,
    MODES,
    OBSERVER,
    Span,
    Work,
    evaluated,
    path,
    tables,
    timing,
    trace,
)

MS = 1_000_000
START = 1_700_000_000_000 * MS
MODE_MS, MOVING_MS, STILL_MS = 600, 400, 500
AWAY = ((0.0, 0.1), (0.1, 0.0))


def samples(tick: int, beyond: float):
    """Return the four messages of one tick; the handle swings once in 200 ms, then stands still.

    Its offset from the spring is `beyond`. While it stops the force is far off, and must not count.
    """
    since = tick % MODE_MS
    angle = 2 * math.pi * since / 200
    position, velocity = 0.18 + 0.05 * math.sin(angle), 0.6 * math.cos(angle)
    force = 100.0 * (position - 0.18) + math.copysign(beyond, velocity)
    if since >= MOVING_MS:
        position, velocity = 0.21, 0.0
        force = 3.0 - 0.5 * beyond if since >= STILL_MS else 90.0
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


def parts() -> list[Work]:
    begins = [START + number * MODE_MS * MS for number in range(len(MODES))]
    return [
        Work(
            Span(name, begin, begin + MOVING_MS * MS - 1),
            Span(name, begin + STILL_MS * MS, begin + MODE_MS * MS - 1),
            AWAY,
        )
        for name, begin in zip(MODES, begins, strict=True)
    ]


def shown(results) -> str:
    console = Console(width=140, record=True, file=open("/dev/null", "w", encoding="utf-8"))
    for item in tables(results):
        console.print(item)
    return console.export_text()


def lines(text: str, word: str) -> str:
    return "\n".join(line for line in text.splitlines() if word in line)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A run that met everything but the deadline: one tick in a hundred was lost."""
    folder = tmp_path_factory.mktemp("good")
    bag = write_bag(folder / "session", (9.5, 1.5, 0.25), skip=range(100, 110))
    return folder, evaluated(bag, parts(), folder)


def test_offsets_stand_beside_the_thesis(good):
    text = shown(good[1])
    assert "9.5 N" in lines(text, IMPEDANCE)
    assert "about 10 N" in lines(text, IMPEDANCE)
    assert "1.5 N" in lines(text, FORCE_FEEDBACK)
    assert "reached" in lines(text, FORCE_FEEDBACK)


def test_table_figure_and_file_have_the_offset_from_the_spring_alone(good):
    assert [found.mean for found in good[1].offsets] == pytest.approx([9.5, 1.5, 0.25])
    told = yaml.safe_load((good[0] / "results.yaml").read_text())["modes"]
    assert [mode["offset"]["mean"] for mode in told] == pytest.approx([9.5, 1.5, 0.25])
    assert f"damper of {COMMANDED.damping:g} Ns/m" in shown(good[1])


def test_the_offset_without_the_damper_has_a_column_of_its_own(good):
    """The damper asks for more than the hand gave: what is left has the other sign."""
    speeds = np.abs(0.6 * np.cos(2 * np.pi * np.arange(200) / 200))
    speeds = speeds[speeds > 0.02]
    for found, beyond in zip(good[1].undamped, (9.5, 1.5, 0.25), strict=True):
        left = np.abs(beyond - COMMANDED.damping * speeds).mean()
        assert found.mean == pytest.approx(left, rel=0.01)
    assert good[1].undamped[0].mean < good[1].offsets[0].mean - 1.0
    assert f"{good[1].undamped[0].mean:.1f} N" in lines(shown(good[1]), IMPEDANCE)


def test_every_mode_gets_the_damper_that_the_observer_needs():
    law = VerticalSettings(stiffness=COMMANDED.stiffness, damping=COMMANDED.damping)
    assert not any(refusal(law, mode.number) for mode in MODES.values())
    assert refusal(law._replace(damping=COMMANDED.damping - 1.0), MODES[OBSERVER].number)


def test_each_path_is_drawn_with_the_targets_that_were_visited(good):
    assert [tuple(path.targets) for path in good[1].paths] == [AWAY] * len(MODES)


def test_the_offset_of_a_hand_at_rest_has_a_column(good):
    assert good[1].held == pytest.approx([4.75, 0.75, 0.125])
    assert "4.75 N" in lines(shown(good[1]), IMPEDANCE)
    assert "0.12 N" in lines(shown(good[1]), OBSERVER)


def test_gaps_of_the_recording_are_listed_by_topic(good):
    table = shown(good[1]).partition("Topics with missing messages")[2]
    assert lines(table, "/handle/force").split()[3:6:2] == ["1790", "10"]
    assert "/screw/encoder" not in table


def test_the_definition_of_motion_is_stated(good):
    assert "faster than 20 mm/s" in shown(good[1])


def test_a_missed_deadline_is_said_plainly(good):
    results = good[1]
    assert results.timing.in_time == pytest.approx(0.99, abs=1e-3)
    missed = results._replace(timing=results.timing._replace(late=results.timing.commands))
    assert "MISSED" in lines(shown(missed), "deadline")
    assert not missed.accepted


@pytest.fixture
def undrawn(monkeypatch):
    """Draw nothing: that takes most of the time, and `good` has the figures."""
    monkeypatch.setattr(demo, "save", lambda figure, file: file)


@pytest.mark.parametrize(
    "beyond", [(6.0, 1.5, 0.2), (14.0, 1.5, 0.2), (9.5, 3.5, 0.2), (9.5, 1.5, 1.1)]
)
def test_an_offset_out_of_bounds_is_said_plainly(undrawn, tmp_path, beyond):
    bag = write_bag(tmp_path / "session", beyond)
    results = evaluated(bag, parts(), tmp_path)
    assert "MISSED" in shown(results)
    assert not results.accepted


def test_figures_and_numbers_are_written(good):
    folder, results = good
    *drawn, moving = results.files
    assert [file.name for file in drawn] == ["force_position.png", "path.png"]
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in drawn)
    text = moving.read_text("utf-8")
    assert moving.name == "machine.html" and all(f'"name": "{name}"' in text for name in MODES)
    told = yaml.safe_load((folder / "results.yaml").read_text())
    assert told["modes"][0]["offset"]["mean"] == pytest.approx(9.5)
    assert told["modes"][2]["held"] == pytest.approx(0.125)
    assert told["recorded"]["/handle/force"]["lost"] == 10


def test_the_bag_is_dropped_only_when_asked_for(good, undrawn, tmp_path):
    assert good[1].bag.is_dir()
    bag = write_bag(tmp_path / "session", (9.5, 1.5, 0.2))
    results = evaluated(bag, parts(), tmp_path, keep_bag=False)
    assert not bag.exists()
    assert "Bag: deleted" in shown(results)


# Columns of a bag ---------------------------------------------------------------------------------

TICKS = 4000
PLAIN = Span("plain", 0, 1999 * MS)
LATE = Span("late", 9_000 * MS, 9_999 * MS)


@pytest.fixture
def topics():
    """Four seconds of a session, with 8 N of offset each way."""
    tick, state, third = np.arange(TICKS), np.arange(0, TICKS, 10), np.arange(0, TICKS, 5)
    position = 0.18 + 0.05 * np.sin(2 * np.pi * tick / 1000)
    velocity = 0.314 * np.cos(2 * np.pi * tick / 1000)
    force = 100.0 * (position - 0.18) + 8.0 * np.sign(velocity)
    common = {"log_time": tick * MS, "sequence": tick + 7}
    return {
        "/screw/encoder": {**common, "position": position, "velocity": velocity,
                           "homed": np.ones(TICKS, bool)},
        "/handle/force": {**common, "fz": force, "status": np.zeros(TICKS, int)},
        "/screw/amplifier_state": {
            "log_time": state * MS, "commands": state + 1, "late": state // 100,
            "lost": np.zeros(len(state), np.uint64), "latency_p50": np.linspace(1e-4, 3e-4, 400),
            "latency_p99": np.linspace(2e-4, 8e-4, 400),
        },
        "/endpoint_state": {
            "log_time": third * MS, "valid": np.ones((len(third), 3), bool),
            **{f"position.{axis}": third * 1e-3 * k for k, axis in enumerate("xyz", 1)},
        },
    }  # fmt: skip


def test_samples_are_joined_by_tick_not_by_place(topics):
    lost = np.arange(TICKS) % 3 == 0
    force = topics["/handle/force"]
    topics["/handle/force"] = {name: values[~lost] for name, values in force.items()}
    found = trace(topics, PLAIN)
    assert len(found.force) == pytest.approx(2000 * 2 / 3, abs=1)
    assert np.abs(found.force - 100.0 * (found.position - 0.18)) == pytest.approx(8.0)


def test_samples_of_a_faulty_sensor_are_left_out(topics):
    topics["/handle/force"]["status"][::2] = 1 << 8
    topics["/handle/force"]["fz"][::2] = 1e6
    assert trace(topics, PLAIN).force.max() < 20.0


def test_heights_without_home_are_left_out(topics):
    topics["/screw/encoder"]["homed"][:] = False
    with pytest.raises(BagError, match="plain: no tick has both"):
        trace(topics, PLAIN)


@pytest.mark.parametrize("read", [trace, path, timing])
def test_a_part_that_was_not_recorded_is_named(topics, read):
    with pytest.raises(BagError, match="late: .* has no message in this part"):
        read(topics, LATE)


def test_the_path_has_three_axes_and_only_valid_samples(topics):
    topics["/endpoint_state"]["valid"][0] = [True, False, True]
    points = path(topics, PLAIN).points
    assert points.shape == (399, 3)
    assert points[0] == pytest.approx([0.005, 0.010, 0.015])


def test_counts_are_those_of_the_stretch(topics):
    found = timing(topics, Span("half", 1000 * MS, 2990 * MS))
    assert (found.commands, found.late, found.lost) == (1990, 19, 0)
    assert found.duration == pytest.approx(1.99)
    assert found.rate == pytest.approx(1000.0)
    assert found.in_time == pytest.approx(1971 / 1990)
    assert found.worst_p99 == pytest.approx(found.p99 + 199 / 2 * 6e-4 / 399)


@pytest.mark.parametrize("name", ["commands", "late", "lost"])
def test_a_restarted_drive_node_is_told(topics, name):
    counts = topics["/screw/amplifier_state"][name] = np.arange(400, dtype=np.uint64)
    counts[150:] = 0
    with pytest.raises(BagError, match=f"count of {name} decreases: the node was restarted"):
        timing(topics, PLAIN)


def test_one_state_says_nothing_and_no_ticks_have_no_share(topics):
    with pytest.raises(BagError, match="has 1 states"):
        timing(topics, Span("short", 0, 5 * MS))
    topics["/screw/amplifier_state"]["commands"][:] = 3
    assert math.isnan(timing(topics, PLAIN).in_time)
