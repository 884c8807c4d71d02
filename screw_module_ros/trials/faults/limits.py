# SPDX-License-Identifier: Apache-2.0
"""The safety contract's limits, in samples of the vertical chain (1 ms), as rows use them."""

from __future__ import annotations

RATE = 1000.0  # of the vertical chain [Hz]; the plane runs at half of it
PERIOD = 1.0 / RATE  # [s]
PERIOD_NS = round(PERIOD * 1e9)
TRUTH_RATE = 500.0  # sim/truth [Hz]

STALE = 5
"""Samples after which a silent sensor or controller is noticed."""
COMMAND = 20
"""Samples without an RPDO after which a drive drops its torque by itself."""
HEARTBEAT = 150
"""Samples in which three of a drive's heartbeats are missed."""
SAFETY = 100
"""Samples without safety_state after which the drives' nodes stop."""
LOST = 200
"""Samples after which the supervisor counts a silent node as lost."""
FROZEN = 500
"""Samples after which a force sensor that repeats itself is noticed."""

DYING = 8
"""Samples: torque dies away with the amplifier's pole, and sim/truth shows every second one."""
TOLD = 40
"""Samples: a fault is told at 100 Hz, decided upon at 50 Hz, and heard each 4 ms by the drives."""
AT_ONCE = 2 + DYING
"""Samples: noticed by the first sample, or by the first answer of a drive."""
BY_SERVICE = 6 + DYING
"""Samples: the supervisor says so at once, the drives look each 4 ms."""
