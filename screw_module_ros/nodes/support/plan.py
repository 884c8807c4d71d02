# SPDX-License-Identifier: Apache-2.0
"""What to start and with which arguments: one plan for `bringup` and for the launch file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

from screw_module_ros.graph import BESIDE, Entry, chosen, table
from screw_module_ros.resources import resource_path

from .command_line import Rule, arguments
from .isolation import port_arguments
from .parameter_files import read_file, strangers

ENCLAVES = "/therapy_robot"
"""Above the enclaves of security/policy.xml."""
_SECURITY_VARIABLE = "ROS_SECURITY_ENABLE"
SEPARATE_LATENCY, COMPOSED_LATENCY = 0.6e-3, 0.3e-3
"""From SYNC to when the answer acts [s]: what `make bench` measures, for simulated time."""
PLANE_RATE_ON_TWO_CORES = 250.0
SIMULATION_PARAMETERS = "params/sim.yaml"
BENCH_PARAMETERS = "params/bench.yaml"


class Plan(NamedTuple):
    """What to start.

    entries: the executables, in order. common: arguments of each, for behind --ros-args. namespace:
    of all nodes, from / on, empty for none. warnings: entries of the parameter file that no node
    reads.
    """

    entries: list[Entry]
    common: list[str]
    namespace: str
    warnings: list[str]

    def arguments(self, entry: Entry) -> list[str]:
        """Return the arguments of one executable, with its enclave where SROS2 is in force."""
        if os.environ.get(_SECURITY_VARIABLE, "").lower() != "true":
            return self.common
        return [*self.common, "--enclave", f"{ENCLAVES}/{entry.executable}"]


def plan(
    simulation: bool = True,
    params: str | None = None,
    namespace: str = "",
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    extra: Sequence[str] = (),
    composed: bool = False,
    wall_clock: bool = False,
    first_port: int | None = None,
) -> Plan:
    """Return what starts the robot.

    simulation: against the simulated rig. params: a file in place of the packaged one. only,
    without: names of the table. extra: goes to every node. composed: `module` in place of its four
    parts. wall_clock: the simulated rig runs in real time. first_port: of the rig's four CAN ports,
    None for those of the file.

    Raises ParameterError for a file that cannot be read, ValueError for a name that is not in the
    table and for ports without a simulated rig.
    """
    if first_port is not None and not simulation:
        raise ValueError("the first port is one of the simulated rig: hardware has none")
    default = SIMULATION_PARAMETERS if simulation else BENCH_PARAMETERS
    path = params or str(resource_path(default))
    above = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    known = [node for entry in table(composed) for node in entry.nodes]
    words = ["--params-file", path]
    if simulation:
        words += simulated_arguments(composed, wall_clock)
    if first_port is not None:
        words += port_arguments(first_port)
    return Plan(
        chosen(simulation, only, without, composed),
        [*words, *extra],
        above,
        strangers(read_file(path), [*known, *BESIDE], above),
    )


def checked_values(values: Sequence[str]) -> list[str]:
    """Return the rules of -p as they are.

    Raises ValueError for one that is none, or that names a node that there is not.
    """
    known = {node for composed in (False, True) for e in table(composed) for node in e.nodes}
    for value in values:
        rules: tuple[Rule, ...] = arguments(["--ros-args", "-p", value]).rules
        if not rules:
            raise ValueError(f"-p {value}: NODE:NAME:=VALUE is wanted")
        if rules[0].node and rules[0].node not in known:
            raise ValueError(
                f"-p {value}: no node {rules[0].node!r}; there are {', '.join(sorted(known))}"
            )
    return list(values)


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
