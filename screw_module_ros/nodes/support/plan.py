# SPDX-License-Identifier: Apache-2.0
"""The executables to start and their arguments, for `bringup` and the launch file."""

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
"""Prefix of the enclaves of security/policy.xml."""
_SECURITY_VARIABLE = "ROS_SECURITY_ENABLE"
SEPARATE_LATENCY, COMPOSED_LATENCY = 0.6e-3, 0.3e-3
"""Delay from SYNC to the effect of its command [s], measured by `make bench`; in simulated time."""
PLANE_RATE_ON_TWO_CORES = 250.0
SIMULATION_PARAMETERS = "params/sim.yaml"
BENCH_PARAMETERS = "params/bench.yaml"


class Plan(NamedTuple):
    """Executables to start.

    entries: the executables, in order. common: arguments for each, after --ros-args. namespace: of
    all nodes, with leading /, empty for none. warnings: entries of the parameter file that no node
    reads.
    """

    entries: list[Entry]
    common: list[str]
    namespace: str
    warnings: list[str]

    def arguments(self, entry: Entry) -> list[str]:
        """Return the arguments of one executable, with its enclave if SROS2 is in use."""
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
    """Return the plan that starts the robot.

    simulation: with the simulated rig. params: a file that replaces the packaged one. only,
    without: names of the table. extra: arguments for every node. composed: `module` replaces its
    four parts. wall_clock: the simulated rig runs in real time. first_port: of the rig's four CAN
    ports, None for those of the file.

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
    """Return the rules of -p unchanged.

    Raises ValueError for a rule of another form, or with an unknown node.
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
    """Return the --ros-args that adapt a real-time simulation to a machine with `cores` cores.

    Two cores are too slow for rig and robot in real time. Then the plane runs at 250 Hz (otherwise
    500 Hz; the original robot had 200 Hz), and the nodes from encoder to amplifier have their own
    core. With more cores the scheduler finds a free one.
    """
    if cores > 2:
        return []
    words = ["-p", f"manus:rate:={PLANE_RATE_ON_TWO_CORES}"]
    for entry in table(composed):
        if entry.core is not None and entry.core < cores:
            for node in entry.nodes:
                words += ["-p", f"{node}:realtime.cores:=[{entry.core}]"]
    return words
