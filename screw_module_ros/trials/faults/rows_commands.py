# SPDX-License-Identifier: Apache-2.0
"""Rows about NaN, infinity and absurd values on topics, services, set points and parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
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

from .acts import both, game, parameter_refused, published, refused
from .limits import BY_SERVICE, VIA_SUPERVISOR
from .patient import SPRING
from .row import GOES_ON, OFF, Act, Alarm, Row, nothing

_NAN, _INF = math.nan, math.inf
_BAD = {"NaN": _NAN, "infinity": _INF}
_COUNT, _EVERY_S = 25, 0.007
_MANY, _TICK_S = 60, 0.001

_ENCODER = Alarm("impedance_controller", "encoder", "encoder")
_FORCE = Alarm("impedance_controller", "force sensor|nodes publish handle/force", "force")
_TWO_SUPERVISORS = "nodes publish safety_state"
_COMMAND = Alarm("amplifier", "force command|second node|publish", "amplifier")
# test/properties/test_watches.py covers all fields and values; here is one of each input path.
# Topic, type, field, value, noticed by, alarm:
_SAMPLES = (
    (graph.ENCODER, EncoderSample, "position", _NAN, "impedance_controller", _ENCODER),
    (graph.ENCODER, EncoderSample, "velocity", _INF, "impedance_controller", _ENCODER),
    (graph.FORCE, ForceSample, "fx", _NAN, "impedance_controller", _FORCE),
    (graph.FORCE, ForceSample, "fz", 1e300, "impedance_controller", _FORCE),
    (graph.FORCE, ForceSample, "tz", _NAN, "impedance_controller", _FORCE),
    (graph.FORCE_COMMAND, ForceCommand, "force", _NAN, "amplifier", _COMMAND),
    (graph.FORCE_COMMAND, ForceCommand, "force", 1e300, "amplifier", _COMMAND),
)  # fmt: skip
_LABELS = {"nan": "NaN", "inf": "infinity", "1e+300": "1e300"}
_STAMPED = (
    (graph.ENCODER, EncoderSample, "impedance_controller", _ENCODER),
    (graph.FORCE, ForceSample, "impedance_controller", _FORCE),
    (graph.FORCE_COMMAND, ForceCommand, "amplifier", _COMMAND),
)
_WITHIN = BY_SERVICE + VIA_SUPERVISOR
"""Samples: the first message comes after 7 of them; the supervisor receives a state."""
_COUNTED = 100 + _WITHIN
"""Samples: the nodes count a topic's publishers each 0.1 s."""
_TRUE_GAME = game(*SPRING)
_LATE_NS = 3_600_000_000_000


def rows() -> Iterator[Row]:
    """Topics, services, set points, parameters."""
    for topic, kind, name, value, who, alarm in _SAMPLES:
        true = {"position": _height, "homed": True} if kind is EncoderSample else {}
        fields = true | {name: value}
        label = _LABELS.get(str(value), str(value))
        yield _foreign(
            f"{topic}-{name}-{label}", f"{label} as {name} on {topic}, from a foreign sender",
            kind, topic, who, alarm, **fields,
        )  # fmt: skip
    for topic, kind, who, alarm in _STAMPED:
        yield _foreign(
            f"{topic}-future", f"{topic} stamped an hour ahead, as after a jump of the clock",
            kind, topic, who, alarm, late=_LATE_NS,
        )  # fmt: skip
    yield from _states()
    yield from _setpoints()
    yield from _services()
    yield from _parameters()


def _height(testbed) -> float:
    return testbed.listener.now.height


def _foreign(
    name: str, text: str, kind: type, topic: str, who: str, alarm: Alarm, **fields: object
) -> Row:  # fmt: skip
    """Return the row of samples or commands from a foreign sender.

    The genuine force samples hide its samples; the second publisher still shows.
    """
    if kind is not ForceSample:
        act = published(kind, topic, _COUNT, _EVERY_S, **fields)
        return _stops(name, text, act, who, alarm, apart=True)
    act = published(kind, topic, _MANY, _TICK_S, **fields)
    who += ": two nodes publish it"
    row = _stops(name, text, act, who, alarm, apart=True)
    return row._replace(within=_COUNTED, plane_within=_COUNTED + VIA_SUPERVISOR)


def _stops(
    name: str, text: str, act: Act, who: str, alarm: Alarm | None, apart: bool = False
) -> Row:
    return Row(
        name=name.replace("/", "-").replace(" ", "-").lower(),
        group="commands",
        fault=text,
        inject=act,
        alarm=alarm,
        recovery="stop the sender; clear_fault or home, reset, enable",
        noticed_by=who,
        within=_WITHIN,
        plane_within=_WITHIN + VIA_SUPERVISOR,
        safe=OFF,
        apart=apart,
    )


def _goes_on(
    name: str, text: str, act: Act, who: str, back: Act = _TRUE_GAME, watch: float = 0.4
) -> Row:
    return Row(
        name=name, group="commands", fault=text, inject=act, back=back, alarm=None,
        recovery="none is needed", noticed_by=who, safe=GOES_ON, watch=watch,
    )  # fmt: skip


# topic, type, fields, content, noticed by, alarm; None = no node acts on it
_STATES = (
    (graph.AMPLIFIER_STATE, AmplifierState, {"faulted": True, "reason": "smoke"}, "a fault",
     "supervisor", Alarm("supervisor", "amplifier: smoke", "amplifier: smoke")),
    (graph.MANUS_STATE, PlanarState, {"enabled": True, "position": [_NAN, _NAN]}, "NaN as position",
     "no controller or driver subscribes to it", None),
    (graph.ENDPOINT_STATE, EndpointState, {"position__x": _NAN, "position__z": _INF},
     "NaN as position", "only games subscribe to it", None),
    (graph.SAFETY_STATE, SafetyState, {"level": 200, "vertical_permitted": True,
                                   "planar_permitted": True}, "a level that does not exist",
     "amplifier, manus: two nodes publish it", Alarm("amplifier", _TWO_SUPERVISORS)),
    (graph.SAFETY_STATE, SafetyState, {"level": SafetyState.STOPPED}, "a stop",
     "amplifier, manus", Alarm("amplifier", _TWO_SUPERVISORS)),
)  # fmt: skip


def _states() -> Iterator[Row]:
    """Return the rows of nodes' states from a foreign sender."""
    for topic, kind, fields, what, who, alarm in _STATES:
        name = f"{topic}-{what}".replace("/", "-").replace(" ", "-").lower()
        text = f"{what} on {topic}, from a foreign sender"
        # The alarm of two supervisors lasts only as long as both publish.
        count = 0 if topic == graph.SAFETY_STATE else _MANY
        act = published(kind, topic, count, _TICK_S, **fields)
        if alarm is None:
            yield _goes_on(name, text, act, who, nothing)
        else:
            row = _stops(name, text, act, who, alarm)
            counted = row._replace(within=_COUNTED, plane_within=_COUNTED)
            yield counted if topic == graph.SAFETY_STATE else row
    smoke = DiagnosticStatus(name="encoder", level=DiagnosticStatus.ERROR, message="smoke")
    yield _stops("diagnostics-error", "an error of the encoder on /diagnostics, from a foreign "
                 "sender", published(DiagnosticArray, graph.DIAGNOSTICS, _COUNT, _EVERY_S,
                                     status=[smoke]), "supervisor",
                 Alarm("supervisor", "encoder: smoke", "encoder: smoke"))  # fmt: skip
    odd = DiagnosticStatus(name="", level=b"\xff", message="x" * 50_000)
    yield _goes_on("diagnostics-absurd", "entries without a name, of 50 kB and an unknown level on "
                   "/diagnostics", published(DiagnosticArray, graph.DIAGNOSTICS, _COUNT, _EVERY_S,
                                             status=[odd]),
                   "no node acts on it", nothing)  # fmt: skip


def _setpoints() -> Iterator[Row]:
    x, y, z, *_ = SPRING
    keeps = "controller and manus leave that axis alone"
    limited = "controller and manus: speed, acceleration and force are limited"
    for label, value in _BAD.items():
        who = keeps if label == "NaN" else limited
        name = label.replace(" ", "-").lower()
        yield _goes_on(f"setpoint-{name}", f"set point {label} in every axis",
                       game(value, value, value, 0.0, 0.0, 0.0), who)  # fmt: skip
        yield _goes_on(f"setpoint-velocity-{name}", f"velocity of the set point {label}",
                       game(x, y, z, value, value, value), who)  # fmt: skip
    yield _goes_on("setpoint-jump-far", "set point jumps by 10 m", game(10.0, 10.0, 10.0, 0, 0, 0),
                   limited)  # fmt: skip
    yield _goes_on("setpoint-jump-floor", "set point jumps below the travel",
                   game(-0.2, -0.2, -0.1, 0.0, 0.0, 0.0), limited)  # fmt: skip
    yield _goes_on("setpoint-gone-moving", "the game ends while its set point moves",
                   both(game(x, y, z, 0.1, 0.1, 0.1), _wait, _no_game),
                   "controller and manus: after 0.2 s its velocity counts as zero",
                   watch=0.8)  # fmt: skip


def _no_game(testbed) -> None:
    testbed.listener.setpoint = None


def _wait(testbed) -> None:
    testbed.robot.pause(0.2)


def _services() -> Iterator[Row]:
    for node in ("impedance_controller", "manus"):
        yield _goes_on(
            f"{node}-stiffness-nan", f"{node}/set_impedance with a stiffness of NaN",
            refused(f"{node}/set_impedance", SetImpedance, "stiffness",
                    stiffness=_NAN, damping=0.0),
            f"{node} refuses, naming it", watch=0.1,
        )  # fmt: skip
    yield _goes_on("set_mode-99", "impedance_controller/set_mode with 99",
                   refused("impedance_controller/set_mode", SetControlMode, "mode", mode=99),
                   "impedance_controller refuses", watch=0.1)  # fmt: skip


def _parameters() -> Iterator[Row]:
    """Return one row of each kind; unit tests cover all parameters."""
    yield _refuses("amplifier", "command_up", 100.0, "set to 100 in motion, when it is fixed")
    yield _refuses("impedance_controller", "stiffness", _NAN, "set to NaN in motion")
    yield _refuses("impedance_controller", "mode", 7, "set to 7 in motion")


def _refuses(node: str, name: str, value, text: str) -> Row:
    return _goes_on(
        f"parameter-{node}-{name}", f"{node}: {name} {text}",
        parameter_refused(node, name, value, name), f"{node} refuses: {name}", watch=0.1,
    )._replace(group="parameters")  # fmt: skip
