"""Joins of points of which components were not measured: an interferometer, a probe, a switch.

The frame is aligned as far as the measured components determine it. What is then left shows rows that are shifted or in
reversed order, and another unit or sign, though not which command a single row belongs to.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from identification.observation.frames import align

FOREIGN = 0.02  # of the readings' spread: readings that follow their commands leave less; by judgement
BETTER = 10.0  # times nearer, in another order or unit
FEWEST = 5  # readings
SHIFTS = 3  # rows
UNITS = {25.4: "inch", 1e3: "m", 1e-3: "um", 10.0: "cm", -1.0: "the other sign"}  # of another unit in mm


def left_over(nominal: Array, measured: Array) -> float:
    """Root mean square difference (mm) of the measured components from the nominal ones in the best frame."""
    difference = measured - align(nominal, measured).apply(nominal)
    return float(np.sqrt(np.nanmean(difference**2)))


def refuse_partial(nominal: Array, measured: Array, name: str) -> None:
    """Refuse readings of some components only that do not follow their commands.

    Parameters
    ----------
    nominal : (n, 3) mm, at the commands of the rows.
    measured : (n, 3) mm, NaN where a component was not measured.
    name : of the file.

    Raises
    ------
    InputError
        The readings do not follow the commands; it says what fits instead, if anything does.
    """
    seen = np.isfinite(measured)
    rows = seen.any(axis=1)
    if seen.all(axis=1).any() or rows.sum() < FEWEST:
        return
    a, b = nominal[rows], measured[rows]
    reach = max(float(np.std(c[np.isfinite(c)])) for c in b.T if np.isfinite(c).any())
    before = left_over(a, b)
    if reach <= 0 or before < FOREIGN * reach:
        return
    n = len(a)
    orders: dict[str, Index] = {"in reversed order": np.arange(n)[::-1]}
    for k in (k for k in range(-SHIFTS, SHIFTS + 1) if k):
        orders[f"{abs(k)} row{'s' * (abs(k) > 1)} {'later' if k > 0 else 'earlier'}"] = np.roll(np.arange(n), -k)
    tries = [(left_over(a, b[order]), f"the readings taken {what}") for what, order in orders.items()]
    tries += [
        (left_over(a, factor * b) / max(abs(factor), 1.0), f"readings in {unit}") for factor, unit in UNITS.items()
    ]
    after, what = min(tries)
    found = f"readings that lie {before:.3g} mm rms from their commands and spread by {reach:.3g} mm"
    if after < before / BETTER:
        found += f"; {what} fit to {1e3 * after:.0f} um"
    raise InputError(name, found, "See that order, unit and sign are right, and that these commands were measured")
