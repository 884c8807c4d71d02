# SPDX-License-Identifier: Apache-2.0
"""The table of the graph: which executables make the robot, in the order they start.

`bringup` and `launch/therapy_robot.launch.py` both read it, so that the two cannot differ.
"""

from __future__ import annotations

from typing import NamedTuple

PACKAGE = "screw_module_ros"


class Entry(NamedTuple):
    """One node of the graph.

    executable: name of the executable and of the node
    simulation: started only against the simulated rig
    core: processor core on a machine with two of them, None for either: the chain from encoder to
    amplifier keeps one core and its caches, the rig and the force sensor the other
    """

    executable: str
    simulation: bool = False
    core: int | None = None


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

SIMULATION_PARAMETERS = "params/sim.yaml"
BENCH_PARAMETERS = "params/bench.yaml"


def chosen(simulation: bool, only: list[str] = (), without: list[str] = ()) -> list[Entry]:
    """Return the entries to start, in order.

    Raises ValueError naming an executable that is not in the table.
    """
    known = [entry.executable for entry in GRAPH]
    for name in (*only, *without):
        if name not in known:
            raise ValueError(f"no node {name!r} in the graph; there are {', '.join(known)}")
    return [
        entry
        for entry in GRAPH
        if (simulation or not entry.simulation)
        and (not only or entry.executable in only)
        and entry.executable not in without
    ]


def placement(cores: int) -> list[str]:
    """Return the --ros-args that place the nodes on a machine with `cores` processor cores.

    Only two cores need it: with more, the scheduler finds a free one.
    """
    if cores != 2:
        return []
    return [
        word
        for entry in GRAPH
        if entry.core is not None
        for word in ("-p", f"{entry.executable}:realtime.cores:=[{entry.core}]")
    ]
