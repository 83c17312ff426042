"""Serially correlated noise: estimation of an ARMA(1,1) model by restricted likelihood, and corrected covariances.

Moving air and a drifting instrument give neighbouring rows similar errors. Least squares stays unbiased, but parameters
that act slowly along the survey (a frame, a zero, a rarely moved joint) have larger standard uncertainties than
independent rows would give. The covariance of the fit is corrected for this. Lengths are in rows, in survey order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from identification.estimation.least_squares import Solution
from identification.estimation.orthonormal_basis import orthonormal_basis
from identification.observation.assembly import Problem
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows, view_vector

# Grid of the noise model, by judgement: steps of about a factor of 3 (lengths) and 4 (variances)
CORRELATION_LENGTHS_ROWS = (2.0, 6.0, 20.0, 60.0, 200.0)  # rows over which the correlation falls to 1/e
CORRELATED_VARIANCE_RATIOS = (0.1, 0.4, 1.5, 6.0)  # variance of the correlated part over that of the white part
FEWEST_NOISE_ROWS = 30  # rows below which correlation is not estimated, by judgement
RESIDUAL_ROUND_OFF_SHARE = 1e-10  # of the machine's size: smaller residuals are round-off, not noise
LEAST_LOG_LIKELIHOOD_GAIN = 8.0  # by which correlated noise must exceed white noise (natural logarithm), by judgement
AT_ONCE = 64  # columns that go through a filter together: their copies stay within the processor's cache
MOST_NOISE_ROWS = 4000  # longer surveys are represented by this many rows from their middle: limits the time


@dataclass(frozen=True)
class Noise:
    """Sum of white noise of variance 1 and first-order autoregressive noise of variance `part`.

    The correlation of the latter falls to 1/e over `length` rows. The sum is an ARMA(1,1) process: a filter of two
    coefficients turns it into innovations. Series are in the order of the rows.
    """

    length: float
    part: float

    @property
    def kept(self) -> float:
        """Autoregressive coefficient: correlation of the correlated part from row to row."""
        return float(np.exp(-1 / self.length))

    @property
    def moving(self) -> float:
        """Moving-average coefficient, from the first autocovariance."""
        phi = self.kept
        ratio = phi / (1 + phi**2 + self.part * (1 - phi**2))
        return float((1 - np.sqrt(1 - 4 * ratio**2)) / (2 * ratio))

    @property
    def news(self) -> float:
        """Variance of an innovation over the variance of the process."""
        return self.kept / self.moving / (1 + self.part)

    def whitened(self, columns: Array, edges: Index) -> Array:
        """Innovations of series (k, N), each part between two `edges` by itself, scaled to one common variance.

        Values behind the last edge stay as they are.
        """
        from scipy.linalg.lapack import dtbtrs

        first, last = edges[:-1], int(edges[-1])
        bands = np.vstack([np.ones(last), np.full(last, -self.moving)])
        bands[1, first[1:] - 1] = 0.0
        out = columns.copy()
        for some in _few(columns):
            changes = self._changes(columns[some], edges).T
            out[some, :last] = dtbtrs(bands, changes, uplo="L", diag="U", overwrite_b=True)[0].T
        out[:, first] *= np.sqrt(self.news)  # the first row has the variance of the process
        return out

    def _changes(self, columns: Array, edges: Index) -> Array:
        """Series (k, N) less what the correlated part keeps of the row before."""
        first, last = edges[:-1], int(edges[-1])
        out = columns[:, :last].copy()
        out[:, 1:] -= self.kept * columns[:, : last - 1]
        out[:, first] = columns[:, first]
        return out

    def weighed(self, columns: Array, edges: Index) -> Array:
        """Product of series (k, N) and the inverse of the covariance that makes `whitened` ones independent.

        Differences that leave the moving average, a tridiagonal system with its covariance, and differences again.
        """
        from scipy.linalg.lapack import dpttrs

        first, last = edges[:-1], int(edges[-1])
        variances, beside = np.ones(last), np.full(max(last - 1, 0), -self.moving)
        variances[first] = 1 / self.news
        beside[first[1:] - 1] = 0.0
        out = columns.copy()
        for some in _few(columns):
            changes, own = self._changes(columns[some], edges).T, out[some]
            solved = dpttrs(variances, beside, changes, overwrite_b=True)[0].T
            np.multiply(-self.kept, solved[:, 1:], out=own[:, : last - 1])
            own[:, first[1:] - 1] = 0.0
            own[:, last - 1 : last] = 0.0
            own[:, :last] += solved
        return out

    def spread(self, columns: Array, edges: Index) -> Array:
        """Product of series (k, N) and the correlation matrix of the noise."""
        out = columns / (1 + self.part)
        for some, (a, b) in product(_few(columns), pairwise(edges)):
            own = columns[some, a:b]
            before, after = _recursion(own, self.kept), _recursion(own[:, ::-1], self.kept)[:, ::-1]
            out[some, a:b] += self.part / (1 + self.part) * (before + after - own)
        return out


def _few(columns: Array) -> list[slice]:
    """Some columns (k, N) at a time: copies of all would take several times their memory."""
    return [slice(k, k + AT_ONCE) for k in range(0, len(columns), AT_ONCE)]


def _recursion(series: Array, kept: float) -> Array:
    """Recursion ``y[i] = kept y[i-1] + x[i]`` along series (k, n), solved as a bidiagonal system."""
    from scipy.linalg.lapack import dtbtrs

    bands = np.vstack([np.ones(series.shape[1]), np.full(series.shape[1], -kept)])
    solved, _ = dtbtrs(bands, series.T, uplo="L", diag="U")
    return np.asarray(solved).T


def is_round_off(chain: Chain, sigma: float) -> bool:
    """Whether residuals of a standard deviation `sigma` (mm) are rounding errors of the computation."""
    return sigma < RESIDUAL_ROUND_OFF_SHARE * chain.size


def series_edges(rows: Index) -> Index:
    """First observation of each series (one component of one view) and the end of the last, by the rows (N,)."""
    return np.concatenate([[0], np.flatnonzero(np.diff(rows) <= 0) + 1, [len(rows)]])


def noises() -> Iterator[Noise]:
    """The grid of noise models over which the likelihood is maximised."""
    return (Noise(length, part) for length, part in product(CORRELATION_LENGTHS_ROWS, CORRELATED_VARIANCE_RATIOS))


def likeliest(residual: Array, design: Array, edges: Index) -> tuple[Noise | None, float]:
    """Noise model of the residual (N,) after a fit of the columns `design` (p, N), None for white; and its variance.

    Restricted likelihood accounts for the slowly varying part of the noise that the fitted parameters have absorbed.
    Columns are of about unit length; those that repeat others count once.
    """
    # orthonormal columns stay well conditioned behind a filter: their products will do
    basis = orthonormal_basis(design.T)
    free, square = len(residual) - basis.shape[1], float(residual @ residual)
    best, least, variance = None, np.inf, square / free
    both = np.vstack([basis.T, residual])
    for noise in (None, *noises()):
        white = both if noise is None else noise.whitened(both, edges)
        triangle = np.diag(np.linalg.cholesky(white @ white.T))
        minus = free * float(np.log(triangle[-1])) + float(np.log(triangle[:-1]).sum())
        # prior: uniform in the logarithm of the length; a length like that of the run is hardly visible in residuals
        minus += 0.0 if noise is None else LEAST_LOG_LIKELIHOOD_GAIN + float(np.log(noise.length))
        if minus < least:
            news = 1.0 if noise is None else noise.news
            # innovations underestimate noise beyond the grid: the variance is at least that of the residual
            best, least, variance = noise, minus, max(float(triangle[-1]) ** 2 / news, square) / free
    return best, variance


def _uneven(residual: Array) -> bool:
    """Whether means of neighbouring rows scatter more than for independent rows: a quick test before the fit."""
    for size in (4, 16, 64):
        means = residual[: len(residual) // size * size].reshape(-1, size).mean(axis=1)
        if len(means) > 3 and size * np.var(means) > np.var(residual) * (1 + 2.5 * np.sqrt(2 / len(means))):
            return True
    return False


def correlated(problem: Problem, solution: Solution, rows: int = 0) -> tuple[Solution, Noise | None]:
    """The solution with its covariance corrected for serial correlation of the residuals, and the noise model.

    Parameters
    ----------
    rows : measured rows that the solution is from, where the views hold the middle of them only; 0: those of the views.

    Returns
    -------
    tuple
        The corrected solution and the noise; the unchanged solution and None where the residuals are white, rows are
        few, or no positions were measured.
    """
    views = [v for v in problem.views if isinstance(v, PositionView)]
    base, place = solution.groups.base, problem.place()
    here = sum(len(v) for v in views)
    rows = max(rows, here)
    if rows < FEWEST_NOISE_ROWS or not len(base) or is_round_off(problem.chain, solution.sigma["position"]):
        return solution, None
    share = min(1.0, MOST_NOISE_ROWS / here)
    level, zero = solution.sigma["position"], np.zeros(len(problem.chain.ids))
    parts, residuals, edges = [], [], [0]
    for whole in views:
        middle, half = len(whole) / 2, share * len(whole) / 2
        view = whole.part(slice(int(middle - half), max(int(middle + half), 1)))
        vector = view_vector(view, place, solution.values, zero)
        gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(vector)])
        seen = np.abs(gap).max(axis=1, initial=0.0) > 0  # measured components
        residuals.append(gap[seen].ravel() / (level * np.sqrt(solution.kept)))
        parts.append((view, np.repeat(seen, len(view))))
        edges += [edges[-1] + k * len(view) for k in range(1, seen.sum() + 1)]
    residual = np.concatenate(residuals)
    if not _uneven(residual):
        return solution, None
    of_base = {solution.unknowns[column]: k for k, column in enumerate(base)}
    picked = [
        own if live.all() else own[live] for own, live in ((design_rows(v, of_base, len(v)), n) for v, n in parts)
    ]
    design = (picked[0] if len(picked) == 1 else np.vstack(picked)).T
    del picked
    design /= level
    norms = np.sqrt(np.einsum("pn,pn->p", design, design))  # without a copy
    free = (norms > 0) & (solution.precision[base] * np.diag(solution.covariance) < 0.5)  # by the data, not the prior
    noise, variance = likeliest(residual, design[free] / norms[free, None], np.array(edges))
    if noise is None:
        return solution, None
    extra = np.empty((len(base), len(base)))
    for some in _few(design):
        beyond = variance * noise.spread(design[some], np.array(edges)) - design[some]
        np.matmul(design, beyond.T, out=extra[:, some])
    del design
    extra /= share * here / rows
    return replace(solution, covariance=_corrected(solution.covariance, extra, variance / (1 + noise.part))), noise


def _corrected(covariance: Array, extra: Array, least: float) -> Array:
    """``C + C E C`` of a covariance C; where that is none, what is less than `least` of C along a direction is as much.

    The rows of E are some of those that C is from, at other values of the parameters. White noise, the share `least` of
    the variance, is left along every direction.
    """
    out = covariance + covariance @ extra @ covariance
    out = (out + out.T) / 2
    try:
        np.linalg.cholesky(out / np.sqrt(np.outer(np.diag(out), np.diag(out))))
    except np.linalg.LinAlgError:
        scale = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        ratios, along = np.linalg.eigh(np.eye(len(root)) + root.T @ ((extra + extra.T) / 2) @ root)
        root = root @ (along * np.sqrt(np.maximum(ratios, min(least, 1.0))))
        out = root @ root.T
    return np.asarray(out)
