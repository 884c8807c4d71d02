# SPDX-License-Identifier: Apache-2.0
"""What a node shows of itself: state messages, timing contract, rates; times in [ns].

The loop fills the messages. In the diagnostics, which another thread makes, rates and latencies
come from the newest state message: the loop owns the meter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from screw_module_msgs.msg import AmplifierState, ImpedanceState, PlanarState
from screw_module_msgs.srv import SetImpedance
from std_msgs.msg import Header

from screw_module_ros.control.modes import OFF
from screw_module_ros.safety.timing import (
    BIN_NS,
    LEAST_SUCCESS,
    DeadlineMeter,
    histogram_text,
    quantile,
)
from screw_module_ros.samples import ForceReading

from .answering import Done
from .inbox import fill_stamp
from .parameters import Parameters

if TYPE_CHECKING:  # not every node has drives: without one, no bus is imported
    from screw_module_ros.loop.controller import VerticalController
    from screw_module_ros.loop.drive import VerticalDrive
    from screw_module_ros.loop.plane import Plane
    from screw_module_ros.safety.permit import Permit

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_UNKNOWN = [math.nan, math.nan]
_SHARES = (0.5, 0.99, 0.999)


class Health(NamedTuple):
    """One entry on /diagnostics: level, message and named values."""

    level: bytes
    message: str
    values: dict

    def status(self, node: str, hardware_id: str) -> DiagnosticStatus:
        """Return the entry as a message; node: its full name."""
        return DiagnosticStatus(
            level=self.level,
            name=node.lstrip("/"),
            message=self.message,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=str(value)) for key, value in self.values.items()],
        )


def at_base(kind: Any) -> Any:
    """Return a message of this class in the robot's frame."""
    return kind(header=Header(frame_id="manus_base"))


def fill_controller(message: ImpedanceState, controller: VerticalController, now_ns: int) -> None:
    """Write the controller's state into its message."""
    output, law = controller.output, controller.laws.state
    message.mode = controller.mode
    message.faulted = controller.faulted
    message.reason = controller.reason
    message.home_in_doubt = controller.home_in_doubt
    message.active = not controller.reason and controller.mode != OFF
    if controller.answered is not None:
        message.position = controller.answered.position
        message.velocity = controller.answered.velocity
    message.desired_position = output.desired_position
    message.desired_velocity = output.desired_velocity
    message.stiffness, message.damping = law.stiffness, law.damping
    message.force_gain = controller.laws.force_gain
    shown = controller.laws.shown
    message.law_names, message.law_values = list(shown), list(shown.values())
    message.gain_share = output.share
    message.measured_force = controller.handle_force
    message.commanded_force = output.force
    message.samples = controller.meter.samples
    _fill_latencies(message, controller.meter, now_ns)


def fill_amplifier(message: AmplifierState, part: VerticalDrive, now_ns: int) -> None:
    """Write the vertical drive's state into its message."""
    drive, reading = part.drive, part.drive.reading
    message.state = int(drive.state(now_ns))
    message.statusword = reading.statusword if reading else 0
    message.error_code = drive.error_code
    _fill_permit(message, part.permit)
    message.commanded_force = part.asked
    message.commanded_torque = part.last.torque
    message.measured_torque = reading.torque if reading else 0.0
    message.position = part.position
    message.saturated = part.last.saturated
    message.commands = part.meter.samples
    _fill_latencies(message, part.meter, now_ns)


def fill_plane(message: PlanarState, plane: Plane, now_ns: int) -> None:
    """Write the plane's state into its message; where the drives are silent, NaN as positions."""
    drives: tuple[Any, ...] = plane.permit.drives
    output = plane.output
    message.homed = plane.homed
    _fill_permit(message, plane.permit)
    message.drive_state = [int(drive.state(now_ns)) for drive in drives]
    message.error_code = [drive.error_code for drive in drives]
    message.joint_position = [motion.position for motion in plane.motions]
    message.joint_velocity = [motion.velocity for motion in plane.motions]
    message.commanded_torque = list(plane.written)
    message.measured_torque = [
        drive.reading.torque if drive.reading else 0.0 for drive in drives
    ]
    if output is not None:
        message.position = [output.x, output.y]
        message.velocity = [output.vx, output.vy]
        message.force = [output.force_x, output.force_y]
        message.desired_position = [output.desired_x, output.desired_y]
        message.saturated = output.saturated or plane.hot
    if not plane.measures(now_ns):
        message.position = message.velocity = _UNKNOWN
        message.joint_position = message.joint_velocity = _UNKNOWN
    message.stiffness, message.damping = plane.state.stiffness, plane.state.damping
    message.samples = plane.meter.samples
    _fill_counts(message, plane.meter, now_ns)


def set_impedance(parameters: Parameters, kind: type, request: SetImpedance.Request) -> str:
    """Carry out a request to change the impedance of the law with settings `kind`."""
    refused = parameters.write(stiffness=request.stiffness, damping=request.damping)
    law = parameters.read(kind)
    return refused or Done(f"stiffness {law.stiffness:g} N/m, damping {law.damping:g} Ns/m")


def fill_wrench(message: WrenchStamped, reading: ForceReading) -> None:
    """Write a force sample into the message for tools."""
    fill_stamp(message.header, reading.stamp_ns)
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z = reading.fx, reading.fy, reading.fz
    torque.x, torque.y, torque.z = reading.tx, reading.ty, reading.tz


def _fill_permit(message: Any, permit: Permit) -> None:
    message.enabled, message.faulted = permit.enabled, permit.faulted
    message.reason = permit.reason


def _fill_counts(message: Any, meter: DeadlineMeter, now_ns: int) -> None:
    message.rate = meter.rate(now_ns)
    message.late, message.lost = meter.late, meter.lost
    message.success_rate = meter.success_rate


def _fill_latencies(message: Any, meter: DeadlineMeter, now_ns: int) -> None:
    _fill_counts(message, meter, now_ns)
    message.latency_p50, message.latency_p99 = meter.latency(0.5), meter.latency(0.99)
    message.consecutive_missed = meter.missed_in_a_row(now_ns)


def histogram_key(name: str) -> str:
    """Return the key of a histogram in the diagnostics."""
    return f"{name} histogram [{BIN_NS // 1000} us]"


def latency_values(name: str, histogram: list[int]) -> dict[str, object]:
    """Return the diagnostics of the latencies since the activation: quantiles and histogram."""
    histogram = histogram.copy()
    text = "/".join(f"{quantile(histogram, share) * 1e6:.0f}" for share in _SHARES)
    return {
        f"{name} p50/p99/p99.9 since activation [us]": text,
        histogram_key(name): histogram_text(histogram),
    }


def timing_values(state: Any, meter: DeadlineMeter) -> dict[str, object]:
    """Return the timing part of the diagnostics: of the last second, and since the activation.

    state: the newest AmplifierState or ImpedanceState.
    """
    return {
        "rate [1/s]": f"{state.rate:.0f}",
        "latency p50 [us]": f"{state.latency_p50 * 1e6:.0f}",
        "latency p99 [us]": f"{state.latency_p99 * 1e6:.0f}",
        "late": state.late,
        "lost": state.lost,
        "missed in a row": state.consecutive_missed,
        "success rate": f"{state.success_rate:.3f}",
        **latency_values("latency", meter.histogram),
    }


def broken_contract(state: Any) -> str:
    """Return the warning about missed deadlines, empty while the contract holds.

    state: the newest AmplifierState, ImpedanceState or PlanarState.
    """
    if state.success_rate >= LEAST_SUCCESS:
        return ""
    return (
        f"deadlines are being missed: {100 * state.success_rate:.1f} % of the last 1000 commands "
        "came in time"
    )


class RateMeter:
    """Turns a counter into a rate, from one diagnostics entry to the next."""

    def __init__(self) -> None:
        self._count = 0
        self._time_ns = 0

    def rate(self, count: int, now_ns: int) -> float:
        """Return events per second since the last call, NaN at the first and after a restart."""
        elapsed = (now_ns - self._time_ns) * 1e-9
        known = self._time_ns and elapsed > 0 and count >= self._count
        rate = (count - self._count) / elapsed if known else math.nan
        self._count, self._time_ns = count, now_ns
        return rate


class Due:
    """Says when the next message of a slower rate is due, at whole multiples of its period.

    rate: messages per second [Hz]. The first one is due at once.
    """

    def __init__(self, rate: float):
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0

    def __call__(self, now_ns: int) -> bool:
        """Return whether a message is due at now_ns [ns]; True counts it as sent."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return True
