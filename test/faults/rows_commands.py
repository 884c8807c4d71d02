# SPDX-License-Identifier: Apache-2.0
"""Rows about NaN, infinity and absurd values on topics, services, set points and parameters."""

from __future__ import annotations

import math
from functools import partial

import row
from acts import both, game, parameter_refused, paused, published, refused
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from fault_robot import SPRING
from row import BY_SERVICE, HOME, PLANE_CLEAR, TARE, VIA_SUPERVISOR, Act, Report, Row
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    EndpointState,
    ForceCommand,
    ForceSample,
    PlanarState,
    SafetyState,
)
from screw_module_msgs.srv import SetControlMode, SetImpedance

from screw_module_ros import graph
from screw_module_ros.graph import MODULE, WHOLE, Entry

_NAN, _INF = math.nan, math.inf
_BAD = {"NaN": _NAN, "infinity": _INF}
_COUNT, _EVERY_S = 25, 0.007
_MANY, _TICK_S = 60, 0.001
_LATE_NS = 3_600_000_000_000

_ENCODER = Report("impedance_controller", "encoder", "encoder")
_FORCE = Report("impedance_controller", "force sensor|nodes publish handle/force", "force")
_TWO_SUPERVISORS = Report("amplifier", "nodes publish safety_state")
_COMMAND = Report("amplifier", "force command|second node|publish", "amplifier")
_BY = {
    graph.ENCODER: (EncoderSample, "impedance_controller", _ENCODER),
    graph.FORCE: (ForceSample, "impedance_controller: two nodes publish it", _FORCE),
    graph.FORCE_COMMAND: (ForceCommand, "amplifier", _COMMAND),
}
"""Type, who notices, report."""
# test/properties/test_watches.py covers all fields and values; here is one of each input path.
_VALUES = (
    (graph.ENCODER, "position", _NAN, "NaN"),
    (graph.ENCODER, "velocity", _INF, "infinity"),
    (graph.FORCE, "fx", _NAN, "NaN"),
    (graph.FORCE, "fz", 1e300, "1e300"),
    (graph.FORCE, "tz", _NAN, "NaN"),
    (graph.FORCE_COMMAND, "force", _NAN, "NaN"),
    (graph.FORCE_COMMAND, "force", 1e300, "1e300"),
)
_WITHIN = BY_SERVICE + VIA_SUPERVISOR
"""Samples: the first message comes after 7 of them; the supervisor receives a state."""
_COUNTED = 100 + _WITHIN
"""Samples: the nodes count a topic's publishers each 0.1 s."""
_SERVICES = (HOME, TARE, PLANE_CLEAR, *row.MISSED)
_goes_on = partial(row.goes_on, group="commands", mend=game(*SPRING), watch=0.4)


def _name(text: str) -> str:
    return text.replace("/", "-").replace(" ", "-").lower()


def _stops(
    name: str, text: str, act: Act, who: str, report: Report, within: int = _WITHIN,
    plane_within: int = 0, shared: Entry | None = WHOLE,
) -> Row:  # fmt: skip
    return Row(
        _name(name), "commands", text, act, report, _SERVICES, who, within,
        plane_within or within + VIA_SUPERVISOR, shared=shared,
    )  # fmt: skip


def _foreign(topic: str, what: str, text: str, **fields) -> Row:
    """Return the row of samples or commands from a foreign sender.

    The genuine force samples hide its samples; the second publisher still shows.
    """
    kind, who, report = _BY[topic]
    if kind is EncoderSample and "late" not in fields:
        genuine = {"position": lambda robot: robot.record.now.height, "homed": True}
        fields = {**genuine, **fields}
    counted = kind is ForceSample
    act = published(kind, topic, *((_MANY, _TICK_S) if counted else (_COUNT, _EVERY_S)), **fields)
    within = _COUNTED if counted else _WITHIN
    return _stops(f"{topic}-{what}", text, act, who, report, within, shared=None)


def _state(topic: str, kind: type, what: str, who: str, report: Report | None, **fields) -> Row:
    """Return the row of a node's state from a foreign sender; None = no node acts on it."""
    # The report of two supervisors lasts only as long as both publish.
    supervisors = topic == graph.SAFETY_STATE
    act = published(kind, topic, 0 if supervisors else _MANY, _TICK_S, **fields)
    name, text = f"{topic}-{what}", f"{what} on {topic}, from a foreign sender"
    if report is None:
        return _goes_on(
            name=_name(name), fault=text, act=act, who=who, mend=row.nothing, shared=MODULE
        )
    counted = supervisors or topic == graph.MANUS_STATE
    limits = (_COUNTED, _COUNTED) if counted else ()
    return _stops(name, text, act, who, report, *limits, shared=MODULE)


_SMOKE_OR_TWO = "amplifier: (smoke|2 nodes publish)"
"""The second sender may be known before its first message comes."""
_SMOKE = DiagnosticStatus(name="encoder", level=DiagnosticStatus.ERROR, message="smoke")
_ODD = DiagnosticStatus(name="", level=b"\xff", message="x" * 50_000)
_X, _Y, _Z, *_ = SPRING
_KEEPS = "controller and manus leave that axis alone"
_LIMITED = "controller and manus: speed, acceleration and force are limited"
ROWS = [
    _foreign(topic, f"{field}-{label}", f"{label} as {field} on {topic}, from a foreign sender",
             **{field: value})
    for topic, field, value, label in _VALUES
] + [
    _foreign(topic, "future", f"{topic} stamped an hour ahead, as by a set clock",
             late=_LATE_NS)
    for topic in _BY
] + [
    _state(graph.AMPLIFIER_STATE, AmplifierState, "a fault", "supervisor",
           Report("supervisor", _SMOKE_OR_TWO, _SMOKE_OR_TWO), faulted=True,
           reason="smoke"),
    _state(graph.MANUS_STATE, PlanarState, "NaN as position",
           "supervisor: two nodes publish it",
           Report("supervisor", "nodes publish manus/state", "manus"), enabled=True,
           position=[_NAN, _NAN]),
    _state(graph.ENDPOINT_STATE, EndpointState, "NaN as position", "only games subscribe to it",
           None, position__x=_NAN, position__z=_INF),
    _state(graph.SAFETY_STATE, SafetyState, "a level that does not exist",
           "amplifier, manus: two nodes publish it", _TWO_SUPERVISORS, level=200,
           vertical_permitted=True, planar_permitted=True),
    _state(graph.SAFETY_STATE, SafetyState, "a stop", "amplifier, manus", _TWO_SUPERVISORS,
           level=SafetyState.STOPPED),
    _stops("diagnostics-error", "an error of the encoder on /diagnostics, from a foreign sender",
           published(DiagnosticArray, graph.DIAGNOSTICS, _COUNT, _EVERY_S, status=[_SMOKE]),
           "supervisor", Report("supervisor", "encoder: smoke", "encoder: smoke")),
    _goes_on("diagnostics-absurd", fault="entries without a name, of 50 kB and an unknown level on "
             "/diagnostics", act=published(DiagnosticArray, graph.DIAGNOSTICS, _COUNT, _EVERY_S,
                                           status=[_ODD]),
             who="no node acts on it", mend=row.nothing),
] + [
    one for label, value in _BAD.items() for one in (
        _goes_on(f"setpoint-{_name(label)}", fault=f"set point {label} in every axis",
                 act=game(value, value, value, 0.0, 0.0, 0.0),
                 who=_KEEPS if label == "NaN" else _LIMITED),
        _goes_on(f"setpoint-velocity-{_name(label)}", fault=f"velocity of the set point {label}",
                 act=game(_X, _Y, _Z, value, value, value),
                 who=_KEEPS if label == "NaN" else _LIMITED),
    )
] + [
    _goes_on("setpoint-jump-far", fault="set point jumps by 10 m",
             act=game(10.0, 10.0, 10.0, 0.0, 0.0, 0.0), who=_LIMITED),
    _goes_on("setpoint-jump-floor", fault="set point jumps below the travel",
             act=game(-0.2, -0.2, -0.1, 0.0, 0.0, 0.0), who=_LIMITED),
    _goes_on("setpoint-gone-moving", fault="the game ends while its set point moves",
             act=both(game(_X, _Y, _Z, 0.1, 0.1, 0.1), paused(0.2), game()),
             who="controller and manus: after 0.2 s its velocity counts as zero", watch=0.8),
] + [
    _goes_on(f"{node}-stiffness-nan", fault=f"{node}/set_impedance with a stiffness of NaN",
             act=refused(f"{node}/set_impedance", SetImpedance, "stiffness", stiffness=_NAN,
                         damping=0.0),
             who=f"{node} refuses, naming it", watch=0.1)
    for node in ("impedance_controller", "manus")
] + [
    _goes_on("set_mode-excitation", fault="impedance_controller/set_mode with 6, without a trial",
             act=refused(row.MODE, SetControlMode, "mode EXCITATION", mode=6),
             who="impedance_controller refuses", watch=0.1),
    _goes_on("set_mode-99", fault="impedance_controller/set_mode with 99",
             act=refused(row.MODE, SetControlMode, "mode", mode=99),
             who="impedance_controller refuses", watch=0.1),
] + [  # one of each kind; unit tests cover all parameters
    _goes_on(f"parameter-{node}-{name}", group="parameters", fault=f"{node}: {name} {text}",
             act=parameter_refused(node, name, value), who=f"{node} refuses: {name}", watch=0.1)
    for node, name, value, text in (
        ("amplifier", "command_up", 100.0, "set to 100 in motion, when it is fixed"),
        ("impedance_controller", "stiffness", _NAN, "set to NaN in motion"),
        ("impedance_controller", "mode", 99, "set to 99 in motion"),
    )
]  # fmt: skip
