"""Weighted Gauss-Newton least squares of all unknowns on the exact kinematics.

The normal equations of the scaled base columns are factorised once. Each further pass evaluates the exact residual in a
stream over the rows, which removes second-order terms and the digits lost by the normal equations. Kinds of
observation without declared uncertainty get a noise level from their own residuals (variance components, with the
degrees of freedom that their rows leave). Units: mm and rad.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from identification.estimation.fitted_groups import as_fitted
from identification.estimation.normal_priors import known_beforehand
from identification.estimation.plausible import IMPLAUSIBLE_SHARE, floors_of, of_its_size
from identification.estimation.scaled_equations import SAME, WeighedEquations, scaled_inverse
from identification.estimation.triangular_factor import triangular_factor
from identification.observation.assembly import group_order
from identification.observation.identifiability import DEPENDENCE_TOLERANCE, Floors, Groups, find_groups
from identification.observation.models import GapView, Kind, PositionView, View
from identification.observation.normal_equations import (
    RANK_SAMPLE_ROWS,
    accumulate,
    design_rows,
    full_norms,
    sampled,
    total,
    weight_of,
)
from identification.observation.readings import ReadingView
from identification.observation.sums import Sums
from identification.runtime.blas import one_blas_thread

# Smallest estimated noise level over the largest (angles times the machine's size): a kind without noise would weigh
# so much that the others were ignored; by judgement
LEAST_NOISE_RATIO = 1e-4
ILL_CONDITIONED = 1e4  # condition number above which normal equations keep fewer than eight digits
WELL_CONDITIONED = 1e5  # the same, up to which they give a residual to six digits
MOST_PASSES = 30  # streams through the data
MOST_RETREATS = 6  # restarts with a tighter prior after divergence
MOST_ASTRAY = 3  # passes in a row that fit worse than the start does: the steps lead away from it
FIRST_NOISE_ROUNDS = 20  # of alternating between noise levels and the step that they weigh
LINEAR_SHARE = 0.1  # movement of the tip over the machine's size up to which M hardly changes; by judgement


@dataclass(frozen=True)
class Solution:
    """Estimates of all unknowns.

    Attributes
    ----------
    unknowns : names; `values` (u,): their estimates, mm and rad, 0 for those that are not the base of a group.
    groups : identifiable groups; `covariance` (rank, rank): of the groups' values.
    sigma : noise level of each kind in units of its whitener, 1 for the kinds in `declared`.
    chi2, dof : whitened residual sum of squares with those levels, and degrees of freedom.
    sums : sufficient statistics of each kind, the residual taken at `values`.
    passes : streams through the data; `converged`: the last step was negligible.
    precision : (u,) of the normal prior about zero; 0: none.
    within : standard deviation, over the machine's size, of the prior that holds rigid error motions at zero, and
        set-ups where they start, after the fit diverged along weakly observable directions; inf where it did not.
    kept : mean square of the weighted residuals of positions, in noise variances: not 1 if rows are weighted robustly.
    at : (u,) values at which M in `sums` was taken, where errors are so large that it changes; None: at zero errors.
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
    kept: float = 1.0
    at: Array | None = None

    def named(self) -> dict[str, float]:
        """Estimates by name."""
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
    effect_sizes: float | None = None,
) -> Solution:
    """Estimate the unknowns from the views.

    Parameters
    ----------
    unknowns : names of the parameters to estimate.
    held : (chain parameters,) values of known parameters, mm and rad; None: zero.
    declared : kinds of observation whose uncertainty is declared.
    exact : bool
        False solves the linear model ``gap = M values`` only.
    levels : noise level of each kind in units of its whitener; None: 1 where declared, else estimated.
    effect_sizes : standard deviation of a normal prior about zero of the parameters of effects, in units of their
        physical sizes; None: no prior. What the data leave open of an effect is not extrapolated with it.
    """
    with one_blas_thread():  # blocks are small: one thread is fastest
        beforehand = known_beforehand(chain, unknowns, effect_sizes)
        return Solver(chain, views, tuple(unknowns), held, declared, exact, levels, beforehand).run()


def identifiable(
    chain: Chain, views: Sequence[View], unknowns: Sequence[str], floors: Floors | None = None, thorough: bool = False
) -> Groups:
    """The identifiable groups of unknowns, decided on a sample of the views' rows or (`thorough`) on all."""
    return find_groups(*observed(chain, views, unknowns, thorough), group_order(chain, unknowns), floors)


def observed(
    chain: Chain, views: Sequence[View], unknowns: Sequence[str], thorough: bool
) -> tuple[Array, Sequence[str], Array]:
    """Triangular factor of M over all views, names of its columns, and their norms at full travel and lever."""
    place = {name: k for k, name in enumerate(unknowns)}
    factor, square = np.zeros((0, len(unknowns))), np.zeros(len(unknowns))
    for view in views:
        level = chain.size if view.turns else 1.0  # angles in mm at the machine's size
        most = max(RANK_SAMPLE_ROWS, 4 * len(unknowns) // len(view.outputs))
        parts = (
            [view.part(slice(k, k + most)) for k in range(0, len(view), most)] if thorough else [sampled(view, most)]
        )
        for part in parts:
            rows = np.vstack([factor, level * design_rows(part, place, most)])
            factor = np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > len(unknowns) else rows
            square += np.square(level * full_norms(part, place))
    return factor, unknowns, np.sqrt(square)


class Solver:
    """State of one least-squares solution; the parameters are those of `solve`."""

    def __init__(
        self,
        chain: Chain,
        views: Sequence[View],
        unknowns: tuple[str, ...],
        held: Array | None,
        declared: frozenset[Kind],
        exact: bool,
        levels: Mapping[Kind, float] | None,
        beforehand: Array,
    ) -> None:
        self.chain, self.views, self.unknowns, self.declared, self.exact = chain, views, unknowns, declared, exact
        self.held = np.zeros(len(chain.ids)) if held is None else held
        if not exact:  # the gap does not change from pass to pass
            plain = [not isinstance(v, ReadingView) and v.exact_columns == len(v.ids) for v in views]
            stored = [own and v.whitener.ndim == 1 for own, v in zip(plain, views, strict=True)]
            if not self.held.any():  # positions: the kernel that gives M gives the gap as well
                stored = [
                    own and not (v.any_axes and isinstance(v, PositionView))
                    for own, v in zip(stored, views, strict=True)
                ]
            self.views = [GapView.of(v, self.held) if own else v for own, v in zip(stored, views, strict=True)]
        self.of_tool = any(v.of_tool for v in self.views)
        self.taken = np.zeros(len(unknowns))
        self.place = {name: k for k, name in enumerate(unknowns)}
        self.sigma: dict[Kind, float] = {v.kind: 1.0 for v in views} | dict(levels or {})
        self.known = declared if levels is None else frozenset(levels)
        self.precision = beforehand
        self.at: Array | None = None
        self.last: WeighedEquations | None = None
        self.each = 1.0  # rows of the survey for each row of the views, where these are a sample

    def run(self) -> Solution:
        start = self.pass_(np.zeros(len(self.unknowns)), None, gram=True)
        seen = self.observed(thorough=False)
        # positions need well-separated columns for normal equations; readings have a triangular factor
        least = (1.0 if self.of_tool else 1e-5) * DEPENDENCE_TOLERANCE
        groups = find_groups(*seen, least=least)
        if self.missed(groups, start):
            seen = self.observed(thorough=True)
            groups = find_groups(*seen, least=least)
        # of nearly dependent columns normal equations give no residual: the noise would come out as nothing
        sound = groups if groups.condition < WELL_CONDITIONED else find_groups(*seen, least=1 / WELL_CONDITIONED)
        beforehand, within = self.precision, np.inf
        whole = of_its_size(self.chain, self.views, self.unknowns, seen[2])
        self.first_noise(start, sound.base, whole)
        shown = self.least_noise(start, sound.base)
        floors = floors_of(self.chain, self.views, start, shown, self.each)
        beyond = max((shown[kind] / self.sigma[kind] for kind in shown), default=1.0)
        for _ in range(MOST_RETREATS):
            if not (floors.direction < groups.margin.direction and floors.lever < groups.margin.lever):
                groups = find_groups(*seen, floors, least)
            # a factor is of the linear model; steps of normal equations that lost digits come again until none is left
            bad = groups.condition > 1 / DEPENDENCE_TOLERANCE and not self.of_tool
            found = self.by_factor(groups, start) if bad else self.iterate(groups.base, start)
            values, sums, passes, converged = found
            reach = (np.sqrt(whole) * np.abs(values)).max(initial=0.0)  # of error motions at the tip
            if (
                converged
                and not (self.at is not None and reach > LINEAR_SHARE)
                and self.misfit(sums) <= (1 + 1e-9) * self.misfit(start)
            ):
                break
            # the step along a weakly observable direction left the linear range: error motions and set-ups get a prior
            # of physical size beside the noise that is seen, which is tightened at each restart
            within = min(0.3 * within, IMPLAUSIBLE_SHARE)
            self.precision = beforehand + whole * (beyond / within) ** 2
            self.taken, self.at = np.zeros(len(self.unknowns)), None
            self.update_noise(start, groups.base)
        else:
            converged = False
        base = groups.base
        covariance = self.covariance(groups, sums)
        free = groups.rank - round(float(np.diag(covariance) @ self.precision[base]))  # less those set by the prior
        unit = {p.id: p.unit for p in self.chain.parameters}
        groups = as_fitted(groups, self.total(sums)[0], covariance, [unit.get(name, "") for name in self.unknowns])
        return Solution(
            self.unknowns, values, groups, covariance, dict(self.sigma), self.declared, self.misfit(sums),
            sum(s.count for s in sums.values()) - free, sums, passes, converged, self.precision, within, at=self.at,
        )  # fmt: skip

    def covariance(self, groups: Groups, sums: dict[Kind, Sums]) -> Array:
        """Covariance of the groups; from a triangular factor of all rows where the normal equations lost digits."""
        base = groups.base
        if groups.condition < ILL_CONDITIONED or self.at is not None:
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
        """Whether a row outside the sample identifies a parameter that is dependent in the sample."""
        gram, _ = self.total(sums)
        others = np.setdiff1d(np.arange(len(self.unknowns)), groups.base)
        if not len(others) or all(len(v) <= RANK_SAMPLE_ROWS for v in self.views):
            return False
        base, mix = groups.base, groups.coefficients[:, others]
        left = (
            np.diag(gram)[others]
            - 2 * np.sum(mix * gram[np.ix_(base, others)], axis=0)
            + np.sum(mix * (gram[np.ix_(base, base)] @ mix), axis=0)
        )
        return bool((left > 1e-9 * np.diag(gram)[others] + 1e-300).any())

    def first_noise(self, sums: dict[Kind, Sums], base: Index, whole: Array) -> None:
        """Noise levels of the first step; `whole` as of `of_its_size`.

        A step beyond every machine may leave nothing: all commands to one ball fit one whose axes stand still. The
        noise is then that beside error motions of physical size.
        """
        self.update_noise(sums, base)
        step = self.weighed(sums, base).solve(self.slope(sums)[base])
        if (np.sqrt(whole[base]) * np.abs(step)).max(initial=0.0) <= IMPLAUSIBLE_SHARE:
            return
        beforehand = self.precision
        self.precision = beforehand + whole / IMPLAUSIBLE_SHARE**2
        self.sigma |= {kind: 1.0 for kind in sums if kind not in self.known}
        for _ in range(FIRST_NOISE_ROUNDS):
            self.update_noise(sums, base)
        self.precision = beforehand

    def round_off(self) -> float:
        """Whitened length of a step that moves the measured points by 1e-13 of the machine's size."""
        weight = sum(
            (weight_of(v) if v.whitener.ndim == 1 else float(np.square(v.whitener).sum())) / self.sigma[v.kind] ** 2
            for v in self.views
        )
        return float(1e-13 * self.chain.size * np.sqrt(self.each * weight))

    def iterate(self, base: Index, sums: dict[Kind, Sums]) -> tuple[Array, dict[Kind, Sums], int, bool]:
        """Steps of the normal equations from the values of the last pass, of which the sums are."""
        values = self.taken
        first = last = 0.0
        start, astray = sums, 0
        for passes in range(1, MOST_PASSES + 1):
            self.update_noise(sums, base)
            slope = self.slope(sums)[base]
            astray = astray + 1 if self.misfit(sums) > (1 + 1e-9) * self.misfit(start) else 0
            if astray == MOST_ASTRAY or not np.isfinite(slope).all():
                return values, sums, passes, False
            equations = self.weighed(sums, base)
            step = equations.solve(slope)
            if passes == 1:  # one norm for all steps: the noise levels, and with them the Gram matrix, change
                measure, round_off = equations.gram, self.round_off()
            size = float(np.sqrt(max(float(step @ measure @ step), 0.0)))
            first = first or size
            small = max(1e-6 * first, round_off)
            # the residual at `values` is known; a step at round-off level or no longer shrinking needs no pass
            if size <= small and size > 0.5 * last:
                return values, sums, passes, True
            values = values.copy()
            values[base] += step
            if size <= 1e-12 * first:
                return values, {kind: s.moved(base, step) for kind, s in sums.items()}, passes, True
            relinearise = passes > 1 and size > max(0.2 * last, small)  # slow convergence: M has changed
            last = size
            if relinearise and self.exact:
                self.at = values
            fresh = self.pass_(values, self.at, gram=relinearise)
            if not relinearise:
                for kind, old in sums.items():
                    fresh[kind].gram = old.gram
            sums = fresh
        return values, sums, MOST_PASSES, False

    def by_factor(self, groups: Groups, sums: dict[Kind, Sums]) -> tuple[Array, dict[Kind, Sums], int, bool]:
        """Solve an ill-conditioned linear problem by orthogonal triangularisation instead of normal equations."""
        values, base = np.zeros(len(self.unknowns)), groups.base
        prior = np.column_stack([np.diag(np.sqrt(self.precision[base])), np.zeros(len(base))])
        factor = self.triangle(base, prior, read=True)
        values[base] = np.linalg.solve(factor[: len(base), :-1], factor[: len(base), -1])
        sums = self.pass_(values, None, gram=True)
        self.update_noise(sums, base)
        return values, sums, 1, True

    def triangle(self, base: Index, above: Array, *, read: bool = False) -> Array:
        """Triangular factor of the base columns over all rows and `above`; `read`: with the readings as last column."""
        at = np.zeros(len(self.unknowns)) if read else None
        return triangular_factor(self.views, self.place, self.sigma, base, above, self.held, at)

    def pass_(self, values: Array, at: Array | None, gram: bool) -> dict[Kind, Sums]:
        taken, self.taken = self.taken, values
        if self.exact:
            return accumulate(self.views, self.place, values, self.held, at=at, gram=gram)
        lengths = bool(values.any())  # not those of a machine without errors, from which all starts
        return accumulate(
            self.views, self.place, values, self.held, exact=False, gram=gram, taken=taken, lengths=lengths
        )

    def total(self, sums: dict[Kind, Sums]) -> tuple[Array, Array]:
        """Normal equations of the data at the values of the last pass and of the prior."""
        gram, _ = total(sums, self.sigma)
        return gram + np.diag(self.precision), self.slope(sums)

    def slope(self, sums: dict[Kind, Sums]) -> Array:
        """The right side of the same."""
        return sum((s.slope / self.sigma[k] ** 2 for k, s in sums.items()), start=-self.precision * self.taken)

    def weighed(self, sums: dict[Kind, Sums], base: Index) -> WeighedEquations:
        """The normal equations of some columns, those of before where they serve."""
        if self.last is None or not self.last.serves(sums, self.sigma, self.precision, base):
            self.last = WeighedEquations(sums, dict(self.sigma), self.precision, base)
        return self.last

    def shown_noise(self, sums: dict[Kind, Sums], base: Index, kinds: Sequence[Kind]) -> dict[Kind, float]:
        """Noise levels of some kinds by the predicted residuals after the next step."""
        alone, step = len(sums) == 1 and not self.precision.any(), np.zeros(len(self.unknowns))
        equations, out = self.weighed(sums, base), dict[Kind, float]()
        step[base] = equations.solve(self.slope(sums)[base])
        for kind in kinds:
            own = sums[kind]
            square = own.square - 2 * float(step @ own.slope) + float(step @ (own.gram @ step))
            square = max(square, 1e-30 * max(own.square, 1e-30))
            free = own.count - (float(len(base)) if alone else equations.used[kind])
            out[kind] = float(np.sqrt(square / max(free, 1e-3)))
        return out

    def least_noise(self, sums: dict[Kind, Sums], base: Index) -> dict[Kind, float]:
        """Noise levels; of kinds whose level is known no less than what their residuals show."""
        known = [k for k in sums if k in self.known and sums[k].count > len(base)]
        return self.sigma | {k: max(self.sigma[k], v) for k, v in self.shown_noise(sums, base, known).items()}

    def update_noise(self, sums: dict[Kind, Sums], base: Index) -> None:
        """Estimate the noise level of each undeclared kind, from the predicted residuals after the next step."""
        open_kinds = [k for k in sums if k not in self.known]
        if not open_kinds:
            return
        for _ in range(50 if len(sums) > 1 else 1):
            before = self.sigma
            self.sigma = before | self.shown_noise(sums, base, open_kinds)
            # noise-free angles beside noisy positions would make the normal equations singular
            turning = {v.kind for v in self.views if v.turns}
            reach = {kind: self.chain.size if kind in turning else 1.0 for kind in open_kinds}
            least = LEAST_NOISE_RATIO * max((reach[kind] * self.sigma[kind] for kind in open_kinds), default=0.0)
            self.sigma |= {kind: max(self.sigma[kind], least / reach[kind]) for kind in open_kinds}
            if all(abs(self.sigma[k] / before[k] - 1) < SAME for k in open_kinds):
                break
