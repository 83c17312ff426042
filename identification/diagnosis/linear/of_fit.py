"""The linear model of a fit: its residuals, what its geometry spans, levers and channels, in units of its noise."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import Vector
from errormodel.survey import Survey
from errormodel.surveys.observations import start_of
from identification.diagnosis.data_checks.temperature_sensors import dead_sensors
from identification.diagnosis.linear.first_poses import FirstPoses
from identification.diagnosis.linear.known_models import Lineage
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.row_channels import LazyChannels, RowChannels, runs_of
from identification.diagnosis.linear.row_residuals import noise_mm
from identification.diagnosis.linear.survey_rows import SurveyRows
from identification.estimation.noise import RESIDUAL_ROUND_OFF_SHARE
from identification.estimation.orthonormal_basis import orthonormal_basis
from identification.estimation.result import Fit
from identification.observation.models import OrientationView, PositionView
from identification.observation.normal_equations import design_rows, view_vector
from identification.observation.readings import ReadingView

Seen = PositionView | OrientationView | ReadingView  # what the linear model is of
MOST_ROWS = 2500  # of a survey: more are thinned out
MOST_RUNS = 12  # labels; more are no runs of one survey
MOST_STATIONS = 3
LEAST_RUN = 8  # rows of a run that may differ
ROUNDED_LEVER = 1e-12  # of the machine's size (of 1, if that is larger): less of a reading's lever is rounding


def set_up(fit: Fit, most: int = MOST_ROWS) -> LinearModel:
    """The linear model of a fit, in units of its noise, of at most `most` rows."""
    chain, problem, solution = fit.chain, fit.problem, fit.solution
    place = problem.place()
    base = solution.groups.base
    zero = np.zeros(len(chain.ids))
    survey = at_rest(fit.survey, [j.name for j in chain.machine.joints])
    points = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(survey.table))
    table = RowChannels(survey, points)
    residuals, designs, levers, indices = [], [], [], []
    views: list[Seen] = [v for v in problem.views if isinstance(v, PositionView | ReadingView)]
    total = sum(len(v) for v in views)
    if total > most:
        views = [v.part(np.unique(np.linspace(0, len(v) - 1, most * len(v) // total).astype(int))) for v in views]
    else:  # of many rows the positions say as much, in half the time
        views = [v for v in problem.views if isinstance(v, Seen)]
    for view in views:
        level = solution.sigma[view.kind]  # 1 where the survey declares its noise
        gap = np.hstack([view.whiten(p, g) for p, g in view.gaps(view_vector(view, place, solution.values, zero))])
        arms = view.whiten(slice(None), _arms(view))
        residuals.append(gap.ravel() / level)
        designs.append(design_rows(view, place, most=len(view))[:, base] / level)
        levers.append(arms.reshape(len(arms), -1) / level)
        indices.append(np.tile(view.index, len(view.outputs)))
    firsts: list[Array] = []  # levers at the first of two poses
    if any(v.observation.poses > 1 for v in problem.readings):
        levers, firsts = _by_pose(levers, 6 * len(chain.element_names))
    design, stacked = np.vstack(designs), np.hstack(levers)
    rows = np.concatenate(indices)
    live = np.abs(design).max(axis=1, initial=0.0) + np.abs(stacked).max(axis=0) > 0  # components that were measured
    # what the machine's own effects tie to zero is tied here too
    ties = np.diag(hold := np.sqrt(solution.precision[base]))[hold > 0]
    design = np.vstack([design[live], ties])
    norms = np.linalg.norm(design, axis=0)
    seen = norms > 1e-12 * norms.max(initial=0.0)  # a mount's orientation moves no position
    q = orthonormal_basis(design[:, seen] / norms[seen])
    residual = np.append(np.concatenate(residuals)[live], -ties @ solution.values[base])
    names = chain.element_names
    # a member called "frame" goes before the measuring frame, as in the chain
    arms_of = {n: stacked[6 * k : 6 * k + 6][:, live] for k, n in enumerate(names)}
    first = _first_poses(fit, np.hstack(firsts)[:, live], rows[live]) if firsts else None
    dead = dead_sensors(survey)
    read = tuple(dict.fromkeys(v.kind for v in problem.readings))
    scene = Scene(
        chain.machine,
        _scene_columns(survey, table, chain, dead),
        _stations(fit),
        survey.motions_of,
        dead,
        read,
        any(not isinstance(v, ReadingView) for v in problem.views),
    )
    left = residual - q @ (q.T @ residual)
    noise = noise_mm(fit)
    round_off = len(left) * (RESIDUAL_ROUND_OFF_SHARE * chain.size / max(noise, 1e-300)) ** 2
    index = rows[live]
    seen_rows, number = np.unique(index, return_inverse=True)
    own = LazyChannels(table, seen_rows)
    by_row = SurveyRows.of(number, own) if first is None else None
    return LinearModel(
        chain, left, q, arms_of, LazyChannels(own, number), index, scene, round_off, first, Lineage(), by_row
    )


def at_rest(survey: Survey, joints: Sequence[str]) -> Survey:
    """The survey whose joints stand still in rows about another joint's error motions that do not say where they are.

    Such a row shows nothing of them, but a joint without a position in some rows would drive nothing in all of them.
    """
    own = survey.table[[*joints]]
    if not own.isna().to_numpy().any():
        return survey
    still = own.groupby(survey.table["file"], sort=False).ffill().ffill().bfill()
    return replace(survey, table=survey.table.assign(**{name: still[name] for name in joints}))


def _arms(view: Seen) -> Array:
    """Change (6 * elements, outputs, n) of what a view observes by each motion of each element; mm, rad."""
    arms = view.levers()
    if not isinstance(view, ReadingView):
        return arms
    # a circle's own plane leaves rounding errors of what acts across it
    return np.where(np.abs(arms) > ROUNDED_LEVER * max(1.0, view.chain.size), arms, 0.0)


def _by_pose(levers: list[Array], count: int) -> tuple[list[Array], list[Array]]:
    """Levers of each view at the only or the second pose, and at the first one (zero where there is but one)."""
    return [a[:count] for a in levers], [a[count:] if len(a) > count else np.zeros_like(a) for a in levers]


def _first_poses(fit: Fit, arms: Array, rows: Index) -> FirstPoses:
    """The first poses of observations with levers (6 * elements, N) there, and with rows (N,) of the survey."""
    at = np.flatnonzero(arms.any(axis=0))
    chain = fit.chain
    survey = replace(fit.survey, table=start_of(fit.survey.table, chain.machine))
    table = RowChannels(survey, chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(survey.table)))
    levers = {n: arms[6 * k : 6 * k + 6, at] for k, n in enumerate(chain.element_names)}
    return FirstPoses(at, levers, LazyChannels(table, rows[at]))


def _stations(fit: Fit) -> tuple[Vector, ...]:
    """Where the instrument stood in the reference's axes, to a millimetre: in the measuring frame, or its origin."""
    here = np.array(getattr(fit.survey.instrument, "station", np.zeros(3)))
    poses = list(fit.problem.frames.values())[:MOST_STATIONS]
    places = {tuple(float(x) for x in np.round(p.invert(here[None])[0])) for p in poses} or {(0.0, 0.0, 0.0)}
    return tuple((x, y, z) for x, y, z in sorted(places))


def unused_runs(survey: Survey) -> list[tuple[str, int]]:
    """Labels of runs that drive no candidate where there are several, with the number of their rows."""
    runs = runs_of(survey)
    many = len(runs) > MOST_RUNS
    return [(label, n) for label, n in runs if many or n < LEAST_RUN] if len(runs) > 1 else []


def _scene_columns(survey: Survey, table: RowChannels, chain: Chain, dead: Collection[str]) -> dict[str, Array]:
    """Summary of the rows: columns, directions of approach and, of one file without a clock, their order."""
    plain = ("time", "feed", "load", *TOOL_CHANNELS)
    names = [c for c in survey.table.columns if (str(c).startswith(("T_", "w_")) and c not in dead) or c in plain]
    columns = {str(n): survey.table[n].to_numpy(dtype=float) for n in names}
    runs = runs_of(survey)
    several = [label for label, n in runs if n >= LEAST_RUN]
    if len(several) >= 2 and len(runs) <= MOST_RUNS:
        columns |= {f"run({label})": table[f"run({label})"] for label in several}
    columns |= {} if "time" in columns or survey.table["file"].nunique() > 1 else {"row": table["row"]}
    joints = [j.name for j in chain.machine.joints]
    columns |= {name: survey.table[name].to_numpy(dtype=float) for name in joints}
    return columns | {f"dir_{name}": table[f"dir_{name}"] for name in joints}
