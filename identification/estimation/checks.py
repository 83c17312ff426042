"""Checks of a survey before and after its fit: runs, redundancy, declared uncertainty, coverage of the travels.

Each check raises an `InputError` that states the finding and the cure, or adds a note to the fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from errormodel.chain import Chain
from errormodel.exceptions import InputError, nearest
from errormodel.serial_chain import ONLY_SERIAL
from errormodel.survey import Survey
from identification.estimation.least_squares import Solution, identifiable
from identification.estimation.result import Fit, Spread
from identification.observation.assembly import Problem
from identification.observation.identifiability import Groups
from identification.observation.models import PositionView, anywhere

# All by judgement
LEAST_EQUATIONS_PER_GROUP = 2  # scalar equations per group that a robust fit needs to identify outliers
FOREIGN_MACHINE_SHARE = 0.02  # nominal misfit, in machine sizes, that cannot come from error motions
UNEXPLAINED_SHARE = 0.5  # share of such a misfit that, if left by the fit, means that the fit explains nothing
COVERED_TRAVEL_SHARE = 0.5  # joints with less of their travel covered are listed where the fit is rank-deficient
CAUTIOUS_DECLARATION_FACTOR = 3.0  # ratio of declared uncertainty to residuals up to which it counts as cautious
FEW_DOF = 10  # degrees of freedom below which residuals can be that small by chance
WRONG_UNIT_FACTOR = 100.0  # ratio of declared uncertainty to residuals, or its inverse, that suggests a wrong unit


def check_runs(chain: Chain, survey: Survey) -> None:
    """Raise InputError if an effect of the machine belongs to a run that has no row in the fit."""
    runs = dict.fromkeys(survey.table["run"].astype(str))
    for name in chain.channels:
        if name.startswith("run(") and name[4:-1] not in runs:
            found = f"an effect of this machine goes with {name}, a run that no fitted row is of"
            raise InputError(str(survey.source), found, nearest(name[4:-1], runs))


def check_redundant(survey: Survey, problem: Problem) -> None:
    """Raise InputError if a robust fit has too few equations to distinguish an outlier from a parameter."""
    equations = sum(v.count for v in problem.views)
    rank = identifiable(problem.chain, problem.views, problem.unknowns).rank
    if equations < LEAST_EQUATIONS_PER_GROUP * rank:
        rows = -(-LEAST_EQUATIONS_PER_GROUP * rank * len(survey) // max(equations, 1))
        raise InputError(
            str(survey.source),
            f"{equations} measured values for {rank} groups of parameters: too few to say which rows are wrong",
            f"Measure at least {rows} rows like these, or fit without --robust",
        )


def check_enough(survey: Survey, problem: Problem, solution: Solution) -> None:
    """Raise InputError if the equations do not outnumber the groups that such rows, all over the travels, identify."""
    equations, rows = sum(s.count for s in solution.sums.values()), len(survey.fit)
    whole, lost = out_of_reach(problem, solution)
    known = solution.declared == set(solution.sums)  # declared noise: no degree of freedom is needed to estimate it
    if equations > whole.rank or (equations == whole.rank and known and not lost):
        return
    need = -(-(whole.rank + 1) * rows // max(equations, 1))
    found = (
        f"{rows} row{'s' if rows > 1 else ''} with {equations} measured values where {whole.rank} groups of parameters "
        "can be told apart"
    )
    if lost:
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        found += f"; {len(lost)} fall: {', '.join(lost[:3])}{more}"
    else:
        found += ", with nothing left to judge the residuals by"
    cure = f"Measure at least {need} rows like these, better {2 * need}, or declare fewer errors in machine.yaml"
    raise InputError(str(survey.source), found, cure)


def out_of_reach(problem: Problem, solution: Solution) -> tuple[Groups, list[str]]:
    """Groups identifiable by such rows all over the travels, and the names of those that the fit did not identify."""
    whole = identifiable(problem.chain, [anywhere(v, 600) for v in problem.views], problem.unknowns)
    reached = {solution.groups.ids[j] for j in solution.groups.base}
    return whole, [whole.name(k) for k in range(whole.rank) if whole.ids[whole.base[k]] not in reached]


def looked_over(fit: Fit) -> Fit:
    """The fit with notes on groups that its poses do not identify and on an implausible declared uncertainty.

    Raises
    ------
    InputError
        No group is identifiable, or the misfit is too large for this machine.
    """
    before, after = (float(np.median(np.linalg.norm(r, axis=1))) for r in (fit.nominal_residuals, fit.residuals))
    other = (
        before > FOREIGN_MACHINE_SHARE * fit.chain.size and after > UNEXPLAINED_SHARE * before
    )  # nan where rows measured one component
    if other or not fit.solution.groups.rank:
        raise InputError(str(fit.survey.source), "no parameter can be identified", far_off(fit.nominal))
    fit = replace(fit, notes=(*fit.notes, *_declared(fit)))
    volumetric = any(isinstance(v, PositionView) for v in fit.problem.views)  # a one-joint survey means that joint only
    lost = out_of_reach(fit.problem, fit.solution)[1] if volumetric else []
    if not lost:
        return fit
    more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
    several = f"{len(lost)} groups" if len(lost) > 1 else "a group"
    short = [
        f"{j.name} covers {100 * share:.0f} %"
        for j in fit.chain.machine.joints
        if (share := float(np.ptp(fit.survey.table[j.name].dropna())) / (j.travel[1] - j.travel[0]))
        < COVERED_TRAVEL_SHARE
    ]
    where = f" ({', '.join(short)} of its travel)" if short else ""
    note = (
        f"rank-deficient: {several} of parameters that poses all over the travels would identify cannot be told from "
        f"others here{where}: {', '.join(lost[:3])}{more}. Predictions away from these poses count that as unknown. "
        "Measure where the joints have not been (`errormodel plan`), or declare fewer errors in machine.yaml"
    )
    return replace(fit, notes=(*fit.notes, note))


def _declared(fit: Fit) -> Iterator[str]:
    """Notes on a declared uncertainty several times larger than the residuals, or different by a unit's factor."""
    s = fit.solution
    if not s.declared or s.dof <= 0 or s.chi2 <= 0:
        return
    ratio = float(np.sqrt(s.chi2 / s.dof))
    unit = (
        " sigma of a survey is in mm (rad for angles): look for another unit"
        if max(ratio, 1 / ratio) > WRONG_UNIT_FACTOR
        else ""
    )
    if ratio > WRONG_UNIT_FACTOR:
        yield f"the residuals are {ratio:.3g} times as large as the declared uncertainty.{unit}"
    elif 1 / ratio > CAUTIOUS_DECLARATION_FACTOR and s.dof >= FEW_DOF:
        yield (
            f"the declared uncertainty is {1 / ratio:.3g} times as large as the residuals show, and standard "
            f"uncertainties follow what is declared.{unit}"
        )


def another(chain: Chain, nominal: Spread) -> bool:
    """Whether the rms misfit to the nominal machine is too large for error motions of this machine."""
    return bool(nominal.n) and 1e-3 * nominal.rms_um > FOREIGN_MACHINE_SHARE * chain.size


def far_off(nominal: Spread) -> str:
    """Message to the user: the misfit, and mistakes that cause such a misfit."""
    return (
        f"What was measured lies {1e-3 * nominal.rms_um:.3g} mm rms beside the nominal machine, further than errors of "
        "a machine go: look for a wrong unit (degrees or radians), sign, column, tool or machine; "
        f"`errormodel diagnose` tries these. {ONLY_SERIAL}"
    )
