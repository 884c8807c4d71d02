# SPDX-License-Identifier: Apache-2.0
"""Physics of the simulated rig (thesis chapters 4 to 6, appendices C and D), free of I/O.

Everything here is a function of (parameters, state, input); `world.World` holds the state. The
values are in `params/plant.yaml`. The friction here is independent of the laws that compensate it,
and has more effects than they model: a controller that shared the plant's formula would prove
nothing.
"""
