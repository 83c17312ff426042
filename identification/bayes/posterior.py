"""Posterior of a fit: draws, moments, method, predictive checks and Bayes factors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from errormodel.arrays import Array
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.sampling import Chains

Method = Literal["exact", "quadrature", "emcee"]
# Sentence on the method in the report, with its fields
METHOD_STATEMENTS: dict[Method, str] = {
    "exact": "The posterior is Gaussian: it is given in closed form, and its draws are exact and independent.",
    "quadrature": (
        "Given the one unknown that is not linear ({what}), the posterior is Gaussian in closed form; over that "
        "unknown it is integrated on a grid. Its draws are exact and independent."
    ),
    "emcee": (
        "{what} sampled by emcee: {walkers} walkers, {steps} steps, {length:.0f} autocorrelation times long, split "
        "R-hat {rhat:.3f}, at least {effective:.0f} independent draws."
    ),
}


@dataclass(frozen=True)
class Check:
    """A posterior predictive check: a statistic of the residuals and of simulated residuals.

    Attributes
    ----------
    name, meaning : of the statistic.
    observed, replicated : (draws,) the statistic of the data and of data simulated from the model, at the same draws.
    """

    name: str
    meaning: str
    observed: Array
    replicated: Array

    @property
    def p_value(self) -> float:
        """Two-sided posterior predictive p-value; 1: the data are in the middle of the simulations."""
        above = float(np.mean(self.replicated >= self.observed))
        return min(1.0, 2 * min(above, 1 - above) + 1 / len(self.observed))


@dataclass(frozen=True)
class EffectEvidence:
    """Decimal logarithm of the Bayes factor of an effect, against the machine without it."""

    effect: str
    where: str
    log10_bayes_factor: float


@dataclass(frozen=True)
class Posterior:
    """The posterior of a fit.

    Attributes
    ----------
    method : closed form, quadrature or sampling by emcee.
    names, units : of the groups' base parameters.
    values : (chains, draws, p) draws of the parameters, in their units.
    coordinates : (chains, draws, q) draws of the hyperparameters, in their units.
    unknowns : the hyperparameters.
    mean, covariance : (p,) and (p, p) of the parameters.
    closed_mean, closed_std : (p,) of the closed form at the starting values of the hyperparameters.
    prior_std : (p,) prior standard deviation of each parameter.
    scaled : whether the parameters themselves were sampled, not only the hyperparameters.
    chains : of emcee; None where draws are exact.
    outliers : file, row and probability of those that are more likely outliers than not.
    log_likelihood : (chains, some of the draws, rows) of each kind of observation; each is one of `every` draws.
    prior_values (n, p), prior_coordinates (n, q) : draws from the prior.
    departure : largest error in the log likelihood of the linear and interpolated model against the exact kinematics.
    """

    method: Method
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    coordinates: Array
    unknowns: tuple[Coordinate, ...]
    mean: Array
    covariance: Array
    closed_mean: Array
    closed_std: Array
    prior_std: Array
    scaled: bool = False
    chains: Chains | None = None
    outliers: tuple[tuple[str, int, float], ...] = ()
    checks: tuple[Check, ...] = ()
    evidence: tuple[EffectEvidence, ...] = ()
    departure: float = 0.0
    log_likelihood: Mapping[str, Array] = field(default_factory=dict)
    every: int = 1
    prior_values: Array = field(default_factory=lambda: np.zeros((0, 0)))
    prior_coordinates: Array = field(default_factory=lambda: np.zeros((0, 0)))
    notes: tuple[str, ...] = field(default=())

    @property
    def statement(self) -> str:
        """The method of the computation, in a sentence for the report."""
        names = ", ".join(c.name for c in self.unknowns)
        if self.chains is None:
            return METHOD_STATEMENTS[self.method].format(what=names)
        c = self.chains
        what = f"{'Scaled groups, ' if self.scaled else ''}{names}" if names else "Scaled groups"
        rest = "" if self.scaled else " Given these the groups are Gaussian: their draws are exact."
        return (
            METHOD_STATEMENTS["emcee"].format(
                what=what + (" were" if self.scaled or len(self.unknowns) > 1 else " was"),
                walkers=len(c.points),
                steps=c.steps,
                length=c.steps / c.tau,
                rhat=c.rhat,
                effective=c.effective,
            )
            + rest
        )

    @property
    def bounds(self) -> Array:
        """Limits (2, p) of the central 95 % credible intervals."""
        return np.asarray(np.quantile(self.values.reshape(-1, len(self.names)), (0.025, 0.975), axis=0))

    def as_json(self) -> dict[str, Any]:
        """The key ``posterior`` of ``fit.json``."""
        low, high = self.bounds
        std = np.sqrt(np.diag(self.covariance))
        flat = self.coordinates.reshape(self.values.shape[0] * self.values.shape[1], -1)
        c = self.chains
        return {
            "method": self.method,
            "statement": self.statement,
            "draws": int(np.prod(self.values.shape[:2])),
            "convergence": None
            if c is None
            else {
                "walkers": len(c.points),
                "steps": c.steps,
                "autocorrelation_time": c.tau,
                "split_rhat": c.rhat,
                "effective_draws": c.effective,
                "accepted": c.accepted,
            },
            "parameters": [
                {"id": n, "mean": m, "std": s, "low": a, "high": b, "unit": u, "prior_std": p, "closed_form_std": f}
                for n, m, s, a, b, u, p, f in zip(
                    self.names, self.mean.tolist(), std.tolist(), low.tolist(), high.tolist(), self.units,
                    self.prior_std.tolist(), self.closed_std.tolist(), strict=True,
                )
            ],
            "unknowns": [
                {
                    "name": u.name,
                    "mean": float(v.mean()),
                    "std": float(v.std()),
                    "low": float(np.quantile(v, 0.025)),
                    "high": float(np.quantile(v, 0.975)),
                    "unit": u.unit,
                }
                for u, v in zip(self.unknowns, flat.T, strict=True)
            ],
            "outliers": [{"file": f, "row": row, "probability": p} for f, row, p in self.outliers],
            "checks": [
                {"name": k.name, "p_value": k.p_value, "observed": float(k.observed.mean()),
                 "expected": float(k.replicated.mean())}
                for k in self.checks
            ],
            "evidence": [
                {"effect": e.effect, "where": e.where, "log10_bayes_factor": e.log10_bayes_factor}
                for e in self.evidence
            ],
            "departure_nats": self.departure,
            "notes": list(self.notes),
        }  # fmt: skip
