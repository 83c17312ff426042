"""The noise of each kind of observation, in a fit of several kinds: positions, orientations, lengths, angles.

Where no uncertainty is declared the fit estimates it from the residuals. What was left out of the model moves some
kinds more than others and makes them seem noisy; the search then hardly looks at them.
"""

from __future__ import annotations

from dataclasses import replace

from identification.diagnosis.decisions.constants import MISFIT_RATIO
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.residual_rows import views_of
from identification.estimation.result import Fit
from identification.observation.models import Kind


def kinds_of(fit: Fit, linear: LinearModel) -> set[Kind]:
    """The kinds of observations in a linear model of a fit."""
    return {view.kind for view in views_of(fit, linear)}


def with_noise_of(fit: Fit, linear: LinearModel, final: Fit, log: DecisionLog) -> Fit | None:
    """A fit with the noise that the final one leaves of each kind in its linear model; None where it hardly differs."""
    kinds = kinds_of(fit, linear)
    if len(kinds) < 2:
        return None
    own, after = fit.solution.sigma, final.solution.sigma
    times = [(own[kind] / after[kind]) ** 2 for kind in kinds]
    ratio = max(times) / min(times)
    changed = ratio > MISFIT_RATIO
    log.add("noise-of-kinds", "found" if changed else "passed", "observations", ratio, MISFIT_RATIO)
    return replace(fit, solution=replace(fit.solution, sigma={**own, **after})) if changed else None
