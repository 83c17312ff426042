"""How convex programmes are solved: one solver, and answers less exact than asked for are the caller's to judge."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import cvxpy


def optimise(problem: cvxpy.Problem, accuracy: float | None = None) -> None:
    """Solve in place; where there is no answer the variables' values are None.

    `accuracy` is the relative one of the objective; None: the solver's own.

    Raises
    ------
    cvxpy.error.SolverError
        The solver failed.
    """
    import cvxpy as cp

    settings = {} if accuracy is None else dict.fromkeys(("tol_gap_rel", "tol_gap_abs", "tol_ktratio"), accuracy)
    # cvxpy finds shapes by adding up memory that nobody has written to: flags of that mean nothing
    with warnings.catch_warnings(), np.errstate(invalid="ignore", over="ignore"):
        warnings.simplefilter("ignore", UserWarning)  # of an inexact answer
        problem.solve(solver=cp.CLARABEL, **settings)  # type: ignore[no-untyped-call]


def sum_of(vector: cvxpy.Expression) -> cvxpy.Expression:
    """The sum of a vector's entries.

    `cvxpy.sum` finds its shape as `optimise` says, and would warn where it is written down.
    """
    import cvxpy as cp

    added: cvxpy.Expression = cp.Constant(np.ones(vector.size)) @ vector
    return added
