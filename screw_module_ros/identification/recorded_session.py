# SPDX-License-Identifier: Apache-2.0
"""Evaluates a recorded session: force against position in each part, and timing.

The arrays come from a bag as `recording.decoded.columns` gives them, one dict of columns per topic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from screw_module_ros import graph

from ..recording.bag import BagError
from ..recording.decoded import columns
from .force_metric import Offsets, Spring, common_ticks, offsets
from .timing import Timing, timing

ENCODER, FORCE = f"/{graph.ENCODER}", f"/{graph.FORCE}"
DRIVE, ENDPOINT = f"/{graph.AMPLIFIER_STATE}", f"/{graph.ENDPOINT_STATE}"
TOPICS = (ENCODER, FORCE, DRIVE, ENDPOINT)

Columns = Mapping[str, np.ndarray]


class Part(NamedTuple):
    """A stretch of a session: its name, begin and end on the system clock [ns since the epoch]."""

    name: str
    begin_ns: int
    end_ns: int


class Trace(NamedTuple):
    """Height [m], velocity [m/s] and force of the patient on the robot [N] at the same ticks."""

    name: str
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray


class Path3D(NamedTuple):
    """Path of the handle in the frame manus_base: x, y, z [m], shape (samples, 3)."""

    name: str
    points: np.ndarray


class Evaluation(NamedTuple):
    """Result of a session; traces, offsets and paths are in the order of its parts.

    timing: from the beginning of the first part to the end of the last one.
    """

    traces: list[Trace]
    offsets: list[Offsets]
    paths: list[Path3D]
    timing: Timing


def read(bag: Path | str, namespace: str = "") -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of the topics that `evaluate` needs.

    Raises BagError when the bag cannot be read or lacks one of them.
    """
    return {topic: columns(bag, namespace + topic) for topic in TOPICS}


def evaluate(
    topics: Mapping[str, Columns], parts: Sequence[Part], spring: Spring
) -> Evaluation:
    """Evaluate each part of a session.

    Raises BagError naming the part that lacks samples, ValueError without parts.
    """
    if not parts:
        raise ValueError("no parts to evaluate")
    traces = [trace(topics[ENCODER], topics[FORCE], part) for part in parts]
    found = [offsets(t.position, t.velocity, t.force, spring) for t in traces]
    paths = [path(topics[ENDPOINT], part) for part in parts]
    whole = Part("the session", parts[0].begin_ns, parts[-1].end_ns)
    return Evaluation(traces, found, paths, drive_timing(topics[DRIVE], whole))


def trace(encoder: Columns, force: Columns, part: Part) -> Trace:
    """Join the valid encoder and force samples of one part by their tick numbers.

    Raises BagError without a common tick.
    """
    encoder = _within(encoder, part, "homed")
    force = _within(force, part)
    healthy = {name: values[force["status"] == 0] for name, values in force.items()}
    at, there = common_ticks(encoder["sequence"], healthy["sequence"])
    if not len(at):
        raise BagError(f"{part.name}: no tick has both a height and a force in the bag")
    return Trace(part.name, encoder["position"][at], encoder["velocity"][at], healthy["fz"][there])


def path(endpoint: Columns, part: Part) -> Path3D:
    """Return the handle's path in one part, from the samples with three valid axes."""
    rows = _within(endpoint, part)
    valid = rows["valid"].all(axis=1)
    points = [rows[f"position.{axis}"][valid] for axis in "xyz"]
    return Path3D(part.name, np.column_stack(points))


def drive_timing(drive: Columns, part: Part) -> Timing:
    """Return the timing of the commands in one part. Raises BagError without samples."""
    rows = _within(drive, part)
    names = ("log_time", "commands", "late", "lost", "latency_p50", "latency_p99")
    try:
        return timing(*(rows[name] for name in names))
    except ValueError as error:
        raise BagError(f"{part.name}: {error}") from error


def _within(topic: Columns, part: Part, *flags: str) -> dict[str, np.ndarray]:
    """Return the rows received in the part for which all flags are set."""
    time = topic["log_time"]
    chosen = (time >= part.begin_ns) & (time <= part.end_ns)
    if not chosen.any():
        raise BagError(f"{part.name}: a required topic has no message in this part")
    for flag in flags:
        chosen &= topic[flag].astype(bool)
    return {name: values[chosen] for name, values in topic.items()}
