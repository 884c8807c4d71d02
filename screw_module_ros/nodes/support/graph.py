# SPDX-License-Identifier: Apache-2.0
"""The table of the graph: which executables make the robot, in the order they start.

`bringup` and `launch/therapy_robot.launch.py` both read it, so that the two cannot differ.
"""

from __future__ import annotations

import os
from typing import NamedTuple

PACKAGE = "screw_module_ros"


class Entry(NamedTuple):
    """One executable of the graph.

    executable: its name, and that of its node
    simulation: started only against the simulated rig
    core: processor core on a machine with two of them, None for either: the chain from encoder to
    amplifier keeps one core and its caches, the rig and the force sensor the other
    parts: names of the nodes in it where there are several
    """

    executable: str
    simulation: bool = False
    core: int | None = None
    parts: tuple[str, ...] = ()

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of its nodes."""
        return self.parts or (self.executable,)


GRAPH = (
    Entry("sim_rig", simulation=True, core=1),
    Entry("supervisor"),
    Entry("encoder", core=0),
    Entry("force_sensor", core=1),
    Entry("impedance_controller", core=0),
    Entry("amplifier", core=0),
    Entry("manus"),
    Entry("endpoint_state"),
    Entry("session_recorder"),
)

COMPOSED = Entry(
    "module", core=0, parts=("encoder", "force_sensor", "impedance_controller", "amplifier")
)
"""One process with one hot loop in place of its four parts."""

BESIDE = ("characterize", "therapy_session", "web_bridge")
"""Nodes that are started by hand beside the graph."""

SEPARATE_LATENCY, COMPOSED_LATENCY = 0.6e-3, 0.3e-3
"""From SYNC to when the answer acts [s]: what `make bench` measures, for simulated time."""
PLANE_RATE_ON_TWO_CORES = 250.0
SIMULATION_PARAMETERS = "params/sim.yaml"
BENCH_PARAMETERS = "params/bench.yaml"


def table(composed: bool) -> list[Entry]:
    """Return the whole graph, `composed`: with `module` in place of its four parts."""
    if not composed:
        return list(GRAPH)
    left = [entry for entry in GRAPH if entry.executable not in COMPOSED.parts]
    left.insert([entry.executable for entry in GRAPH].index(COMPOSED.parts[0]), COMPOSED)
    return left


def nodes_of(executable: str) -> tuple[str, ...]:
    """Return the names of the nodes in an executable."""
    return COMPOSED.nodes if executable == COMPOSED.executable else (executable,)


def chosen(
    simulation: bool, only: list[str] = (), without: list[str] = (), composed: bool = False
) -> list[Entry]:
    """Return the entries to start, in order.

    Raises ValueError naming an executable that is not in the table.
    """
    known = [entry.executable for entry in table(composed)]
    for name in (*only, *without):
        if name not in known:
            raise ValueError(f"no node {name!r} in the graph; there are {', '.join(known)}")
    return [
        entry
        for entry in table(composed)
        if (simulation or not entry.simulation)
        and (not only or entry.executable in only)
        and entry.executable not in without
    ]


def simulated_arguments(composed: bool = False, wall_clock: bool = False) -> list[str]:
    """Return the --ros-args of a robot with the simulated rig."""
    latency = COMPOSED_LATENCY if composed else SEPARATE_LATENCY
    words = ["-p", f"sim_rig:devices.command_latency:={latency}"]
    if wall_clock:
        words += ["-p", "use_sim_time:=false", *placement(len(os.sched_getaffinity(0)), composed)]
    return words


def placement(cores: int, composed: bool = False) -> list[str]:
    """Return the --ros-args that fit a real-time simulation to a machine with `cores` cores.

    With two, rig and robot together are more than they can do in time: the plane then runs at
    250 Hz (500 Hz otherwise, the original robot's 200 Hz) and the chain keeps a core of its own.
    With more the scheduler finds a free one.
    """
    if cores > 2:
        return []
    words = ["-p", f"manus:rate:={PLANE_RATE_ON_TWO_CORES}"]
    for entry in table(composed):
        if entry.core is not None and entry.core < cores:
            for node in entry.nodes:
                words += ["-p", f"{node}:realtime.cores:=[{entry.core}]"]
    return words
