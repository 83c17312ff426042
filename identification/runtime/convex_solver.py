"""How convex programmes are solved: one solver, and answers less exact than asked for are the caller's to judge."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import cvxpy


def optimise(problem: cvxpy.Problem) -> None:
    """Solve in place; where there is no answer the variables' values are None.

    Raises
    ------
    cvxpy.error.SolverError
        The solver failed.
    """
    import cvxpy as cp

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of an inexact answer
        problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
