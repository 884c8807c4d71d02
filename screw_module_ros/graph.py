# SPDX-License-Identifier: Apache-2.0
"""The one table of the graph: executables, topics, CAN buses. All other code reads it from here.

The table is independent of ROS: a type is `package/msg/Name`, a quality of service is a name in
`nodes/support/topics.py`. Tests compare the table with the running graph, the security policy,
setup.py, the parameter files and docs/nodes.md.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

PACKAGE = "screw_module_ros"
SEPARATE_LATENCY, COMPOSED_LATENCY = 0.6e-3, 0.3e-3
"""Delay from SYNC to the effect of its command [s], with nodes apart and with several in a process,
measured by `make bench`; in simulated time."""


class Entry(NamedTuple):
    """One executable of the graph.

    executable: its name, and that of its node
    simulation: started only with the simulated rig
    core: processor core on a machine with two cores, None for any: the chain from encoder to
    amplifier uses one core and its caches, the rig and the force sensor use the other
    parts: names of its nodes, if it has several
    """

    executable: str
    simulation: bool = False
    core: int | None = None
    parts: tuple[str, ...] = ()

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of its nodes."""
        return self.parts or (self.executable,)


class Topic(NamedTuple):
    """One topic.

    name: relative to the namespace of the robot, or ~/ below its publisher
    type: of its messages
    qos: of its publisher, and default of its subscribers: sample, command or state
    publisher: name of the only node that may publish it; empty if any may
    rate: messages per second by default [1/s], 0 if they follow an event; the publisher's parameter
    may change it
    subscribers: nodes of the table that subscribe to it
    clock: node whose ticks the `sequence` of the messages counts, empty for none
    every: ticks from one message to the next, or the name of the parameter of `clock` with it
    """

    name: str
    type: str
    qos: str
    publisher: str
    rate: float
    subscribers: tuple[str, ...] = ()
    clock: str = ""
    every: int | str = 0


class Bus(NamedTuple):
    """One CAN bus of the simulated robot.

    name: its channel, and prefix of the rig's parameters. node: the driver node.
    """

    name: str
    node: str


# Executables, in the order they start ---------------------------------------------------------

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

MODULE = Entry(
    "module", core=0, parts=("encoder", "force_sensor", "impedance_controller", "amplifier")
)
"""The vertical axis in one process with one hot loop, instead of its four parts."""

WHOLE = Entry(
    "whole", simulation=True,
    parts=("sim_rig", "supervisor", *MODULE.parts, "manus", "endpoint_state", "session_recorder"),
)  # fmt: skip
"""The simulated robot in one process, instead of all others."""

ONE_PROCESS_SIMULATES = (
    "the whole robot in one process is for simulated time alone, with hardware or by wall clock "
    "each loop would wait for the others: start the nodes apart, or `module` (--composed)"
)
_FREE = ("supervisor", "manus", "endpoint_state", "session_recorder")
"""Nodes that `whole` can do without: they have processes of their own, or do not run."""

BESIDE = ("characterize", "therapy_session", "web_bridge")
"""Nodes that are started by hand beside the graph."""

# Topics ---------------------------------------------------------------------------------------

ENCODER = "screw/encoder"
ENCODER_DECIMATED = "screw/encoder/decimated"
FORCE = "handle/force"
FORCE_DECIMATED = "handle/force/decimated"
WRENCH = "handle/wrench"
FORCE_COMMAND = "screw/force_command"
CONTROLLER_STATE = "screw/controller_state"
EXCITATION = "screw/excitation"
AMPLIFIER_STATE = "screw/amplifier_state"
MANUS_STATE = "manus/state"
ENDPOINT_STATE = "endpoint_state"
JOINT_STATES = "joint_states"
SAFETY_STATE = "safety_state"
SETPOINT = "setpoint"
RECORDER_STATUS = "~/status"
TRUTH = "sim/truth"
CLOCK = "clock"
DIAGNOSTICS = "/diagnostics"
THERAPY_SLOT = "therapy/slot"
THERAPY_WISH = "therapy/wish"
THERAPY_ATTENDANCE = "therapy/attendance"
THERAPY_ANSWER = "therapy/answer"
THERAPY_ACTION = "therapy/action"
THERAPY_SCORE = "therapy/score"
THERAPY_STATE = "therapy/state"
THERAPY_TRIAL = "therapy/trial"
THERAPY_ASSISTANCE = "therapy/assistance"

DECIMATED_RATE = 200.0
"""Rate of the decimated topics [1/s]. The middleware alone uses 4 to 5 % of a core for each
subscription at 1 kHz, so only the laws have any: from encoder to amplifier, and the plane's."""

_OURS = "screw_module_msgs/msg/"
_TOPICS = (
    Topic(ENCODER, _OURS + "EncoderSample", "sample", "encoder", 1000.0,
          ("impedance_controller",), clock="encoder", every=1),
    Topic(ENCODER_DECIMATED, _OURS + "EncoderSample", "state", "encoder", DECIMATED_RATE,
          ("endpoint_state", "supervisor")),
    Topic(FORCE, _OURS + "ForceSample", "sample", "force_sensor", 1000.0,
          ("impedance_controller", "manus"), clock="force_sensor", every=1),
    Topic(FORCE_DECIMATED, _OURS + "ForceSample", "state", "force_sensor", DECIMATED_RATE,
          ("endpoint_state", "supervisor")),
    Topic(WRENCH, "geometry_msgs/msg/WrenchStamped", "state", "force_sensor", 100.0),
    Topic(FORCE_COMMAND, _OURS + "ForceCommand", "command", "impedance_controller", 1000.0,
          ("amplifier",), clock="encoder", every=1),
    Topic(EXCITATION, _OURS + "ExcitationRequest", "command", "characterize", 0.0,
          ("impedance_controller",)),
    Topic(CONTROLLER_STATE, _OURS + "ImpedanceState", "state", "impedance_controller", 100.0,
          ("supervisor", "therapy_session")),
    Topic(AMPLIFIER_STATE, _OURS + "AmplifierState", "state", "amplifier", 100.0,
          ("encoder", "force_sensor", "impedance_controller", "endpoint_state", "supervisor")),
    Topic(MANUS_STATE, _OURS + "PlanarState", "state", "manus", 125.0,
          ("force_sensor", "endpoint_state", "supervisor"), clock="manus", every="state_every"),
    Topic(ENDPOINT_STATE, _OURS + "EndpointState", "state", "endpoint_state", 200.0,
          ("supervisor", "therapy_session", "web_bridge"), clock="endpoint_state", every=1),
    Topic(JOINT_STATES, "sensor_msgs/msg/JointState", "state", "endpoint_state", 100.0),
    Topic(SAFETY_STATE, _OURS + "SafetyState", "command", "supervisor", 50.0,
          ("impedance_controller", "amplifier", "manus", "endpoint_state", "web_bridge")),
    Topic(SETPOINT, _OURS + "EndpointSetpoint", "command", "", 0.0,
          ("impedance_controller", "manus", "sim_rig")),
    Topic(RECORDER_STATUS, "diagnostic_msgs/msg/DiagnosticStatus", "state", "session_recorder",
          1.0, ("therapy_session",)),
    Topic(TRUTH, _OURS + "SimTruth", "state", "sim_rig", 100.0),
    Topic(CLOCK, "rosgraph_msgs/msg/Clock", "command", "sim_rig", 100.0),
    Topic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", "state", "", 1.0, ("supervisor",)),
    Topic(THERAPY_SLOT, _OURS + "TherapySlot", "command", "therapy_session", 0.0,
          ("impedance_controller", "manus")),
    Topic(THERAPY_WISH, _OURS + "EndpointSetpoint", "command", "", 0.0,
          ("therapy_session", "sim_rig")),
    Topic(THERAPY_ATTENDANCE, "std_msgs/msg/Empty", "command", "web_bridge", 0.0,
          ("therapy_session",)),
    Topic(THERAPY_ANSWER, "std_msgs/msg/UInt8", "command", "web_bridge", 0.0,
          ("therapy_session",)),
    Topic(THERAPY_ACTION, "rcl_interfaces/msg/Log", "state", "web_bridge", 0.0),
    Topic(THERAPY_SCORE, "std_msgs/msg/Float64", "command", "", 0.0, ("therapy_session",)),
    Topic(THERAPY_STATE, _OURS + "TherapyState", "state", "therapy_session", 0.0,
          ("web_bridge", "sim_rig")),
    Topic(THERAPY_TRIAL, _OURS + "TrialResult", "state", "therapy_session", 0.0,
          ("web_bridge",)),
    Topic(THERAPY_ASSISTANCE, _OURS + "AssistanceChange", "state", "therapy_session", 0.0,
          ("web_bridge",)),
)  # fmt: skip
TOPICS = {topic.name: topic for topic in _TOPICS}

# Buses ----------------------------------------------------------------------------------------

BUSES = (
    Bus("encoder", "encoder"),
    Bus("drive", "amplifier"),
    Bus("force_sensor", "force_sensor"),
    Bus("planar", "manus"),
)


PATIENTS = (
    "healthy", "weak", "tremor", "flaccid", "spastic", "synergy", "slacking", "tiring", "severe",
)  # fmt: skip
"""Who may hold the simulated handle: the names of `params/patients.yaml`."""


def bus_of(node: str) -> str:
    """Return the simulated bus of a driver node. Raises KeyError for another node."""
    return {bus.node: bus.name for bus in BUSES}[node]


def subscribed_by(node: str) -> list[Topic]:
    """Return the topics that a node subscribes to."""
    return [topic for topic in _TOPICS if node in topic.subscribers]


def together(shared: Entry, apart: Sequence[str]) -> Entry:
    """Return a shared process without some of its nodes, which stay apart.

    Raises ValueError naming one that it cannot do without, or does not have.
    """
    free = [name for name in shared.parts if shared is WHOLE and name in _FREE]
    for name in apart:
        if name not in free:
            can = f"only {', '.join(free)} can" if free else "none of its nodes can"
            raise ValueError(f"{name} cannot leave the process {shared.executable}: {can}")
    return shared._replace(parts=tuple(name for name in shared.parts if name not in apart))


def table(shared: Entry | None = None) -> list[Entry]:
    """Return the whole graph; shared: with this process in place of its parts."""
    if shared is None:
        return list(GRAPH)
    left = [entry for entry in GRAPH if entry.executable not in shared.parts]
    left.insert([entry.executable for entry in GRAPH].index(shared.parts[0]), shared)
    return left


def chosen(
    simulation: bool,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    shared: Entry | None = None,
    apart: Sequence[str] = (),
) -> list[Entry]:
    """Return the entries to start, in order.

    simulation: with the simulated rig. only: these executables, empty for all. without: not these.
    shared: a process in place of its parts. apart: those of them that keep a process of their own.
    Raises ValueError naming an executable that is not in the table, or that cannot leave the shared
    process; if none is left to start; and for a shared rig where there is none.
    """
    if shared is not None:
        left = [name for name in without if name in shared.parts]
        shared = together(shared, [*left, *apart])
        if shared.simulation and not simulation:
            raise ValueError(f"{shared.executable}: {ONE_PROCESS_SIMULATES}")
    elif apart:
        raise ValueError(f"{apart[0]}: the nodes are apart already")
    entries = table(shared)
    known = [entry.executable for entry in entries]
    for name in (*only, *without):
        if name not in known:
            raise ValueError(f"no node {name!r} in the graph; there are {', '.join(known)}")
    found = [
        entry
        for entry in entries
        if (simulation or not entry.simulation)
        and (not only or entry.executable in only)
        and entry.executable not in without
    ]
    if not found:
        raise ValueError("these options leave no node to start (hardware has no sim_rig)")
    return found


def interface_class(type_name: str) -> Any:
    """Return the class of `package/msg/Name`, `package/Name`, a service or an action's feedback.

    Raises ImportError, AttributeError where it is not installed.
    """
    package, *folder, name = type_name.split("/")
    module = importlib.import_module(".".join((package, *(folder or ["msg"]))))
    kind = getattr(module, name.removesuffix("_FeedbackMessage"))
    return kind.Impl.FeedbackMessage if folder == ["action"] else kind
