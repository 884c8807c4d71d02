# SPDX-License-Identifier: Apache-2.0
"""`whole`: the simulated robot in one process, in which one thread runs all loops.

The nodes are those of the separate executables, with the same names, topics, services, parameters
and diagnostics; each has its own service thread. Their loops take turns in the main thread
(`lockstep.rounds`), frames and topics between them pass by calls. It is for simulated time alone:
by wall clock a loop would wait for the others.
"""

from __future__ import annotations

import os
from functools import partial

from screw_module_ros.graph import MODULE, ONE_PROCESS_SIMULATES, WHOLE, together
from screw_module_ros.lockstep import clock
from screw_module_ros.lockstep.rounds import RoundsClock
from screw_module_ros.settings import SettingError

from . import module
from .endpoint_state import EndpointStateNode
from .manus import ManusNode
from .session_recorder import SessionRecorder
from .sim_rig import SimRigNode
from .supervisor import SupervisorNode
from .support.arguments import PARTS, arguments
from .support.local_topics import LocalTopics
from .support.node import Node
from .support.runtime import run_together
from .support.threads import run_loop

_CLASSES = {
    "sim_rig": SimRigNode, "supervisor": SupervisorNode, "manus": ManusNode,
    "endpoint_state": EndpointStateNode, "session_recorder": SessionRecorder,
}  # fmt: skip


def make_nodes() -> list[Node]:
    """Return the nodes, the rig first. Raises SettingError by wall clock, or as `module`."""
    clock.use(RoundsClock)
    asked = arguments().parts or WHOLE.parts
    try:
        parts = together(WHOLE, sorted({*WHOLE.parts} ^ {*asked})).parts
    except ValueError as error:
        raise SettingError(f"{PARTS}: {error}") from None
    made = {node.get_name(): node for node in module.make_nodes()}
    nodes = [made.get(name) or _CLASSES[name]() for name in parts]
    local = LocalTopics(parts)
    for node in nodes:
        if not node.clock.simulated:
            raise SettingError(ONE_PROCESS_SIMULATES)
        node.local = local
    return nodes


def run(nodes: list[Node]) -> None:
    """Run the loops of the nodes until they are to stop; the rig's own moves the time."""
    rig, *others = nodes
    assert isinstance(rig.clock, RoundsClock)
    rounds = rig.clock.rounds
    chain = [node for node in others if node.get_name() in MODULE.parts]
    rounds.add(partial(run_loop, chain, module.chain_of(chain)))
    for node in others:
        if node not in chain:
            rounds.add(node.run)
    rig.run()
    rounds.end("simulated time stands still: sim_rig has stopped")


def main() -> int:
    """Console entry point."""
    os.umask(0o077)  # only the owner may read a patient's recording
    return run_together(WHOLE.executable, make_nodes, run)
