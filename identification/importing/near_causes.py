"""Why points without pairs lie in no frame on their commands: another unit, or another hand of the axes."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from identification.importing.nearest import find_pairing
from identification.importing.proof import MIRROR_CURE, UNIT_FACTORS, unit_cure

ALIKE = 3.0  # times: the reach of the points in another unit may differ so from that of the commands; some are missing
MIRROR = np.array([1.0, 1.0, -1.0])


def other_cause(path: Array, measured: Array, seed: int, read_as: float) -> tuple[str, str] | None:
    """What brings points onto commands, in words, and what to write; None where no unit and no hand does.

    Parameters
    ----------
    path : (m, 3) nominal points, mm; measured : (n, 3), of which as they stand no frame was found.
    read_as : mm a unit as which the file's numbers were read.
    """
    good = measured[np.isfinite(measured).all(axis=1)]
    ratio = _reach(path) / max(_reach(good), 1e-12)
    for size, unit in [(read_as, ""), *UNIT_FACTORS.items()]:
        factor = size / read_as
        if (unit and factor == 1) or not factor / ALIKE < ratio < factor * ALIKE:
            continue
        for hand in (np.ones(3), MIRROR):
            if not unit and (hand > 0).all():
                continue
            found = find_pairing(path, good * factor * hand, seed)
            if found is None:
                continue
            own = found.command >= 0
            at = found.pose.apply(path[found.command[own]])
            off = 1e3 * float(np.median(np.linalg.norm(good[own] * factor * hand - at, axis=1)))
            mirrored = bool((hand < 0).any())
            what = [f"in {unit}"] * bool(unit) + ["as their mirror image"] * mirrored
            text = f"{' and '.join(what)} {int(own.sum())} of {len(good)} readings fit to {off:.0f} um"
            cures = [f"{unit_cure(unit)} (or that of the commands, --command-units)"] * bool(unit)
            cures += [MIRROR_CURE] * mirrored
            return text, ". ".join(cures)
    return None


def refuse_cause(path: Array, measured: Array, seed: int, read_as: float, where: str, found: str) -> None:
    """InputError with the unit or the hand that makes points fit, if one does; parameters as above."""
    cause = other_cause(path, measured, seed, read_as)
    if cause is not None:
        raise InputError(where, f"{found}. What fits instead: {cause[0]}", cause[1])


def _reach(points: Array) -> float:
    return float(np.sqrt(np.sum(np.var(points, axis=0))))
