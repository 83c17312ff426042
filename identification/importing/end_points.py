"""Readings between two poses: the columns of both (``Ball 1 X`` .. ``Ball 2 Z``), and lengths that nobody measured."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import first_pose
from identification.diagnosis.data_checks.readings import Lengths

COMPUTED_MM = 1e-4  # root mean square beside a machine without errors, below which no machine and no instrument lies
FEWEST = 8  # lengths, to say so
_CALIBRATED = re.compile(r"calib|kalib|certif|zertif|nominal|etalon|\bref", re.IGNORECASE)


def end_points(names: Sequence[str], machine: Machine) -> dict[str, str]:
    """Columns of the joints at the first pose and the second, where two sets of columns have all joints' names.

    ``Ball 1 X``, ``Ball 2 X``; ``X start``, ``X end``; ``von_X``, ``nach_X``: the first set in the file is the start.
    """
    joints = {j.name.casefold(): j.name for j in machine.joints}
    found: dict[str, dict[str, str]] = {}
    for name in names:
        words = [w for w in re.split(r"[\s_.\-/:]+", name.casefold()) if w]
        own = [w for w in (words[-1:] + words[:1]) if w in joints]
        if len(words) > 1 and own:
            words.remove(own[0])
            found.setdefault(" ".join(words), {})[joints[own[0]]] = name
    whole = [columns for columns in found.values() if len(columns) == len(joints)]
    if len(whole) != 2 or {*joints} & {n.casefold() for n in names}:
        return {}
    first, second = whole
    return {first_pose(joint): theirs for joint, theirs in first.items()} | second


def calibrated(names: Sequence[str]) -> str:
    """The column of a calibrated length among others; empty where none or several may be it."""
    own = [n for n in names if _CALIBRATED.search(n)]
    return own[0] if len(own) == 1 else ""


def computed_notes(survey: Survey, lengths: Sequence[Lengths]) -> Iterator[str]:
    """Notes on lengths between two poses that are distances of the commands themselves, to their last digits."""
    for own in lengths:
        if survey.observations[own.label.partition(",")[0]].poses < 2 or len(own.gap) < FEWEST:
            continue
        rms = float(np.sqrt(np.mean(np.square(own.gap))))
        if rms < COMPUTED_MM:
            yield (
                f"lengths of {own.label} lie {1e3 * rms:.2g} um rms from those of a machine without errors: no machine "
                "is so good, and they seem to be computed from the commanded positions. Give the lengths that an "
                "instrument read, of a bar its calibrated length: --columns length=.."
            )
