# SPDX-License-Identifier: Apache-2.0
"""NaN, infinities and absurd values on every topic and service; set points; parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator

from screw_module_msgs.msg import EncoderSample, ForceCommand, ForceSample
from screw_module_msgs.srv import SetControlMode, SetImpedance

from .acts import both, game, parameter_refused, published, refused
from .row import GOES_ON, OFF, Act, Alarm, Row
from .stand import SPRING

_NAN, _INF = math.nan, math.inf
_BAD = {"NaN": _NAN, "infinity": _INF, "minus infinity": -_INF, "1e300": 1e300}
_AT_ONCE, _FOLLOWS = 8, 8
_COUNT, _EVERY_S = 25, 0.007  # messages; the true ones come between and often hide them

_ENCODER = Alarm("impedance_controller", "encoder", "encoder")
_FORCE = Alarm("impedance_controller", "force sensor", "force")
_COMMAND = Alarm("amplifier", "force command|second node|publish", "amplifier")
# topic, type, field, bad values, who notices, alarm
_SAMPLES = (
    ("screw/encoder", EncoderSample, "position", "impedance_controller", _ENCODER),
    ("screw/encoder", EncoderSample, "velocity", "impedance_controller", _ENCODER),
    ("handle/force", ForceSample, "fx", "impedance_controller or manus", _FORCE),
    ("handle/force", ForceSample, "fz", "impedance_controller", _FORCE),
    ("handle/force", ForceSample, "tz", "impedance_controller", _FORCE),
    ("screw/force_command", ForceCommand, "force", "amplifier", _COMMAND),
)
_TRUE_GAME = game(*SPRING)
_LATE_NS = 3_600_000_000_000


def rows() -> Iterator[Row]:
    """Topics, services, set points, parameters."""
    for topic, kind, name, who, alarm in _SAMPLES:
        for told, value in _BAD.items():
            if name == "tz" and told == "1e300":
                continue  # a torque has no limit of its own
            fields = {name: value} | ({"homed": True} if kind is EncoderSample else {})
            yield _stops(
                f"{topic}-{name}-{told}", f"{told} as {name} on {topic}, from a foreign sender",
                published(kind, topic, _COUNT, _EVERY_S, **fields), who,
                alarm if name != "fx" else Alarm("supervisor", ".", "force|handle"),
            )  # fmt: skip
        if name in ("position", "fz", "force"):
            yield _stops(
                f"{topic}-future", f"{topic} stamped an hour ahead: its clock has jumped",
                published(kind, topic, _COUNT, _EVERY_S, late=_LATE_NS), who, alarm,
            )  # fmt: skip
    yield from _setpoints()
    yield from _services()
    yield from _parameters()


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


# node -> parameters fixed while active, and live ones with values that cannot be
_FIXED = {
    "impedance_controller": {"force_up": 100.0, "fade_time": 0.1, "watch.stale_periods": 100.0,
                             "rate": 1000.0, "friction_fraction": 0.5},
    "amplifier": {"force_up": 100.0, "torque.peak": 5.0, "gate.safety_timeout": 1.0,
                  "command_timeout": 5.0, "rated_torque": 1.0, "linearize": False,
                  "max_torque": 100.0, "direction": -1, "missed_limit": 1000},
    "manus": {"handle_force_limit": 500.0, "shoulder.direction": -1, "gate.ramp_time": 0.05,
              "joints.speed": 50.0},
    "encoder": {"direction": -1, "lead": 0.001, "rate": 1000.0, "home_position": 0.0},
    "force_sensor": {"sign": -1, "roll": 3.0, "rate": 500.0},
    "supervisor": {"timeout": 10.0, "required": ["encoder"], "rate": 20.0},
}  # fmt: skip
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
            for told, value in {"NaN": _NAN, "infinity": _INF, "-1e9": -1e9, "1e9": 1e9,
                                "text": "a lot", "an integer": 5}.items():  # fmt: skip
                yield _refuses(node, name, value, f"set to {told} in motion", f"-{told}")
    yield _refuses("impedance_controller", "mode", 7, "set to 7 in motion")


def _refuses(node: str, name: str, value, text: str, suffix: str = "") -> Row:
    return _goes_on(
        f"parameter-{node}-{name}{suffix}".replace(" ", "-").lower(), f"{node}: {name} {text}",
        parameter_refused(node, name, value), f"{node} refuses, naming it", watch=0.1,
    )._replace(group="parameters")  # fmt: skip
