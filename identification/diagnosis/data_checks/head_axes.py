"""Axes of a measuring head that are swapped, mirrored or the tool's, in R-tests and surveys as narrow.

Where points spread, swapped columns show in the alignment. In an R-test the readings are deviations of micrometres
about one point, and any assignment of axes aligns. The linear model of the machine's declared errors is therefore
fitted to the readings with their axes in every other order and sign, and residual sums of squares are compared.
"""

from __future__ import annotations

from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from errormodel.exceptions import InputError
from errormodel.surveys.columns import MEASURED
from identification.diagnosis.data_checks.declared_errors import CLEARLY, DeclaredErrors
from identification.estimation.orthonormal_basis import orthonormal_basis
from identification.estimation.result import Fit
from identification.observation.open_signs import at_one_place

BETTER = 1.5  # times the residual standard deviation


class Axes(NamedTuple):
    """Which reading is taken along each axis, with which sign, and whether these axes turn with the tool."""

    order: tuple[int, ...]
    signs: tuple[int, ...]
    of_tool: bool = False

    @property
    def changes(self) -> int:
        swaps = sum(k != own for own, k in enumerate(self.order))
        return swaps + sum(s < 0 for s in self.signs) + self.of_tool

    def __str__(self) -> str:
        names = (f"{'-' if s < 0 else ''}{MEASURED[k]}" for k, s in zip(self.order, self.signs, strict=True))
        where = " in axes that turn with the tool" if self.of_tool else ""
        return f"{', '.join(names)}{where} (or all three with the opposite sign)"


class Assigned(NamedTuple):
    """Axes with which the readings fit, by what ratio their residual is smaller, and the log likelihood ratio."""

    axes: Axes
    ratio: float
    log_ratio: float


def all_axes() -> list[Axes]:
    """The axes in every order and sign, the fewest changes first; of two that are opposite in all signs, one."""
    every = product(permutations(range(3)), product((1, -1), repeat=3), (False, True))
    return sorted((Axes(*a) for a in every if sum(a[1]) > 0), key=lambda a: a.changes)


def refuse_turned_head(fit: Fit) -> None:
    """InputError where readings of a measuring head are explained best with its axes swapped or mirrored.

    All readings with the opposite sign fit as well as they do, with all errors of the opposite sign, so that nothing is
    put right. An effect that the machine's model lacks may look like turned axes: the best one must explain less.
    """
    found = assigned(fit)
    if found is None or found.log_ratio < CLEARLY + _best_effect(fit):
        return
    raise InputError(
        f"{fit.survey.source}, columns {' '.join(MEASURED)}",
        f"the machine's errors leave {found.ratio:.2g} times less of these readings if they are taken as {found.axes}, "
        "which no effect that is missing does",
        "See how the measuring head was mounted and wired, and write its readings along x, y and z of the reference, "
        "at the chain's beginning",
    )


def assigned(fit: Fit) -> Assigned | None:
    """Axes with which the readings fit clearly better than as they are written, or None."""
    if fit.survey.indicated or not at_one_place(fit.problem.views):
        return None
    as_stated = DeclaredErrors.of(fit.problem)
    if as_stated is None:
        return None
    views, gaps, basis, freedom = as_stated.views, as_stated.gaps, as_stated.basis, as_stated.freedom
    tools = [v.commanded for v in views]
    zeros = np.vstack(
        [v.whiten(slice(None), t.transpose(2, 1, 0)).reshape(3, -1).T for v, t in zip(views, tools, strict=True)]
    )
    wider = orthonormal_basis(np.hstack([basis, zeros / np.linalg.norm(zeros, axis=0)]))  # a head's own zero turns too

    def deviation(axes: Axes) -> float:
        """Norm of the residual of the readings with their axes in this order and sign, in units of the noise."""
        parts = []
        for view, gap, tool in zip(views, gaps, tools, strict=True):
            turned = view.pose.rotation @ gap  # in the head's axes
            turned = np.array(axes.signs)[:, None] * turned[list(axes.order)]
            turned = np.einsum("nij,jn->in", tool, turned) if axes.of_tool else view.pose.rotation.T @ turned
            parts.append(view.whiten(slice(None), turned).ravel())
        readings, known = np.concatenate(parts), wider if axes.of_tool else basis
        return float(np.linalg.norm(readings - known @ (known.T @ readings)))

    as_written, *others = all_axes()
    best = min(others, key=deviation)
    ratio = deviation(as_written) / max(deviation(best), np.finfo(float).tiny)
    found = Assigned(best, ratio, freedom * float(np.log(max(ratio, np.finfo(float).tiny))))
    return found if ratio > BETTER and found.log_ratio > CLEARLY else None


def _best_effect(fit: Fit) -> float:
    """Log likelihood ratio of the effect that explains most of what is left."""
    from identification.diagnosis.linear.of_fit import set_up
    from identification.diagnosis.search.candidates import Candidates
    from identification.diagnosis.search.proposals import proposed

    linear = set_up(fit)
    candidates = Candidates.of(linear, proposed(linear))
    if not candidates.effects:
        return 0.0
    best = candidates.effects[int(np.argmax(candidates.scores(linear).delta_chi2))]
    return linear.freedom / 2 * float(np.log(linear.square / linear.square_with(best)))
