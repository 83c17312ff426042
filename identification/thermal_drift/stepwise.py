"""Stepwise regression on temperatures at each position, with a polynomial through the positions.

After "Synthesization of Thermally Induced Errors in Coordinate Measuring Machines", equations (5) to (8). It is the
benchmark for the method that the command uses (`identification.thermal_drift.selection`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array

# Probabilities of the F statistic below which a sensor enters and above which it leaves: usual in statistics programs
ENTER_PROBABILITY, LEAVE_PROBABILITY = 0.05, 0.10


@dataclass(frozen=True)
class Stepwise:
    """Regressions ``constant + coefficients @ temperatures`` at each position.

    Attributes
    ----------
    positions : (positions,) mm or rad.
    coefficients : (positions, 1 + sensors), constant first; mm or rad, and per kelvin.
    r2 : (positions,) coefficient of determination of each on its own data.
    """

    positions: Array
    coefficients: Array
    r2: Array

    def predict(self, position: Array, temperatures: Array) -> Array:
        """Prediction (n,) at positions (n,) and temperatures (n, sensors): polynomial through all positions."""
        at_each = self.coefficients[:, 0] + temperatures @ self.coefficients[:, 1:].T
        return np.asarray(np.einsum("np,np->n", at_each, _through(self.positions, position)))


def stepwise(position: Array, values: Array, temperatures: Array) -> Stepwise:
    """Stepwise regressions of values (n,) on temperatures (n, sensors), one for each distinct position in (n,)."""
    places = np.unique(position)
    coefficients, r2 = np.zeros((len(places), temperatures.shape[1] + 1)), np.zeros(len(places))
    for k, place in enumerate(places):
        here = position == place
        chosen = _chosen(values[here], temperatures[here])
        design = np.column_stack([np.ones(here.sum()), temperatures[here][:, chosen]])
        found = np.linalg.lstsq(design, values[here], rcond=None)[0]
        coefficients[k, [0, *(c + 1 for c in chosen)]] = found
        r2[k] = 1 - np.var(values[here] - design @ found) / max(np.var(values[here]), 1e-30)
    return Stepwise(places, coefficients, r2)


def _chosen(values: Array, temperatures: Array) -> list[int]:
    """Columns by stepwise regression: the best enters, then the weakest leaves if it is no longer significant."""
    from scipy.stats import f

    def square(columns: list[int]) -> float:
        design = np.column_stack([np.ones(len(values)), temperatures[:, columns]])
        gap = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        return float(gap @ gap)

    chosen: list[int] = []
    for _ in range(2 * temperatures.shape[1]):  # limited, because entering and leaving can alternate
        left = [c for c in range(temperatures.shape[1]) if c not in chosen]
        dof = len(values) - len(chosen) - 2
        if not left or dof < 1:
            break
        before, tries = square(chosen), {c: square([*chosen, c]) for c in left}
        best = min(tries, key=lambda c: tries[c])
        if f.sf((before - tries[best]) / (tries[best] / dof + 1e-300), 1, dof) > ENTER_PROBABILITY:
            break
        chosen.append(best)
        whole = tries[best]
        leaving = {
            c: f.sf((square([o for o in chosen if o != c]) - whole) / (whole / dof + 1e-300), 1, dof) for c in chosen
        }
        worst = max(leaving, key=lambda c: leaving[c])
        if leaving[worst] > LEAVE_PROBABILITY:
            chosen.remove(worst)
    return sorted(chosen)


def _through(places: Array, position: Array) -> Array:
    """Lagrange weights (n, places) of the polynomial through all places."""
    out = np.ones((len(position), len(places)))
    for k, here in enumerate(places):
        for other in np.delete(places, k):
            out[:, k] *= (position - other) / (here - other)
    return out
