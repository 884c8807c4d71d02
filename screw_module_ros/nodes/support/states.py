# SPDX-License-Identifier: Apache-2.0
"""Fills state messages from the parts of the loops; for the loop's thread, times in [ns]."""

from __future__ import annotations

import math
from typing import Any

from geometry_msgs.msg import WrenchStamped
from screw_module_msgs.msg import AmplifierState, ImpedanceState, PlanarState

from screw_module_ros.control.modes import OFF
from screw_module_ros.loop.controller import VerticalController
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.plane import Plane
from screw_module_ros.safety.permit import Permit
from screw_module_ros.safety.timing import DeadlineMeter
from screw_module_ros.samples import ForceReading

from .hot_topics import fill_stamp

_UNKNOWN = [math.nan, math.nan]


def fill_controller(message: ImpedanceState, controller: VerticalController, now_ns: int) -> None:
    """Write the controller's state into its message."""
    output, law = controller.output, controller.state
    message.mode = controller.mode
    message.faulted = controller.faulted
    message.reason = controller.reason
    message.active = not controller.reason and controller.mode != OFF
    if controller.answered is not None:
        message.position = controller.answered.position
        message.velocity = controller.answered.velocity
    message.desired_position = output.desired_position
    message.desired_velocity = output.desired_velocity
    message.stiffness, message.damping = law.stiffness, law.damping
    message.force_gain = law.gain
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
    drives, output = plane.permit.drives, plane.output
    message.homed = plane.homed
    _fill_permit(message, plane.permit)
    message.drive_state = [int(drive.state(now_ns)) for drive in drives]
    message.error_code = [drive.error_code for drive in drives]
    message.joint_position = [joint.angle for joint in plane.joints]
    message.joint_velocity = [joint.velocity for joint in plane.joints]
    message.commanded_torque = list(plane.written)
    message.measured_torque = [
        drive.reading.torque if drive.reading else 0.0 for drive in drives
    ]
    if output is not None:
        message.position = [output.x, output.y]
        message.velocity = [output.vx, output.vy]
        message.force = [output.force_x, output.force_y]
        message.desired_position = [output.desired_x, output.desired_y]
        message.saturated = output.saturated
    if not plane.measures(now_ns):
        message.position = message.velocity = _UNKNOWN
        message.joint_position = message.joint_velocity = _UNKNOWN
    message.stiffness, message.damping = plane.settings.stiffness, plane.settings.damping
    message.samples = plane.meter.samples
    _fill_counts(message, plane.meter, now_ns)


def impedance_text(law: Any) -> str:
    """Return the impedance that a law's settings ask for, as the answer of a service."""
    return f"stiffness {law.stiffness:g} N/m, damping {law.damping:g} Ns/m"


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
