# SPDX-License-Identifier: Apache-2.0
"""The weight measured across the play (our method, not in the thesis).

At rest the handle touches the nut on one side of the play. While the stage creeps to the other
side, handle and nut have no contact: the transducer measures the weight of the moving parts and the
drag of the grease film, which is proportional to the speed, but no friction of the screw. The
encoder measures the nut, which stands still during the crossing, so stage travel minus nut travel
shows its beginning, its end and its width.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .lab import Part
from .trials import Samples, StageTrial

_INNER = (0.2, 0.8)  # of the play: clear of the contacts at both sides
_FEWEST = 8  # samples that make a plateau
_UNEVEN = 0.5  # change of the force across a plateau that indicates contact [N]


class Crossing(NamedTuple):
    """Result of one run.

    sign: +1 upright, -1 upside down; direction: +1 up, -1 down the screw; speed: of the stage
    [m/s]; width: handle relative to nut, from rest to steady motion [m]; rate: the handle's speed
    relative to the nut during the crossing [m/s]; force: its mean during the crossing [N]; error:
    standard error of that mean [N]; both NaN without a crossing.
    """

    sign: float
    direction: float
    speed: float
    width: float
    rate: float
    force: float
    error: float

    @property
    def seen(self) -> bool:
        """Whether the handle crossed the play."""
        return bool(np.isfinite(self.force))


class Weight(NamedTuple):
    """weight [N]; film: drag [N s/m]; error, film_error: their standard errors; zero: of the
    transducer [N]. film and zero are NaN if the runs do not determine them. spread: of the forces
    about the fit, relative to their standard errors.
    """

    weight: float
    error: float
    film: float
    film_error: float
    zero: float
    spread: float


def traced(trial: StageTrial, samples: Samples) -> Part:
    """Reduce a creeping run to `gap` (handle relative to nut [m]), `force` [N] and `time` [s]."""
    direction = np.sign(trial.speed)
    stage = abs(trial.speed) * samples.time
    gap = stage - direction * (samples.position - samples.position[0])
    moving = stage <= abs(trial.end - trial.start)
    return {"gap": gap[moving], "force": samples.force[moving], "time": samples.time[moving]}


def crossing(trial: StageTrial, part: Part, least: float) -> Crossing:
    """Evaluate a run reduced by `traced`; least: smaller play counts as none [m]."""
    gap, force, time = part["gap"], part["force"], part["time"]
    width = float(np.median(gap[-max(len(gap) // 4, 1) :]))
    direction = float(np.sign(trial.speed))
    sign = -1.0 if trial.upside_down else 1.0
    nothing = Crossing(sign, direction, abs(trial.speed), width, *(float("nan"),) * 3)
    first, last = (int(np.argmax(gap >= share * width)) for share in _INNER)
    if width < least or last - first < _FEWEST:
        return nothing
    inside = slice(first, last)
    level = force[inside]
    half = len(level) // 2
    error = float(level.std(ddof=1) / np.sqrt(len(level)))
    uneven = abs(float(level[:half].mean() - level[half:].mean()))
    if uneven > max(_UNEVEN, 6.0 * error):
        return nothing
    rate = float(np.polyfit(time[inside], gap[inside], 1)[0])
    return nothing._replace(rate=rate, force=float(level.mean()), error=error)


def weighed(crossings: list[Crossing]) -> Weight | None:
    """Return the best fit of the weight to all crossings, None without any.

    force = sign weight + direction film rate + zero, weighted least squares. If the runs do not
    determine all three (one orientation, one speed), the fit omits the zero, which the bench has
    subtracted, and then the film.
    """
    seen = [c for c in crossings if c.seen]
    if not seen:
        return None
    terms = np.array([(c.sign, c.direction * c.rate, 1.0) for c in seen])
    terms[:, 1] *= 1e3  # mm/s, so that all columns are of one size
    force = np.array([c.force for c in seen])
    error = np.array([c.error for c in seen])
    used = next(n for n in (3, 2, 1) if np.linalg.matrix_rank(terms[:, :n], tol=0.1) == n)
    matrix = terms[:, :used] / error[:, None]
    values, *_ = np.linalg.lstsq(matrix, force / error, rcond=None)
    spare = len(seen) - used
    misfit = matrix @ values - force / error
    spread = float(np.sqrt((misfit**2).sum() / spare)) if spare else 1.0
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))) * max(spread, 1.0)
    values, errors = np.pad(values, (0, 3 - used)), np.pad(errors, (0, 3 - used))
    nan = float("nan")
    return Weight(
        float(values[0]),
        float(errors[0]),
        float(values[1] * 1e3) if used > 1 else nan,
        float(errors[1] * 1e3) if used > 1 else nan,
        float(values[2]) if used > 2 else nan,
        spread,
    )


def play_width(crossings: list[Crossing], resolution: float) -> tuple[float, float]:
    """Return the play and its standard error [m], from the widths of the crossings.

    The fit of a line over the speed removes the effect of a late start of the stage. resolution: of
    the encoder [m]. NaN without a crossing.
    """
    seen = [c for c in crossings if c.seen]
    if not seen:
        return float("nan"), float("nan")
    speed = np.array([c.speed for c in seen])
    width = np.array([c.width for c in seen])
    quantised = resolution / np.sqrt(6.0)  # of a difference of two counts
    if len(set(speed)) < 2 or len(seen) < 4:
        return float(width.mean()), float(np.hypot(width.std(), quantised))
    (_, at_rest), cov = np.polyfit(speed, width, 1, cov="unscaled")
    left = width - np.polyval(np.polyfit(speed, width, 1), speed)
    spread = max(float(np.sqrt((left**2).sum() / (len(seen) - 2))), quantised)
    return float(at_rest), float(spread * np.sqrt(cov[1, 1]))
