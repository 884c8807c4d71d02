# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of an identified value: its sources, and the interval that they give.

After JCGM 100:2008 (GUM). A *statistical* source has a standard uncertainty from scatter, with
degrees of freedom (type A). A *systematic* one does not shrink with repetition: it has a bound with
a reason, and counts as evenly distributed within it (type B: bound / sqrt 3). Sources are
independent and add in quadrature; the effective degrees of freedom are Welch and Satterthwaite's
(G.4.2), and Student's t with these gives the 95 % interval.

What an experiment states as its uncertainty is a standard deviation in the same sense for all: the
half width of the 95 % interval over 1.96. With few degrees of freedom it is larger than the root of
the sum, so that 1.96 of it always are the 95 %, and three of it a limit that an honest value
exceeds in 3 of 1000 cases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.stats import t as student

PER_INTERVAL = 1.959963984540054
"""Stated standard deviations in half of a 95 % interval."""
TRANSDUCER, TRANSDUCER_ERROR = "calibration of the transducer, 1 % of the reading", 0.01
"""Of a real transducer: what and bound as a share, ours; the certificate of a make has its own."""
_LEVEL = 0.975
Group = TypeVar("Group")


class Source(NamedTuple):
    """One source of a value's uncertainty.

    what: for a table, with the reason of a bound; standard: standard uncertainty in the value's
    unit; freedom: its degrees of freedom, infinite for a bound.
    """

    what: str
    standard: float
    freedom: float = math.inf


def bounded(what: str, bound: float) -> Source:
    """Return a systematic source: an error that lies evenly within +-bound."""
    return Source(what, abs(bound) / math.sqrt(3.0))


def stated(sources: Iterable[Source]) -> float:
    """Return what is stated for these sources together: the 95 % half width over 1.96.

    NaN if a source is NaN or there is none.
    """
    known = tuple(sources)
    squares = sum(source.standard**2 for source in known)
    if not known or not math.isfinite(squares):
        return math.nan
    # G.2b: a source of infinite freedom adds nothing to the sum.
    spread = sum(source.standard**4 / source.freedom for source in known)
    freedom = squares**2 / spread if spread > 0.0 else math.inf
    factor = PER_INTERVAL if math.isinf(freedom) else float(student.ppf(_LEVEL, freedom))
    return math.sqrt(squares) * factor / PER_INTERVAL


def jackknifed(
    what: str, fit: Callable[[Sequence[Group]], Sequence[float]], groups: Sequence[Group]
) -> list[Source]:
    """Return the statistical source of each value of a fit, by a jackknife over groups of samples.

    Samples of one group (a trial, a record) share errors and are not independent; the groups are.
    fit: values of some of the groups. NaN with fewer than three groups.
    """
    n = len(groups)
    if n < 3:
        return [Source(what, math.nan) for _ in fit(groups)]
    left_out = [fit([*groups[:out], *groups[out + 1 :]]) for out in range(n)]
    errors = np.sqrt((n - 1) * np.var(np.array(left_out, float), axis=0))
    return [Source(what, float(error), n - 1.0) for error in errors]
