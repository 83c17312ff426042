"""Fit of a survey larger than memory: a sample of its rows is fitted, and one pass over all rows completes the fit.

The pass sums up, at the values of the sample's fit, the normal equations, the sizes of residuals and the like
(`totals`); the solution for all rows follows from the sums (`expansion`). What depends on each row by itself in another
way is not done here: robust weights, single outliers, correlation along the whole survey.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
import pandas as pd

from errormodel.arrays import Array, as_rows
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey_rows import WHOLE, SurveyRows, ranges_of
from errormodel.yamlfile import Document
from identification.bayes.settings import PriorForm
from identification.diagnosis.data_checks.gate import passed
from identification.diagnosis.data_checks.rows import OWN_FILE, OWN_RUN
from identification.estimation.bounded import bounded
from identification.estimation.checks import WILD, WILD_FROM, another, far_off, looked_over
from identification.estimation.fit import HELDOUT_BLOCK_ROWS, fit_machine, look_at, moved, placed
from identification.estimation.lacking_channels import lacking_notes
from identification.estimation.least_squares import Solution
from identification.estimation.noise import correlated
from identification.estimation.notes import fit_notes
from identification.estimation.result import Fit, Spread, Streamed, residuals_of
from identification.estimation.scaled_equations import determined_step
from identification.observation.assembly import Problem, determined_columns, frame_columns
from identification.observation.frames import rotation_notes
from identification.observation.models import PositionView
from identification.observation.normal_equations import accumulate
from identification.observation.open_signs import sign_notes
from identification.observation.pose import Pose
from identification.observation.stated_tip import tip_notes
from identification.runtime.blas import one_blas_thread
from identification.runtime.engines import Crew
from identification.streaming.expansion import KIND, ExpandedSolver, Expansion, best_frames, frame_sums
from identification.streaming.sample import MOST_HELD_OUT_ROWS, SAMPLE_ROWS, middle_of, sample_of
from identification.streaming.totals import Totals, combined, whole_of
from identification.streaming.work import BLOCK_ROWS, SEGMENT_ROWS, Task, totals_of, views_of

LARGE_BLOCK_ROWS = 1 << 13  # rows left out together where the sample is not all of them: smaller blocks take time
MOST_FOLDS = 512  # blocks of rows that are left out in turn: limits the memory for their sums
MOST_PASSES = 4
DOUBT = 0.01  # standard uncertainties: what a sample leaves open of the second order, below which no pass is added
MOST_NOTES = 12  # on rows, that are kept
BEFORE_LAST_STEP = "mean and largest residual are those before the last step of the parameters"


@dataclass(frozen=True)
class Sizing:
    """Rows at a time; the result is the same to rounding for all (and tests show it)."""

    sample: int = SAMPLE_ROWS
    segment: int = SEGMENT_ROWS
    block: int = BLOCK_ROWS


def fit_rows(
    machine: Machine,
    rows: SurveyRows,
    bounds: Mapping[str, PriorForm] | None = None,
    document: Document | None = None,
    *,
    crew: Crew | None = None,
    report: Callable[[float, str], None] = lambda _share, _text: None,
    sizing: Sizing | None = None,
) -> Fit:
    """Fit a machine to rows that are read a range at a time.

    Parameters
    ----------
    bounds, document : as of `identification.estimation.fit.fit_machine`.
    crew : who works; None: this process.
    report : called with the share done and a remark.

    Returns
    -------
    Fit
        Whose survey and residuals are those of the sample; all else is of all rows.

    Raises
    ------
    InputError
        The rows are wrong, or cannot be fitted in this way: the message says why.
    """
    with one_blas_thread():
        return _Streaming(
            machine, rows, bounds or {}, document, crew or Crew(workers=1), report, sizing or Sizing()
        ).run()


class _Streaming:
    """State of one fit; the parameters are those of `fit_rows`."""

    def __init__(
        self,
        machine: Machine,
        rows: SurveyRows,
        bounds: Mapping[str, PriorForm],
        document: Document | None,
        crew: Crew,
        report: Callable[[float, str], None],
        sizing: Sizing,
    ) -> None:
        self.machine, self.rows, self.bounds, self.document = machine, rows, bounds, document
        self.crew, self.report, self.sizing, self.begun = crew, report, sizing, perf_counter()
        held_out = sum(f.count for f in rows.files if f.entry.role == "test")
        if held_out > MOST_HELD_OUT_ROWS:
            found = f"{held_out} rows to hold out, which are read as a whole"
            raise InputError(str(rows.source), found, f"Give at most {MOST_HELD_OUT_ROWS} rows the role test")
        self.survey, self.numbers = sample_of(rows, sizing.sample)
        try:
            self.first = passed(machine, self.survey, lambda: fit_machine(machine, self.survey))
        except InputError as error:
            if OWN_RUN not in error.cure:
                raise
            raise InputError(error.where, error.found, OWN_FILE) from error
        if any(not isinstance(v, PositionView) for v in self.first.problem.views):
            raise InputError(str(rows.source), "rows that are no positions", f"Take them out, or {WHOLE}")
        self.chain: Chain = self.first.chain
        self.place = self.first.problem.place()
        self.zero = np.zeros(len(self.chain.ids))
        self.edges = self.fold_edges()

    def fold_edges(self) -> tuple[int, ...]:
        count = len(self.rows)
        size = HELDOUT_BLOCK_ROWS if count <= self.sizing.sample else LARGE_BLOCK_ROWS
        folds = min(max(10, round(count / size)), count, MOST_FOLDS)
        size, more = divmod(count, folds)
        return tuple(k * size + min(k, more) for k in range(folds + 1))

    def run(self) -> Fit:
        problem, values = self.first.problem, self.first.solution.values
        reading = computing = 0.0
        for passes in range(1, MOST_PASSES + 1):
            totals = self.pass_(problem, values, passes)
            reading, computing = reading + totals.reading, computing + totals.computing
            expansion = self.expansion(problem, values, totals)
            expansion, nominal_square, problem = self.anchored(problem, expansion, totals)
            solution = self.solution(problem, expansion, totals)
            if expansion.doubt(solution.values, solution.groups.base, solution.sigma[KIND]) <= DOUBT:
                break
            values = solution.values
        step = solution.values - expansion.values + expansion.shift
        weight = expansion.whole.count if KIND not in solution.declared else self.weight(totals)
        moved_mm = float(np.sqrt(max(float(step @ expansion.whole.gram @ step), 0.0) / weight * 3))
        kept = replace(self.kept(totals, passes, moved_mm), reading=reading, computing=computing)
        return self.result(problem, solution, expansion, totals, kept, nominal_square)

    def weight(self, totals: Totals) -> float:
        """Mean weight of a coordinate times their number, where rows have weights."""
        views = self.first.problem.views
        squares = np.concatenate([np.square(v.whitener).reshape(len(v), -1).sum(axis=1) for v in views])
        ones = 3.0 if all(v.whitener.ndim == 1 for v in views) else 1.0
        return float(squares.mean()) * ones * totals.before.count

    def pass_(self, problem: Problem, values: Array, number: int) -> Totals:
        size = self.chain.size
        usual = np.linalg.norm(self.first.nominal_residuals, axis=1)
        usual = usual[np.isfinite(usual)]
        wild = max(WILD * float(np.quantile(usual, 0.8)), WILD_FROM * size) if len(usual) else np.inf
        task = Task(
            self.rows, problem.frames, problem.unknowns, values, self.edges, KIND in problem.declared, wild,
            self.sizing.block,
        )  # fmt: skip
        packed = pickle.dumps(task)
        jobs = [(packed, start, stop) for start, stop in ranges_of(len(self.rows), self.sizing.segment)]
        parts: list[Totals | None] = [None] * len(jobs)
        what = "" if number == 1 else f", pass {number}"
        done, begun = 0, perf_counter()
        for k, result in self.crew.each(totals_of, jobs):
            if isinstance(result, Exception):
                raise result
            parts[k] = result
            done += result.rows
            self.report(done / len(self.rows), f"{done} rows, {done / (perf_counter() - begun):.0f} a second{what}")
        totals = combined([p for p in parts if p is not None])
        if totals.wild:
            file, row, _ = totals.wild_rows[0]
            farthest = max(distance for *_, distance in totals.wild_rows)
            listed = ", ".join(str(r) for _, r, _ in totals.wild_rows)
            several = f"rows {listed}{' ...' if totals.wild > len(totals.wild_rows) else ''} lie"
            raise InputError(
                f"{file}, columns mx my mz",
                f"{several if totals.wild > 1 else f'row {row} lies'} up to {farthest:.3g} mm from where the other "
                f"{totals.rows - totals.wild} rows put the nominal machine",
                "Leave mx my mz empty in these rows; `fit --robust`, which weighs rows, does not stream",
            )
        return totals

    def expansion(self, problem: Problem, values: Array, totals: Totals) -> Expansion:
        count = len(problem.unknowns)
        sample = accumulate(problem.views, self.place, values, self.zero)[KIND]
        whole = whole_of(totals.folds, count)
        return Expansion(whole, sample, values, np.zeros(count), problem.views, self.place, self.zero)

    def anchored(
        self, problem: Problem, expansion: Expansion, totals: Totals
    ) -> tuple[Expansion, float | None, Problem]:
        """The frames where they fit the machine without errors best, by all rows, and the sum of squares there."""
        if not problem.frames:
            return expansion, None, problem
        names = [c for label in problem.frames for c in frame_columns(self.chain, label)]
        columns = [self.place[c] for c in names]
        own = totals.nominal
        of_frames = frame_sums(expansion, columns, own.slope, own.square, own.count)
        free = [c for la, pose in problem.frames.items() for c in determined_columns(self.chain, la, pose)]
        if expansion.each == 1.0:  # the sample is all rows: its frames are the best ones
            return expansion, own.square, problem
        best, square = best_frames(of_frames, free)
        named = dict(zip(names, best.tolist(), strict=True))
        poses: dict[str, Pose] = {la: moved(self.chain, p, named, la) for la, p in problem.frames.items()}
        problem = replace(placed(problem, poses), frames=poses)
        shift = np.zeros(len(problem.unknowns))
        shift[columns] = best
        return replace(expansion, shift=shift, views=problem.views), square, problem

    def solution(self, problem: Problem, expansion: Expansion, totals: Totals) -> Solution:
        """Least squares; rows outside the sample may tell parameters apart that the sample does not.

        Raises
        ------
        InputError
            Only rows that are not kept tell some parameters apart.
        """
        for further in ([], [self.outside(problem, totals)]):
            solver = ExpandedSolver(problem, np.zeros(len(problem.unknowns)), expansion, further)
            solution = solver.run()
            if not solver.missed(solution.groups, solution.sums):
                return solution
        found = "parameters that only a few of its rows tell apart"
        raise InputError(str(self.rows.source), found, f"Measure more such rows, or {WHOLE}")

    def outside(self, problem: Problem, totals: Totals) -> PositionView:
        """Rows with the outermost commands of each range, as a view for deciding the rank."""
        like = next(v for v in problem.views if isinstance(v, PositionView))
        count = len(totals.extremes)
        level = float(np.abs(like.whitener).max(initial=0.0))
        return replace(
            like, rows=as_rows(*totals.extremes.T), whitener=np.full(count, level), measured=np.zeros((count, 3)),
            index=np.zeros(count, dtype=np.intp), fixed={},
        )  # fmt: skip

    def kept(self, totals: Totals, passes: int, moved_mm: float) -> Streamed:
        """What is known of all rows beside the solution."""
        ranges = pd.DataFrame({name: list(ends) for name, ends in totals.ranges.items()})
        counts = {f.label: f.count for f in self.rows.files if f.entry.role == "fit"}
        steps = np.zeros((len(self.edges) - 1, len(self.place)))
        return Streamed(
            totals.rows, counts, ranges, passes, moved_mm, 0.0, 0.0, perf_counter() - self.begun, self.edges, steps
        )

    def result(
        self, problem: Problem, solution: Solution, expansion: Expansion, totals: Totals, kept: Streamed,
        nominal_square: float | None,
    ) -> Fit:  # fmt: skip
        chain, first = self.chain, self.first
        window = self.window(problem)
        solution, noise = correlated(window, solution, solution.sums[KIND].count // 3 if window is not problem else 0)
        solution, at_bound, dropped = bounded(chain, solution, self.bounds, self.document)
        steps, squares = self.without_each_fold(solution, expansion, totals, [b.id for b in at_bound])
        kept = replace(kept, steps=steps)
        plain = KIND not in solution.declared
        count = totals.before.count
        folds = totals.folds if plain else totals.plain
        step = solution.values - expansion.values + expansion.shift
        after = whole_of(folds, len(step)).moved(np.arange(len(step)), step).square
        before = nominal_square if plain and nominal_square is not None else totals.before.square
        nominal = _spread(before, totals.before.total, totals.before.largest, count)
        fitted = _spread(after, totals.after.total, totals.after.largest, count)
        heldout = _spread(float(sum(squares)), np.nan, np.nan, count)
        residuals = residuals_of(problem.views, self.place, solution.values, self.zero, len(first.survey))
        nominal_residuals = residuals_of(problem.views, {}, np.zeros(0), self.zero, len(first.survey))
        survey = replace(self.survey, notes=_few((*self.survey.notes, *totals.notes)))
        longest = max(kept.files.values())
        notes = (
            *fit_notes(survey, solution, noise, longest),
            *dropped,
            *rotation_notes(problem.frames),
            *sign_notes(problem.views, survey.indicated),
            *tip_notes(chain.machine, first.survey, problem.views),
        )
        if another(chain, nominal):
            notes = (*notes, far_off(nominal))
        notes = (*notes, *(b.statement for b in at_bound), *_of_stream(kept, len(first.survey)))
        fit = Fit(
            chain, first.survey, problem, solution, nominal, fitted, heldout, len(squares), residuals,
            nominal_residuals, self.heldout_residuals(problem, solution, steps), notes=notes, at_bound=at_bound,
            counted=problem.views, streamed=kept,
        )  # fmt: skip
        judged = [test for test in self.survey.test if np.isfinite(test.measured).any()]
        more = [note for test in judged for note in lacking_notes(chain, test)]
        return looked_over(replace(fit, tests=tuple(look_at(fit, t) for t in judged), notes=(*fit.notes, *more)))

    def window(self, problem: Problem) -> Problem:
        """The problem with rows that follow each other, for the correlation of the noise."""
        if len(self.numbers) == len(self.rows):
            return problem
        views = views_of(self.chain, middle_of(self.rows), problem.frames, KIND in problem.declared)
        return replace(problem, views=tuple(views))

    def without_each_fold(
        self, solution: Solution, expansion: Expansion, totals: Totals, fixed: list[str]
    ) -> tuple[Array, list[float]]:
        """Steps of the fit when each block of rows is left out, and the sum of squares (mm^2) of its residuals then.

        As `identification.estimation.fit.held_out`, from the sums of the blocks.
        """
        level, count = solution.sigma[KIND], len(solution.values)
        base = solution.groups.base
        base = base[~np.isin(np.array(solution.unknowns)[base], fixed)]
        pick, every = np.ix_(base, base), np.arange(count)
        gram = solution.sums[KIND].gram[pick] / level**2 + np.diag(solution.precision[base])
        scale = 1 / np.sqrt(np.diag(gram))
        step = solution.values - expansion.values + expansion.shift
        steps, squares = np.zeros((len(self.edges) - 1, count)), list[float]()
        for fold in range(len(self.edges) - 1):
            if fold not in totals.folds:  # nothing was measured there
                continue
            own = totals.folds[fold].moved(every, step)
            less, slope = gram - own.gram[pick] / level**2, -own.slope[base] / level**2
            back = determined_step(less, slope, scale)
            steps[fold, base] = back
            plain = own if KIND not in solution.declared else totals.plain[fold].moved(every, step)
            squares.append(plain.moved(base, back).square)
        return steps, squares

    def heldout_residuals(self, problem: Problem, solution: Solution, steps: Array) -> Array:
        """Residuals (rows, 3) of the sample's rows, each by the fit without its block."""
        out = np.full((len(self.first.survey), 3), np.nan)
        fold = np.searchsorted(self.edges, self.numbers, side="right") - 1
        for number in np.unique(fold):
            views = [v.part(fold[v.index] == number) for v in problem.views]
            own = residuals_of(
                [v for v in views if len(v)], self.place, solution.values + steps[number], self.zero, len(out)
            )
            out[fold == number] = own[fold == number]
        return out


def _spread(square: float, total: float, largest: float, count: int) -> Spread:
    """Statistics from sums of lengths, mm; NaN for what is not known."""
    return Spread(1e3 * float(np.sqrt(max(square, 0.0) / count)), 1e3 * total / count, 1e3 * largest, count)


def _few(notes: tuple[str, ...]) -> tuple[str, ...]:
    """The first notes, each once, and how many more there are."""
    each = tuple(dict.fromkeys(notes))
    return each if len(each) <= MOST_NOTES else (*each[:MOST_NOTES], f"and {len(each) - MOST_NOTES} more notes on rows")


def _of_stream(kept: Streamed, sample: int) -> tuple[str, ...]:
    if kept.rows == sample:
        return ()
    times = "once" if kept.passes == 1 else f"{kept.passes} times"
    return (
        f"streamed: all {kept.rows} rows were read {times} and are in the estimates; figures, residuals.csv and the "
        f"search for mistakes are of {sample} rows, evenly spread",
        f"{BEFORE_LAST_STEP}, which moves the points by {1e3 * kept.moved_mm:.2g} um rms",
    )
