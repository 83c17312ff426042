"""Stations that were moved a little on the way: lengths that all errors of the machine explain only place by place.

Large moves are refused where a station is placed. Smaller ones hide in the machine's errors and are looked for beside
these: every parameter of the machine and of the set-up, and play of every joint, act alike on both sides of a border;
what the station's place changes does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.channels import direction
from errormodel.observations.moved_station import border
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import length
from identification.observation.models import View
from identification.observation.readings import ReadingView

PLACE = ("x", "y", "z")
FREE = 10  # degrees of freedom at least: fewer readings follow any model
GAIN = 4.0  # times less variance must a move leave than none: what a machine does besides its model seldom is a step
SUDDEN = 2.0  # times less than a move that goes on over all rows: a drift is none
CERTAIN = 30.0  # ratio of mean squares; the best of 1000 borders reaches 12 by chance once in 1000 surveys


@dataclass(frozen=True)
class MovedStation:
    """From `row` of `file` on, the lengths of `label` fit a place `shift_um` beside the one before."""

    label: str
    file: str
    row: int
    shift_um: float

    @property
    def text(self) -> str:
        """A sentence for a proof or a note."""
        return (
            f"{self.label}: from row {self.row} of {self.file} on the lengths fit a place about "
            f"{length(self.shift_um)} beside the one before, and no error of the machine explains both: the station or "
            "the target was moved there. "
            "Declare one station more (a run of their own, and station: per-run, dead_path: per-run)"
        )


def moved_stations(survey: Survey, views: Sequence[View]) -> Iterator[MovedStation]:
    """Stations whose lengths fit two places, before and behind a row; by a comparison of models at each row."""
    places: dict[str, list[ReadingView]] = {}
    for view in views:
        if isinstance(view, ReadingView) and {*PLACE} <= {*view.free}:
            column = view.columns[len(view.ids) + view.free.index("x")]
            places.setdefault(column, []).append(view)
    for own in places.values():
        found = _move(survey, sorted(own, key=lambda v: int(v.index[0])))
        if found is not None:
            first, shift = found
            row = survey.table.iloc[first]
            yield MovedStation(own[0].label, str(row["file"]), int(row["row"]), 1e3 * shift)


def _move(survey: Survey, views: Sequence[ReadingView]) -> tuple[int, float] | None:
    """The survey row before which a station was moved, and by how much, mm."""
    names = list(dict.fromkeys(c for view in views for c in view.columns))
    known, changes, gap = [], [], []
    for view in views:
        design = view.design(False)(view.rows, view.at_zero).T
        own = np.zeros((len(view), len(names)))
        own[:, [names.index(c) for c in view.columns]] = design
        known.append(own)
        changes.append(design[:, [len(view.ids) + view.free.index(n) for n in view.free]])
        gap.append(np.concatenate([part[0] for _, part in view.gaps(view.at_zero)]))
    index, base, steps, left = _in_order(survey, views, known, changes, gap)
    chain = views[0].chain
    sides = [np.nan_to_num(direction(survey.table, j.name)[index]) for j in chain.machine.joints]
    base = np.column_stack([base, *(steps[:, :3] * side[:, None] for side in sides if np.ptp(side) > 0)])
    low, high = np.quantile(left, [0.02, 0.98])  # single readings far off decide nothing
    left = np.clip(left, low, high)
    found = border(base, steps, left)
    if found is None:
        return None
    first, n, m = found[0], len(left), steps.shape[1]
    behind = (np.arange(n) >= first)[:, None]
    none, rank = _residual(base, left)
    move, _ = _residual(np.column_stack([base, steps * behind]), left)
    slow, _ = _residual(np.column_stack([base, steps * np.linspace(-1, 1, n)[:, None]]), left)
    free = n - rank - m
    if free < FREE or GAIN * move > none or SUDDEN * move > slow or (none - move) / m < CERTAIN * move / free:
        return None
    x = np.linalg.lstsq(np.column_stack([base, steps * behind]), left, rcond=1e-9)[0]
    return int(index[first]), float(np.linalg.norm(x[-m:][:3]))


def _in_order(
    survey: Survey, views: Sequence[ReadingView], known: list[Array], changes: list[Array], gap: list[Array]
) -> tuple[Index, Array, Array, Array]:
    """All of them, run after run as these come, each in the order of the survey's rows."""
    index = np.concatenate([v.index for v in views])
    runs = survey.table["run"].astype(str).to_numpy()[index]
    first = {run: int(index[runs == run].min()) for run in set(runs.tolist())}
    order = np.lexsort((index, np.array([first[r] for r in runs])))
    return index[order], np.vstack(known)[order], np.vstack(changes)[order], np.concatenate(gap)[order]


def _residual(columns: Array, values: Array) -> tuple[float, int]:
    """Sum of squares that columns leave of values, and their rank."""
    scale = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(scale > 0, scale, 1.0), full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    return float(np.sum((values - u @ (u.T @ values)) ** 2)), u.shape[1]
