"""The work on one range of rows: read, checked, and summed up; done here, or in other processes."""

from __future__ import annotations

import pickle
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from time import thread_time

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import root
from errormodel.exceptions import InputError
from errormodel.kernel import of_rows
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.survey_rows import SurveyRows, ranges_of
from identification.observation.assembly import build, frame_columns
from identification.observation.models import GapView, PositionView, View
from identification.observation.normal_equations import accumulate
from identification.observation.pose import Pose
from identification.observation.sums import Sums
from identification.runtime.parallel import one_core
from identification.streaming.totals import MOST_WILD, Sizes, Totals, added, outermost

SEGMENT_ROWS = 1 << 20  # rows of one job: the sums of so many are combined in the tree
BLOCK_ROWS = 1 << 17  # rows that are in memory at a time: some tens of MB


@dataclass(frozen=True)
class Task:
    """What all jobs of one pass have in common.

    Attributes
    ----------
    rows : the survey.
    frames : pose of each measuring frame, by label.
    unknowns, values : names of all unknowns, and where the residual is taken, mm and rad.
    edges : first row of each block that is left out together, and at last the number of rows.
    declared : whether the survey states the uncertainty of positions.
    wild : distance (mm) from the nominal point beyond which a row is none of this machine's.
    block : rows in memory at a time.
    """

    rows: SurveyRows
    frames: Mapping[str, Pose]
    unknowns: tuple[str, ...]
    values: Array
    edges: tuple[int, ...]
    declared: bool
    wild: float
    block: int = BLOCK_ROWS

    @property
    def machine(self) -> Machine:
        return self.rows.machine


@lru_cache(maxsize=2)
def _opened(task: bytes) -> tuple[Task, Chain]:
    """A task and its chain: a process compiles it once for all of its jobs."""
    given: Task = pickle.loads(task)  # it comes from the process that started this one
    return given, Chain(given.machine)


def totals_of(job: tuple[bytes, int, int]) -> Totals:
    """Statistics of the rows from a first to before a last one, of a pickled :class:`Task`."""
    task, chain = _opened(job[0])
    with of_rows(task.edges[-1]), one_core():  # other processes have the others
        return _summed(task, chain, *job[1:])


def _summed(task: Task, chain: Chain, start: int, stop: int) -> Totals:
    out = Totals()
    begun = thread_time()
    for low, high in ranges_of(stop - start, task.block):
        survey = task.rows.survey((start + low, start + high))
        read = thread_time()
        block = _of_block(task, chain, survey, start + low)
        block.reading, block.computing = read - begun, thread_time() - read
        out.add(block)
        begun = thread_time()
    return out


def views_of(chain: Chain, survey: Survey, frames: Mapping[str, Pose], declared: bool) -> list[PositionView]:
    """Views of a block of rows in known frames; none where nothing was measured.

    Raises
    ------
    InputError
        Its uncertainty is stated and that of other rows is not, or the other way round.
    """
    if not np.isfinite(survey.measured).any():
        return []
    problem = build(chain, survey, poses=frames)
    if ("position" in problem.declared) != declared:
        row = survey.table.iloc[0]
        found = "rows with a standard uncertainty in one part of the survey, and without in another"
        raise InputError(f"{row['file']}, from row {row['row']}", found, "Give sigma in every row or in none")
    return [v for v in problem.views if isinstance(v, PositionView)]


def _of_block(task: Task, chain: Chain, survey: Survey, start: int) -> Totals:
    out = Totals(rows=len(survey), notes=dict.fromkeys(survey.notes))
    place = {name: k for k, name in enumerate(task.unknowns)}
    zero = np.zeros(len(chain.ids))
    labels = {} if survey.frame == "fixed" else task.frames
    frames = {c: k for k, c in enumerate(c for label in labels for c in frame_columns(chain, label))}
    out.nominal = Sums.zero(len(frames))
    for name in dict.fromkeys((*(j.name for j in chain.machine.joints), *map(root, chain.channels))):
        if name in survey.table:
            column = survey.table[name].to_numpy(dtype=np.float64)
            if np.isfinite(column).any():
                out.ranges[name] = float(np.nanmin(column)), float(np.nanmax(column))
    for view in views_of(chain, survey, task.frames, task.declared):
        out.extremes = outermost(np.vstack([e for e in (out.extremes, outermost(np.transpose(view.rows))) if len(e)]))
        before, lengths = _residuals(view, zero)
        out.before.add(Sizes.of(lengths))
        wild = np.flatnonzero(lengths > task.wild)
        out.wild += len(wild)
        rows = survey.table.iloc[view.index[wild[: MOST_WILD - len(out.wild_rows)]]]
        out.wild_rows += list(
            zip(rows["file"], rows["row"].tolist(), lengths[wild].tolist(), strict=False)
        )  # fmt: skip
        if frames:
            # at zero errors only the frame's own columns are needed
            own = replace(before, ids=chain.frame_ids, columns=view.columns[:6])
            own_sums = accumulate(
                [own], frames, np.zeros(len(frames)), zero, gram=False, exact=not isinstance(own, GapView)
            )
            out.nominal = added(out.nominal, own_sums["position"])
        after, lengths = _residuals(view, view.vector(place, task.values, zero))
        out.after.add(Sizes.of(lengths))
        for fold, part in _by_fold(after, start, task.edges):
            sums = _at(part, place, task.values, zero)
            out.folds[fold] = added(out.folds[fold], sums) if fold in out.folds else sums
            if task.declared:
                sums = _at(unweighted(part), place, task.values, zero)
                out.plain[fold] = added(out.plain[fold], sums) if fold in out.plain else sums
    return out


def _at(view: View, place: Mapping[str, int], values: Array, zero: Array) -> Sums:
    """Sums of a view at the values at which its residuals are kept, if they are."""
    kept = isinstance(view, GapView)
    return accumulate([view], place, values, zero, exact=not kept, taken=values if kept else None)["position"]


def _residuals(view: PositionView, p: Array) -> tuple[View, Array]:
    """The view with its residuals at the chain's parameters `p` kept where it can be, and their lengths (n,), mm."""
    kept = GapView.of(view, p)
    lengths: Array = np.sqrt(np.einsum("cn,cn->n", kept.gap, kept.gap))
    if view.whitener.ndim == 1:
        return kept, lengths
    left = (view.pose.rotation @ kept.gap) * view.components.T  # in the measuring frame, without what was not measured
    return view, np.sqrt(np.einsum("cn,cn->n", left, left))


def unweighted(view: View) -> View:
    """The view with weight 1 for all that was measured."""
    if view.whitener.ndim == 1:
        return replace(view, whitener=np.ones(len(view)))
    return replace(view, whitener=np.einsum("ni,ij->nij", view.components.astype(float), np.eye(3)))


def _by_fold(view: View, start: int, edges: tuple[int, ...]) -> Iterator[tuple[int, View]]:
    """Parts of a view in each block that is left out together; `start` is the number of its survey's first row."""
    rows = view.index + start
    first, last = bisect_right(edges, int(rows[0])) - 1, bisect_right(edges, int(rows[-1])) - 1
    cuts = np.searchsorted(rows, edges[first : last + 2])
    for fold, low, high in zip(range(first, last + 1), cuts, cuts[1:], strict=False):
        if low < high:
            yield fold, view if high - low == len(view) else view.part(slice(int(low), int(high)))
