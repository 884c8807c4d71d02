# SPDX-License-Identifier: Apache-2.0
"""Quantities and notes about the compliant mounting; `mounting.py` computes the mechanics."""

from __future__ import annotations

import math

import numpy as np

from .results import Quantity
from .screw_geometry import DESCRIPTIONS, LEAD, Bar

_FASTEST = 1.0  # m/s, the module's highest speed (thesis A.1.1)
_PRINTED_DIP = 200.0  # rad/s (thesis A.4)


def quantities(
    settings, screws: dict[str, Bar], data: dict[str, np.ndarray], half_length: float
) -> tuple[Quantity, ...]:
    """Return the experiment's quantities; `half_length`: l1 for the required frequency [m].

    Uncertainties are the spread (one standard deviation) over the candidates for the screw.
    """
    names = list(screws)
    at = names.index(settings.screw)
    z, inertia = data["nut"], data["case1_inertia"]
    first, second = data["case1_frequency"], data["case2_frequency"]
    least = first.min(1)
    low, high = data["case3_resonances"].T

    def of(name: str, values, unit: str, text: str) -> Quantity:
        values = np.asarray(values, float)
        return Quantity(name, float(values[at]), float(values.std(ddof=1)), unit, text)

    def all_bars(function) -> list[float]:
        return [function(screw) for screw in screws.values()]

    softest = settings.case2_top * (settings.wanted / second.min(1)) ** 2
    fixed = (
        of("screw_mass", all_bars(lambda s: s.mass), "kg", "mass of the screw, derived"),
        of("screw_length", all_bars(lambda s: s.length), "m", "length of the screw, derived"),
        of("half_length", all_bars(lambda s: s.half_length), "m",
           "l1, centre of the screw to either bearing, derived"),
        of("screw_reflected_mass", all_bars(Bar.reflected), "kg",
           "mass the screw's rotation reflects to the handle (Table 5.1: 3.25 kg)"),
        Quantity("half_length_wanted", half_length, math.nan, "m",
                 f"l1 at which case 1 has just {settings.wanted:g} Hz at its worst position"),
        Quantity("fastest_rotation", _FASTEST / LEAD, math.nan, "Hz",
                 "turns per second at 1 m/s (thesis A.1.1: about 50 Hz)"),
        of("case1_inertia_greatest", inertia.max(1), "kg m^2",
           "case 1, inertia about the nut at the bottom of travel (fig A-2)"),
        of("case1_inertia_least", inertia.min(1), "kg m^2",
           "case 1, inertia about the nut at the top of travel (fig A-2)"),
        of("case1_frequency_least", least, "Hz",
           "case 1, least natural frequency over the travel (A.2, fig A-3: at least 500 Hz)"),
        of("case1_worst_position", z[first.argmin(1)], "m",
           "case 1, where that is, above the screw's centre (fig A-3)"),
        of("case1_frequency_greatest", first.max(1), "Hz",
           "case 1, greatest natural frequency over the travel (fig A-3)"),
        of("case2_frequency_least", second.min(1), "Hz",
           "case 2, least natural frequency over the travel (A.3, fig A-4: acceptable)"),
        of("case2_frequency_centre", second[:, len(z) // 2], "Hz",
           "case 2, natural frequency with the nut at the centre (fig A-4: the top of the curve)"),
        of("case2_softest", softest, "N/m",
           f"case 2, softest k1, k2 in proportion, for {settings.wanted:g} Hz "
           "(A.3: 2e6 N/m is acceptable)"),
        Quantity("case3_antiresonance", float(data["case3_antiresonance"][at]), math.nan, "rad/s",
                 "case 3, dip of velocity over torque (A.4, fig A-7: close to 200 rad/s as "
                 "printed)"),
        of("case3_resonance_low", low, "rad/s", "case 3, peak below the dip (fig A-7)"),
        of("case3_resonance_high", high, "rad/s", "case 3, peak above the dip (fig A-7)"),
    )  # fmt: skip
    return fixed + tuple(
        Quantity(f"{case}_frequency_least_{name}", float(values[number]), math.nan, "Hz",
                 f"{case[:-1]} {case[-1]}, least natural frequency, {DESCRIPTIONS[name]}")
        for case, values in (("case1", least), ("case2", second.min(1)))
        for number, name in enumerate(names)
    )  # fmt: skip


def notes(
    settings, screws: dict[str, Bar], data: dict[str, np.ndarray], half_length: float
) -> tuple[str, ...]:
    """Return the notes for the report; `half_length`: l1 for the required frequency [m]."""
    lines = [
        f"screw '{name}' ({DESCRIPTIONS[name]}): {screw.mass:.3f} kg, {screw.length:.4f} m, "
        f"diameter of the equal cylinder {1e3 * screw.diameter:.2f} mm, reflects "
        f"{screw.reflected():.2f} kg; least natural frequency {first:.0f} Hz in case 1 and "
        f"{second:.0f} Hz in case 2"
        for (name, screw), first, second in zip(
            screws.items(),
            data["case1_frequency"].min(1),
            data["case2_frequency"].min(1),
            strict=True,
        )
    ]
    stiffness = settings.case3_top + settings.case3_ground
    dip = math.sqrt(stiffness / settings.top_mass)
    return (
        "The thesis prints neither the screw's mass and length nor l1. Assumed: candidate "
        f"'{settings.screw}', with l1 half its length. The default is the candidate that reaches "
        "the thesis's 500 Hz in case 1 with the least margin ('the most compliance possible'); the "
        "uncertainties are the spread over the candidates. "
        f"Exactly {settings.wanted:g} Hz requires l1 = {half_length:.4f} m "
        f"({half_length / 0.0254:.2f} in).",
        *lines,
        f"Case 3: undamped, the dip lies at sqrt((k1 + k3) / M_top) = {dip:.0f} rad/s "
        f"({dip / 2 / math.pi:.0f} Hz) for any screw. The printed 'close to 200 rad/sec' "
        f"would require k1 + k3 = {_PRINTED_DIP**2 * settings.top_mass:.3g} N/m instead of "
        f"{stiffness:.3g} N/m; 2000 is probably meant.",
        "Eq A.3 in our text of the thesis (by OCR) lacks the square in b1 (l1 - z)^2 of its "
        "first element and the factor b1 in its second; its inertia is about the screw's centre, "
        "which is correct only at z = 0. "
        "Here the equation is derived again. With b = 0 the printed second element would make the "
        "system very slightly unstable (real parts of +-0.17 rad/s with the default screw), "
        "without a change of peaks and dip.",
    )
