"""Result of a fit, statistics of residual vectors, and residuals of positions.

Residuals are measured minus predicted, in mm in the measuring frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.survey import Survey
from identification.estimation.bounded import AtBound
from identification.estimation.least_squares import Solution
from identification.estimation.motions import Motions
from identification.estimation.noise import Noise
from identification.estimation.outliers import Outlier, Sorting
from identification.estimation.readings import Readings
from identification.observation.assembly import Problem
from identification.observation.models import Kind, OrientationView, PositionView, View
from identification.observation.normal_equations import view_vector
from identification.observation.pose import Pose

if TYPE_CHECKING:
    import pandas as pd

    from identification.bayes.posterior import Posterior
    from identification.uncertainty.other_effects import OtherEffect
    from identification.uncertainty.unseen_expansion import Expansions


TWO_SIGMA = 0.9772498680518208  # of a normal distribution lies below two standard deviations


@dataclass(frozen=True)
class Spread:
    """Statistics of residual vectors, um; in rows with missing components the vector has the measured ones only."""

    rms_um: float  # root mean square of the 3-D residual
    mean_um: float  # mean magnitude
    max_um: float
    n: int

    @classmethod
    def of(cls, residuals: Array) -> Spread:
        """Statistics of residuals (n, 3) in mm, NaN where not measured."""
        seen = np.isfinite(residuals).any(axis=1)
        length = 1e3 * np.sqrt(np.nansum(np.square(residuals[seen]), axis=1))
        if not len(length):
            return cls(float("nan"), float("nan"), float("nan"), 0)
        return cls(float(np.sqrt(np.mean(length**2))), float(length.mean()), float(length.max()), len(length))


@dataclass(frozen=True)
class TestFile:
    """A test file: residuals of the nominal and the fitted machine, after its own frame and tool were estimated."""

    __test__ = False  # keeps pytest from collecting the class

    path: str
    survey: Survey
    nominal: Spread
    fitted: Spread
    residuals: Array  # (n, 3) mm, after the fit
    nominal_residuals: Array
    refit: dict[str, float]  # re-estimated frame and tool parameters by name, mm and rad
    frames: dict[str, Pose]


@dataclass(frozen=True)
class Streamed:
    """What a fit of rows that were streamed keeps of them.

    Attributes
    ----------
    rows : rows of the survey, measured or not, and by `files`.
    ranges : lowest and highest value of each recorded channel, a table of two rows, mm and rad.
    passes : times that all rows were read.
    moved_mm : rms distance by which the last step of the parameters moves the measured points: mean and largest
        residuals are those before it.
    reading, computing, seconds : time, s, that all workers together spent on reading and on sums, and that passed.
    steps : for each block of rows that is left out together its first row, and the fit without it less the fit.
    """

    rows: int
    files: Mapping[str, int]
    ranges: pd.DataFrame
    passes: int
    moved_mm: float
    reading: float
    computing: float
    seconds: float
    edges: tuple[int, ...]
    steps: Array


Beyond = Literal["repeats", "declared", "recorded"]
"""How it is known that something is left: it exceeds repeats, or a declared uncertainty, or depends on channels."""


@dataclass(frozen=True)
class Fit:
    """A fitted machine: plain values. What is derived from them is in `identification.results.analysis`."""

    chain: Chain
    survey: Survey
    problem: Problem
    solution: Solution
    nominal: Spread
    fitted: Spread
    heldout: Spread
    folds: int
    residuals: Array
    nominal_residuals: Array
    heldout_residuals: Array
    tests: tuple[TestFile, ...] = ()
    notes: tuple[str, ...] = field(default=())
    posterior: Posterior | None = None
    motions: Motions | None = None
    readings: Readings | None = None
    sorting: Sorting | None = None
    at_bound: tuple[AtBound, ...] = ()
    counted: tuple[View, ...] = ()
    serial: Noise | None = None  # serial correlation of the residuals
    systematic_mm: float = 0.0  # of a coordinate: what a diagnosis left beyond the noise
    systematic_by: Beyond | None = None  # by what that is known; None: there is none
    others: tuple[OtherEffect, ...] = ()  # what the recording leaves open of effects
    expansions: Expansions | None = None  # and of the expansion of axes; None where nobody looked for it
    streamed: Streamed | None = None  # the survey and its residuals are then those of a sample of the rows

    @property
    def rows(self) -> int:
        """Number of rows that were fitted."""
        return len(self.survey) if self.streamed is None else self.streamed.rows

    @property
    def span(self) -> pd.DataFrame:
        """Recorded channels, mm and rad, of all rows, or of their lowest and highest values."""
        return self.survey.table if self.streamed is None else self.streamed.ranges

    @property
    def outliers(self) -> tuple[Outlier, ...]:
        """Outliers of a robust fit; none of another."""
        return () if self.sorting is None else self.sorting.outliers

    @property
    def held(self) -> Array:
        """The chain's parameters at the solution, without frames: (chain parameters,)."""
        named = self.solution.named()
        return self.chain.vector(
            {i: named[i] for i in named if i in self.chain.index and i not in self.chain.frame_ids}
        )

    @property
    def sigma_mm(self) -> float:
        """Standard uncertainty of one measured coordinate, from the residuals, mm."""
        return position_sigma(self.problem.views, self.solution)

    @property
    def sigma_rad(self) -> float | None:
        """Standard uncertainty of one component of an orientation, from the residuals, rad; None without any."""
        return self.solution.sigma.get("orientation")

    @property
    def declared(self) -> frozenset[Kind]:
        """Kinds whose noise is declared: none where rows are means, with the scatter of their readings for weights."""
        return frozenset() if self.survey.scatter else self.solution.declared

    @property
    def inflation(self) -> float:
        """Birge ratio, a factor on standard uncertainties: above 1 if chi-squared rejects the declared noise at 1 %.

        Where rows only have the scatter of single readings for weights, it gives the noise of their means.
        """
        s = self.solution
        if not s.declared or s.dof <= 0:
            return 1.0
        if self.survey.scatter:
            return float(np.sqrt(s.chi2 / s.dof))
        from scipy.special import chdtrc

        return float(np.sqrt(s.chi2 / s.dof)) if chdtrc(s.dof, s.chi2) < 0.01 else 1.0

    @property
    def coverage(self) -> float:
        """Factor on standard uncertainties of predictions: where few degrees of freedom gave the noise, above 1.

        Two of them then cover 95.45 % (Student's t). A posterior and declared noise need none.
        """
        s = self.solution
        known = self.posterior is not None or (self.declared == set(s.sums) and self.inflation == 1)
        return 1.0 if known else coverage_of(s.dof)


def noise_bounds(dof: int) -> tuple[float, float]:
    """Factors on a standard deviation estimated with so many degrees of freedom: its 95 % interval (chi-squared)."""
    from scipy.special import chdtri

    if dof <= 0:
        return 0.0, float("inf")
    low, high = np.sqrt(dof / chdtri(dof, [0.025, 0.975])).tolist()
    return low, high


def coverage_of(dof: int) -> float:
    """Factor on a standard uncertainty with estimated noise, so that twice it covers 95.45 % (Student's t; GUM G.3)."""
    from scipy.special import stdtrit

    return float(stdtrit(dof, TWO_SIGMA) / 2) if dof > 0 else 1.0


def position_sigma(views: Sequence[View], solution: Solution) -> float:
    """Standard deviation of one measured coordinate, mm: from residuals, mean over rows and directions."""
    whiteners = [v.whitener for v in views if v.kind == "position"]
    if not whiteners:
        return float("nan")
    if "position" not in solution.declared:
        return solution.sigma["position"]
    precision = np.concatenate([np.square(w) if w.ndim == 1 else _mean_precision(w) for w in whiteners])
    return float(np.sqrt(np.mean(1 / precision[precision > 0]) * max(solution.chi2 / max(solution.dof, 1), 0.0)))


def _mean_precision(whiteners: Array) -> Array:
    """Of rows with a covariance, (n,), from factors L (n, 3, 3): trace(L'L) over how many components were measured."""
    squares = np.square(whiteners).sum(axis=2)
    return np.asarray(squares.sum(axis=1) / np.maximum(np.count_nonzero(squares, axis=1), 1))


def turned_residuals(fit: Fit) -> Array:
    """Measured minus predicted orientations (rows, 3), rad in the axes of the reference, NaN where not measured."""
    out = np.full((fit.rows, 3), np.nan)
    place, held = fit.problem.place(), np.zeros(len(fit.chain.ids))
    for view in fit.problem.views:
        if isinstance(view, OrientationView):
            for part, gap in view.gaps(view_vector(view, place, fit.solution.values, held)):
                out[view.index[part]] = gap.T
    return out


def residuals_of(views: Sequence[View], unknowns: Mapping[str, int], values: Array, held: Array, rows: int) -> Array:
    """Measured minus predicted positions (rows, 3), mm in the measuring frame, NaN where not measured."""
    out = np.full((rows, 3), np.nan)
    for view in views:
        if isinstance(view, PositionView):
            gaps = np.empty((3, len(view)))
            for part, gap in view.gaps(view_vector(view, unknowns, values, held)):
                gaps[:, part] = gap
            out[view.index] = np.where(view.components, (view.pose.rotation @ gaps).T, np.nan)
    return out
