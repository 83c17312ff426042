"""Uncertainty budget (GUM) as a section of the report."""

from __future__ import annotations

from math import isfinite, sqrt
from typing import NamedTuple

from identification.report.tables import number
from identification.report.wording import three
from identification.results.analysis import Analysis
from identification.results.parameter_table import printed
from identification.uncertainty.budget import Budget, Input

MOST_BUDGET_GROUPS = 80  # groups listed; a longer table is not read


class BudgetPart(NamedTuple):
    """Inputs of the prediction's budget, their combination, and a row per group."""

    measurand: str
    unit: str
    lines: list[list[str]]
    result: list[str]
    statement: str
    groups: list[list[str]]
    more: int


def budget_part(analysis: Analysis) -> BudgetPart | None:
    """The section's content; None for a fit that identified nothing."""
    budgets = analysis.budgets
    if not budgets.groups:
        return None
    known = [e for e in analysis.estimates if e.kind not in ("frame", "zero", "observation")]
    rows = []
    for e in known[:MOST_BUDGET_GROUPS]:
        own = budgets.groups[e.number - 1]
        factor, unit = printed(own.unit)
        split = [_root(own, t) for t in "AB"]
        cells = [three(factor * v) if v else "–" for v in (*split, own.std)]
        rows.append([e.name, *cells, degrees(own.dof), f"{own.k:.2f}", three(factor * own.expanded), unit])
    worst = budgets.prediction
    if worst is None:
        return BudgetPart("", "", [], [], "", rows, len(known) - len(rows))
    lines = [_line(i, worst) for i in worst.inputs]
    result = [three(1e3 * worst.std), degrees(worst.dof), f"{worst.k:.2f}", three(1e3 * worst.expanded)]
    text = (
        f"U = {result[3]} µm (k = {result[2]}, {100 * worst.level:.0f} %, effective degrees of freedom {result[1]}): "
        f"expanded uncertainty of the {worst.measurand}."
    )
    return BudgetPart(worst.measurand, "µm", lines, result, text, rows, len(known) - len(rows))


def _root(budget: Budget, kind: str) -> float:
    return sqrt(sum(i.contribution**2 for i in budget.inputs if i.type == kind))


def _line(i: Input, budget: Budget) -> list[str]:
    factor, unit = printed(i.unit)
    share = (i.contribution / budget.std) ** 2 if budget.std else 0.0
    return [
        i.name, i.type, i.distribution, f"{three(factor * i.std)} {unit}", three(1e3 * i.sensitivity / factor),
        three(1e3 * i.contribution), number(100 * share, 0), degrees(i.dof),
    ]  # fmt: skip


def degrees(dof: float) -> str:
    """Degrees of freedom as displayed, rounded down."""
    return str(int(dof + 1e-9)) if isfinite(dof) and dof < 1e6 else "∞"
