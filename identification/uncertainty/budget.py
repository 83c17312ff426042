"""Uncertainty budget of a fit by the GUM (JCGM 100:2008): inputs, sensitivities, degrees of freedom, coverage factor.

Measurands are the component of the predicted volumetric error with the largest uncertainty, and each parameter group.
Measurement noise propagates to both through the fit. A systematic input (a scale factor, a temperature sensor's offset,
a tool's length) changes the measured values, thereby the parameters and the prediction. Inputs are independent. The
combination is the law of propagation (GUM 5.1), the effective degrees of freedom are those of Welch and Satterthwaite
(GUM G.4.1); a test compares both with GTC (B. D. Hall). Units: mm, rad, K.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import ceil, floor, hypot, inf, isfinite, sqrt
from typing import Any

import numpy as np

from errormodel.arrays import Array, as_rows, corners_of_cube
from errormodel.channels import root
from errormodel.simulation import random_points
from errormodel.survey import Survey
from errormodel.surveys.file import BudgetEntry
from identification.estimation.result import Fit
from identification.observation.assembly import marginal_whitener
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows, total
from identification.observation.readings import ReadingView
from identification.results.stored_fit import StoredFit
from identification.uncertainty.prediction import predict
from identification.uncertainty.reading_prediction import rigid_parts

COVERAGE_PROBABILITY = 0.95  # of the expanded uncertainty: convention
WORST_POSE_CANDIDATES = 400  # random poses, half of them corners at most, among which the worst prediction is sought
FORM_ERROR_SIGMA = 3.0  # standard deviations by which held-out variance must exceed the noise's: convention
DESIGN_CHUNK_ROWS = 1000  # rows whose M is held at a time: limits the memory
SENSITIVITY_STEP = 1e-4  # finite difference of a temperature (K) or load channel; lengths and angles use 1e-3 mm, rad
UNIDENTIFIED_LINE = "parameters that the survey does not identify"  # name of a line
LEAST_VARIANCE_SHARE = 0.01  # of the fit's variance, above which the unexplained rest gets its own line; by judgement


@dataclass(frozen=True)
class Input:
    """One line of a budget: `std` in `unit`, `sensitivity` in units of the measurand per `unit`."""

    name: str
    type: str  # A: by statistical analysis of observations, B: by other means (GUM)
    distribution: str
    std: float
    unit: str
    sensitivity: float
    dof: float = inf

    @property
    def contribution(self) -> float:
        """Standard uncertainty of the measurand by this input."""
        return abs(self.sensitivity) * self.std


@dataclass(frozen=True)
class Budget:
    """A budget: combined standard uncertainty, effective degrees of freedom, coverage factor, expanded uncertainty."""

    measurand: str
    unit: str
    inputs: tuple[Input, ...]
    std: float
    dof: float
    k: float
    expanded: float
    level: float

    def as_json(self) -> dict[str, Any]:
        """The budget for JSON, with null for infinite degrees of freedom."""
        lines = [
            asdict(i) | {"contribution": i.contribution, "dof": i.dof if isfinite(i.dof) else None} for i in self.inputs
        ]
        dof = self.dof if isfinite(self.dof) else None
        return {
            "measurand": self.measurand, "unit": self.unit, "inputs": lines, "standard_uncertainty": self.std,
            "effective_dof": dof, "k": self.k, "expanded_uncertainty": self.expanded, "level": self.level,
        }  # fmt: skip


@dataclass(frozen=True)
class Budgets:
    """Budgets of the least certain prediction (None if error motions alone were read) and of each group, in order."""

    prediction: Budget | None
    groups: tuple[Budget, ...]

    def as_json(self) -> dict[str, Any]:
        """The key ``budget`` of ``fit.json``."""
        worst = self.prediction.as_json() if self.prediction else None
        return {"prediction": worst, "groups": [b.as_json() for b in self.groups]}


def combine(measurand: str, unit: str, inputs: Sequence[Input], level: float = COVERAGE_PROBABILITY) -> Budget:
    """Combine independent inputs: law of propagation, Welch-Satterthwaite formula, coverage factor of Student's t.

    Effective degrees of freedom are rounded down before the coverage factor is computed (GUM G.4.1, note 1).

    Parameters
    ----------
    measurand, unit : name and unit of the measurand.
    inputs : lines of the budget.
    level : coverage probability.
    """
    from scipy.special import stdtrit

    std = hypot(*(i.contribution for i in inputs))
    if not std:
        return Budget(measurand, unit, tuple(inputs), 0.0, inf, 0.0, 0.0, level)
    spread = sum((i.contribution / std) ** 4 / i.dof for i in inputs)
    dof = 1 / spread if spread else inf
    k = float(stdtrit(max(1.0, floor(dof + 1e-9)) if isfinite(dof) else inf, (1 + level) / 2))
    return Budget(measurand, unit, tuple(inputs), std, dof, k, k * std, level)


def budgets_of(fit: Fit, groups: Sequence[Mapping[str, Any]], stored: StoredFit) -> Budgets:
    """The budgets of a fit, by its survey's instrument and ``budget`` block.

    Parameters
    ----------
    groups : the fit's base parameters, with ``group`` (formula) and ``unit``.
    stored : the fit as prediction needs it.
    """
    effects = list(_effects(fit))
    each = tuple(combine(p["group"], p["unit"], [e.of_group(k) for e in effects]) for k, p in enumerate(groups))
    predicts = bool(np.isfinite(fit.residuals).any()) or fit.readings is not None
    return Budgets(_prediction(fit, stored, effects) if predicts else None, each)


@dataclass(frozen=True)
class _Effect:
    """Effect of an input on the groups: the covariance (p, p) that it causes, or their change (p,) per unit."""

    input: Input
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    change: Array | None = None

    def line(self, row: Array) -> Input:
        """The budget's line for the measurand ``row @ groups``."""
        if self.change is not None:
            return replace(self.input, sensitivity=float(row @ self.change))
        return self._noise(float(row @ self.covariance @ row))

    def of_group(self, k: int) -> Input:
        """The budget's line for group k."""
        if self.change is not None:
            return replace(self.input, sensitivity=float(self.change[k]))
        return self._noise(float(self.covariance[k, k]))

    def _noise(self, variance: float) -> Input:
        return replace(self.input, sensitivity=sqrt(max(variance, 0.0)) / self.input.std)


def _effects(fit: Fit) -> Iterator[_Effect]:
    """Inputs that propagate through the fit: noise by its sources, then systematic inputs."""
    s = fit.solution
    base = s.groups.base
    pick = np.ix_(base, base)
    inverse = _inverse(total(s.sums, s.sigma)[0][pick] + np.diag(s.precision[base]))
    left = s.covariance * fit.inflation**2
    whole = left
    parts = _caused(fit) if "position" in s.declared and not _own_sigmas(fit.survey) else []
    for line, caused in parts:
        covariance = inverse @ caused @ inverse
        left = left - covariance
        yield _Effect(line, covariance)
    rest = float(np.trace(left / whole.diagonal()[:, None])) / len(base) if len(base) else 0.0
    estimated = "position" not in fit.declared
    if parts and rest > LEAST_VARIANCE_SHARE:
        name = "scatter beyond the instrument's (residuals, correlation of neighbours)"
        if fit.posterior is not None:
            name = "noise level and shapes of effects, as the posterior has them"
        yield _Effect(Input(name, "A", "normal", fit.sigma_mm, "mm", 0.0, _dof(fit)), left)
    elif not parts:
        name = "measurement noise, from the residuals" if estimated else "measurement noise, as declared"
        known = not estimated and fit.inflation == 1
        dof = inf if known else _dof(fit)
        size = next((v for v in (fit.sigma_mm, *s.sigma.values()) if isfinite(v) and v > 0), 1.0)
        unit = "rad" if all(v.turns for v in fit.problem.views) else "mm"
        yield _Effect(Input(name, "B" if known else "A", "normal", size, unit, 0.0, dof), left)
    for entry in fit.survey.budget:
        if entry.acts != "prediction":
            change = inverse @ _moved_by(fit, entry.acts)
            yield _Effect(_input(entry, _unit(fit, entry.acts)), change=change)


def _dof(fit: Fit) -> float:
    """Degrees of freedom of the fit, at least 1."""
    return float(max(fit.solution.dof, 1))


def _input(entry: BudgetEntry, unit: str) -> Input:
    """A line of the budget from an entry of the survey."""
    return Input(entry.name, entry.type, entry.shape, entry.standard, unit, 1.0, entry.dof or inf)


def _unit(fit: Fit, acts: str) -> str:
    """Unit of a systematic input."""
    joint = next((j for j in fit.chain.machine.joints if j.name == acts), None)
    if joint is not None:
        return "rad" if joint.type == "rotary" else "mm"
    return "1" if acts == "scale" else "K" if acts.startswith("T_") else "mm"


def _own_sigmas(survey: Survey) -> bool:
    """Whether the survey states a standard uncertainty for each axis in its rows."""
    return any(name in survey.table for name in ("sigma_x", "sigma_y", "sigma_z"))


def _rows(fit: Fit) -> Iterator[tuple[PositionView, Array]]:
    """Position rows in chunks, and their whitened M (3, m, p) in units of the noise."""
    base, place = fit.solution.groups.base, fit.problem.place()
    for view in fit.counted:
        if isinstance(view, PositionView):
            for k in range(0, len(view), DESIGN_CHUNK_ROWS):
                part = view.part(slice(k, k + DESIGN_CHUNK_ROWS))
                rows = design_rows(part, place, most=DESIGN_CHUNK_ROWS)[:, base] / fit.solution.sigma["position"]
                yield part, rows.reshape(3, len(part), -1)


def _caused(fit: Fit) -> list[tuple[Input, Array]]:
    """For each source of the declared instrument its line and ``M'W S W M`` (p, p), S its covariance of the rows."""
    instrument = fit.survey.instrument
    lines: dict[str, Input] = {}
    caused: dict[str, Array] = {}
    for view, rows in _rows(fit):
        sources = instrument.sources(view.measured)
        whole = instrument.covariance(view.measured)
        assert whole is not None
        # in units of the noise; robust weights are contained in M, so that the parts add up to the total
        white = marginal_whitener(whole, ~np.isfinite(fit.survey.measured[view.index]))
        for source in sources:
            if source.std > 0:
                turned = white @ source.covariance @ white.transpose(0, 2, 1)
                part = np.einsum("imp,mij,jmq->pq", rows, turned, rows, optimize=True)
                name = f"{instrument.type}, {source.name}"
                lines[name] = Input(name, "B", "normal", source.std, source.unit, 0.0)
                caused[name] = caused[name] + part if name in caused else part
    return [(line, caused[name]) for name, line in lines.items()]


def _moved_by(fit: Fit, acts: str) -> Array:
    """``M'W d`` (p,), d the change of measured minus predicted values per unit of a systematic input."""
    out = _readings_moved_by(fit, acts)
    p = fit.held
    for view, rows in _rows(fit):
        if acts == "scale":
            change = view.pose.rotation.T @ view.measured.T
        else:
            step = _step(acts)
            shifted = [c + step * (root(name) == acts) for name, c in zip(view.chain.channels, view.rows, strict=True)]
            other = replace(view, rows=as_rows(*shifted), fixed={k: v for k, v in view.fixed.items() if k != acts})
            here, there = (np.hstack([g for _, g in v.gaps(p)]) for v in (view, other))
            change = (there - here) / step
        white = view.whiten(slice(None), change) / fit.solution.sigma["position"]
        out += np.einsum("imp,im->p", rows, white)
    return out


def _readings_moved_by(fit: Fit, acts: str) -> Array:
    """The same of single readings: a scale acts on lengths as they were read, a position at both of two poses."""
    base, place = fit.solution.groups.base, fit.problem.place()
    out = np.zeros(len(base))
    for view in fit.counted:
        if not isinstance(view, ReadingView):
            continue
        if acts == "scale":
            change = np.zeros(len(view)) if view.turns else view.measured
        else:
            step = _step(acts)
            names = view.chain.channels * view.observation.poses
            shifted = [c + step * (root(name) == acts) for name, c in zip(names, view.rows, strict=True)]
            vector = view.vector(place, fit.solution.values, fit.held)
            other = replace(view, rows=as_rows(*shifted))
            here, there = (np.hstack([g for _, g in v.gaps(vector)])[0] for v in (view, other))
            change = (there - here) / step
        level = fit.solution.sigma[view.kind]
        rows = design_rows(view, place, most=len(view))[:, base] / level
        out += rows.T @ (view.whitener * change / level)
    return out


def _step(acts: str) -> float:
    """Step of an input for its sensitivity: mm, rad, K or kg."""
    return SENSITIVITY_STEP if acts.startswith("T_") or acts == "load" else 1e-3


def _prediction(fit: Fit, stored: StoredFit, effects: Sequence[_Effect]) -> Budget:
    """Of the component of the predicted error that is known worst, at the pose where it is, with the machine's tool."""
    machine = fit.chain.machine
    table = random_points(machine, WORST_POSE_CANDIDATES, 0)
    low, high = np.transpose([j.travel for j in machine.joints])
    corners = corners_of_cube(len(machine.joints), WORST_POSE_CANDIDATES // 2)
    table.iloc[: len(corners), : len(machine.joints)] = np.where(corners, high, low)
    source = fit.survey.table
    for name in source:  # temperatures, load and other channels at their means
        if str(name).startswith(("T_", "w_")) or name in ("time", "feed", "load"):
            table[name] = float(source[name].mean())
    first = source.iloc[0]
    table = table.assign(run=first["run"], file=first["file"], role="fit", row=np.arange(1, WORST_POSE_CANDIDATES + 1))
    points = replace(fit.survey, table=table)
    known = predict(replace(stored, coverage=1.0, systematic=0.0), points)[["ux", "uy", "uz"]].to_numpy()
    worst, axis = np.unravel_index(int(np.argmax(known)), known.shape)
    rows = as_rows(*(c[[worst]] for c in fit.chain.columns(table)))
    label = next(iter(fit.problem.frames), None)
    row = _design(fit, rows, label, stored.free_reference)[:, axis]
    lines = [e.line(row) for e in effects]
    through = float(row @ (fit.solution.covariance * fit.inflation**2) @ row)
    unseen = float(known[worst, axis]) ** 2 - through
    if unseen > 1e-6 * through:
        lines.append(Input(UNIDENTIFIED_LINE, "B", "normal", sqrt(unseen), "mm", 1.0))
    form, name = _form(fit), "form of the model, from blocks of rows left out"
    if fit.systematic_mm > form:  # the same cause: one line
        form, name = fit.systematic_mm, "form of the model, or scatter: what a diagnosis left beyond the noise"
    if form > 0:
        lines.append(Input(name, "A", "normal", form, "mm", 1.0, float(max(fit.folds - 1, 1))))
    lines += [_input(e, "mm") for e in fit.survey.budget if e.acts == "prediction"]
    pose = ", ".join(
        f"{j.name} = {float(np.degrees(c) if j.type == 'rotary' else c):.4g} {'°' if j.type == 'rotary' else 'mm'}"
        for j, c in zip(machine.joints, (r[0] for r in rows), strict=False)
    )
    return combine(f"predicted volumetric error along {'xyz'[axis]} at {pose}", "mm", lines)


def _design(fit: Fit, rows: list[Array], label: str | None, free_reference: bool = False) -> Array:
    """Change (p, 3) of the predicted position in the measuring frame, mm, per unit of each group, at one pose.

    With a free reference, the motion of the machine as a whole is taken out, as in its predictions.
    """
    chain, view = fit.chain, fit.problem.views[0]
    columns = dict(zip(view.columns, view.ids, strict=False)) if view.of_tool else {}
    ids = [columns.get(fit.solution.unknowns[j], fit.solution.unknowns[j]) for j in fit.solution.groups.base]
    own = [k for k, i in enumerate(ids) if i in chain.index and i not in chain.tool_ids]
    out = np.zeros((len(ids), 3))
    design = chain.kernel("design", tuple(ids[k] for k in own), outputs=(0, 1, 2))(rows)
    turn = fit.problem.frames[label].rotation if label is not None else np.eye(3)
    out[own] = design.reshape(len(own), 3) @ turn.T
    if free_reference:
        rigid = chain.kernel("design", chain.frame_ids, outputs=(0, 1, 2))(rows).reshape(6, 3)
        out[own] -= rigid_parts(chain, tuple(ids[k] for k in own)).T @ rigid
    return out


def _form(fit: Fit) -> float:
    """Standard uncertainty (mm) of a coordinate by the form of the model: held-out residuals beyond noise."""
    if not fit.heldout.n:
        return 0.0
    count = sum(own.count for own in fit.solution.sums.values())
    used = len(fit.solution.groups.base)
    # of a row's components some may not have been measured
    share = fit.fitted.n / fit.solution.sums["position"].count if "position" in fit.solution.sums else 1 / 3
    noise = (1e-3 * fit.fitted.rms_um) ** 2 * share * count / max(count - used, 1)
    # parameters estimated without a block are less certain than with all rows
    others = count * (1 - 1 / max(fit.folds, 2)) - used
    left = (1e-3 * fit.heldout.rms_um) ** 2 * share - noise * (1 + used / max(others, 1))
    return sqrt(left) if left > FORM_ERROR_SIGMA * noise * sqrt(2 / max(count, 1)) else 0.0


def _inverse(gram: Array) -> Array:
    """Pseudo-inverse of normal equations, scaled to unit diagonal."""
    d = 1 / np.sqrt(np.diag(gram))
    return np.asarray(np.linalg.pinv(gram * np.outer(d, d), hermitian=True) * np.outer(d, d))


def rounded(value: float, digits: int = 2) -> str:
    """An uncertainty as text, rounded up to `digits` significant digits."""
    if value <= 0 or not isfinite(value):
        return "0" if value == 0 else "–"
    places = digits - 1 - floor(np.log10(value))
    return f"{ceil(value * 10.0**places - 1e-9) / 10.0**places:.{max(places, 0)}f}"
