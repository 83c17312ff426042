"""Whether measured orientations turn as the commands turn the last frame; those that do not are refused.

The frame of the positions and one mount of the target are taken out: what is left of right orientations are the angular
errors of the machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import permutations, product

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.surveys.columns import ORIENTATION
from identification.observation.frames import mean_rotation
from identification.observation.models import OrientationView, View

FEWEST = 5  # rows with an orientation, for it to be judged
FAR = 0.05  # rad: so far no machine's members are turned from where they should be; by judgement
BETTER = 10.0  # times nearer, read in another way
LEAVE_OUT = "leave them out (of raw files with --columns mrx=-,mry=-,mrz=-, of a table by taking the columns away)"


def refuse_foreign_orientations(survey: Survey, views: Iterable[View]) -> None:
    """Look at all orientations of a survey.

    Raises
    ------
    InputError
        They do not follow the commands: with what fits instead, if anything does.
    """
    for view in views:
        if isinstance(view, OrientationView) and len(view.index) >= FEWEST and not len(view.pose.undetermined):
            _refuse_foreign(survey, view)


def _refuse_foreign(survey: Survey, view: OrientationView) -> None:
    from scipy.spatial.transform import Rotation

    kernel = view.chain.kernel("nominal", (), view.fixed, tuple(range(3, 12)))
    zero = np.zeros(len(view.chain.ids))
    commanded = np.concatenate(
        [kernel.expand(f).reshape(3, 3, -1).transpose(2, 1, 0) for _, f in kernel.blocks(view.rows, zero)]
    )
    turn = view.pose.rotation
    vectors = Rotation.from_matrix(view.turned).as_rotvec()
    off = _misfit(turn, vectors, commanded)
    if off < FAR:
        return
    ways = ((words, _misfit(turn, other, commanded)) for words, other in _otherwise(vectors))
    words, after = min(ways, key=lambda way: way[1])
    fits = after < min(off / BETTER, FAR)
    found = f"measured orientations that lie {np.degrees(off):.3g} deg (median) from those commanded"
    found += (
        f"; {words} leaves {np.degrees(after):.2g} deg" if fits else ", in the frame of the points and with any mount"
    )
    cure = f"Say it with --columns, or {LEAVE_OUT}" if fits else f"See how the file writes them, or {LEAVE_OUT}"
    raise InputError(f"{survey.table['file'].iloc[view.index[0]]}, columns {' '.join(ORIENTATION)}", found, cure)


def _misfit(turn: Array, vectors: Array, commanded: Array) -> float:
    """Median angle (rad) between measured orientations, as rotation vectors (n, 3), and commanded ones (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    seen = turn.T @ Rotation.from_rotvec(vectors).as_matrix()
    mount = mean_rotation(commanded.transpose(0, 2, 1) @ seen)
    apart = seen @ mount.T @ commanded.transpose(0, 2, 1)
    return float(np.median(Rotation.from_matrix(apart).magnitude()))


def _otherwise(vectors: Array) -> Iterator[tuple[str, Array]]:
    """Other signs and orders of the three columns: in words for ``columns``, and the rotation vectors (n, 3)."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        names = (f"{'-' if s < 0 else ''}{ORIENTATION[k]}" for k, s in zip(order, signs, strict=True))
        text = ",".join(f"{ours}={theirs}" for ours, theirs in zip(ORIENTATION, names, strict=True))
        yield text, vectors[:, order] * signs
