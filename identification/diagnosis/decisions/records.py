"""A decision log as rows of a table, and read back from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

import numpy as np

from errormodel.exceptions import InputError
from identification.diagnosis.decisions.log import COLUMNS, Decision, Outcome
from identification.diagnosis.decisions.rules import RULES

NUMBERS = ("value", "threshold", "gain")


def as_rows(log: Iterable[Decision]) -> Iterator[dict[str, Any]]:
    """One row a decision, with the columns `COLUMNS`; numbers to six digits."""
    for d in log:
        rule = RULES[d.rule]
        row = {"stage": rule.stage, "scale": rule.scale}
        row |= {name: getattr(d, name) for name in COLUMNS if name not in row}
        yield {name: _short(row[name]) if name in NUMBERS else row[name] for name in COLUMNS}


def from_rows(rows: Iterable[Mapping[str, str]], source: str) -> list[Decision]:
    """The decisions of a table whose cells are text.

    Raises
    ------
    InputError
        A column is missing, a number is none, or a rule is not known.
    """
    out = []
    for number, row in enumerate(rows, start=1):
        try:
            values = {name: float(row[name]) if row[name] else None for name in NUMBERS}
            rule, round_ = row["rule"], int(row["round"])
            plain = {name: row[name] for name in ("effect", "where", "driver", "compared_with", "part", "search")}
            outcome = cast("Outcome", row["outcome"])
            if not plain["search"].partition(".")[0].isdecimal():
                raise ValueError(f"'{plain['search']}' is no number of a search")
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{source}, row {number}", f"it cannot be read ({error})", "Run diagnose again") from error
        if rule not in RULES:
            raise InputError(
                f"{source}, row {number}", f"a rule '{rule}' that this version has not", "Run diagnose again"
            )
        out.append(Decision(rule=rule, outcome=outcome, round=round_, **plain, **values))  # type: ignore[arg-type]
    return out


def _short(value: Any) -> float | None:
    """Six significant digits: what is behind them depends on the order of sums."""
    if value is None or not np.isfinite(value):
        return None
    return float(f"{value:.6g}")
