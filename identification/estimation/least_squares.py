"""Weighted least squares: all unknowns together, iterated on the exact kinematics until linearising no longer matters.

The normal equations of the scaled base columns are factorised once; every further pass streams the exact residual
through again, which removes second-order terms and, at the same time, what normal equations lose in digits.
Where no uncertainty is declared, each kind of observation gets its own noise level from its own residuals
(variance components, with the degrees of freedom its rows leave).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.kernel import KERNEL_BLOCK_ROWS
from identification.observation.assembly import group_order
from identification.observation.identifiability import ROUND_OFF, Floors, Groups, find_groups
from identification.observation.models import GapView, Kind, View
from identification.observation.normal_equations import (
    SAMPLE,
    Sums,
    accumulate,
    design_rows,
    full_norms,
    sampled,
    total,
    view_vector,
    weight_of,
)

FINEST = 1e-4  # of the coarsest kind of observation, by what it moves at the far end
SHAKY = 1e4  # condition from which normal equations give fewer than eight digits
MOST_PASSES = 30
MOST_RETREATS = 6
LARGEST = 0.003  # error of a machine, of its size: where the fit runs away, what is not seen is no larger


@dataclass(frozen=True)
class Solution:
    """Estimates of all unknowns.

    Attributes
    ----------
    unknowns : names; `values` (u,): their estimates, 0 for those that are not the base of a group.
    groups : what is identifiable; `covariance` (rank, rank) of the groups' values.
    sigma : noise level of each kind in units of its whitener (1 where declared: `declared`).
    chi2, dof : whitened residual sum of squares with those levels, and degrees of freedom.
    sums : sufficient statistics of each kind, the residual taken at `values`.
    passes : streams through the data; `converged`: the last step was negligible.
    precision : (u,) of what is known beforehand, about zero.
    within : of the machine's size, the standard deviation by which rigid error motions are tied to zero, so that what
        the poses hardly show does not run away; inf where nothing did.
    left : of a linear fit, the residual of each view whose weights are alike in all directions, (outputs, n).
    kept : mean square of the weighted residuals of positions, in noise variances: not 1 if rows are weighted robustly.
    """

    unknowns: tuple[str, ...]
    values: Array
    groups: Groups
    covariance: Array
    sigma: dict[Kind, float]
    declared: frozenset[Kind]
    chi2: float
    dof: int
    sums: dict[Kind, Sums]
    passes: int
    converged: bool
    precision: Array
    within: float = np.inf
    left: tuple[Array, ...] = ()
    kept: float = 1.0

    def named(self) -> dict[str, float]:
        return dict(zip(self.unknowns, self.values.tolist(), strict=True))


def solve(
    chain: Chain,
    views: Sequence[View],
    unknowns: Sequence[str],
    held: Array | None = None,
    declared: frozenset[Kind] = frozenset(),
    *,
    exact: bool = True,
    levels: Mapping[Kind, float] | None = None,
) -> Solution:
    """Estimate the unknowns from the views.

    Parameters
    ----------
    held : (chain parameters,) values of parameters that are known; None: zero.
    levels : noise level of each kind in units of its whitener; None: 1 where declared, else estimated.
    exact : bool
        False solves the linear model ``gap = M values`` only.
    """
    with threadpool_limits(1, "blas"):  # blocks are small: two threads would wait for each other
        return _Solver(chain, views, tuple(unknowns), held, declared, exact, levels).run()


def identifiable(
    chain: Chain, views: Sequence[View], unknowns: Sequence[str], floors: Floors | None = None, thorough: bool = False
) -> Groups:
    """The groups of unknowns that the views can tell apart, by a sample of their rows or (`thorough`) by all."""
    return find_groups(*observed(chain, views, unknowns, thorough), group_order(chain, unknowns), floors)


def observed(
    chain: Chain, views: Sequence[View], unknowns: Sequence[str], thorough: bool
) -> tuple[Array, Sequence[str], Array]:
    """A triangular factor of M over all views, its columns' names, and what their norms would be with a full lever."""
    place = {name: k for k, name in enumerate(unknowns)}
    factor, square = np.zeros((0, len(unknowns))), np.zeros(len(unknowns))
    for view in views:
        level = chain.size if view.outputs[0] >= 3 else 1.0  # angles count by what they move at the far end
        most = max(SAMPLE, 4 * len(unknowns))
        parts = (
            [view.part(slice(k, k + most)) for k in range(0, len(view), most)] if thorough else [sampled(view, most)]
        )
        for part in parts:
            rows = np.vstack([factor, level * design_rows(part, place, most)])
            factor = np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > len(unknowns) else rows
            square += np.square(level * full_norms(part, place))
    return factor, unknowns, np.sqrt(square)


class _Solver:
    def __init__(
        self,
        chain: Chain,
        views: Sequence[View],
        unknowns: tuple[str, ...],
        held: Array | None,
        declared: frozenset[Kind],
        exact: bool,
        levels: Mapping[Kind, float] | None,
    ) -> None:
        self.chain, self.views, self.unknowns, self.declared, self.exact = chain, views, unknowns, declared, exact
        self.held = np.zeros(len(chain.ids)) if held is None else held
        if not exact:  # the gap does not change from pass to pass
            self.views = [GapView.of(v, self.held) if v.whitener.ndim == 1 else v for v in views]
        self.taken = np.zeros(len(unknowns))
        self.place = {name: k for k, name in enumerate(unknowns)}
        self.sigma: dict[Kind, float] = {v.kind: 1.0 for v in views} | dict(levels or {})
        self.known = declared if levels is None else frozenset(levels)
        self.precision = known_beforehand(chain, unknowns)
        self.relinearised = False

    def run(self) -> Solution:
        start = self.pass_(np.zeros(len(self.unknowns)), None, gram=True)
        seen = self.observed(thorough=False)
        # the normal equations of positions need what can be told apart to be so clearly; of readings a factor will do
        least = ROUND_OFF if any(v.kind == "position" for v in self.views) else 1e-5 * ROUND_OFF
        groups = find_groups(*seen, least=least)
        if self.missed(groups, start):
            seen = self.observed(thorough=True)
            groups = find_groups(*seen, least=least)
        self.update_noise(start, groups)
        floors = self.floors(start)
        beforehand, whole, within = self.precision, self.of_its_size(seen[2]), np.inf
        for _ in range(MOST_RETREATS):
            groups = find_groups(*seen, floors, least)
            solve = self.iterate if groups.condition < 1 / ROUND_OFF else self.by_factor
            values, sums, passes, converged = solve(groups, start)
            if converged and self.misfit(sums) <= (1 + 1e-9) * self.misfit(start):
                break
            # along a direction that hardly shows the step was so far that the kinematics bent: errors are tied to
            # what they can be, and ever more tightly
            within = min(0.3 * within, LARGEST)
            self.precision = beforehand + whole / within**2
            self.taken = np.zeros(len(self.unknowns))
            self.update_noise(start, groups)
        base = groups.base
        covariance = self.covariance(groups, sums)
        free = groups.rank - round(float(np.diag(covariance) @ self.precision[base]))  # what a prior holds is not free
        return Solution(
            self.unknowns,
            values,
            groups,
            covariance,
            dict(self.sigma),
            self.declared,
            self.misfit(sums),
            sum(s.count for s in sums.values()) - free,
            sums,
            passes,
            converged,
            self.precision,
            within,
            tuple(v.gap for v in self.views if isinstance(v, GapView)),
        )

    def covariance(self, groups: Groups, sums: dict[Kind, Sums]) -> Array:
        """Of the base; where the normal equations have lost digits, from a triangular factor of all rows."""
        base = groups.base
        if groups.condition < SHAKY or self.relinearised:
            gram, _ = self.total(sums)
            return scaled_inverse(gram[np.ix_(base, base)])
        factor = self.triangle(base, np.diag(np.sqrt(self.precision[base])))
        norms = np.linalg.norm(factor, axis=0)
        inverse = np.linalg.solve(factor / norms, np.eye(len(base))) / norms[:, None]
        return np.asarray(inverse @ inverse.T)

    def misfit(self, sums: dict[Kind, Sums]) -> float:
        """Whitened residual sum of squares at the present noise levels."""
        return float(sum(s.square / self.sigma[k] ** 2 for k, s in sums.items()))

    def observed(self, thorough: bool) -> tuple[Array, Sequence[str], Array, list[int]]:
        factor, unknowns, norms = observed(self.chain, self.views, self.unknowns, thorough)
        held = np.diag(np.sqrt(self.precision))[self.precision > 0]
        norms = np.sqrt(np.square(norms) + self.precision)
        return np.vstack([factor, held]), unknowns, norms, group_order(self.chain, self.unknowns)

    def missed(self, groups: Groups, sums: dict[Kind, Sums]) -> bool:
        """Whether some row outside the sample moves a parameter by itself that the sample saw only in groups."""
        gram, _ = self.total(sums)
        others = np.setdiff1d(np.arange(len(self.unknowns)), groups.base)
        if not len(others) or all(len(v) <= SAMPLE for v in self.views):
            return False
        mix = groups.coefficients[:, others]
        base = groups.base
        left = (
            np.diag(gram)[others]
            - 2 * np.sum(mix * gram[np.ix_(base, others)], axis=0)
            + np.sum(mix * (gram[np.ix_(base, base)] @ mix), axis=0)
        )
        return bool((left > 1e-9 * np.diag(gram)[others] + 1e-300).any())

    def floors(self, sums: dict[Kind, Sums]) -> Floors:
        """What the noise hides: directions uncertain by a tenth of the machine, and motions that hardly show.

        The latter are those of which a millimetre (at the end of the travel and of the longest lever) would stay below
        the noise, because less than a thousandth of it is seen: what is not measured shows by the frame's tilt only.
        """
        if "position" not in sums or not sums["position"].count:
            return Floors()
        views = [v for v in self.views if v.kind == "position"]
        weight = np.sqrt(sum(map(weight_of, views)))
        shift = self.sigma["position"] / weight  # standard uncertainty, mm, of a shift of everything
        return Floors(direction=shift / (0.1 * self.chain.size), lever=min(1e-3, shift))

    def of_its_size(self, full: Array) -> Array:
        """Precision (unknowns,) of the rigid error motions if each could move the tip by the machine's size.

        `full` are the norms that their columns would have with a full lever.
        """
        reach = full / np.sqrt(sum(map(weight_of, self.views)))  # mm that a unit of each moves
        rigid = np.isin(self.unknowns, [*{*self.chain.machine_ids} - self.chain.of_effects])
        return np.where(rigid, np.square(reach / self.chain.size), 0.0)

    def round_off(self) -> float:
        """Size of a step that moves what is measured by 1e-13 of the machine."""
        weight = sum(float(np.square(v.whitener).sum()) / self.sigma[v.kind] ** 2 for v in self.views)
        return float(1e-13 * self.chain.size * np.sqrt(weight))

    def iterate(self, groups: Groups, sums: dict[Kind, Sums]) -> tuple[Array, dict[Kind, Sums], int, bool]:
        base = groups.base
        pick = np.ix_(base, base)
        values, at = np.zeros(len(self.unknowns)), None
        first = last = 0.0
        for passes in range(1, MOST_PASSES + 1):
            self.update_noise(sums, groups)
            gram, slope = self.total(sums)
            if not np.isfinite(slope).all():
                return values, sums, passes, False
            step = scaled_solve(gram[pick], slope[base])
            if passes == 1:  # all steps are measured alike: noise levels fall with the residual as long as it falls
                measure, round_off = gram[pick], self.round_off()
            size = float(np.sqrt(max(float(step @ measure @ step), 0.0)))
            first = first or size
            small = max(1e-6 * first, round_off)
            # the residual at `values` is known; a step that rounds away, or no longer shrinks, is not worth a pass
            if size <= small and size > 0.5 * last:
                return values, sums, passes, True
            values = values.copy()
            values[base] += step
            if size <= 1e-12 * first:
                return values, {kind: s.moved(base, step) for kind, s in sums.items()}, passes, True
            relinearise = passes > 1 and size > max(0.2 * last, small)  # errors so large that M itself has changed
            last = size
            if relinearise and self.exact:
                at, self.relinearised = values, True
            fresh = self.pass_(values, at, gram=relinearise)
            if not relinearise:
                for kind, old in sums.items():
                    fresh[kind].gram = old.gram
            sums = fresh
        return values, sums, MOST_PASSES, False

    def by_factor(self, groups: Groups, sums: dict[Kind, Sums]) -> tuple[Array, dict[Kind, Sums], int, bool]:
        """As `iterate`, of a linear problem whose columns are so much alike that only orthogonal steps keep digits."""
        values, base = np.zeros(len(self.unknowns)), groups.base
        factor = self.triangle(base, np.zeros((0, len(base) + 1)), read=True)
        values[base] = np.linalg.solve(factor[: len(base), :-1], factor[: len(base), -1])
        sums = self.pass_(values, None, gram=True)
        self.update_noise(sums, groups)
        return values, sums, 1, True

    def triangle(self, base: Index, above: Array, *, read: bool = False) -> Array:
        """Triangular factor of the base's columns over all rows, below `above`; `read`: with the readings, last."""
        factor = above
        for view in self.views:
            if read:
                vector = view_vector(view, self.place, np.zeros(len(self.unknowns)), self.held)
                gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(vector)])
            for start in range(0, len(view), KERNEL_BLOCK_ROWS):
                part = slice(start, start + KERNEL_BLOCK_ROWS)
                rows = design_rows(view.part(part), self.place, KERNEL_BLOCK_ROWS)[:, base]
                rows = np.column_stack([rows, gap[:, part].ravel()]) if read else rows
                rows /= self.sigma[view.kind]
                factor = np.asarray(np.linalg.qr(np.vstack([factor, rows]), mode="r"))
        return factor

    def pass_(self, values: Array, at: Array | None, gram: bool) -> dict[Kind, Sums]:
        taken, self.taken = self.taken, values
        if self.exact:
            return accumulate(self.views, self.place, values, self.held, at=at, gram=gram)
        return accumulate(self.views, self.place, values, self.held, exact=False, gram=gram, taken=taken)

    def total(self, sums: dict[Kind, Sums]) -> tuple[Array, Array]:
        """Of the data at the values of the last pass, and of what is known beforehand."""
        gram, slope = total(sums, self.sigma)
        return gram + np.diag(self.precision), slope - self.precision * self.taken

    def update_noise(self, sums: dict[Kind, Sums], groups: Groups) -> None:
        """Noise level of each kind that has none declared, from the residuals one step ahead."""
        open_kinds = [k for k in sums if k not in self.known]
        base = groups.base
        pick = np.ix_(base, base)
        for _ in range(50 if open_kinds and len(sums) > 1 else 1):
            gram, slope = self.total(sums)
            step = scaled_solve(gram[pick], slope[base])
            inverse = scaled_inverse(gram[pick])
            before = dict(self.sigma)
            for kind in open_kinds:
                own = sums[kind]
                square = own.square - 2 * float(step @ own.slope[base]) + float(step @ own.gram[pick] @ step)
                used = float(np.sum(inverse * own.gram[pick])) / self.sigma[kind] ** 2
                used = len(base) if len(sums) == 1 and not self.precision.any() else used  # exactly
                free = own.count - used
                floor = 1e-30 * max(own.square, 1e-30)
                self.sigma[kind] = float(np.sqrt(max(square, floor) / max(free, 1e-3)))
            # angles without noise beside noisy positions would weigh so much that nothing else is left to solve
            reach = {kind: self.chain.size if kind in ("orientation", "angle") else 1.0 for kind in open_kinds}
            least = FINEST * max((reach[kind] * self.sigma[kind] for kind in open_kinds), default=0.0)
            self.sigma |= {kind: max(self.sigma[kind], least / reach[kind]) for kind in open_kinds}
            if all(abs(self.sigma[k] / before[k] - 1) < 1e-6 for k in open_kinds):
                break


def known_beforehand(chain: Chain, unknowns: Sequence[str]) -> Array:
    """Precision (unknowns,) about zero of what a prior holds: 1/variance, 0 where there is none."""
    priors = [chain.parameters[chain.index[u]].prior if u in chain.index else None for u in unknowns]
    return np.array([0.0 if p is None else p**-2 for p in priors])


def scaled_solve(gram: Array, slope: Array) -> Array:
    """Solution of normal equations, by their columns' scale."""
    from scipy.linalg import cho_factor, cho_solve

    if not len(slope):
        return np.zeros(0)
    d = 1 / np.sqrt(np.diag(gram))
    unit = gram * np.outer(d, d)
    try:
        return np.asarray(d * cho_solve(cho_factor(unit), d * slope))
    except np.linalg.LinAlgError:  # dependent to round-off: the shortest step
        return np.asarray(d * (np.linalg.pinv(unit, rcond=1e-12, hermitian=True) @ (d * slope)))


def scaled_inverse(gram: Array) -> Array:
    """Inverse of normal equations, by their columns' scale."""
    from scipy.linalg import cho_factor, cho_solve

    if not len(gram):
        return np.zeros((0, 0))
    d = 1 / np.sqrt(np.diag(gram))
    unit = gram * np.outer(d, d)
    try:
        return np.asarray(np.outer(d, d) * cho_solve(cho_factor(unit), np.eye(len(gram))))
    except np.linalg.LinAlgError:
        return np.asarray(np.outer(d, d) * np.linalg.pinv(unit, rcond=1e-12, hermitian=True))
