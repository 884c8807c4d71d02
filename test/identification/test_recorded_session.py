# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from screw_module_ros.identification import recorded_session as session
from screw_module_ros.identification.force_metric import Spring
from screw_module_ros.identification.recorded_session import Part, evaluate
from screw_module_ros.recording.bag import BagError

SPRING = Spring(100.0, 0.18)
MS = 1_000_000
TICKS = 4000
PARTS = [Part("plain", 0, 1999 * MS), Part("better", 2000 * MS, 3999 * MS)]


def columns():
    """Return four seconds of a session: 8 N of offset each way in the first part, 2 N after it."""
    tick = np.arange(TICKS)
    log_time = tick * MS
    position = 0.18 + 0.05 * np.sin(2 * np.pi * tick / 1000)
    velocity = 0.314 * np.cos(2 * np.pi * tick / 1000)
    beyond = np.where(tick < 2000, 8.0, 2.0) * np.sign(velocity)
    state = np.arange(0, TICKS, 10)
    third = np.arange(0, TICKS, 5)
    return {
        session.ENCODER: {
            "log_time": log_time,
            "sequence": tick + 7,
            "position": position,
            "velocity": velocity,
            "homed": np.ones(TICKS, bool),
        },
        session.FORCE: {
            "log_time": log_time,
            "sequence": tick + 7,
            "fz": 100.0 * (position - 0.18) + beyond,
            "status": np.zeros(TICKS, int),
        },
        session.DRIVE: {
            "log_time": state * MS,
            "commands": state + 1,
            "late": np.zeros(len(state), int),
            "lost": np.zeros(len(state), int),
            "latency_p50": np.full(len(state), 2e-4),
            "latency_p99": np.full(len(state), 3e-4),
        },
        session.ENDPOINT: {
            "log_time": third * MS,
            "position.x": third * 1e-3,
            "position.y": third * 2e-3,
            "position.z": third * 3e-3,
            "valid": np.ones((len(third), 3), bool),
        },
    }


def test_each_part_has_its_own_offset():
    found = evaluate(columns(), PARTS, SPRING)
    assert [t.name for t in found.traces] == ["plain", "better"]
    assert [o.mean for o in found.offsets] == pytest.approx([8.0, 2.0])


def test_samples_are_joined_by_tick_not_by_place():
    topics = columns()
    force = topics[session.FORCE]
    lost = np.arange(TICKS) % 3 == 0
    topics[session.FORCE] = {name: values[~lost] for name, values in force.items()}
    found = evaluate(topics, PARTS, SPRING)
    assert found.offsets[0].mean == pytest.approx(8.0)
    assert len(found.traces[0].force) == pytest.approx(2000 * 2 / 3, abs=1)


def test_samples_of_a_faulty_sensor_are_left_out():
    topics = columns()
    faulty = np.arange(TICKS) % 2 == 0
    topics[session.FORCE]["status"][faulty] = 1 << 8
    topics[session.FORCE]["fz"][faulty] = 1e6
    assert evaluate(topics, PARTS, SPRING).offsets[1].mean == pytest.approx(2.0)


def test_heights_without_home_are_left_out():
    topics = columns()
    topics[session.ENCODER]["homed"][:] = False
    with pytest.raises(BagError, match="plain: no tick has both"):
        evaluate(topics, PARTS, SPRING)


def test_a_part_that_was_not_recorded_is_named():
    late = Part("late", 9_000 * MS, 9_999 * MS)
    with pytest.raises(BagError, match="late: a required topic has no message"):
        evaluate(columns(), [*PARTS, late], SPRING)


def test_the_path_has_three_axes_and_only_valid_samples():
    topics = columns()
    topics[session.ENDPOINT]["valid"][0] = [True, False, True]
    points = evaluate(topics, PARTS, SPRING).paths[0].points
    assert points.shape == (399, 3)
    assert points[0] == pytest.approx([0.005, 0.010, 0.015])


def test_timing_spans_all_parts():
    found = evaluate(columns(), PARTS, SPRING).timing
    assert found.rate == pytest.approx(1000.0)
    assert found.in_time == 1.0


def test_a_restarted_drive_node_is_told():
    topics = columns()
    topics[session.DRIVE]["commands"][300:] = 0
    with pytest.raises(BagError, match="restarted"):
        evaluate(topics, PARTS, SPRING)


def test_no_parts_are_refused():
    with pytest.raises(ValueError, match="no parts"):
        evaluate(columns(), [], SPRING)
