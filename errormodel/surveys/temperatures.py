"""Temperatures in another unit than degC, or than the other sensors of a recording have."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.exceptions import ReadValueError

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.arrays import Array

APART = 20.0  # K: at no time does a sensor come so near to any other; at 20 degC degrees Fahrenheit are 48 more
ALIKE = 5.0  # K, of the medians in degF: a machine and its room
KELVIN = (250.0, 330.0)  # of machines and the rooms they stand in, -23 to 57 degC; no machine is as hot
ZERO_DEGC = 273.15
HEATED = re.compile(r"hot|nozzle|extru|heater", re.IGNORECASE)  # names of what is as hot in degC


def in_kelvin(name: str, values: Array) -> bool:
    """Whether a temperature (n,) read in degC is in K in all rows, as its numbers say."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and bool(KELVIN[0] < known.min() and known.max() < KELVIN[1]) and not HEATED.search(name)


def kelvin_note(read: pd.DataFrame, where: str, measured: bool) -> str | None:
    """A note on temperatures of undeclared unit that are in K by their medians.

    Raises
    ------
    ReadValueError
        All of them are, in all rows, in a file of measurements (`measured`).
    """
    values = {str(n): read[n].dropna().to_numpy(dtype=np.float64) for n in read}
    found = {n: v for n, v in values.items() if len(v) and in_kelvin(n, np.median(v, keepdims=True))}
    if not found:
        return None
    inside = np.concatenate([v[(v > KELVIN[0]) & (v < KELVIN[1])] for v in found.values()])
    low, high = float(inside.min()), float(inside.max())
    names, are, whole = " ".join(found), "are" if len(found) > 1 else "is", len(found) == len(values)
    text = f"{low:.4g} to {high:.4g} degC; in K it would be {low - ZERO_DEGC:.3g} to {high - ZERO_DEGC:.3g} degC"
    units = "{temperature: K}" if whole else f"{{{', '.join(f'{n}: K' for n in found)}}}"
    if not (whole and measured and all(in_kelvin(n, v) for n, v in found.items())):
        return f"{names} {are} {text}. If so, write units: {units} in a survey.yaml"
    options, kept = ",".join(f"{n}=K" for n in found), ", ".join(f"{n}: degC" for n in found)
    cure = (
        f"Write units: {units} in a survey.yaml, or import with --units {options}; if they are right, units: {{{kept}}}"
    )
    raise ReadValueError(f"{where}, column{'s' * (len(found) > 1)} {names}", text, cure)


def fahrenheit_notes(table: pd.DataFrame) -> Iterator[str]:
    """Notes on sensors that lie far above all others, and among them if they are in degF."""
    values: dict[str, Array] = {}
    for name in (str(c) for c in table.columns if str(c).startswith("T_")):
        column = table[name].to_numpy(dtype=np.float64)
        if np.isfinite(column).any():
            values[name] = column[np.isfinite(column)]
    warm = {n: v for n, v in values.items() if any(_between(v, other) for m, other in values.items() if m != n)}
    for name, own in warm.items():
        rest = {n: v for n, v in values.items() if n not in warm}
        if not rest or not all(_between(own, v) for v in rest.values()):
            continue
        other, beside = next(iter(rest.items()))
        low, high = ((x - 32) / 1.8 for x in (own.min(), own.max()))
        yield (
            f"{name} is {own.min():.4g} to {own.max():.4g} degC where {other} is {beside.min():.4g} to "
            f"{beside.max():.4g}: as degF it would be {low:.3g} to {high:.3g} degC. If it is in degF, write units: "
            f"{{{name}: degF}} in a survey.yaml, or import with --units {name}=degF"
        )


def _between(own: Array, other: Array) -> bool:
    """Whether a sensor lies apart from another as read, and beside it if it is in degF."""
    near = any(abs((of(own) - 32) / 1.8 - np.median(other)) < ALIKE for of in (np.median, np.min))  # hot, or cold yet
    return bool(own.min() > other.max() + APART and near)
