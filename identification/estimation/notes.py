"""Notes on a fit: noise that is correlated, directions that ran away, groups that are sums to first order only."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.chain import Chain
from errormodel.conventions import ROTATIONS
from errormodel.survey import Survey
from errormodel.surveys.observations import is_unknown
from identification.estimation.least_squares import Solution
from identification.estimation.noise import Noise

SECOND_ORDER_SIGMA = 3.0  # standard uncertainties of second order that are said; by judgement


def second_order(solution: Solution) -> list[str]:
    """A note where groups, which are sums of parameters to first order, are known better than that order is.

    A rotation that is in the group of another turns all errors between the two.
    """
    base = solution.groups.base
    names, values = [solution.unknowns[k] for k in base], np.abs(solution.values[base])
    std = np.sqrt(np.diag(solution.covariance))
    turns = np.array([n.rpartition(".")[2] in ROTATIONS for n in names], dtype=bool)  # of frames and members, rad
    angle = values[turns].max(initial=0.0)
    off = np.divide(angle * values, std, out=np.zeros_like(std), where=std > 0)
    if not len(off) or off.max() < SECOND_ORDER_SIGMA:
        return []
    worst = int(off.argmax())
    return [
        f"rotations of {1e3 * angle:.2g} mrad turn other errors by more than their standard uncertainties, and groups "
        f"are sums of parameters to first order only: {names[worst]} may differ from such a sum by {off[worst]:.0f} of "
        "its own, others likewise. Correct the largest errors of the machine, or its dimensions in machine.yaml, and "
        "measure again"
    ]


def idle_effects(chain: Chain, solution: Solution) -> Iterator[str]:
    """Notes on effects of the machine that the fitted rows do not show at all."""
    for spec, ids in zip(chain.machine.effects, chain.effect_ids, strict=True):
        if ids and set(ids) <= set(solution.groups.no_effect):
            yield (
                f"effect {spec.effect} ({', '.join(ids)}) moves nothing in these rows, which therefore do not "
                "determine it: what drives it does not change in them"
            )


def fit_notes(survey: Survey, solution: Solution, noise: Noise | None, longest: int) -> tuple[str, ...]:
    """Notes for the user on correlated noise, divergence and convergence."""
    notes = list(survey.notes)
    if noise is not None:
        part = 100 * noise.part / (1 + noise.part)
        notes.append(
            f"the residuals are correlated over about {noise.length:.0f} rows ({part:.0f} % of their variance): "
            "standard uncertainties take it into account"
        )
        if noise.length > longest / 4:
            notes.append(
                f"that is no shorter than a quarter of the longest run ({longest} rows), so that such noise cannot be "
                "distinguished from an offset or a drift: standard uncertainties are lower limits. Measure longer or "
                "repeat the run, or let `errormodel diagnose` look for a drift"
            )
    if np.isfinite(solution.within):
        what = "zero, and set-ups to where they start," if any(map(is_unknown, solution.unknowns)) else "zero"
        notes.append(
            "the poses leave some error motions so open that the fit ran away along them: all are held to "
            f"{what} within {1e3 * solution.within:.2g} mm a metre, which changes nothing that was seen. Measure where "
            "the joints have not been (`errormodel plan`), or declare fewer errors in machine.yaml"
        )
    notes += second_order(solution)
    if not solution.converged:
        notes.append(
            "the iteration has not settled: errors are too large for this model, or rows contradict each other"
        )
    return tuple(notes)
