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
    required: the others cannot move without it
    """

    executable: str
    simulation: bool = False
    required: bool = True


GRAPH = (
    Entry("sim_rig", simulation=True),
    Entry("supervisor"),
    Entry("encoder"),
    Entry("force_sensor"),
    Entry("impedance_controller"),
    Entry("amplifier"),
    Entry("manus"),
    Entry("endpoint_state", required=False),
    Entry("session_recorder", required=False),
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
