"""What became of each candidate of a diagnosis: where it dropped out, by which rule, beside what."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from errormodel.effects.unnamed import Unnamed
from identification.diagnosis.decisions.constants import LEAST_EVIDENCE
from identification.diagnosis.decisions.log import MAIN, Decision
from identification.diagnosis.decisions.rules import RULES
from identification.diagnosis.decisions.stages import NAMES, PROPOSALS, SELECTION, UNTESTABLE, WITNESSES

Place = tuple[str, str]  # effect and where
UNNAMED = Unnamed.effect
SCORES = ("candidate-score", "optimised-score")
PREFERENCES = ("most-evidence", "empirical-lead")
ACCEPTED_BY = ("cross-validation", "second-sensor")  # rules that make something part of a finding
FOUND, DATA_CHECK, NAMELESS = "found", "found by a check of the data", "found, and its name refused"
ALTERNATIVE, MERGED, CONTRADICTED, TAKEN_OUT = "alternative", "part of a finding", "contradicted", "taken out"
REFUSED, BEHIND, EXPLAINED, LOW = "refused", "not preferred", "explained", "too little evidence"
NEVER, ABSENT, PERHAPS = "not considered", "no candidate", "perhaps there"


@dataclass(frozen=True)
class Fate:
    """What became of an effect at a place.

    Attributes
    ----------
    word : one of the words above.
    deciding : the decisions behind it, in their order.
    explained_by : the findings whose acceptance took its evidence away.
    first, last : its score before anything was accepted, and the last one, with the rounds.
    """

    effect: str
    where: str
    word: str
    deciding: tuple[Decision, ...] = ()
    explained_by: tuple[str, ...] = ()
    first: Decision | None = None
    last: Decision | None = None

    @property
    def place(self) -> str:
        return f"{self.effect}@{self.where}" if self.where else self.effect


class History:
    """The decisions of one diagnosis, or of one joint's motions in it, that led to its result.

    Parameters
    ----------
    decisions : in their order.
    findings : effect and place of each finding.
    """

    def __init__(self, decisions: Iterable[Decision], findings: Sequence[Place]) -> None:
        self.findings = list(findings)
        every = list(decisions)
        runs = [int(d.search.split(".")[0]) for d in every]
        self.base = str(max(runs, default=int(MAIN)))
        kept = [d for d in every if d.rule == "model-evidence" and d.outcome == "kept" and d.search == self.base]
        named = re.match(r"search ([\d.]+):", kept[-1].where) if kept else None
        self.kept = named[1] if named else self.base
        early = _of_stages(PROPOSALS, SELECTION)
        self.every = every
        # what another search decided has no part in the result; scores of the first round are the same in all
        self.decisions = [
            d
            for d in every
            if d.search == self.kept or (d.search == self.base and (d.rule not in early or self.kept == self.base))
        ]

    @cached_property
    def of_place(self) -> dict[Place, list[Decision]]:
        """The decisions on each candidate, in their order."""
        out: dict[Place, list[Decision]] = {}
        for d in self.decisions:
            if d.effect:
                out.setdefault((d.effect, d.where), []).append(d)
        return out

    @cached_property
    def refused_names(self) -> dict[Place, list[Decision]]:
        """What was found, and is without a name by these decisions."""
        refused = {
            place: [d for d in own if RULES[d.rule].stage == NAMES and d.outcome == "refused"]
            for place, own in self.of_place.items()
            if place not in self.findings and (UNNAMED, place[1]) in self.findings
        }
        return {place: own for place, own in refused.items() if own}

    @cached_property
    def added(self) -> list[Decision]:
        """The effects that were accepted, in their order."""
        accepted = [d for d in self.decisions if d.rule == "cross-validation" and d.outcome in ("added", "merged")]
        return [*(d for d in self.decisions if d.rule == "search-from"), *accepted]

    @cached_property
    def first_scores(self) -> dict[Place, Decision]:
        """The best score of each candidate in the first round, the best first."""
        own = [d for d in self.every if d.rule == "candidate-score" and d.search == self.base and d.round == 0]
        out: dict[Place, Decision] = {}
        for d in sorted(own, key=lambda d: -(d.value or 0.0)):
            out.setdefault((d.effect, d.where), d)
        return out

    def fate(self, effect: str, where: str) -> Fate:
        """What became of a candidate."""
        found = (effect, where) in self.findings
        own = self.of_place.get((effect, where), [])
        named = any(d.rule == "name-probability" and d.outcome == "kept" for d in own)
        refused = [place for place in self.refused_names if found and not named and place[1] == where]
        form = refused[0] if refused else (effect, where)  # what has no name may have been found in the form of one
        own, first = self.of_place.get(form, []), self.first_scores.get(form)
        last = self._last_score(own) or first
        # by these sensors it was no candidate, whatever became of it by others
        untried = [d for d in own if d.rule == "sensor-not-tried"]
        own = [d for d in own if d not in untried]

        def fate(word: str, deciding: Iterable[Decision] = (), explained_by: Iterable[str] = ()) -> Fate:
            return Fate(effect, where, word, (*deciding, *untried), tuple(explained_by), first, last)

        if found:
            tests = [d for d in own if d.rule != "candidate-score"]
            return fate(FOUND if named or refused else DATA_CHECK, tests, [f"{e}@{w}" for e, w in refused[:1]])
        if (effect, where) in self.refused_names:
            return fate(NAMELESS, self.refused_names[effect, where], [f"{UNNAMED}@{where}"])
        witness = [d for d in own if RULES[d.rule].stage == WITNESSES]
        if any(d.outcome == "removed" for d in witness):
            return fate(CONTRADICTED, witness)
        merged = [d for d in own if d.outcome == "merged" and d.rule in ACCEPTED_BY]
        into = {f"{e}@{w}" for e, w in self.findings}
        if any(d.compared_with in into for d in merged):
            reasons = [d for d in own if d.outcome == "merged"]
            return fate(MERGED, reasons, dict.fromkeys(d.compared_with for d in merged if d.compared_with in into))
        taken = [d for d in own if d.outcome in ("replaced", "removed")]
        compared = [d for d in own if d.outcome == "compared" and d.compared_with in into]
        if compared:
            aside = [d for d in own if d.rule in PREFERENCES and d.outcome == "set aside"]
            others = dict.fromkeys(d.compared_with for d in compared)
            return fate(ALTERNATIVE, [*aside, *taken, *compared], others)
        if taken:
            return fate(TAKEN_OUT, taken, dict.fromkeys(d.compared_with for d in taken if d.compared_with))
        failed = [d for d in own if d.outcome == "refused"]
        if perhaps := [d for d in own if d.rule == "perhaps-there"]:
            return fate(PERHAPS, [*failed[-3:], *perhaps])
        unseen = [d for d in own if RULES[d.rule].stage in (UNTESTABLE, PROPOSALS)]
        if failed and failed[-1].rule != "least-evidence":
            return fate(REFUSED, failed[-3:])
        if first and last and (last.value or 0.0) >= LEAST_EVIDENCE:
            failed = [d for d in self.decisions if d.round == last.round and d.outcome == "refused"]
            aside = [d for d in own if d.outcome == "set aside" and d.round == last.round]
            return fate(BEHIND, [last, *aside, *failed])
        if first and last and (first.value or 0.0) >= LEAST_EVIDENCE:
            return fate(EXPLAINED, [first, last], self._added_between(own, first))
        if unseen and (first is None or any(RULES[d.rule].stage == UNTESTABLE for d in unseen)):
            return fate(NEVER, unseen)
        return fate(LOW, [first]) if first else fate(ABSENT)

    def near(self, most: int) -> list[Fate]:
        """The candidates that came nearest without being found, by their first score, one for each effect and place."""
        out = []
        for (effect, where), d in self.first_scores.items():
            if (effect, where) not in self.findings and d.outcome == "examined":
                out.append(self.fate(effect, where))
        return out[:most]

    def behind(self, fate: Fate) -> list[tuple[str, str, float]]:
        """Rule (white, correlated noise), finding, and the log Bayes factor by which an alternative is behind it."""
        out = []
        for rule in ("conditional-evidence", "evidence-in-correlated-noise"):
            for finding in fate.explained_by:
                own = [d.value for d in fate.deciding if d.rule == rule and d.compared_with == finding]
                best = [d.value for d in self.decisions if (d.rule, d.place, d.outcome) == (rule, finding, "kept")]
                if own and best and own[0] is not None and best[0] is not None:
                    out.append((rule, finding, best[0] - own[0]))
        return out

    def _last_score(self, own: Sequence[Decision]) -> Decision | None:
        """The best score of the last round in which there is one."""
        scores = [d for d in own if d.rule == "candidate-score"]
        if not scores:
            return None
        end = max(d.round for d in scores)
        return max((d for d in scores if d.round == end), key=lambda d: d.value or 0.0)

    def _added_between(self, own: Sequence[Decision], first: Decision) -> list[str]:
        """The effects whose acceptance took away at least half of the evidence that a candidate had before."""
        before, out = first.value or 0.0, []
        for d in self.added:
            now = [s.value or 0.0 for s in own if s.rule == "candidate-score" and s.round > d.round]
            later = [s.round for s in own if s.rule == "candidate-score" and s.round > d.round]
            if not later:
                break
            best = max(v for v, r in zip(now, later, strict=True) if r == min(later))
            if best < before / 2 and before > LEAST_EVIDENCE:
                out.append(d.place)
            before = best
        return list(dict.fromkeys(out))


def _of_stages(*stages: str) -> tuple[str, ...]:
    return tuple(name for name, rule in RULES.items() if rule.stage in stages)
