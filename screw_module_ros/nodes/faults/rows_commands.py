# SPDX-License-Identifier: Apache-2.0
"""NaN, infinities and absurd values on every topic and service; set points; parameters."""

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
    ImpedanceState,
    PlanarState,
    SafetyState,
)
from screw_module_msgs.srv import InjectFault, SetArm, SetControlMode, SetFixture, SetImpedance

from .acts import both, game, parameter_refused, published, refused
from .patient import SPRING
from .row import GOES_ON, OFF, Act, Alarm, Row, nothing

_NAN, _INF = math.nan, math.inf
_BAD = {"NaN": _NAN, "infinity": _INF, "minus infinity": -_INF, "1e300": 1e300}
_AT_ONCE, _FOLLOWS = 8, 8
_COUNT, _EVERY_S = 25, 0.007  # messages; the true ones come between and often hide them

_ENCODER = Alarm("impedance_controller", "encoder", "encoder")
_FORCE = Alarm("impedance_controller", "force sensor", "force")
_TWO_SUPERVISORS = "nodes publish safety_state"
_COMMAND = Alarm("amplifier", "force command|second node|publish", "amplifier")
# topic, type, field, bad values, who notices, alarm
_SAMPLES = (
    ("screw/encoder", EncoderSample, "position", "impedance_controller", _ENCODER),
    ("screw/encoder", EncoderSample, "velocity", "impedance_controller", _ENCODER),
    ("handle/force", ForceSample, "fx", "impedance_controller or manus", _FORCE),
    ("handle/force", ForceSample, "fy", "impedance_controller or manus", _FORCE),
    ("handle/force", ForceSample, "fz", "impedance_controller", _FORCE),
    ("handle/force", ForceSample, "tx", "impedance_controller", _FORCE),
    ("handle/force", ForceSample, "ty", "impedance_controller", _FORCE),
    ("handle/force", ForceSample, "tz", "impedance_controller", _FORCE),
    ("screw/force_command", ForceCommand, "force", "amplifier", _COMMAND),
)
_TRUE_GAME = game(*SPRING)
_LATE_NS = 3_600_000_000_000


def rows() -> Iterator[Row]:
    """Topics, services, set points, parameters."""
    for topic, kind, name, who, alarm in _SAMPLES:
        for told, value in _BAD.items():
            if name in ("tx", "ty", "tz") and told == "1e300":
                continue  # a torque has no limit of its own
            true = {"position": _height, "homed": True} if kind is EncoderSample else {}
            fields = true | {name: value}
            yield _stops(
                f"{topic}-{name}-{told}", f"{told} as {name} on {topic}, from a foreign sender",
                published(kind, topic, _COUNT, _EVERY_S, **fields), who,
                alarm if name not in ("fx", "fy") else Alarm("supervisor", ".", "force|handle"),
            )  # fmt: skip
        if name in ("position", "fz", "force"):
            yield _stops(
                f"{topic}-future", f"{topic} stamped an hour ahead: its clock has jumped",
                published(kind, topic, _COUNT, _EVERY_S, late=_LATE_NS), who, alarm,
            )  # fmt: skip
    yield from _states()
    yield from _setpoints()
    yield from _services()
    yield from _parameters()


def _height(stand) -> float:
    return stand.heard.now.height


def _stops(name: str, text: str, act: Act, who: str, alarm: Alarm) -> Row:
    return Row(
        name=name.replace("/", "-").replace(" ", "-").lower(),
        group="commands",
        fault=text,
        inject=act,
        alarm=alarm,
        way_back="stop the sender; clear_fault or home, reset, enable",
        noticed_by=who,
        within=_AT_ONCE,
        plane_within=_AT_ONCE + _FOLLOWS,
        safe=OFF,
    )


def _goes_on(
    name: str, text: str, act: Act, who: str, back: Act = _TRUE_GAME, watch: float = 1.0,
    alarm: Alarm | None = None, safe: str = GOES_ON,
) -> Row:  # fmt: skip
    return Row(
        name=name,
        group="commands",
        fault=text,
        inject=act,
        back=back,
        alarm=alarm,
        way_back="none is needed" if safe == GOES_ON else "reset, enable",
        noticed_by=who,
        within=0 if safe == GOES_ON else 20,
        plane_within=0 if safe == GOES_ON else 20,
        safe=safe,
        watch=watch,
    )


# topic, type, fields, what it pretends, who notices, alarm; None = nobody is misled
_STATES = (
    ("screw/amplifier_state", AmplifierState, {"faulted": True, "reason": "smoke"}, "a fault",
     "supervisor", Alarm("supervisor", "amplifier: smoke", "amplifier: smoke")),
    ("screw/controller_state", ImpedanceState, {"faulted": True, "reason": "smoke"}, "a fault",
     "supervisor", Alarm("supervisor", "controller: smoke", "controller: smoke")),
    ("manus/state", PlanarState, {"faulted": True, "reason": "smoke"}, "a fault",
     "supervisor", Alarm("supervisor", "manus: smoke", "manus: smoke")),
    ("manus/state", PlanarState, {"enabled": True, "position": [_NAN, _NAN]}, "NaN as position",
     "nobody who drives anything hears it", None),
    ("endpoint_state", EndpointState, {"position__x": _NAN, "position__z": _INF}, "NaN as position",
     "only games hear it", None),
    ("safety_state", SafetyState, {"level": 200, "vertical_permitted": True,
                                   "planar_permitted": True}, "a level that does not exist",
     "amplifier, manus: two nodes publish it", Alarm("amplifier", _TWO_SUPERVISORS)),
    ("safety_state", SafetyState, {"level": SafetyState.STOPPED}, "a stop",
     "amplifier, manus", Alarm("amplifier", _TWO_SUPERVISORS)),
)  # fmt: skip


def _states() -> Iterator[Row]:
    """What nodes say of themselves, said by somebody else."""
    for topic, kind, fields, what, who, alarm in _STATES:
        name = f"{topic}-{what}".replace("/", "-").replace(" ", "-").lower()
        text = f"{what} on {topic}, from a foreign sender"
        # Who permits is told of as long as there are two of them.
        count = 0 if topic == "safety_state" else _COUNT
        act = published(kind, topic, count, _EVERY_S, **fields)
        if alarm is None:
            yield _goes_on(name, text, act, who, nothing)
        else:
            yield _stops(name, text, act, who, alarm)
    smoke = DiagnosticStatus(name="encoder", level=DiagnosticStatus.ERROR, message="smoke")
    yield _stops("diagnostics-error", "an error of the encoder on /diagnostics, from a foreign "
                 "sender", published(DiagnosticArray, "/diagnostics", _COUNT, _EVERY_S,
                                     status=[smoke]), "supervisor",
                 Alarm("supervisor", "encoder: smoke", "encoder: smoke"))  # fmt: skip
    odd = DiagnosticStatus(name="", level=b"\xff", message="x" * 50_000)
    yield _goes_on("diagnostics-absurd", "entries without a name, of 50 kB and an unknown level on "
                   "/diagnostics", published(DiagnosticArray, "/diagnostics", _COUNT, _EVERY_S,
                                             status=[odd]),
                   "nobody is misled", nothing)  # fmt: skip


def _setpoints() -> Iterator[Row]:
    x, y, z, *_ = SPRING
    keeps = "controller and manus leave that axis alone"
    limited = "controller and manus: speed, acceleration and force are limited"
    for told, value in _BAD.items():
        who = keeps if told == "NaN" else limited
        name = told.replace(" ", "-").lower()
        yield _goes_on(f"setpoint-{name}", f"set point {told} in every axis",
                       game(value, value, value, 0.0, 0.0, 0.0), who)  # fmt: skip
        yield _goes_on(f"setpoint-velocity-{name}", f"velocity of the set point {told}",
                       game(x, y, z, value, value, value), who)  # fmt: skip
    yield _goes_on("setpoint-jump-far", "set point jumps by 10 m", game(10.0, 10.0, 10.0, 0, 0, 0),
                   limited)  # fmt: skip
    yield _goes_on("setpoint-jump-floor", "set point jumps below the travel",
                   game(-0.2, -0.2, -0.1, 0.0, 0.0, 0.0), limited)  # fmt: skip
    yield _goes_on("setpoint-gone-still", "the game stops publishing", _no_game,
                   "nobody: a point that stands stays valid")  # fmt: skip
    yield _goes_on("setpoint-gone-moving", "the game dies while its point moves",
                   both(game(x, y, z, 0.1, 0.1, 0.1), _wait, _no_game),
                   "controller and manus: after 0.2 s its velocity counts as zero")  # fmt: skip


def _no_game(stand) -> None:
    stand.heard.setpoint = None


def _wait(stand) -> None:
    stand.robot.pause(0.2)


def _services() -> Iterator[Row]:
    for told, value in {**_BAD, "-1": -1.0}.items():
        for node in ("impedance_controller", "manus"):
            yield _goes_on(
                f"{node}-stiffness-{told}".replace(" ", "-").lower(),
                f"{node}/set_impedance with a stiffness of {told}",
                refused(f"{node}/set_impedance", SetImpedance, "stiffness",
                        stiffness=value, damping=0.0),
                f"{node} refuses, naming it", watch=0.2,
            )  # fmt: skip
        if told == "-1":
            continue
        for node in ("impedance_controller", "manus"):
            yield _goes_on(
                f"{node}-damping-{told}".replace(" ", "-").lower(),
                f"{node}/set_impedance with a damping of {told}",
                refused(f"{node}/set_impedance", SetImpedance, "damping",
                        stiffness=100.0, damping=value),
                f"{node} refuses, naming it", watch=0.2,
            )  # fmt: skip
    yield _goes_on("set_mode-99", "impedance_controller/set_mode with 99",
                   refused("impedance_controller/set_mode", SetControlMode, "mode", mode=99),
                   "impedance_controller refuses", watch=0.2)  # fmt: skip
    for name, kind, said, fields in _RIG:
        told = ", ".join(f"{key} {value}" for key, value in fields.items())
        yield _goes_on(f"sim_rig-{name}", f"sim_rig/{name.rpartition('-')[0]} with {told}",
                       refused(f"sim_rig/{name.rpartition('-')[0]}", kind, said, **fields),
                       "sim_rig refuses, naming it", watch=0.2)  # fmt: skip


# row, type, what must be named, fields
_RIG = (
    ("set_arm-kind", SetArm, "kind", {"kind": "robot"}),
    ("set_arm-mass", SetArm, "mass", {"mass": -1.0, "stiffness": _NAN, "damping": _NAN}),
    ("set_arm-stiffness", SetArm, "stiffness", {"mass": _NAN, "stiffness": _INF, "damping": _NAN}),
    ("set_fixture-name", SetFixture, "fixture", {"fixture": "glue", "position": _NAN}),
    ("set_fixture-position", SetFixture, "position", {"fixture": "free", "position": 1e300}),
    ("inject_fault-device", InjectFault, "toaster", {"device": "toaster", "fault": "cable_out"}),
    ("inject_fault-fault", InjectFault, "smoke", {"device": "drive", "fault": "smoke"}),
    ("inject_fault-duration", InjectFault, "duration",
     {"device": "drive", "fault": "deaf", "duration": -1.0}),
)  # fmt: skip


# node -> parameters fixed while active, and live ones with values that cannot be
_FIXED = {
    "impedance_controller": {"force_up": 100.0, "fade_time": 0.1, "watch.stale_periods": 100.0,
                             "rate": 1000.0, "friction_fraction": 0.5},
    "amplifier": {"command_up": 100.0, "torque.peak": 5.0, "gate.safety_timeout": 1.0,
                  "command_timeout": 5.0, "rated_torque": 1.0, "linearize": False,
                  "max_torque": 100.0, "direction": -1, "missed_limit": 1000},
    "manus": {"handle_force_limit": 500.0, "shoulder.direction": -1, "gate.ramp_time": 0.05,
              "joints.speed": 50.0},
    "encoder": {"direction": -1, "lead": 0.001, "rate": 1000.0, "home_position": 0.0},
    "force_sensor": {"sign": -1, "roll": 3.0, "rate": 500.0},
    "supervisor": {"timeout": 10.0, "required": ["encoder"], "rate": 20.0},
}  # fmt: skip
_NO_NUMBERS = {"NaN": _NAN, "infinity": _INF, "-1e9": -1e9, "1e9": 1e9}
_WRONG_TYPE = {"text": "a lot", "an integer": 5}  # rclpy's own words
_LIVE = {
    "impedance_controller": ("stiffness", "damping", "force_gain", "gravity"),
    "manus": ("stiffness", "damping"),
}


def _parameters() -> Iterator[Row]:
    for node, values in _FIXED.items():
        for name, value in values.items():
            yield _refuses(node, name, value, f"set to {value} in motion, where it is fixed")
    for node, names in _LIVE.items():
        for name in names:
            for told, value in (_NO_NUMBERS | _WRONG_TYPE).items():
                yield _refuses(node, name, value, f"set to {told} in motion", told)
    yield _refuses("impedance_controller", "mode", 7, "set to 7 in motion")


def _refuses(node: str, name: str, value, text: str, told: str = "") -> Row:
    said = "parameter type" if told in _WRONG_TYPE else name
    return _goes_on(
        "-".join(filter(None, ("parameter", node, name, told))).replace(" ", "-").lower(),
        f"{node}: {name} {text}",
        parameter_refused(node, name, value, said), f"{node} refuses: {said}", watch=0.1,
    )._replace(group="parameters")  # fmt: skip
