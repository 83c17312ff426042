"""Sentences of a report, from the numbers of a fit."""

from __future__ import annotations

from math import floor, log10
from pathlib import Path
from typing import NamedTuple

import numpy as np

from identification.estimation.result import Fit, Spread
from identification.results.analysis import Analysis
from identification.results.correlations import correlation

HEADLINE_MOTIONS = 3  # error motions in a headline
WORSE_RMS_RATIO = 1.5  # RMS on held-out rows over RMS on fitted ones, from which the report warns; by judgement
# p-value of the lower chi-squared tail, below which the declared uncertainty is called too large; convention
RARE_P_VALUE = 0.001
# correlation coefficient, from which a sum or difference is much better determined than its terms; by judgement
CLOSE_CORRELATION = 0.9
ROUND_OFF_UM = 1e-3  # um: smaller errors are rounding and are not mentioned


class Judgement(NamedTuple):
    """One sentence; `good` is False where the reader should act."""

    good: bool
    text: str


def short(value: float) -> str:
    """An error in um, rounded for a sentence: ``421``, ``27``, ``4.2``, ``0.35``."""
    if not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}" if value >= 0.95 else f"{value:.2f}"


def three(value: float) -> str:
    """A positive number in three digits, without an exponent at usual sizes."""
    return f"{value:.{max(2 - floor(log10(value)), 0)}f}" if 1e-3 < value < float("inf") else f"{value:.3g}"


def file_name(path: Path | str) -> str:
    """Name of a file, without the folders that depend on where the command was run."""
    return Path(path).name


def _mean(spread: Spread) -> str:
    """Mean size, or the root mean square where only that is known."""
    known = np.isfinite(spread.mean_um)
    return f"{short(spread.mean_um)} µm" if known else f"{short(spread.rms_um)} µm rms"


def headline(fit: Fit) -> str:
    """Result of the fit in one line."""
    if not fit.fitted.n and fit.motions is not None:
        sizes = sorted(fit.motions.errors(fit.survey), key=lambda e: -e.nominal)
        shown = [
            f"{e.symbol} {short(e.nominal)} → {short(e.fitted)} {e.unit.replace('u', 'µ', 1)} rms, held-out "
            f"{short(e.heldout)}"
            for e in sizes[:HEADLINE_MOTIONS]
        ]
        more = f"; and {len(sizes) - HEADLINE_MOTIONS} more" if len(sizes) > HEADLINE_MOTIONS else ""
        return f"Error motions fitted: {'; '.join(shown)}{more}."
    if not fit.fitted.n and fit.readings is not None:
        each = list(fit.readings.errors(fit.survey))
        shown = [
            f"{e.observation} {short(e.nominal)} → {short(e.fitted)} {e.unit.replace('u', 'µ', 1)} rms, held-out "
            f"{short(e.heldout)}"
            for e in each[:HEADLINE_MOTIONS]
        ]
        more = f"; and {len(each) - HEADLINE_MOTIONS} more" if len(each) > HEADLINE_MOTIONS else ""
        return f"Readings fitted: {'; '.join(shown)}{more}."
    return (
        f"Geometry fitted: mean error {short(fit.nominal.mean_um)} → {short(fit.fitted.mean_um)} µm; "
        f"held-out {_mean(fit.heldout)}."
    )


def judgements(fit: Fit) -> list[Judgement]:
    """Sentences on the quality of the fit: improvement, held-out rows, declared noise, test files."""
    out: list[Judgement] = []
    if fit.fitted.n:
        if fit.fitted.mean_um > max(0.8 * fit.nominal.mean_um, ROUND_OFF_UM):
            text = (
                "The error parameters explain little of the error: there is hardly more of it than noise, or its cause "
                "is not in this model."
            )
            out.append(Judgement(False, text))
        ratio = fit.heldout.rms_um / max(fit.fitted.rms_um, ROUND_OFF_UM)
        if ratio > WORSE_RMS_RATIO:
            text = (
                f"Rows that were left out are predicted {ratio:.1f} times worse (rms) than those fitted: too few poses "
                "for so many parameters, or the machine changed during the survey."
            )
        else:
            text = "Rows that were left out of the fit are predicted about as well as those that were fitted."
        out.append(Judgement(ratio <= WORSE_RMS_RATIO, text))
    if fit.declared:
        from scipy.special import chdtr

        if fit.inflation > 1:
            text = (
                f"The residuals are {fit.inflation:.2g} times as large as the declared uncertainty allows: the model "
                "misses something, or the instrument was worse than declared. All standard uncertainties are "
                "multiplied by this factor."
            )
        elif chdtr(fit.solution.dof, fit.solution.chi2) < RARE_P_VALUE:
            text = (
                f"The residuals are only {np.sqrt(fit.solution.chi2 / fit.solution.dof):.2g} times as large as the "
                "declared uncertainty lets expect: the instrument was better than declared. Standard uncertainties "
                "are those declared."
            )
        else:
            text = "The residuals agree with the declared uncertainty."
        out.append(Judgement(fit.inflation <= 1, text))
    if fit.outliers:
        rows = len({o.index for o in fit.outliers})
        text = (
            f"{rows} row{'s lie' if rows > 1 else ' lies'} so far from what the others agree on that the robust fit "
            f"left {'them' if rows > 1 else 'it'} out, in whole or in part: measure {'them' if rows > 1 else 'it'} "
            "again, or find the cause."
        )
        out.append(Judgement(False, text))
    for test in fit.tests:
        if test.fitted.n and test.fitted.rms_um > WORSE_RMS_RATIO * fit.fitted.rms_um:
            text = (
                f"The test file {file_name(test.path)} is predicted clearly worse: mean "
                f"{short(test.fitted.mean_um)} µm (before: {short(test.nominal.mean_um)} µm)."
            )
            out.append(Judgement(False, text))
    return out


def noise(fit: Fit) -> str:
    """Origin of the noise level."""
    dof = f"{fit.solution.dof} degrees of freedom"
    if "position" in fit.declared:
        return (
            f"The survey declares the uncertainty of its positions. Measured by it, the residuals have a reduced "
            f"chi-square of {fit.solution.chi2 / max(fit.solution.dof, 1):.3f} (1 is as declared) with {dof}; they "
            f"scatter by {three(1e3 * fit.sigma_mm)} µm (k = 1) in one coordinate."
        )
    return (
        f"No uncertainty of positions is declared, so the noise is estimated from the residuals, with {dof}. What the "
        "model cannot follow is then taken for noise: a survey of known uncertainty would distinguish them."
    )


def strongest_correlation(analysis: Analysis) -> str:
    """The two groups whose estimates are correlated most, in words."""
    groups, matrix = correlation(analysis)
    if len(groups) < 2:
        return ""
    matrix = matrix - np.eye(len(groups))
    i, j = sorted(int(k) for k in np.unravel_index(int(np.argmax(np.abs(matrix))), matrix.shape))
    value = f"{matrix[i, j]:+.3f}".replace("-", "−")
    known = "difference" if matrix[i, j] > 0 else "sum"
    more = f": their {known}, each in its standard uncertainties, is known better than either"
    more = more if abs(matrix[i, j]) > CLOSE_CORRELATION else ""
    return (
        f"Of all pairs of groups, the estimates of {groups[i].name} and {groups[j].name} are correlated most, with a "
        f"correlation coefficient of {value}{more}."
    )
