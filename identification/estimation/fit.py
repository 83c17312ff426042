"""Fit of a machine to a survey: frames, least squares or robust estimation, bounds, held-out and test residuals.

Residuals are measured minus predicted, in mm in the measuring frame. Steps: assembly of the problem, alignment of the
frames, estimation, correction for correlated noise, bounds, cross-validation by blocks of rows, test files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.yamlfile import Document
from identification.bayes.settings import PriorForm
from identification.estimation.bounded import bounded
from identification.estimation.checks import another, check_enough, check_redundant, check_runs, far_off
from identification.estimation.lacking_channels import judged_without, lacking_notes
from identification.estimation.least_squares import Solution, solve
from identification.estimation.motions import Motions, before_fit, motion_residuals
from identification.estimation.noise import correlated
from identification.estimation.notes import fit_notes, idle_effects
from identification.estimation.outliers import sort_rows
from identification.estimation.readings import Readings, reading_residuals
from identification.estimation.replaced_effect import refitted
from identification.estimation.result import Fit, Spread, TestFile, residuals_of
from identification.estimation.robust import first_judgement, settle
from identification.estimation.scaled_equations import determined_step
from identification.estimation.weights import Judgement
from identification.observation.assembly import Problem, build, determined_columns, frame_columns, frame_labels
from identification.observation.frames import rotation_notes
from identification.observation.models import MotionView, OrientationView, PositionView, View
from identification.observation.normal_equations import accumulate, total
from identification.observation.open_signs import sign_notes
from identification.observation.pose import IDENTITY, Pose
from identification.observation.readings import ReadingView
from identification.observation.stated_tip import tip_notes
from identification.runtime.blas import one_blas_thread

# Consecutive rows left out together in large surveys, a tenth of the rows in small ones; by judgement
HELDOUT_BLOCK_ROWS = 600
# Of a column's square sum, outside a block: of less its zero is the block's own, as that of a run is. M of readings is
# taken at other values in a block than in all rows, and what is left of products of such columns would be no zero
SEEN_ELSEWHERE = 1e-9
SMALL_STEP = 1e-3  # of a step, for its derivative: errors of second order and of rounding are far below any noise


def fit_machine(
    machine: Machine,
    survey: Survey,
    robust: bool = False,
    bounds: Mapping[str, PriorForm] | None = None,
    document: Document | None = None,
    *,
    effect_sizes: float | None = None,
    other_runs: bool = False,
) -> Fit:
    """Fit all parameters, frames and noise levels to the survey's fit rows, and evaluate its test files.

    Parameters
    ----------
    robust : estimate robustly: outliers get weight zero and are listed.
    bounds : the user's bounds by parameter name, in place of physical ones; `document`: their file, for messages.
    effect_sizes : standard deviation of a normal prior about zero of the parameters of effects, in units of their
        physical sizes; None: no prior.
    other_runs : whether runs that effects belong to may have no rows here, so that the effects are not there.

    Returns
    -------
    Fit
        Estimates, covariance, residuals and notes.

    Raises
    ------
    InputError
        The survey has no rows to fit or no more equations than identifiable unknowns, a bound names an unknown
        parameter, or (robust) most rows are outliers.
    """
    with one_blas_thread():  # blocks are small: one thread is fastest
        return _fit(Chain(machine), survey, robust, bounds or {}, document, effect_sizes, other_runs)


def fit_if_possible(machine: Machine, survey: Survey, robust: bool = False) -> Fit | None:
    """The fit to a survey with a mistake in it, which need not be possible."""
    try:
        return fit_machine(machine, survey, robust)
    except (InputError, np.linalg.LinAlgError):
        return None


def _fit(
    chain: Chain,
    survey: Survey,
    robust: bool,
    bounds: Mapping[str, PriorForm],
    document: Document | None,
    effect_sizes: float | None,
    other_runs: bool,
) -> Fit:
    rows = survey.fit
    if not len(rows):
        raise InputError(str(survey.source), "no file has role: fit", "Give at least one file the role fit")
    check_runs(chain, rows, other_runs)
    problem = build(chain, rows).storing_design()
    judged = None
    if robust:
        check_redundant(rows, problem)
        judged = first_judgement(chain, problem.views, problem.unknowns, None, problem.declared)
    problem, nominal_residuals = anchored(problem, len(rows), judged=judged)
    if judged is None:
        solution = solve(chain, problem.views, problem.unknowns, declared=problem.declared, effect_sizes=effect_sizes)
        weighted = problem
    else:
        solution, judged = settle(chain, problem.views, problem.unknowns, None, problem.declared, judged)
        weighted = replace(problem, views=judged.weigh(problem.views))
    solution, noise = correlated(weighted, solution)
    if sum(s.count for s in solution.sums.values()) <= len(problem.unknowns):
        check_enough(survey, problem, solution)
    solution, at_bound, dropped = bounded(chain, solution, bounds, document)
    place, zero = problem.place(), np.zeros(len(chain.ids))
    residuals = residuals_of(problem.views, place, solution.values, zero, len(rows))
    heldout, folds = held_out(weighted, solution, len(rows), [b.id for b in at_bound])
    motions = None
    if any(isinstance(v, MotionView) for v in problem.views):
        left_out, _ = held_out(weighted, solution, len(rows), [b.id for b in at_bound], motion_residuals)
        motions = Motions(
            before_fit(problem.views, place, zero, len(rows)),
            motion_residuals(problem.views, place, solution.values, zero, len(rows)),
            left_out,
        ).without(problem.views, judged)
    readings = None
    if problem.readings:
        left_out, _ = held_out(weighted, solution, len(rows), [b.id for b in at_bound], reading_residuals)
        readings = Readings(
            nominal_readings(problem, len(rows), judged),
            reading_residuals(problem.views, place, solution.values, zero, len(rows)),
            left_out,
        ).without(problem.views, judged)
    sorting = None
    if judged is not None:
        sorting = sort_rows(rows, problem.views, judged, residuals, nominal_residuals)
        residuals, nominal_residuals, heldout = map(sorting.without, (residuals, nominal_residuals, heldout))
    notes = (
        *fit_notes(survey, solution, noise, max(map(len, problem.views))),
        *dropped,
        *idle_effects(chain, solution),
        *rotation_notes(problem.frames),
        *sign_notes(problem.views, survey.indicated),
        *tip_notes(chain.machine, survey, problem.views),
    )
    nominal = Spread.of(nominal_residuals)
    far = (far_off(nominal),) if another(chain, nominal) else ()
    notes = (*notes, *far, *(b.statement for b in at_bound))
    fit = Fit(
        chain, rows, problem, solution, nominal, Spread.of(residuals), Spread.of(heldout), folds,
        residuals, nominal_residuals, heldout, notes=notes, sorting=sorting, at_bound=at_bound,
        counted=weighted.views, motions=motions, readings=readings, serial=noise,
    )  # fmt: skip
    tests, more = list[TestFile](), list[str]()
    for test in survey.test:
        if np.isfinite(test.measured).any():
            tests.append(look_at(fit, test))
            more += lacking_notes(chain, test)
        else:
            name = test.table["file"].iloc[0]
            what = "single readings" if survey.observations else "error motions"
            cure = (
                "predict their set-ups with `errormodel predict`"
                if survey.observations
                else ("`errormodel thermal` does it where they drift")
            )
            more.append(f"{name} holds {what} only, each from a zero of its own: not judged here; {cure}")
    return replace(fit, tests=tuple(tests), notes=(*fit.notes, *more))


def parameters_of(machine: Machine, fit: Fit, effect_sizes: float | None = None) -> dict[str, float]:
    """All parameters by name, mm and rad, of another machine that is fitted to the rows of a fit, in its frames.

    Parameters
    ----------
    effect_sizes : as of `fit_machine`.
    """
    with one_blas_thread():
        chain = Chain(machine)
        problem = build(chain, fit.survey, mount=fit.problem.mount, poses=fit.problem.frames).storing_design()
        if (found := refitted(chain, problem, fit, effect_sizes)) is not None:
            return found
        own = solve(chain, problem.views, problem.unknowns, declared=problem.declared, effect_sizes=effect_sizes)
    return own.named()


def anchored(
    problem: Problem, rows: int, held: Array | None = None, judged: Judgement | None = None
) -> tuple[Problem, Array]:
    """The problem with its frames aligned by least squares to the machine with parameters `held` (None: nominal).

    Small frame parameters are relative to these poses. Also returned are the residuals (rows, 3), mm: the error of that
    machine. With `judged`, rows have their robust weights.
    """
    held = np.zeros(len(problem.chain.ids)) if held is None else held
    weighted = problem.views if judged is None else judged.weigh(problem.views)
    points = [v for v in weighted if isinstance(v, PositionView) or (isinstance(v, ReadingView) and v.in_frame)]
    poses = dict(problem.frames)
    free = [c for label, pose in poses.items() for c in determined_columns(problem.chain, label, pose)]
    if free:
        free += dict.fromkeys(c for v in points if isinstance(v, ReadingView) for c in v.starts)
        best = solve(problem.chain, points, free, held, problem.declared & {v.kind for v in points}).named()
        poses = {label: moved(problem.chain, pose, best, label) for label, pose in poses.items()}
    out = replace(placed(problem, poses), frames=poses)
    return out, residuals_of(out.views, {}, np.zeros(0), held, rows)


def nominal_readings(problem: Problem, rows: int, judged: Judgement | None) -> Array:
    """Residuals (rows,) of readings of the machine without errors, the unknowns of the set-ups as they fit it best."""
    zero = np.zeros(len(problem.chain.ids))
    views = (
        problem.readings if judged is None else [v for v in judged.weigh(problem.views) if isinstance(v, ReadingView)]
    )
    free = tuple(dict.fromkeys(c for v in problem.readings for c in v.starts))
    if not free:
        return reading_residuals(problem.views, {}, np.zeros(0), zero, rows)
    best = solve(problem.chain, views, free, zero, problem.declared)
    place = {name: k for k, name in enumerate(free)}
    return reading_residuals(problem.views, place, best.values, zero, rows)


def moved(chain: Chain, pose: Pose, values: dict[str, float], label: str) -> Pose:
    """A frame's pose followed by its small parameters ``Trans(d) Rx Ry Rz``."""
    from scipy.spatial.transform import Rotation

    small = np.array([values.get(c, 0.0) for c in frame_columns(chain, label)])
    return pose.then_small(small[:3], Rotation.from_euler("XYZ", small[3:]).as_matrix())


def held_out(
    problem: Problem,
    solution: Solution,
    rows: int,
    fixed: Sequence[str] = (),
    residuals: Callable[[Sequence[View], Mapping[str, int], Array, Array, int], Array] = residuals_of,
) -> tuple[Array, int]:
    """Residuals (rows, 3) of blocks of consecutive rows, each predicted by a fit without it; and how many blocks.

    The sums of a block are subtracted from those of all rows, so that no data is streamed twice. Parameters that are
    `fixed` (at a bound) keep their values. Unknowns of a set-up that is left out as a whole are those of its own rows.
    `residuals` computes the residuals: (rows, 3) of positions, or
    `motion_residuals` (rows, 6); they are linear in the step, since along directions that are hardly determined the
    exact kinematics would leave the valley of the fit.
    """
    blocks = np.array_split(np.arange(rows), min(max(10, round(rows / HELDOUT_BLOCK_ROWS)), rows))
    zero, place, base = np.zeros(len(problem.chain.ids)), problem.place(), solution.groups.base
    base = base[~np.isin(np.array(solution.unknowns)[base], fixed)]
    pick = np.ix_(base, base)
    gram = total(solution.sums, solution.sigma)[0][pick] + np.diag(solution.precision[base])
    scale = 1 / np.sqrt(np.diag(gram))
    of_set_ups = np.isin(np.array(solution.unknowns)[base], [c for v in problem.readings for c in v.starts])
    out = residuals(problem.views, place, solution.values, zero, rows)
    views_in_order = [v if (np.diff(v.index) > 0).all() else v.part(np.argsort(v.index)) for v in problem.views]
    for block in blocks:
        ends = (np.searchsorted(v.index, [block[0], block[-1] + 1]).tolist() for v in views_in_order)
        views = [v.part(slice(*own)) for v, own in zip(views_in_order, ends, strict=True) if own[0] < own[1]]
        if not views:  # nothing was measured there
            continue
        own = accumulate(views, place, solution.values, zero, at=solution.at)
        own_gram, own_slope = total(own, solution.sigma)
        less, slope = gram - own_gram[pick], -own_slope[base]
        # directions that the other blocks do not determine keep the fitted values
        kept = np.diag(less) > SEEN_ELSEWHERE * np.diag(gram)
        step = np.zeros(len(base))
        step[kept] = determined_step(less[np.ix_(kept, kept)], slope[kept], scale[kept])
        alone = ~kept & of_set_ups  # which nothing but these rows can tell: beside the others' machine
        rest = own_slope[base] - own_gram[pick] @ step
        step[alone] = determined_step(own_gram[pick][np.ix_(alone, alone)], rest[alone], scale[alone])
        values = solution.values.copy()
        values[base] += SMALL_STEP * step
        views = [replace(v, index=v.index - block[0]) for v in views]
        out[block] += (residuals(views, place, values, zero, len(block)) - out[block]) / SMALL_STEP
    return out, len(blocks)


def look_at(fit: Fit, test: Survey) -> TestFile:
    """Residuals of a test file after re-estimating its own frame, if it has one, and the tool if `refit` names it."""
    chain, given, (test, held) = fit.chain, test, judged_without(fit, test)
    tool = chain.tool_ids[:3] if "tool" in test.refit else ()
    labels = frame_labels(test)
    known = fit.problem.frames
    own_frame = test.frame == "per-file" or any(label not in known for label in labels if test.frame != "fixed")
    ids: Sequence[str] = tool
    problem = build(chain, test, held, ids, mount=fit.problem.mount)
    zero = np.zeros(len(chain.ids))
    unknowns = [u for u in problem.unknowns if u not in chain.tool_ids[3:] and (own_frame or u in tool)]
    declared = problem.declared & {"position"}
    judged = None
    if fit.sorting is not None and unknowns:
        judged = first_judgement(chain, _positions(problem), unknowns, held, declared)
    if own_frame:
        nominal_problem = build(chain, test, zero, ())
        nominal_problem = replace(nominal_problem, views=_positions(nominal_problem))
        _, nominal = anchored(nominal_problem, len(test), judged=judged)
    else:
        named = fit.solution.named()
        poses = {label: moved(chain, known[label], named, label) if known else IDENTITY for label in set(labels)}
        problem = placed(problem, poses)
        nominal = residuals_of(placed(problem, known or poses).views, {}, np.zeros(0), zero, len(test))
    views = _positions(problem)
    refit: dict[str, float] = {}
    if judged is not None:
        refit = settle(chain, views, unknowns, held, declared, judged)[0].named()
    elif unknowns:  # none for a file in a known frame
        refit = solve(chain, views, unknowns, held, declared).named()
    places = {name: k for k, name in enumerate(refit)}
    residuals = residuals_of(views, places, np.array([*refit.values()]), held, len(test))
    path = str(test.table["file"].iloc[0])
    return TestFile(path, given, Spread.of(nominal), Spread.of(residuals), residuals, nominal, refit, problem.frames)


def _positions(problem: Problem) -> tuple[PositionView, ...]:
    return tuple(v for v in problem.views if isinstance(v, PositionView))


def placed(problem: Problem, poses: dict[str, Pose]) -> Problem:
    """The problem with its measuring frames at the given poses (by label)."""
    labels = {frame_columns(problem.chain, label)[0]: label for label in poses}
    views: list[View] = []
    for view in problem.views:
        if isinstance(view, PositionView | OrientationView) and poses:
            views.append(replace(view, pose=poses[labels[view.columns[0]]]))
        elif isinstance(view, ReadingView) and view.in_frame and poses:
            views.append(view.placed(poses[labels[view.columns[0]]]))
        else:
            views.append(view)
    return replace(problem, views=tuple(views))
