# SPDX-License-Identifier: Apache-2.0
"""Every n-th sample of the hot topics, for who does not act on each.

A subscription at 1 kHz costs its process 4 to 5 % of a core in the middleware alone, so only the
chain from encoder to amplifier has any.
"""

SLOW_RATE = 200.0  # [Hz]
SLOW_ENCODER = "screw/encoder/decimated"
SLOW_FORCE = "handle/force/decimated"
