# SPDX-License-Identifier: Apache-2.0
"""The ticks the catalogue runs at: slow, so that the machine's own pauses are no faults.

A limit that is a number of periods is unchanged; one in seconds is widened, by no more than the
ticks are slower: in milliseconds no row takes longer at 1 kHz than here.
"""

from __future__ import annotations

RATE = 50.0  # of vertical chain and plane [Hz]
_CUTOFF = 12.0  # of the velocity and force filters, below half the rate [Hz]
PERIOD = 1.0 / RATE  # [s]
PERIOD_NS = round(PERIOD * 1e9)
SAFETY_S, SUPERVISOR_S, COMMAND_S, HEARTBEAT_S = 0.4, 0.5, 0.15, 0.3
FREEZE_S = 0.5  # as on the robot
TRUTH_RATE = 200.0

STALE = 5
"""Samples after which a silent sensor or controller is noticed."""


def samples(seconds: float) -> int:
    """Return a time [s] in samples of the vertical chain."""
    return round(seconds * RATE)


def slow_ticks() -> list[str]:
    """Return the --ros-args that make the graph tick slowly."""
    given = {
        "encoder:rate": RATE,
        "encoder:velocity_cutoff": _CUTOFF,
        "force_sensor:rate": RATE,
        "force_sensor:tare_samples": 20,
        "impedance_controller:rate": RATE,
        "impedance_controller:force_cutoff": _CUTOFF,
        "amplifier:rate": RATE,
        "amplifier:gate.safety_timeout": SAFETY_S,
        "amplifier:command_timeout": COMMAND_S,
        "amplifier:heartbeat_timeout": HEARTBEAT_S,
        "manus:rate": RATE,
        "manus:joints.velocity_cutoff": _CUTOFF,
        "manus:state_every": 1,
        "manus:gate.safety_timeout": SAFETY_S,
        "supervisor:timeout": SUPERVISOR_S,
        "sim_rig:truth_rate": TRUTH_RATE,
    }
    for joint in ("shoulder", "elbow"):
        given[f"manus:{joint}.command_timeout"] = COMMAND_S
        given[f"manus:{joint}.heartbeat_timeout"] = HEARTBEAT_S
    return [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
