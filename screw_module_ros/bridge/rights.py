# SPDX-License-Identifier: Apache-2.0
"""Rights of each role: topics to subscribe and to publish, services to call.

A browser cannot reach anything that is not listed here. No role may publish `setpoint`: the wishes
of a game pass through `therapy_session`, which limits them.
Names in the tables are relative to a robot's namespace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from .. import graph

PATIENT, THERAPIST = "patient", "therapist"
ROLES = (PATIENT, THERAPIST)
WISH, ATTENDANCE = graph.THERAPY_WISH, graph.THERAPY_ATTENDANCE

_READ = (graph.ENDPOINT_STATE, graph.THERAPY_STATE, graph.THERAPY_TRIAL)
HEARD = {
    name: graph.TOPICS[name].type
    for name in (*_READ, graph.THERAPY_ASSISTANCE, graph.SAFETY_STATE)
}
"""Topics that the bridge subscribes to, with their types."""
KEPT = (graph.THERAPY_TRIAL, graph.THERAPY_ASSISTANCE)
"""Topics of which the last messages are kept, for a page that is opened or reloaded."""
SENT = {name: graph.TOPICS[name].type for name in (WISH, ATTENDANCE)}
"""Topics that the bridge publishes, with their types."""
STOP = "supervisor/estop"
"""The software stop."""
_TRIGGER, _PARAMETERS = "std_srvs/srv/Trigger", "rcl_interfaces/srv/"
ASKED = {
    "therapy_session/start": "screw_module_msgs/srv/StartTherapy",
    "therapy_session/pause": _TRIGGER,
    "therapy_session/resume": _TRIGGER,
    "therapy_session/abort": _TRIGGER,
    "therapy_session/describe_parameters": _PARAMETERS + "DescribeParameters",
    "therapy_session/get_parameters": _PARAMETERS + "GetParameters",
    "therapy_session/set_parameters": _PARAMETERS + "SetParameters",
    "session_recorder/stop": _TRIGGER,
    STOP: _TRIGGER,
}
"""Services that the bridge calls, with their types; only for the therapist."""
ATTENDED = ("therapy_session/start", "therapy_session/resume")
"""Services that a page calls only for a session that it attends."""
LIMITS = (
    "allow_wishes", "assistance.stiffness",
    "wish.half_width", "wish.half_depth", "wish.low", "wish.high", "wish.speed",
)  # fmt: skip
"""Parameters of `therapy_session` that a therapist may read and set."""

_HEARS = {
    PATIENT: _READ,
    THERAPIST: tuple(HEARD),
}
_SENDS = {PATIENT: (), THERAPIST: tuple(SENT)}
_ASKS = {PATIENT: (), THERAPIST: tuple(ASKED)}


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


class Rights:
    """Rights of each role for the robots of a bridge.

    robots: their namespaces, with leading /. wishes: whether the patient's token, which otherwise
    only reads, may publish `therapy/wish`; it can be changed at any time.
    """

    def __init__(self, robots: Sequence[str], wishes: bool = False):
        self.robots = tuple(robots)
        self.wishes = wishes

    def hears(self, role: str, name: str) -> tuple[Place, str]:
        """Return a topic that a role may subscribe to, and its type. Raises Denied."""
        return self._found(name, HEARD, _HEARS[role], f"the {role}'s page may not hear {{}}")

    def sends(self, role: str, name: str) -> tuple[Place, str]:
        """Return a topic that a role may publish, and its type. Raises Denied."""
        may = _SENDS[role] + ((WISH,) if self.wishes else ())
        hint = (
            f"; nobody publishes set points here: a game publishes {WISH}"
            if name.endswith("setpoint") else ""
        )  # fmt: skip
        return self._found(name, SENT, may, f"the {role}'s page may not publish {{}}{hint}")

    def asks(self, role: str, name: str, arguments: dict) -> tuple[Place, str]:
        """Return a service that a role may call with these arguments, and its type.

        Raises Denied.
        """
        place, kind = self._found(name, ASKED, _ASKS[role], f"the {role}'s page may not call {{}}")
        if place.name.endswith("_parameters"):
            for parameter in _parameters_in(arguments):
                if parameter not in LIMITS:
                    raise Denied(
                        f"{place.full}: parameter {str(parameter)[:80]!r} is not for pages; "
                        f"those are {', '.join(LIMITS)}"
                    )
        return place, kind

    def places(self, table: dict[str, str]) -> list[tuple[Place, str]]:
        """Return each entry of a table of names and types for each robot."""
        return [(Place(robot, name), kind) for robot in self.robots for name, kind in table.items()]

    def _found(
        self, name: str, known: dict[str, str], may: Sequence[str], refusal: str
    ) -> tuple[Place, str]:
        place = self._place(name)
        if place is None or place.name not in may or place.name not in known:
            raise Denied(refusal.format(name[:80]) + f" (it may: {', '.join(may) or 'nothing'})")
        return place, known[place.name]

    def _place(self, name: str) -> Place | None:
        """Return the place of a name; a name without a leading / belongs to the first robot."""
        if not name.startswith("/"):
            return Place(self.robots[0], name)
        for robot in self.robots:
            prefix = f"{robot.rstrip('/')}/"
            if name.startswith(prefix) and name[len(prefix) :] in (*HEARD, *SENT, *ASKED):
                return Place(robot, name[len(prefix) :])
        return None


def _parameters_in(arguments: dict) -> list[Any]:
    """Return the names of the parameters in a call of a parameter service."""
    (key, named), *more = [*arguments.items(), ("", None)]
    if key not in ("names", "parameters") or len(more) > 1 or not isinstance(named, list):
        raise Denied("one list, names or parameters, is wanted")
    if not named:
        raise Denied("the list names no parameter")
    return [each.get("name") if isinstance(each, dict) else each for each in named]
