# SPDX-License-Identifier: Apache-2.0
"""Rights of each role: topics to subscribe and to publish, services to call.

A browser cannot reach anything that is not listed here. No role may publish `setpoint`: the wishes
of a game pass through `therapy_session`, which limits them. Names are relative to a robot's
namespace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from .. import graph

PATIENT, THERAPIST = "patient", "therapist"
SUBSCRIBE, PUBLISH, CALL = "subscribe", "publish", "call"
WISH, ATTENDANCE = graph.THERAPY_WISH, graph.THERAPY_ATTENDANCE
ANSWER, SCORE = graph.THERAPY_ANSWER, graph.THERAPY_SCORE
"""A number that the patient touches, and how well he plays."""
ACTION = graph.THERAPY_ACTION
"""What a person did at a page: of calls and answers the bridge tells it, of `PRESSES` the page."""
STOP = "supervisor/estop"
"""The software stop."""
PATIENTS_STOP = "therapy_session/pause_by_patient"
"""All that the patient's token may call: it pauses a session."""
_TRIGGER, _PARAMETERS = "std_srvs/srv/Trigger", "rcl_interfaces/srv/"
SERVICES = {
    "therapy_session/start": "screw_module_msgs/srv/StartTherapy",
    "therapy_session/pause": _TRIGGER,
    PATIENTS_STOP: _TRIGGER,
    "therapy_session/resume": _TRIGGER,
    "therapy_session/abort": _TRIGGER,
    "therapy_session/rest": _TRIGGER,
    "therapy_session/lower": _TRIGGER,
    "therapy_session/weigh": "screw_module_msgs/srv/StartTherapy",
    "therapy_session/describe_parameters": _PARAMETERS + "DescribeParameters",
    "therapy_session/get_parameters": _PARAMETERS + "GetParameters",
    "therapy_session/set_parameters": _PARAMETERS + "SetParameters",
    "session_recorder/count": "screw_module_msgs/srv/CountSessions",
    "session_recorder/stop": _TRIGGER,
    STOP: _TRIGGER,
}
"""Services that the bridge calls, with their types."""

SILENT = ("get_parameters", "describe_parameters")
"""Services that a page calls by itself, so that they are no action of a person."""
PRESSES = {
    PATIENT: ("back", "language", "hand", "sound", "full", "fruit", "free"),
    THERAPIST: ("fresh", "again", "plan", "last_time", "language"),
}
"""Buttons that ask nothing of the robot, by their `name` in a page: all that it may tell of them,
so that nothing typed gets into a bag."""

_STATES = (graph.ENDPOINT_STATE, graph.THERAPY_STATE)
ROLES = {
    PATIENT: {SUBSCRIBE: _STATES, PUBLISH: (ANSWER, SCORE, ACTION), CALL: (PATIENTS_STOP,)},
    THERAPIST: {
        SUBSCRIBE: (
            *_STATES, graph.THERAPY_TRIAL, graph.THERAPY_ASSISTANCE, graph.SAFETY_STATE,
            graph.CONTROLLER_STATE, graph.AMPLIFIER_STATE,
        ),
        PUBLISH: (WISH, ATTENDANCE, ANSWER, SCORE, ACTION),
        CALL: tuple(SERVICES),
    },
}
"""What each role may do: exactly what its page does. The therapist's includes the patient's."""

TYPES = {name: topic.type for name, topic in graph.TOPICS.items()} | SERVICES
KEPT = {graph.THERAPY_TRIAL: ("trial",), graph.THERAPY_ASSISTANCE: ("block", "circuit")}
"""Topics whose messages of the running session are kept, for a page that subscribes later, with
the fields that rise within a session."""
LIMITS = (
    "allow_wishes", "assistance.stiffness", "support.force", "patient_sound",
    "wish.half_width", "wish.half_depth", "wish.low", "wish.high", "wish.speed",
)  # fmt: skip
"""Parameters of `therapy_session` that a therapist may read and set."""


class Denied(PermissionError):
    """The client has no right to that, or it does not exist; the message says which."""


class Place(NamedTuple):
    """A topic or service: namespace of its robot, `/` or like `/left`, and its name there."""

    robot: str
    name: str

    @property
    def full(self) -> str:
        """Full name."""
        return f"{self.robot.rstrip('/')}/{self.name}"

    @property
    def type(self) -> str:
        """Type as `package/msg/Name` or `package/srv/Name`."""
        return TYPES[self.name]


class Rights:
    """Rights of each role for the robots of a bridge.

    robots: their namespaces, with leading /. wishes: whether the patient's token, which otherwise
    only reads, may publish `therapy/wish`; it can be changed at any time.
    """

    def __init__(self, robots: Sequence[str], wishes: bool = False):
        self.robots = tuple(robots)
        self.wishes = wishes

    def may(
        self, role: str, verb: str, name: str, kind: str = "", arguments: dict | None = None
    ) -> Place:
        """Return the topic or service that a role may use.

        verb: SUBSCRIBE, PUBLISH or CALL. kind: expected type, also as `package/Name`, empty for
        any. arguments: of a call. Raises Denied.
        """
        allowed = ROLES[role][verb]
        if verb == PUBLISH and self.wishes and WISH not in allowed:
            allowed = (*allowed, WISH)
        place = self._place(name)
        if place is None or place.name not in allowed:
            hint = ""
            if verb == PUBLISH and name.endswith("setpoint"):
                hint = f"; nobody publishes set points here: a game publishes {WISH}"
            raise Denied(
                f"the {role}'s page may not {verb} {name[:80]}{hint} "
                f"(it may: {', '.join(allowed) or 'nothing'})"
            )
        package, _, rest = place.type.partition("/")
        if kind not in ("", place.type, f"{package}/{rest.rpartition('/')[2]}"):
            raise Denied(f"{name} has the type {place.type}, not {kind[:80]!r}")
        if place.name.endswith("_parameters"):
            _check_parameters(place.full, arguments or {})
        return place

    def places(self, verb: str) -> list[Place]:
        """Return each topic or service that any role may use, for each robot."""
        return [Place(robot, name) for robot in self.robots for name in ROLES[THERAPIST][verb]]

    def _place(self, name: str) -> Place | None:
        """Return the place of a name; a name without a leading / belongs to the first robot."""
        if not name.startswith("/"):
            return Place(self.robots[0], name)
        for robot in self.robots:
            prefix = f"{robot.rstrip('/')}/"
            if name.startswith(prefix) and name[len(prefix) :] in TYPES:
                return Place(robot, name[len(prefix) :])
        return None


def pressed(role: str, content: Any) -> str:
    """Return which button a page tells of. Raises Denied for any but those of its role."""
    name = content.get("msg") if isinstance(content, dict) else None
    if name not in PRESSES[role]:
        raise Denied(f"{ACTION}: msg is one of {', '.join(PRESSES[role])}")
    return name


def _check_parameters(service: str, arguments: dict[str, Any]) -> None:
    """Raise Denied unless a call of a parameter service names limits alone."""
    (key, named), *more = [*arguments.items(), ("", None)]
    if key not in ("names", "parameters") or len(more) > 1 or not isinstance(named, list):
        raise Denied("one list, names or parameters, is wanted")
    if not named:
        raise Denied("the list names no parameter")
    for each in named:
        parameter = each.get("name") if isinstance(each, dict) else each
        if parameter not in LIMITS:
            raise Denied(
                f"{service}: parameter {str(parameter)[:80]!r} is not for pages; "
                f"those are {', '.join(LIMITS)}"
            )
