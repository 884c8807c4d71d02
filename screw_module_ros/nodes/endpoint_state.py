# SPDX-License-Identifier: Apache-2.0
"""`endpoint_state`: the 3-D state for games and tools, combined from all axes.

The robot's motion does not depend on this node. The plane is carried to the instant of z, once for
both topics: what has one stamp shows one pose. In `endpoint_state` an axis that is stale or not
homed is marked invalid and has NaN as values. In `joint_states` it is omitted, because subscribers
take every value there for a measurement. Its joints are those of the URDF, those that follow others
among them. The parameter `rate` sets the rate of `endpoint_state`; `joint_states` has half of it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from screw_module_msgs.msg import (
    AmplifierState,
    EndpointState,
    PlanarState,
    SafetyState,
)
from sensor_msgs.msg import JointState

from screw_module_ros import graph
from screw_module_ros.control.limits import clamp
from screw_module_ros.geometry import MANUS_NAME, Screw, torque_to_force
from screw_module_ros.loop.ticker import BETWEEN_TICKS_NS, Ticker
from screw_module_ros.safety.checks import is_finite, is_measured, status_problem
from screw_module_ros.samples import EncoderReading, ForceReading
from screw_module_ros.settings import Setting

from .support.inbox import fill_stamp
from .support.node import Node
from .support.states import OK, WARN, Health, RateMeter, at_base
from .support.topics import Newest, offered, requested

_NAN = math.nan
_CARRIED_S = 0.02  # time for which a velocity is good for a position
_JOINTS_EVERY = 2
_FOLLOWERS = {
    "crank": ("elbow", 1.0),
    "coupler": ("elbow", -1.0),
    "handle_elbow": ("elbow", -1.0),
    "handle_shoulder": ("shoulder", -1.0),
}
"""Joint of the URDF -> the joint that it mimics, and how often. The screw follows by its lead."""
_INPUTS = {
    graph.ENCODER: graph.ENCODER_DECIMATED,
    graph.FORCE: graph.FORCE_DECIMATED,
    graph.MANUS_STATE: graph.MANUS_STATE,
    graph.AMPLIFIER_STATE: graph.AMPLIFIER_STATE,
    graph.SAFETY_STATE: graph.SAFETY_STATE,
}
"""Name in the diagnostics -> topic, in the order in which `step` takes them."""


class EndpointSettings(NamedTuple):
    """Rate of the topic, and the largest age of a sample."""

    rate: Annotated[
        float, Setting(f"{graph.ENDPOINT_STATE} messages per second", "Hz", 10.0, 500.0)
    ] = graph.TOPICS[graph.ENDPOINT_STATE].rate
    max_age: Annotated[float, Setting("samples older than this are invalid", "s", 0.005, 1.0)] = 0.1


class EndpointStateNode(Node):
    """Combines the newest messages at its own rate and never waits for one."""

    def __init__(self) -> None:
        super().__init__("endpoint_state")
        self.parameters.declare(EndpointSettings, Screw)
        self._rate = RateMeter()
        self._message, self._joints = at_base(EndpointState), at_base(JointState)

    def connect(self) -> None:
        """Make the topics."""
        settings = self.parameters.read(EndpointSettings)
        self._screw = self.parameters.read(Screw)
        self._period_ns = round(1e9 / settings.rate)
        age_ns = int(settings.max_age * 1e9)
        take = self.new_inbox().subscribe
        self._inputs = {
            shown: Newest(take(*requested(topic)), age_ns) for shown, topic in _INPUTS.items()
        }
        self._publish = self.outlet(*offered(graph.ENDPOINT_STATE))
        self._publish_joint_state = self.outlet(*offered(graph.JOINT_STATES))

    def begin(self) -> None:
        """Start the ticks."""
        self._ticker = Ticker(self.clock, self._period_ns, BETWEEN_TICKS_NS)
        self._ticks = 0

    def step(self) -> None:
        """Publish one state."""
        tick = self._ticker.sleep()
        now = tick.monotonic_ns
        encoder, force, plane, amplifier, safety = (
            newest.fresh(now) for newest in self._inputs.values()
        )
        message = self._message
        if encoder:
            fill_stamp(message.header, encoder.stamp_ns)
        else:
            self.stamp(message.header)
        message.sequence = tick.sequence
        message.monotonic_ns = encoder.monotonic_ns if encoder else now
        plane_now = carried(plane, message.monotonic_ns)
        _fill_plane(message, plane_now)
        _fill_vertical(message, encoder)
        _fill_force(message, force)
        message.enabled = [bool(plane and plane.enabled), bool(amplifier and amplifier.enabled)]
        message.safety = safety.level if safety else SafetyState.UNKNOWN
        # The pin stays in, also without a supervisor.
        last = self._inputs[graph.SAFETY_STATE].message
        message.vertical_locked = bool(last and last.vertical_locked)
        self._publish(message)
        self._ticks += 1
        if tick.sequence % _JOINTS_EVERY == 0:
            self._publish_joints(message.header.stamp, encoder, plane_now, amplifier)

    def _publish_joints(
        self, stamp: Any, encoder: Any, plane: PlaneNow | None, amplifier: Any
    ) -> None:
        joints = all_joints(
            {**planar_joints(plane), **vertical_joint(encoder, amplifier, self._screw)}, self._screw
        )
        if not joints:
            return
        message = self._joints
        message.header.stamp = stamp
        message.name = list(joints)
        message.position, message.velocity, message.effort = zip(*joints.values(), strict=True)
        self._publish_joint_state(message)

    def health(self) -> Health:
        """Report the stale inputs."""
        now = self.clock.now_ns()
        inputs = self._inputs.items()
        ages = {f"age {name} [s]": newest.age_text(now) for name, newest in inputs}
        stale = [name for name, newest in inputs if newest.stale(now)]
        rate = self._rate.rate(self._ticks, now)
        values = {"rate [1/s]": f"{rate:.1f}", **ages}
        if stale:
            return Health(WARN, f"no fresh {', '.join(stale)}", values)
        return Health(OK, "all inputs fresh", values)


class PlaneNow(NamedTuple):
    """The homed plane at one instant.

    joint_position [rad] and joint_velocity [rad/s]: absolute angles of upper arm and forearm;
    position: x, y from the workspace centre [m]; velocity [m/s]; torque: of both motors [Nm].
    shown: the arm is that of the URDF.
    """

    joint_position: tuple[float, float]
    joint_velocity: tuple[float, float]
    position: tuple[float, float]
    velocity: tuple[float, float]
    torque: tuple[float, float]
    shown: bool = True


def carried(plane: PlanarState | None, now_ns: int) -> PlaneNow | None:
    """Return the plane at an instant [ns], angles and position carried along their velocities.

    Its state comes at 125 Hz: uncarried it is 4 ms older on average than z. Angles and position are
    carried alike, so the arm's forward kinematics stay, but for the curvature of its path: 3 um
    after 8 ms at 0.2 m/s, less than a count of the joints. None of a plane that is not homed, or
    whose drives do not tell their positions.
    """
    if plane is None or not plane.homed:
        return None
    if not all(map(math.isfinite, (*plane.joint_position, *plane.position))):
        return None
    ahead = clamp(1e-9 * (now_ns - plane.monotonic_ns), -_CARRIED_S, _CARRIED_S)
    return PlaneNow(
        _along(plane.joint_position, plane.joint_velocity, ahead),
        _along(plane.joint_velocity),
        _along(plane.position, plane.velocity, ahead),
        _along(plane.velocity),
        _along(plane.measured_torque),
        plane.arm.partition(" ")[0] in ("", MANUS_NAME),
    )


def _along(values: Any, rates: Any = (0.0, 0.0), ahead: float = 0.0) -> tuple[float, float]:
    """Return two values as plain floats, `ahead` [s] along their rates."""
    (first, second), (fast, slow) = values, rates
    return float(first + ahead * fast), float(second + ahead * slow)


def planar_joints(plane: PlaneNow | None) -> dict[str, tuple[float, float, float]]:
    """Return angle [rad], speed [rad/s] and torque [Nm] of the joints `shoulder`, `elbow`.

    Both motors stand at the base and measure absolute angles. The joint `elbow` is the angle of the
    forearm to the upper arm. By virtual work its torque is the elbow motor's, and the torque of the
    joint `shoulder` is the sum of both motors'. Of an arm that the URDF does not describe: none.
    """
    if plane is None or not plane.shown:
        return {}
    (upper, fore), (upper_speed, fore_speed) = plane.joint_position, plane.joint_velocity
    upper_torque, fore_torque = plane.torque
    return {
        "shoulder": (upper, upper_speed, upper_torque + fore_torque),
        "elbow": (fore - upper, fore_speed - upper_speed, fore_torque),
    }


def vertical_joint(
    encoder: EncoderReading | None, amplifier: AmplifierState | None, screw: Screw
) -> dict[str, tuple[float, float, float]]:
    """Return height [m], speed [m/s] and force [N] of the homed joint `vertical`.

    The force is that of the motor's torque through a screw without friction (eq 3.1).
    """
    if encoder is None or not encoder.homed or amplifier is None:
        return {}
    force = torque_to_force(amplifier.measured_torque, screw)
    return {"vertical": (encoder.position, encoder.velocity, force)}


def all_joints(
    driven: dict[str, tuple[float, float, float]], screw: Screw
) -> dict[str, tuple[float, float, float]]:
    """Return joints with those that mimic them: angle [rad], speed [rad/s], and no torque.

    A viewer that knows no mimic shows the whole machine too. The torque stands at the joint that
    the motor drives.
    """
    followers = {**_FOLLOWERS, "screw": ("vertical", 2.0 * math.pi / screw.lead)}
    return driven | {
        name: (times * driven[of][0], times * driven[of][1], 0.0)
        for name, (of, times) in followers.items()
        if of in driven
    }


def _fill_plane(message: EndpointState, plane: PlaneNow | None) -> None:
    message.valid[0] = message.valid[1] = plane is not None
    message.position.x, message.position.y = plane.position if plane else (_NAN, _NAN)
    message.velocity.x, message.velocity.y = plane.velocity if plane else (_NAN, _NAN)


def _fill_vertical(message: EndpointState, encoder: EncoderReading | None) -> None:
    if encoder and not is_measured(encoder):
        encoder = None
    message.valid[2] = encoder is not None and encoder.homed
    message.position.z = encoder.position if encoder and encoder.homed else _NAN
    message.velocity.z = encoder.velocity if encoder else _NAN


def _fill_force(message: EndpointState, force: ForceReading | None) -> None:
    if force and not (is_finite(force) and not status_problem(force.status)):
        force = None
    message.force_valid = force is not None
    f = message.force
    f.x, f.y, f.z = (force.fx, force.fy, force.fz) if force else (_NAN,) * 3
