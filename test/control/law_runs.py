# SPDX-License-Identifier: Apache-2.0
"""The laws of both axes run over inputs, with the memory that they keep; forces in the plane."""

from __future__ import annotations

import math

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import envelope, plane_envelope
from screw_module_ros.control.laws.plane_impedance import PLANE_IMPEDANCE
from screw_module_ros.control.laws.thesis import THESIS, Own
from screw_module_ros.control.planar import PlanarInput
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.geometry import inverse, jacobian

MODEL = thesis_friction()
DT, PLANE_DT = 0.001, 0.002
NO_SETPOINT = (math.nan,) * 4
UNKNOWN = (math.nan, math.nan)
VERTICAL, PLANAR = VerticalSettings(), PlanarSettings()
_thesis = envelope.enveloped(THESIS)
_plane = plane_envelope.enveloped(PLANE_IMPEDANCE)


def initial_state(settings=VERTICAL):
    """Return the vertical law's memory before the first step."""
    return envelope.initial_state(settings, THESIS, Own(settings, MODEL))


def vertical_step(settings, state, inp, dt=DT):
    """Return the vertical law's output, and take its memory dt [s] further."""
    return _thesis(settings, Own(settings, MODEL), state, inp, dt)


def vertical_outputs(inputs, law=VERTICAL, state=None):
    """Return the vertical law's output for each input, one a tick."""
    state = state or initial_state(law)
    return [vertical_step(law, state, inp) for inp in inputs]


def planar_outputs(inputs, law=PLANAR, state=None):
    """Return the planar law's output for each input, one a tick."""
    state = state or initial_plane(law)
    return [planar_step(law, state, inp) for inp in inputs]


def initial_plane(law=PLANAR):
    """Return the planar law's memory before the first step."""
    return plane_envelope.initial_state(law, PLANE_IMPEDANCE, law)


def planar_step(law, state, inp, dt=PLANE_DT):
    """Return the planar law's output, and take its memory dt [s] further."""
    return _plane(law, law, state, inp, dt)


def plane_at(x, y, setpoint=NO_SETPOINT, velocity=(0.0, 0.0), force=UNKNOWN):
    """Return an input: handle at x, y [m], its velocity [m/s] and the patient's force [N]."""
    shoulder, elbow = inverse(x, y)
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow)
    determinant = x_s * y_e - x_e * y_s
    vx, vy = velocity
    speeds = (y_e * vx - x_e * vy) / determinant, (x_s * vy - y_s * vx) / determinant
    return PlanarInput(shoulder, elbow, *speeds, *setpoint, True, 0.0, 0.0, 0.0, *force)


def handle_force(output, inp):
    """Return the force of the torques at the handle [N]: the Jacobian transpose, inverted."""
    x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow)
    determinant = x_s * y_e - x_e * y_s
    return (
        (y_e * output.shoulder_torque - y_s * output.elbow_torque) / determinant,
        (x_s * output.elbow_torque - x_e * output.shoulder_torque) / determinant,
    )
