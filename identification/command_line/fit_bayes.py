"""What ``fit --bayes`` does between the fit and its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from identification.command_line.console import counting, say, show_notes, working

if TYPE_CHECKING:
    from errormodel.machine import Machine
    from errormodel.yamlfile import Document
    from identification.bayes.settings import PriorForm
    from identification.estimation.result import Fit
    from identification.results.results_folder import ResultsFolder


def beforehand(priors: Path | None, bayes: bool) -> tuple[Mapping[str, PriorForm], Document | None]:
    """What ``--priors`` says; least squares take bounds of it, and nothing else.

    Raises
    ------
    InputError
        The file is wrong, or has a normal prior for a fit that is not Bayesian.
    """
    if priors is None:
        return {}, None
    from identification.bayes.settings import prior_error, read_priors

    given, document = read_priors(priors)
    for name, form in given.items():
        if form.std is not None and not bayes:
            found = "a normal prior (std), which least squares do not use: they take bounds only"
            raise prior_error(document, name, found, "Add --bayes, or leave low and high alone")
    return given, document


def with_posterior(
    fit: Fit,
    refit: Callable[[Machine], Fit],
    given: Mapping[str, PriorForm],
    document: Document | None,
    robust: bool,
    seed: int,
    out: ResultsFolder,
) -> Fit:
    """The fit with its posterior; an unfinished chain is kept in ``out/chain``.

    Raises
    ------
    InputError
        A prior is wrong.
    NotConvergedError
        The chain has not converged.
    """
    from identification.bayes.run import bayesian
    from identification.results.folder_contents import CHAIN

    result = bayesian(
        fit,
        refit,
        given,
        document,
        robust=robust,
        seed=seed,
        folder=out.workspace(CHAIN),
        progress=working,
        count=counting,
    )
    if result.posterior is not None:
        say(result.posterior.statement)
        show_notes(result.posterior.notes)
    return result
