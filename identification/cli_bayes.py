"""What ``fit --bayes`` does between the fit and its report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from errormodel.exceptions import InputError
from identification.console import counting, say, show_notes, working

if TYPE_CHECKING:
    from errormodel.machine import Machine
    from identification.fit.result import Fit


def with_posterior(
    fit: Fit, refit: Callable[[Machine], Fit], bayes: bool, priors: Path | None, robust: bool, seed: int, out: Path
) -> Fit:
    """The fit with its posterior; an unfinished chain is kept in ``out/chain``.

    Raises
    ------
    InputError
        A prior is wrong, or given to a fit that uses none.
    NotConvergedError
        The chain has not converged.
    """
    if not bayes:
        raise InputError("--priors", "priors without --bayes, which least squares do not use", "Add --bayes")
    from identification.bayes.run import bayesian
    from identification.bayes.settings import read_priors

    given, document = read_priors(priors) if priors is not None else ({}, None)
    result = bayesian(
        fit, refit, given, document, robust=robust, seed=seed, folder=out / "chain", tell=working, count=counting
    )
    if result.posterior is not None:
        say(result.posterior.statement)
        show_notes(result.posterior.notes)
    return result
