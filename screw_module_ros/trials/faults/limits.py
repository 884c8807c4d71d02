# SPDX-License-Identifier: Apache-2.0
"""Limits of the safety contract for the rows, in samples of the vertical chain (1 ms)."""

from __future__ import annotations

RATE = 1000.0  # of the vertical chain [Hz]; the plane runs at half of it
PERIOD = 1.0 / RATE  # [s]
PERIOD_NS = round(PERIOD * 1e9)
TRUTH_RATE = 500.0  # sim/truth [Hz]

STALE = 5
"""Samples until a silent sensor or controller is detected."""
COMMAND = 20
"""Samples without an RPDO after which a drive drops its torque by itself."""
HEARTBEAT = 150
"""Samples in which three of a drive's heartbeats are missed."""
SAFETY = 100
"""Samples without safety_state after which the drives' nodes stop."""
LOST = 200
"""Samples after which the supervisor counts a silent node as lost."""
FROZEN = 500
"""Samples until a force sensor with a constant reading is detected."""

DYING = 8
"""Samples: the torque decays with the amplifier's pole; sim/truth has every second sample."""
VIA_SUPERVISOR = 40
"""Samples: a node reports a fault at 100 Hz, the supervisor decides at 50 Hz, and the drives' nodes
read its state each 4 ms."""
AT_ONCE = 2 + DYING
"""Samples: detected in the first sample, or in the first answer of a drive."""
BY_SERVICE = 6 + DYING
"""Samples: the supervisor publishes at once, the drives' nodes read its state each 4 ms."""
APART = 50 + 2 + DYING
"""Samples: two positions of one motion have differed for 50 ms."""
SLOW = 900
"""Samples until the hand is so slow that a shift of 5 mm exceeds the tolerance, at 70 mm/s."""
