# SPDX-License-Identifier: Apache-2.0
"""A dynamic signal analyser on the servo amplifier alone (thesis 4.1.2: HP 3562A, 256 kHz).

It feeds a sine into the amplifier, held between its samples, and reads the current, without the
module. The amplifier is that of `amplifier.py` at the instrument's rate, where its delay lasts many
substeps.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import compiled
from .amplifier import Amplifier, bridge_current, delayed_step, discretised


def analyzed(
    amplifier: Amplifier, frequency: float, amplitude: float, duration: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the result of `analyzer_sine`, from its compiled function."""
    return compiled(analyzer_sine)(amplifier, frequency, amplitude, duration, rate)


def analyzer_sine(
    amplifier: Amplifier, frequency: float, amplitude: float, duration: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return command [A] and current [A] at the instants k / rate while a sine is played.

    frequency [Hz]; amplitude: of the command [A]; duration [s]; rate [1/s]. Sample k of the command
    is held from k / rate to (k + 1) / rate, the current is read as it begins. At rest before.
    """
    count = int(round(duration * rate))
    p = discretised(amplifier, 1.0 / rate)
    command = np.empty(count)
    settled = np.zeros(count + p.whole + 1)  # current of the bridge, after the delay
    answer = np.empty(count)
    current = 0.0
    for k in range(count):
        command[k] = amplitude * math.sin(2.0 * math.pi * frequency * k / rate)
        settled[k + p.whole + 1] = bridge_current(amplifier, command[k])
        answer[k] = current
        current, _ = delayed_step(p, current, settled[k], settled[k + 1])
    return command, answer
