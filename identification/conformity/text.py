"""Evaluations and decisions in words, for the command line and the certificate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from identification.conformity.decision import RULES, Conformity, Judgement
from identification.iso_standards.base import Quantity, rounded
from identification.results.parameter_table import decimals, printed

if TYPE_CHECKING:
    from identification.results.evaluation_result import EvaluationResult

UNDETERMINED = "not determined"
MOST_LINES = 24  # quantities that the command line prints of one standard


def headline(conformity: Conformity) -> str:
    """The verdict in one sentence."""
    if conformity.verdict is None:
        return "No tolerance is stated: figures without a decision."
    of = {v: [j for j in conformity.by_severity if j.verdict == v] for v in ("fails", "cannot be decided", "passes")}
    count = len(conformity.judgements)
    if conformity.verdict == "passes":
        return f"Passes: {'the one tolerance is' if count == 1 else f'all {count} tolerances are'} met."
    if conformity.verdict == "fails":
        more = f" and {len(of['fails']) - 2} more" if len(of["fails"]) > 2 else ""
        return f"Fails: {'; '.join(map(sentence, of['fails'][:2]))}{more}."
    more = f" and {len(of['cannot be decided']) - 2} more" if len(of["cannot be decided"]) > 2 else ""
    return f"Cannot be decided: {'; '.join(map(sentence, of['cannot be decided'][:2]))}{more}."


def sentence(j: Judgement) -> str:
    """Value beside its limit."""
    return f"{j.quantity.name} {value_text(j.quantity)}, limit {limit_text(j)}"


def limit_text(j: Judgement) -> str:
    """The limit in its quantity's unit, and as it was stated where that has another unit or grows with a length."""
    shown = amount(j.limit, j.quantity)
    same = unit_word(j.stated) == unit_word(shown)
    return shown if same else f"{shown} ({j.stated})"


def unit_word(text: str) -> str:
    """What follows the number of a limit, in one spelling."""
    return text.lstrip("0123456789.eE+- ").replace("µ", "u").replace("\u03bc", "u")


def value_text(q: Quantity) -> str:
    """Value with its expanded uncertainty and unit."""
    if not np.isfinite(q.value):
        return UNDETERMINED
    factor, unit = printed(q.unit)
    digits = decimals(factor * q.expanded / 2) if q.expanded else 2
    around = "" if q.expanded is None else f" ± {factor * q.expanded:.{digits}f}"
    return f"{rounded(factor * q.value, digits)}{around} {unit}"


def cells(q: Quantity) -> tuple[str, str, str]:
    """Value, expanded uncertainty and unit, for a table."""
    factor, unit = printed(q.unit)
    if not np.isfinite(q.value):
        return UNDETERMINED, "–", unit
    digits = decimals(factor * q.expanded / 2) if q.expanded else 2
    expanded = "–" if q.expanded is None else rounded(factor * q.expanded, digits)
    return rounded(factor * q.value, digits), expanded, unit


def amount(value: float, q: Quantity) -> str:
    """A limit or a guard band in the unit of its quantity."""
    factor, unit = printed(q.unit)
    return f"{factor * value:.4g} {unit}"


def evaluation_lines(result: EvaluationResult) -> Iterator[str]:
    """What the command line prints."""
    for e in result.evaluations:
        yield f"{e.title}"
        yield f"  {e.source}"
        width = max((len(q.name) for q in e.quantities), default=0)
        for q in e.quantities[:MOST_LINES]:
            yield f"  {q.name:{width}}  {value_text(q):>22}  {q.words}"
        if len(e.quantities) > MOST_LINES:
            yield f"  and {len(e.quantities) - MOST_LINES} more, in figures.csv and evaluation.json (--out)"
        yield ""
    yield headline(result.conformity)
    if result.conformity.judgements:
        yield f"rule: {RULES[result.conformity.rule]}"
        for j in result.conformity.by_severity[:MOST_LINES]:
            why = f" ({j.reason})" if j.reason else ""
            yield f"  {j.verdict}: {sentence(j)}, guard band {amount(j.guard, j.quantity)}{why}"
    if result.conformity.unused:
        yield f"not tested here: {', '.join(result.conformity.unused)}"
