# SPDX-License-Identifier: Apache-2.0
"""Conditions of a certificate: with which loop, filters and observer its gains were found stable.

Each name is that of the parameter. What the controller knows of itself it compares: a departure in
the direction that makes the largest stable gain smaller is refused, one that makes it larger is
not. The delay and the encoder's velocity filter belong to other nodes: they are written down for
who reads the certificate.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..control.vertical_settings import VerticalSettings
from ..settings import Field, Setting, declared
from .strict_mapping import Section

FEEDBACK, OBSERVED = "force_gain", "observer_gain"
LEAST = {"rate": (FEEDBACK, OBSERVED), "observer_bandwidth": (OBSERVED,),
         "observer_delay": (OBSERVED,), "mass": (OBSERVED,)}  # fmt: skip
"""Conditions of which less costs margin, with the gains that need it."""
MOST = {"force_cutoff": (FEEDBACK,), "observer_cutoff": (OBSERVED,),
        "observer_inertia": (OBSERVED,)}  # fmt: skip
"""Conditions of which more costs margin."""


class Conditions(NamedTuple):
    """The loop and the law's settings with which the largest gains were found.

    rate, delay: of the loop; velocity_cutoff: of the encoder's filter; the others: settings of the
    law (`VerticalSettings`).
    """

    rate: Annotated[float, Setting("samples per second", "Hz", 50.0, 10_000.0)]
    delay: Annotated[float, Setting("from a sample to the current's answer", "s", 0.0, 0.1)]
    velocity_cutoff: Annotated[float, Setting("of the velocity filter", "Hz", 0.1, 1000.0)]
    force_cutoff: float
    observer_cutoff: float
    observer_bandwidth: float
    observer_delay: float
    observer_inertia: float
    mass: float

    def departure(
        self, gain: str, settings: VerticalSettings, rate: float
    ) -> tuple[str, str] | None:
        """Return what costs a gain margin and what the certificate is for, None if nothing does.

        gain: name of the setting; rate: of the controller [Hz].
        """
        actual = conditions_of(settings, rate, self.delay, self.velocity_cutoff)
        for names, way, better in ((LEAST, "at least", "higher"), (MOST, "at most", "lower")):
            for name in (name for name, gains in names.items() if gain in gains):
                found, wanted = getattr(actual, name), getattr(self, name)
                if found < wanted if names is LEAST else found > wanted:
                    unit = _field(name).setting.unit
                    unit = f" {unit}" if unit else ""
                    return (
                        f"{name} is {found:.10g}{unit}",
                        f"is for {wanted:.10g}{unit} {way}: choose a {better} one",
                    )
        return None


def conditions_of(
    law: VerticalSettings, rate: float, delay: float, velocity_cutoff: float
) -> Conditions:
    """Return the conditions of a law in a loop; rate [Hz], delay [s], velocity_cutoff [Hz]."""
    own = {name: getattr(law, name) for name in Conditions._fields if hasattr(law, name)}
    return Conditions(rate=rate, delay=delay, velocity_cutoff=velocity_cutoff, **own)


def read_conditions(section: Section) -> Conditions:
    """Return the conditions in a section of a certificate. Raises the section's error."""
    fields = {name: _field(name).setting for name in Conditions._fields}
    return Conditions(*(section.number(name, s.low, s.high) for name, s in fields.items()))


def _field(name: str) -> Field:
    return declared(Conditions).get(name) or declared(VerticalSettings)[name]
