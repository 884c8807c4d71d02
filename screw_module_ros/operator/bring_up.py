# SPDX-License-Identifier: Apache-2.0
"""One way to operation: home, tare, clear, reset, choose the mode, enable, as an operator does.

`next_step` decides by one snapshot of the robot; `bring_up` carries out the steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from screw_module_msgs.msg import (
    AmplifierState,
    EncoderSample,
    ImpedanceState,
    PlanarState,
    SafetyState,
)
from screw_module_msgs.srv import SetControlMode
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.safety.permit import PermitSettings

from .client import RobotError
from .robot import Robot

DRIVES = ("amplifier", "manus")
_HOMINGS, _TARE = ("encoder/home", "manus/home"), "force_sensor/tare"
_REFERENCES = (*_HOMINGS, _TARE)
_ENABLINGS = {f"{drive}/enable" for drive in DRIVES}
_MIDDLE, _BEYOND = 0.18, 0.02  # middle of the travel, and the stops' compression [m]
_LOOK_S, _ANSWER_S = 0.02, 6.0
_AGAIN_S = 1.1
"""A homing or tare that contradicts the last one counts when it is requested again, 1 s to 15 s
later; the force sensor's diagnostics show a tare within 1 s."""
_MORE_S = 0.1  # time beyond the ramp until all torque acts


class Hand(Protocol):
    """Who holds the handle. at_rest: whether it rests, so that only the robot changes its force."""

    at_rest: bool

    def to_mark(self) -> None:
        """Bring the nut to its reference mark, at rest."""

    def plane_to_mark(self) -> None:
        """Bring the arm to its reference mark, at rest."""

    def let_go(self) -> None:
        """Leave the handle alone, for taring."""

    def take_hold(self) -> None:
        """Hold the handle, before the torque acts."""


class Seen(NamedTuple):
    """What an operator sees at one time.

    A message is None when the newest one is older than 0.3 s. force_level: of the force sensor's
    entry on /diagnostics, None before the first. force_rate: its samples per sample of the encoder.
    tared_s: time since its last tare, infinity without one [s].
    """

    encoder: EncoderSample | None = None
    wrench: WrenchStamped | None = None
    force_level: bytes | None = None
    force_rate: float = 1.0
    tared_s: float = math.inf
    amplifier: AmplifierState | None = None
    manus: PlanarState | None = None
    safety: SafetyState | None = None
    controller: ImpedanceState | None = None

    @property
    def homed(self) -> bool:
        """Whether the encoder is homed, its position within the travel and not in doubt."""
        return (
            self.encoder is not None
            and self.encoder.homed
            and abs(self.encoder.position - _MIDDLE) < _MIDDLE + _BEYOND
            and not (self.controller and self.controller.home_in_doubt)
        )


class Step(NamedTuple):
    """What an operator does next.

    why: in words; services: to be called, in order, empty to wait; kind, fields: of the requests;
    before, after: what the hand does.
    """

    why: str
    services: tuple[str, ...] = ()
    kind: type[Any] = Trigger
    fields: dict[str, Any] = {}
    before: Callable[[], None] = lambda: None
    after: Callable[[], None] = lambda: None


class Operation(NamedTuple):
    """How the robot came to operation: the services called, and when the enabling began [ns],
    minus infinity if the drives were on."""

    services: frozenset[str]
    enabled_ns: float


WORKS = Step("the robot works")


def next_step(seen: Seen, mode: int, hand: Hand, drives: Sequence[str] = DRIVES) -> Step:
    """Return the next step to operation in `mode` (a constant of ForceCommand), `WORKS` at the end.

    drives: those to be enabled.
    """
    if not seen.homed:
        return Step("the encoder is not homed", (_HOMINGS[0],), before=hand.to_mark)
    return (
        _force_step(seen, hand)
        or _drive_step(seen, hand, drives)
        or _permission_step(seen)
        or _enabling_step(seen, mode, hand, drives)
    )


def _force_step(seen: Seen, hand: Hand) -> Step | None:
    if any(state is not None and state.enabled for state in (seen.amplifier, seen.manus)):
        return None  # taring is refused: the force feedback would jump
    if seen.wrench is None:
        return _tare("the force sensor is silent", hand)
    if seen.force_level is None:
        return Step("the force sensor has not reported yet")
    if seen.force_level == DiagnosticStatus.OK or seen.tared_s < _AGAIN_S:
        return None
    if seen.force_rate < 0.5:  # its entry says so until a second has passed
        return Step("the force sensor's samples have just begun")
    return _tare("the force sensor needs taring", hand)


def _tare(why: str, hand: Hand) -> Step:
    return Step(why, (_TARE,), before=hand.let_go, after=hand.take_hold)


def _drive_step(seen: Seen, hand: Hand, drives: Sequence[str]) -> Step | None:
    for name in DRIVES:  # the supervisor's permission needs all of them
        state = getattr(seen, name)
        if state is None and name not in drives:
            continue
        if state is None:
            return Step(f"{name} is silent")
        if state.faulted:
            return Step(f"{name}: {state.reason}", (f"{name}/clear_fault",))
        states = (state.state,) if name == "amplifier" else tuple(state.drive_state)
        if AmplifierState.UNKNOWN in states:
            return Step(f"{name}: its drive is silent")
        if name == "manus" and not state.homed:
            return Step("the plane is not homed", (_HOMINGS[1],), before=hand.plane_to_mark)
    return None


def _permission_step(seen: Seen) -> Step | None:
    if seen.safety is None:
        return Step("the supervisor is silent")
    if seen.safety.level == SafetyState.OK:
        return None
    resets = ("supervisor/reset",) if seen.safety.level == SafetyState.STOPPED else ()
    return Step(", ".join(seen.safety.reasons) or "the supervisor waits", resets)


def _enabling_step(seen: Seen, mode: int, hand: Hand, drives: Sequence[str]) -> Step:
    if seen.controller is None:
        return Step("impedance_controller is silent")
    if seen.controller.mode != mode:
        service = "impedance_controller/set_mode"
        return Step("another mode is chosen", (service,), SetControlMode, {"mode": mode})
    off = tuple(f"{name}/enable" for name in drives if not getattr(seen, name).enabled)
    if not off and seen.tared_s < _AGAIN_S and seen.force_level != DiagnosticStatus.OK:
        return Step("the force sensor does not report its tare yet")
    if not off:
        return WORKS
    if not hand.at_rest:
        return Step("the hand moves")
    return Step(f"{off[0]} is to come", off, SetBool, {"data": True}, hand.take_hold)


def look(robot: Robot, tared_s: float = math.inf) -> Seen:
    """Return what there is to see of the robot now."""
    forces, positions = (
        float(robot.reported("rate [1/s]", node) or "nan") for node in ("force_sensor", "encoder")
    )
    return Seen(
        robot.state(EncoderSample),
        robot.state(WrenchStamped),
        robot.level("force_sensor"),
        forces / positions if positions > 0.0 and math.isfinite(forces) else 1.0,
        tared_s,
        robot.state(AmplifierState),
        robot.state(PlanarState),
        robot.state(SafetyState),
        robot.state(ImpedanceState),
    )


def bring_up(
    robot: Robot,
    mode: int,
    hand: Hand,
    drives: Sequence[str] = DRIVES,
    deadline_s: float = 30.0,
    ramp_s: float = PermitSettings().ramp_time,
) -> Operation:
    """Do what an operator would until torque acts in `mode`; return the services called.

    ramp_s: `gate.ramp_time` of the drives. Raises RobotError with the step that did not help, after
    `deadline_s` of the robot's time.
    """
    end_ns = robot.clock.now_ns() + round(deadline_s * 1e9)
    called: dict[str, int] = {}  # the time of each service's last success [ns]
    enabled_ns = -math.inf
    refused = ""
    while True:
        now_ns = robot.clock.now_ns()
        tared_s = 1e-9 * (now_ns - called.get(_TARE, -math.inf))
        step = next_step(look(robot, tared_s), mode, hand, drives)
        if step is WORKS and 1e-9 * (now_ns - enabled_ns) > ramp_s + _MORE_S:
            return Operation(frozenset(called), enabled_ns)
        if now_ns > end_ns:
            raise RobotError(f"no operation: {refused or step.why}{robot.complaints_text()}")
        step.before()
        if step.kind is SetBool and not called.keys() & _ENABLINGS:
            enabled_ns = robot.clock.now_ns()
        refused = _refused(robot, step, called)
        step.after()
        robot.pause(_AGAIN_S if refused and step.services[0] in _REFERENCES else _LOOK_S)


def _refused(robot: Robot, step: Step, called: dict[str, int]) -> str:
    """Call the step's services up to the first that refuses; return its message, empty if none."""
    for service in step.services:
        request = step.kind.Request(**step.fields)
        try:
            answer = robot.call(step.kind, service, request, _ANSWER_S)
        except RobotError as error:
            robot.watch()  # a process that has ended gives a better message
            return str(error)
        if not answer.success:
            return f"{service} was refused: {answer.message}"
        called[service] = robot.clock.now_ns()
    return ""
