"""A decision log in words: why this effect, why not that one, and what every stage decided."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from identification.diagnosis.decisions.constants import LEAST_EVIDENCE
from identification.diagnosis.decisions.fates import (
    ABSENT,
    ACCEPTED_BY,
    ALTERNATIVE,
    BEHIND,
    CONTRADICTED,
    DATA_CHECK,
    EXPLAINED,
    FOUND,
    LOW,
    MERGED,
    NAMELESS,
    NEVER,
    PERHAPS,
    PREFERENCES,
    REFUSED,
    TAKEN_OUT,
    Fate,
    History,
)
from identification.diagnosis.decisions.log import Decision
from identification.diagnosis.decisions.rule import CHANCE, COUNT
from identification.diagnosis.decisions.rules import RULES
from identification.diagnosis.decisions.stages import (
    CHECKED,
    CONDITIONAL,
    NAMES,
    PROPOSALS,
    SELECTION,
    STAGES,
    UNTESTABLE,
)
from identification.results.terminal import counted, table_lines

LARGE = 1e6  # a factor that is printed as a power of ten
SHOWN, SHOWN_ASIDE = 6, 10  # candidates of a list, the first of many; those that a finding was preferred to
WHY = {
    FOUND: "was found",
    DATA_CHECK: "was found by a check of the data, before any effect was looked for",
    NAMELESS: "was found, and its name refused: the finding is {by}",
    ALTERNATIVE: "was not chosen: it is another explanation of {by}",
    MERGED: "was accepted as part of {by}, not as a finding of its own",
    CONTRADICTED: "was found by its evidence, and a witness contradicts it",
    TAKEN_OUT: "was accepted once, and taken out again{beside}",
    PERHAPS: "was not found, and may be there: the uncertainty of predictions has it by its probability",
    REFUSED: "was tested for acceptance, and refused",
    EXPLAINED: "had evidence at first, and has none to speak of beside the findings{explained}",
    BEHIND: "has evidence to the last, and another candidate was preferred to it, which was refused",
    LOW: "was scored, and has too little evidence to be examined",
    NEVER: "could not be considered",
    ABSENT: "was no candidate: the library proposes no such effect at this place of this machine",
}


def number(value: float | None) -> str:
    """A number for a line of text."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 999.5 else f"{value:.3g}"


def decision_line(d: Decision, said: set[str] | None = None) -> str:
    """One decision with its value, threshold and margin, and what its rule decides.

    Parameters
    ----------
    said : rules of which it has been said; it is said once.
    """
    rule = RULES[d.rule]
    text = f"{d.where}, {d.rule}: " if d.where and not d.effect else f"{d.rule}: "
    if d.value is not None:
        text += f"{number(d.value)}{f' ({rule.scale})' if rule.scale not in ('', COUNT) else ''}"
        if d.threshold is not None:
            text += f", threshold {number(d.threshold)}, margin {_margin(d.value, d.threshold, rule.scale)}"
        text += ", "
    if d.gain is not None:
        text += f"gain in log likelihood {number(d.gain)}, "
    beside = f" ({d.compared_with})" if d.compared_with else ""
    known = said is not None and d.rule in said
    if said is not None:
        said.add(d.rule)
    return f"{text}{d.outcome}{beside}" if known else f"{text}{d.outcome}{beside}. {rule.decides}"


def _margin(value: float, threshold: float, scale: str) -> str:
    """Distance of a value from its threshold; of chances, how many times one is the other."""
    if scale != CHANCE:
        return number(abs(value - threshold))
    low, high = sorted((value, threshold))
    if low <= 0:
        return "any factor"
    return f"a factor of {number(high / low) if high < LARGE * low else f'{high / low:.0e}'}"


def overview_lines(
    parts: Mapping[str, History], whole: Sequence[Decision], diagnosis: Mapping[str, Any]
) -> Iterator[str]:
    """All stages in their order: what was looked at, and what decided."""
    found = [f"{f['effect']}@{f['where']} ({f['probability']:.2f})" for f in diagnosis["findings"]]
    yield f"verdict: {diagnosis['verdict']}; {'found: ' + ', '.join(found) if found else 'nothing was found'}"
    for d in whole:
        yield f"  {decision_line(d)}"
    for part, history in parts.items():
        if part:
            yield f"\n==== {part}"
        for stage, what in STAGES.items():
            own = [d for d in history.decisions if RULES[d.rule].stage == stage]
            if own:
                yield f"\n{stage}: {what}"
                yield from _stage_lines(stage, own, history)


def _stage_lines(stage: str, own: Sequence[Decision], history: History) -> Iterator[str]:
    if stage == PROPOSALS:
        scored = history.first_scores
        kinds = len({effect for effect, _ in scored})
        yield f"  {kinds} effects at {len(scored)} places of effects have a score"
        hidden = [d for d in own if d.rule == "collinear-with-geometry"]
        if hidden:
            yield f"  {len(hidden)} candidates are collinear with the geometry: {_some(d.place for d in hidden)}"
        yield from (f"  {decision_line(d)}" for d in own if d not in hidden)
    elif stage == SELECTION:
        yield from _selection_lines(own, history)
    elif stage in (CONDITIONAL, NAMES):
        yield from _against_lines(own)
    elif stage == UNTESTABLE:
        for rule in dict.fromkeys(d.rule for d in own):
            some = [d for d in own if d.rule == rule]
            yield f"  {rule}: {_some(d.place for d in some)}. {RULES[rule].decides}"
    else:
        said: set[str] = set()
        yield from (f"  {_with_place(d, said)}" for d in own)


def _with_place(d: Decision, said: set[str] | None = None) -> str:
    return f"{_candidate(d)} {decision_line(d, said)}" if d.effect else decision_line(d, said)


def _candidate(d: Decision) -> str:
    """The candidate as ``effect@where``; of what has no name also what drives it: at one place there are many."""
    from errormodel.effects.unnamed import Unnamed

    return f"{d.place} by {' and '.join(d.driver.split())}" if d.effect == Unnamed.effect and d.driver else d.place


def _selection_lines(own: Sequence[Decision], history: History) -> Iterator[str]:
    """Round by round: how many were scored, which were examined, chosen, tested."""
    if history.kept != history.base:
        yield f"  of search {history.kept}, which was kept; {history.base} was the one that began with nothing"
    said: set[str] = set()
    for round_ in dict.fromkeys(d.round for d in own):
        here = [d for d in own if d.round == round_]
        scored = sorted((d for d in here if d.rule == "candidate-score"), key=lambda d: -(d.value or 0.0))
        if scored:
            best = ", ".join(f"{_candidate(d)} {number(d.value)}" for d in scored[:3])
            examined = sum(d.outcome == "examined" for d in scored)
            beside = f"beside {counted(round_, 'effect')}" if round_ else "beside the geometry alone"
            yield f"  {beside}: {len(scored)} candidates with a log Bayes factor, {examined} examined; the best {best}"
        for d in here:
            if d.rule not in ("candidate-score", "optimised-score") and d.outcome != "set aside":
                yield f"    {_with_place(d, said)}"


def _against_lines(own: Sequence[Decision]) -> Iterator[str]:
    """Findings with their alternatives, one row each, a column a rule."""
    rules = list(dict.fromkeys(d.rule for d in own))
    values: dict[tuple[str, str], dict[str, float | None]] = {}
    for d in own:
        # an alternative is compared with its finding; a finding, if with anything, with a motion by a channel
        pair = (d.compared_with, d.place) if d.outcome == "compared" else (d.place, d.compared_with or d.place)
        values.setdefault(pair, {}).setdefault(d.rule, d.value)
    rows = [["", *rules]]
    for (finding, place), known in sorted(values.items(), key=lambda v: v[0][0]):
        name = place if finding == place else f"  instead {place}"
        rows.append([name, *(number(known.get(r)) for r in rules)])
    yield from table_lines(rows, "<" + ">" * len(rules), indent=2)


def fate_lines(fate: Fate, history: History, diagnosis: Mapping[str, Any]) -> Iterator[str]:
    """Why an effect was found, or where it dropped out."""
    gone = {d.place: d.rule for d in history.decisions if d.outcome == "removed"}
    causes = [f"{p} (later removed: {gone[p]})" if p in gone else p for p in fate.explained_by]
    by = " and ".join(causes) or "a finding"
    if fate.word == ABSENT and fate.effect in CHECKED:
        yield f"{fate.effect} was not found: it is no candidate, the data are checked for it before the search"
        own = [d for d in history.decisions if RULES[d.rule].stage == CHECKED[fate.effect]]
        yield from (f"  {_with_place(d)}" for d in own)
        return
    yield f"{fate.place} " + WHY[fate.word].format(
        by=by,
        beside=f" beside {by}" if fate.explained_by else "",
        explained=f": {by} explains what it would" if fate.explained_by else "",
    )
    if fate.first is not None:
        rank = 1 + [*history.first_scores].index((fate.effect, fate.where))
        yield (
            f"  first score: log Bayes factor {number(fate.first.value)}, gain in log likelihood "
            f"{number(fate.first.gain)}, number {rank} of {len(history.first_scores)} effects at places"
        )
        if fate.word == LOW:
            least, last = number(LEAST_EVIDENCE), fate.first.threshold
            examined = (
                f"the examined ones had {number(last)} and more, or were the best of their name; " if last else ""
            )
            yield f"  {examined}with less than {least} nothing is ever found"
    later = fate.last is not None and fate.first is not None and fate.last.round > fate.first.round
    if fate.last is not None and later and fate.word not in (FOUND, ALTERNATIVE, MERGED):
        yield f"  last score: {number(fate.last.value)}, beside {fate.last.round} accepted effects"
    if fate.word in (FOUND, DATA_CHECK):
        yield from _finding_lines(fate, history, diagnosis)
    else:
        shown = [d for d in fate.deciding if d.rule != "candidate-score"]
        several, said = len({d.driver for d in shown}) > 1, set[str]()
        for d in shown:
            other = f"{d.place} " if d.effect and d.place != fate.place else ""
            yield f"  {other}{f'by {d.driver}, ' * several}{decision_line(d, said)}"
        if fate.word == ABSENT:
            places = [place for place in history.of_place if place[0] == fate.effect]
            yield f"  it was at {_some(where for _, where in places)}" if places else "  nor at any other"
        if fate.word == ALTERNATIVE:
            for rule, finding, behind in history.behind(fate):
                word = "behind" if behind >= 0 else "ahead of"
                yield f"  {rule}: {number(abs(behind))} (log Bayes factor) {word} {finding}"


def _finding_lines(fate: Fate, history: History, diagnosis: Mapping[str, Any]) -> Iterator[str]:
    entries = [f for f in diagnosis["findings"] if (f["effect"], f["where"]) == (fate.effect, fate.where)]
    for entry in entries:
        before, after = (number(entry["heldout_rms_um"][k]) for k in ("before", "after"))
        yield f"  {entry['statement']}"
        yield f"  held-out error, linearised, beside all other findings: {before} um rms without it, {after} um with it"
    if fate.word == DATA_CHECK:
        return
    form = fate.explained_by[0] if fate.explained_by else fate.place
    if form != fate.place:
        yield f"it was found in the form of {form}, whose name was refused; what follows is about that form"
    aside = [
        d
        for d in history.decisions
        if d.rule in PREFERENCES and d.outcome == "set aside" and d.compared_with == form and d.effect
    ]
    if aside:
        yield "why it was preferred"
        for rule in dict.fromkeys(d.rule for d in aside):
            yield f"  {rule}: {RULES[rule].decides}"
            some = [d for d in aside if d.rule == rule]
            rows = [[f"{d.place} by {d.driver}", number(d.value), f"threshold {number(d.threshold)}"] for d in some]
            yield from table_lines(rows[:SHOWN_ASIDE], "<><", indent=4)
            if len(rows) > SHOWN_ASIDE:
                yield f"    and {len(rows) - SHOWN_ASIDE} more"
    until = min((d.round for d in history.added if d.place == form), default=None)
    tests = [
        d
        for d in fate.deciding
        if d.outcome != "set aside"
        and RULES[d.rule].stage not in (CONDITIONAL, NAMES)
        and (until is None or d.round <= until or RULES[d.rule].stage != SELECTION)
    ]
    yield "its tests"
    said: set[str] = set()
    yield from (f"  {decision_line(d, said)}" for d in tests)
    into = [d for d in history.decisions if d.outcome == "merged" and d.compared_with == form]
    parts = {d.place for d in into if d.rule in ACCEPTED_BY}
    merged = [d for d in into if d.place in parts]
    if merged:
        yield "what was merged into it"
        yield from (f"  {_candidate(d)}: {decision_line(d, said)}" for d in merged)
    own = [
        d
        for d in history.decisions
        if RULES[d.rule].stage in (CONDITIONAL, NAMES)
        and (d.compared_with == form or (d.place == form and d.outcome in ("kept", "refused")))
    ]
    yield "against its alternatives"
    yield from _against_lines(own)


def _some(places: Iterable[str]) -> str:
    names = list(dict.fromkeys(places))
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more
