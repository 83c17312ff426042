"""Sufficient statistics of the linear model with interpolated shape parameters, from which log-likelihoods follow.

M is the design matrix, W the inverse covariance of the observations, y the gap at zero parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from identification.bayes.shape_parameters import ShapeInterpolation
from identification.estimation.fit import placed
from identification.estimation.result import Fit
from identification.observation.assembly import Problem, build
from identification.observation.models import Kind, View
from identification.observation.normal_equations import accumulate, design_rows, view_vector


@dataclass(frozen=True)
class RowsApart:
    """Rows of one kind of observation that keep their own equations.

    Attributes
    ----------
    design, gap : whitened M (m, components, e) over the extended unknowns, and gap at zero parameters (m, components).
    index : (m,) row numbers in the survey.
    kind : of observation.
    """

    design: Array
    gap: Array
    index: Index
    kind: Kind

    @property
    def seen(self) -> Array:
        """Number of measured components, (m,)."""
        return np.asarray((np.abs(self.design).sum(axis=2) + np.abs(self.gap) > 0).sum(axis=1), dtype=float)


@dataclass(frozen=True)
class Statistics:
    """``M'WM``, ``M'Wy``, ``y'Wy`` and counts over the extended unknowns.

    A parameter has one extended unknown, or one for each interpolation node of its effect.

    Attributes
    ----------
    names : (p,) the groups' base parameters.
    places : indices of the extended unknowns of each of them; `shape`: index of its interpolation, or None.
    interpolations : of the shape parameters.
    kinds : kinds of observation, K in number.
    gram, slope, square, count : (K, e, e), (K, e), (K,) and (K,) for each kind.
    apart : rows that these leave out; `share`: weight of each of the other rows.
    """

    names: tuple[str, ...]
    places: tuple[Index, ...]
    shape: tuple[int | None, ...]
    interpolations: tuple[ShapeInterpolation, ...]
    kinds: tuple[Kind, ...]
    gram: Array
    slope: Array
    square: Array
    count: Array
    apart: RowsApart
    share: float = 1.0

    def weights(self, shapes: Array) -> list[Array]:
        """Weights (n, nodes) of each interpolation, at shapes (n, all shapes) on the sampled scale."""
        out, start = [], 0
        for shape in self.interpolations:
            out.append(shape.weights(shapes[:, start : start + len(shape.names)]))
            start += len(shape.names)
        return out

    def extended(self, values: Array, shapes: Array) -> Array:
        """Extended unknowns (n, e) from parameters (n, p) and shapes (n, all shapes)."""
        weights = self.weights(shapes)
        out = np.zeros((len(values), self.gram.shape[1]))
        for k, (place, shape) in enumerate(zip(self.places, self.shape, strict=True)):
            out[:, place] = values[:, k, None] if shape is None else values[:, k, None] * weights[shape]
        return out

    def squares(self, values: Array, shapes: Array) -> Array:
        """Residual sum of squares (n, K) of each kind."""
        v = self.extended(values, shapes) if self.interpolations else values
        parts = [
            c - 2 * (v @ h) + np.einsum("ni,ni->n", v @ g, v)
            for g, h, c in zip(self.gram, self.slope, self.square, strict=True)
        ]
        return np.stack(parts, axis=1)

    def normal(self, levels: Array, shapes: Array) -> tuple[Array, Array, Array]:
        """``M'WM`` (n, p, p), ``M'Wy`` (n, p) and ``y'Wy`` (n,) at weights (n, K) of the kinds and at shapes."""
        gram = np.tensordot(levels, self.gram, axes=1)
        slope, square = levels @ self.slope, levels @ self.square
        if not self.interpolations:
            return gram, slope, square
        weights = self.weights(shapes)
        mix = np.zeros((len(levels), gram.shape[1], len(self.names)))
        for k, (place, shape) in enumerate(zip(self.places, self.shape, strict=True)):
            mix[:, place, k] = 1.0 if shape is None else weights[shape]
        return mix.transpose(0, 2, 1) @ gram @ mix, np.einsum("nek,ne->nk", mix, slope), square


def posed(fit: Fit, machine: Machine) -> Problem:
    """Estimation problem of a machine with the fit's rows and measuring frames, without robust weights."""
    chain = fit.chain if machine is fit.chain.machine else Chain(machine)
    problem = build(chain, fit.survey, mount=fit.problem.mount)
    return placed(problem, fit.problem.frames) if fit.problem.frames else problem


@dataclass(frozen=True)
class Extended:
    """The rows of a fit over the extended unknowns: one a parameter, or one a node of the effect that it belongs to.

    Attributes
    ----------
    problem : what the rows ask of the machine that has each bending effect once a node.
    place : number of each extended unknown by its id; `at`: their values at the fit.
    names, places, shape : see `Statistics`.
    """

    problem: Problem
    place: dict[str, int]
    at: Array
    names: tuple[str, ...]
    places: tuple[Index, ...]
    shape: tuple[int | None, ...]


def extended(fit: Fit, interpolations: Sequence[ShapeInterpolation]) -> Extended:
    """The rows of a fit over the extended unknowns of these bends."""
    machine, solution = fit.chain.machine, fit.solution
    by_number = {b.number: k for k, b in enumerate(interpolations)}
    specs: list[EffectSpec] = []
    copies: list[range] = []
    for number, spec in enumerate(machine.effects):
        same = [spec]
        if number in by_number:
            shape = interpolations[by_number[number]]
            effect_at = [shape.effect_at(x) for x in shape.nodes]
            same = [e.spec for e in effect_at]
        copies.append(range(len(specs), len(specs) + len(same)))
        specs += same
    problem = posed(fit, replace(machine, effects=tuple(specs)) if interpolations else machine)
    chain = problem.chain
    names = tuple(solution.unknowns[j] for j in solution.groups.base)
    owner = {i: (n, t) for n, ids in enumerate(fit.chain.effect_ids) for t, i in enumerate(ids)}
    place: dict[str, int] = {}
    places, bend_of = [], list[int | None]()
    for name in names:
        ids = [name]
        if name in owner:
            number, term = owner[name]
            ids = [chain.effect_ids[m][term] for m in copies[number]]
        places.append(np.arange(len(place), len(place) + len(ids)))
        bend_of.append(by_number.get(owner[name][0]) if name in owner else None)
        place |= {identity: len(place) + k for k, identity in enumerate(ids)}
    # residuals and M of the exact kinematics at the fitted parameters
    at = np.zeros(len(place))
    for k, j in enumerate(solution.groups.base):
        own = None if bend_of[k] is None else interpolations[bend_of[k] or 0]
        at[places[k]] = solution.values[j] * (1.0 if own is None else own.weights(own.best[None])[0])
    return Extended(problem, place, at, names, tuple(places), tuple(bend_of))


def gather(
    fit: Fit, interpolations: Sequence[ShapeInterpolation], keep: Mask | None = None, share: float = 1.0
) -> Statistics:
    """The statistics of a fit's rows, in one stream.

    Parameters
    ----------
    keep : (rows,) True for rows that keep their own equations, of the kind of observation that has outliers.
    share : what a row counts, below 1 where noise is correlated from row to row.
    """
    e = extended(fit, interpolations)
    problem, place, at = e.problem, e.place, e.at
    kind = problem.views[0].kind if keep is None else kind_with_outliers(fit)
    keep = np.zeros(len(fit.survey), dtype=bool) if keep is None else keep
    apart = [v.part(keep[v.index]) for v in problem.views if v.kind == kind]
    core = [v.part(~keep[v.index]) if v.kind == kind else v for v in problem.views]
    zero = np.zeros(len(problem.chain.ids))
    sums = accumulate([v for v in core if len(v)], place, at, zero, at=at)
    kinds = tuple(sums)
    gram = share * np.array([s.gram for s in sums.values()])
    slope = share * np.array([s.slope for s in sums.values()])
    square = share * np.array([s.square for s in sums.values()]) + 2 * slope @ at + np.einsum("kij,i,j", gram, at, at)
    return Statistics(
        e.names, e.places, e.shape, tuple(interpolations), kinds, gram, slope + gram @ at, square,
        share * np.array([s.count for s in sums.values()]), _apart(apart, place, at, zero),
        share,
    )  # fmt: skip


def kind_with_outliers(fit: Fit) -> Kind:
    """The kind of observation among whose rows a robust posterior looks for outliers: positions, or the only kind.

    Raises
    ------
    InputError
        No position was measured, and readings are of several kinds.
    """
    kinds = dict.fromkeys(v.kind for v in fit.problem.views)
    if "position" in kinds:
        return "position"
    if len(kinds) > 1:
        found = f"readings of several kinds ({', '.join(kinds)}) and no position"
        cure = "Fit with --robust or with --bayes: both together take outliers among rows of one kind"
        raise InputError(f"{fit.survey.source}, --robust --bayes", found, cure)
    return next(iter(kinds))


def _apart(views: Sequence[View], place: dict[str, int], at: Array, zero: Array) -> RowsApart:
    """The equations of the rows that keep their own, at zero parameters."""
    components = len(views[0].outputs)
    designs, gaps = [np.zeros((0, components, len(place)))], [np.zeros((0, components))]
    own = [v for v in views if len(v)]
    for view in own:
        design, gap = equations(view, place, at, zero)
        designs.append(design)
        gaps.append(gap)
    index = np.concatenate([np.zeros(0, np.intp), *(v.index for v in own)])
    return RowsApart(np.concatenate(designs), np.concatenate(gaps), index, views[0].kind)


def equations(view: View, place: dict[str, int], at: Array, zero: Array) -> tuple[Array, Array]:
    """Whitened M (m, outputs, e) of a view's rows at the values `at` (e,), and gaps (m, outputs) at zero parameters."""
    design = design_rows(view, place, most=len(view)).reshape(len(view.outputs), len(view), -1).transpose(1, 0, 2)
    gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(view_vector(view, place, at, zero))])
    return design, gap.T + design @ at
