"""Posterior distribution as a section of the report."""

from __future__ import annotations

from functools import partial
from math import floor, log10
from typing import NamedTuple

import numpy as np

from identification.bayes.posterior import Posterior
from identification.plots.posterior_corner import draw_posterior_corner
from identification.plots.posterior_trace import draw_posterior_trace
from identification.plots.predictive_checks import draw_predictive_checks
from identification.report.pictures import Picture, picture
from identification.report.tables import number
from identification.results.parameter_table import printed

MOST_POSTERIOR_OUTLIERS = 40  # outliers listed
DOUBTFUL_P_VALUE = 0.01  # p-value of a posterior predictive check, below which the report warns; convention


class PosteriorPart(NamedTuple):
    """Sentences, tables and figures of the section."""

    statement: str
    notes: tuple[str, ...]
    unknowns: list[list[str]]
    groups: list[list[str]]
    outliers: str
    checks: list[list[str]]
    checked: str
    evidence: list[list[str]]
    drawn: list[Picture]
    predicted: list[Picture]


def posterior_part(p: Posterior | None) -> PosteriorPart | None:
    """The section's content; None for a fit without a posterior."""
    if p is None:
        return None
    failed = [c.name for c in p.checks if c.p_value < DOUBTFUL_P_VALUE]
    return PosteriorPart(
        f"{p.statement} The log likelihood of the linear model differs from that of the exact kinematics by at most "
        f"{p.departure:.2g}.",
        p.notes,
        _unknowns(p),
        _groups(p),
        _outliers(p),
        [[c.name, c.meaning, f"{np.mean(c.observed):.3g}", f"{np.mean(c.replicated):.3g}", f"{c.p_value:.2g}"]
         for c in p.checks],
        f"Data drawn from the model rarely look like these: {', '.join(failed)}." if failed else
        "Data drawn from the model look like these.",
        [[e.effect, e.where, number(e.log10_bayes_factor, 1)] for e in p.evidence],
        _figures(p),
        [_predictive(p)] if p.checks else [],
    )  # fmt: skip


def _unknowns(p: Posterior) -> list[list[str]]:
    out = []
    for k, unknown in enumerate(p.unknowns):
        factor, unit = unknown.printed
        out.append([unknown.name, *_cells(factor * p.coordinates[:, :, k].ravel()), unit])
    return out


def _groups(p: Posterior) -> list[list[str]]:
    out = []
    for k, (name, unit) in enumerate(zip(p.names, p.units, strict=True)):
        if name.startswith(("frame", "zero[")):
            continue
        factor, text = printed(unit)
        cells = _cells(factor * p.values[:, :, k].ravel(), factor * float(p.mean[k]))
        ratio = float(np.sqrt(p.covariance[k, k])) / p.closed_std[k]
        out.append([name, *cells, text, number(ratio, 2), number(float(p.prior_std[k]) / p.closed_std[k], 0)])
    return out


def _cells(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], mean: float | None = None) -> list[str]:
    """Mean and standard deviation, and the central 95 % interval."""
    std = float(values.std())
    places = min(max(0, 1 - floor(log10(std))), 8) if std > 0 else 3
    low, high = np.quantile(values, (0.025, 0.975))
    middle = float(values.mean()) if mean is None else mean
    return [f"{number(middle, places)} ± {number(std, places)}", f"{number(low, places)} to {number(high, places)}"]


def _outliers(p: Posterior) -> str:
    if not p.outliers:
        return ""
    rows = ", ".join(
        f"{row} ({100 * probability:.0f} %)" for _, row, probability in p.outliers[:MOST_POSTERIOR_OUTLIERS]
    )
    more = (
        f" and {len(p.outliers) - MOST_POSTERIOR_OUTLIERS} more in fit.json"
        if len(p.outliers) > MOST_POSTERIOR_OUTLIERS
        else ""
    )
    return f"{len(p.outliers)} rows are more likely outliers than not: rows {rows}{more}."


def _figures(p: Posterior) -> list[Picture]:
    out = [
        picture(
            partial(draw_posterior_corner, p),
            "Unknowns by pairs (contours hold 68 and 95 % of the draws) and each by itself; dashed: the closed form at "
            "the most likely noise and shapes.",
            "Corner plot of the posterior",
            "png",
        )
    ]
    if p.chains is not None:
        text = (
            "The chain after its burn-in: some walkers (grey), their median and middle 68 %. Level bands have settled."
        )
        out.append(picture(partial(draw_posterior_trace, p), text, "Trace of the walkers over the draws", "png"))
    return out


def _predictive(p: Posterior) -> Picture:
    text = "Figures of the residuals (line and band) beside those of data drawn from the model (grey)."
    return picture(partial(draw_predictive_checks, p), text, "Histograms of posterior predictive checks")
