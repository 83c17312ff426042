"""The short form of a decision log in ``diagnosis.json``: how much each stage decided, and the deciding lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from identification.diagnosis.decisions.fates import Fate, History, Place
from identification.diagnosis.decisions.log import Decision
from identification.diagnosis.decisions.records import as_rows
from identification.diagnosis.decisions.rules import RULES
from identification.diagnosis.decisions.stages import STAGES

NEAREST = 5  # candidates that came near without being found
LINE = ("rule", "outcome", "value", "threshold", "scale", "gain", "compared_with")
IN_FAVOUR = ("accepted", "added", "merged", "kept")


def parts_of(log: Iterable[Decision], findings: Sequence[Place]) -> dict[str, History]:
    """The history of each part of a survey that was diagnosed by itself; of one part, "", where there are no parts.

    Checks of the whole survey stand before those of the parts.
    """
    by_part: dict[str, list[Decision]] = {}
    for d in log:
        by_part.setdefault(d.part, []).append(d)
    if len(by_part) > 1:
        by_part.pop("", None)
    named = {part: _named(own) for part, own in by_part.items()}
    anywhere = set().union(*named.values())
    return {
        part: History(own, [f for f in findings if f in named[part] or f not in anywhere])
        for part, own in by_part.items()
    }


def _named(own: Iterable[Decision]) -> set[Place]:
    """The findings that came from candidates."""
    return {(d.effect, d.where) for d in own if d.rule == "name-probability" and d.outcome == "kept"}


def short(log: Iterable[Decision], findings: Sequence[Place]) -> dict[str, Any]:
    """Counts of outcomes by stage, and for each finding and each candidate that came near the deciding lines."""
    every = list(log)
    stages: dict[str, dict[str, int]] = {name: {} for name in STAGES}
    for d in every:
        counts = stages[RULES[d.rule].stage]
        counts[d.outcome] = counts.get(d.outcome, 0) + 1
    found, near = [], []
    for part, history in parts_of(every, findings).items():
        for effect, where in dict.fromkeys(findings):
            fate = history.fate(effect, where)
            lines = [d for d in fate.deciding if d.outcome in IN_FAVOUR]
            if lines:
                found.append(_entry(fate, lines, part))
        near += [
            _entry(f, f.deciding, part) | {"fate": f.word, "explained_by": list(f.explained_by)}
            for f in history.near(NEAREST)
        ]
    return {"stages": {name: counts for name, counts in stages.items() if counts}, "findings": found, "near": near}


def _entry(fate: Fate, lines: Iterable[Decision], part: str) -> dict[str, Any]:
    own = [{name: row[name] for name in LINE if row[name] not in (None, "")} for row in as_rows(lines)]
    return ({"part": part} if part else {}) | {"effect": fate.effect, "where": fate.where, "lines": own}
