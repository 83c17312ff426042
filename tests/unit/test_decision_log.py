"""The decision log: what is recorded, how it is stored, and what became of a candidate by it."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from identification.diagnosis.decisions.fates import (
    ABSENT,
    ALTERNATIVE,
    BEHIND,
    CONTRADICTED,
    EXPLAINED,
    FOUND,
    LOW,
    MERGED,
    NEVER,
    PERHAPS,
    REFUSED,
    TAKEN_OUT,
    History,
)
from identification.diagnosis.decisions.log import UNRECORDED, Decision, DecisionLog
from identification.diagnosis.decisions.records import as_rows, from_rows
from identification.diagnosis.decisions.rules import RULES
from identification.diagnosis.decisions.summary import parts_of, short

A, B, C = "sag@X", "play@Y", "wave@Z"


def decision(
    rule: str, outcome: str, place: str, round_: int = 0, value: float | None = None, **more: object
) -> Decision:
    effect, _, where = place.partition("@")
    return Decision(rule, outcome, effect, where, value=value, round=round_, search="1", **more)  # type: ignore[arg-type]


def scores(round_: int, **values: float) -> list[Decision]:
    """Scores of A, B, C in one round."""
    places = {"a": A, "b": B, "c": C}
    return [decision("candidate-score", "scored", places[k], round_, v, gain=v + 2) for k, v in values.items()]


FOUND_A = [
    *scores(0, a=100.0, b=40.0, c=3.0),
    decision("cross-validation", "added", A, 0, 0.5, threshold=1.0),
    decision("name-probability", "kept", A, 1, 0.99),
]


def fate(decisions: Sequence[Decision], place: str) -> tuple[str, tuple[str, ...]]:
    effect, _, where = place.partition("@")
    found = History(decisions, [("sag", "X")]).fate(effect, where)
    return found.word, found.explained_by


def test_what_was_found() -> None:
    assert fate(FOUND_A, A) == (FOUND, ())


def test_evidence_that_a_finding_takes_away_is_explained_by_it() -> None:
    assert fate([*FOUND_A, *scores(1, b=0.5)], B) == (EXPLAINED, (A,))


def test_evidence_that_is_left_is_not_explained() -> None:
    log = [*FOUND_A, *scores(1, b=38.0), decision("detection", "refused", C, 1, 1.0)]
    assert fate(log, B) == (BEHIND, ())


def test_too_little_evidence_from_the_first() -> None:
    assert fate(FOUND_A, C) == (LOW, ())


@pytest.mark.parametrize(
    ("lines", "word"),
    [
        ([decision("detection", "refused", B, 0, 2.0)], REFUSED),
        ([decision("detection", "refused", B, 0, 2.0), decision("perhaps-there", "kept", B, 1, 0.2)], PERHAPS),
        ([decision("cross-validation", "merged", B, 1, 0.9, compared_with=A)], MERGED),
        ([decision("cross-validation", "merged", B, 1, 0.9, compared_with=C)], LOW),  # into what was not found
        ([decision("superfluous-by-cross-validation", "removed", B, 2, 1.0, compared_with=A)], TAKEN_OUT),
        ([decision("conditional-evidence", "compared", B, 1, 30.0, compared_with=A)], ALTERNATIVE),
        ([decision("witness-contradicts", "removed", B, 1, 0.1, compared_with="w_level_Y")], CONTRADICTED),
        ([decision("not-recorded", "not considered", B, 1, compared_with="no load")], NEVER),
        ([], ABSENT),
    ],
)
def test_what_decides_last_has_the_say(lines: list[Decision], word: str) -> None:
    first = scores(0, b=3.0) if word == LOW else []
    assert fate([*first, *lines], B)[0] == word


def test_what_a_dead_sensor_would_drive_is_judged_by_the_others() -> None:
    """And it is said beside: an effect that no sensor was tried for could not be considered."""
    untried = decision("sensor-not-tried", "not considered", B, 1, compared_with="T_1 cannot be used")
    history = History([*FOUND_A, *scores(1, b=0.5), untried], [("sag", "X")])
    fate = history.fate("play", "Y")
    assert (fate.word, fate.deciding[-1].rule) == (EXPLAINED, "sensor-not-tried")


def test_an_alternative_is_behind_by_its_evidence() -> None:
    log = [
        *FOUND_A,
        decision("conditional-evidence", "kept", A, 1, 100.0),
        decision("conditional-evidence", "compared", B, 1, 93.5, compared_with=A),
    ]
    history = History(log, [("sag", "X")])
    assert history.behind(history.fate("play", "Y")) == [("conditional-evidence", A, 6.5)]


def test_only_the_search_that_was_kept_counts() -> None:
    other = [
        Decision("search-from", "added", "play", "Y", search="1.1"),
        Decision("detection", "refused", "sag", "X", value=1.0, threshold=4.6, search="1.1", round=1),
    ]
    refused = Decision("detection", "refused", "play", "Y", value=1.0, threshold=4.6, search="1")
    kept = Decision("model-evidence", "kept", where="search 1.1: play@Y", search="1")
    named = Decision("name-probability", "kept", "play", "Y", value=0.9, search="1")
    history = History([*scores(0, a=10.0, b=11.0), refused, *other, kept, named], [("play", "Y")])
    assert history.kept == "1.1"
    assert history.fate("play", "Y").word == FOUND
    assert not any(d.outcome == "refused" for d in history.fate("play", "Y").deciding)
    assert history.fate("sag", "X").word == REFUSED


def test_only_the_last_begun_search_counts() -> None:
    log = DecisionLog()
    log.add("detection", "refused", "rows", 1.0, 4.6)
    log.again()
    log.begin(2)
    log.add("detection", "accepted", "rows", 9.0, 4.6)
    assert [(d.search, d.round) for d in log] == [("1", 0), ("2", 2)]
    assert [d.outcome for d in History(log, []).decisions] == ["accepted"]


def test_branches_are_joined_in_their_order() -> None:
    log = DecisionLog()
    branches = [log.branch(k) for k in (1, 2)]
    for k in (1, 0):  # the second one is done first
        branches[k].add("most-steps", "refused", "rows", k)
    for branch in branches:
        log.join(branch)
    assert [(d.search, d.value) for d in log] == [("1.1", 0), ("1.2", 1)]


def test_a_log_of_a_part_says_which() -> None:
    log, own = DecisionLog(), DecisionLog()
    own.add("most-steps", "refused", "rows")
    log.join(own, "rotations of X")
    assert [*parts_of(log, [])] == ["rotations of X"]


def test_without_a_log_nothing_is_recorded() -> None:
    UNRECORDED.begin(3)
    UNRECORDED.add("detection", "refused", "rows", 1.0)
    UNRECORDED.branch(1).add("detection", "refused", "rows", 1.0)
    UNRECORDED.join([Decision("detection", "refused")])
    UNRECORDED.again()
    assert [len(UNRECORDED), UNRECORDED.round, UNRECORDED.search, UNRECORDED.recording] == [0, 0, "1", False]


numbers = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(st.sampled_from(sorted(RULES)), numbers, numbers, st.text("abc XYZ,()\"'", max_size=12), st.integers(0, 30))
def test_what_was_stored_reads_back(rule: str, value: float | None, gain: float | None, text: str, round_: int) -> None:
    one = Decision(rule, "scored", "sag", "X", text, value, 4.6, gain, text, "rotations of X", "1.2", round_)
    [row] = as_rows([one])
    cells = {name: "" if cell is None else str(cell) for name, cell in row.items()}
    [again] = from_rows([cells], "decisions.csv")
    assert [again] == from_rows([{**cells}], "decisions.csv")
    for name in ("rule", "outcome", "effect", "where", "driver", "compared_with", "part", "search", "round"):
        assert getattr(again, name) == getattr(one, name)
    for had, has in ((value, again.value), (gain, again.gain)):
        assert has == (None if had is None else pytest.approx(had, rel=1e-5))  # six digits


@pytest.mark.parametrize(("column", "cell"), [("value", "much"), ("round", ""), ("rule", "gut-feeling")])
def test_a_table_that_was_changed_is_refused(column: str, cell: str) -> None:
    [row] = as_rows([Decision("detection", "refused", value=1.0)])
    cells = {name: "" if value is None else str(value) for name, value in row.items()}
    with pytest.raises(InputError, match="row 1"):
        from_rows([cells | {column: cell}], "decisions.csv")


def test_the_short_form_counts_all_and_shows_what_decided() -> None:
    said = short([*FOUND_A, *scores(1, b=0.5)], [("sag", "X")])
    assert said["stages"]["forward selection"] == {"scored": 4, "added": 1}
    [found] = said["findings"]
    assert (found["effect"], found["where"]) == ("sag", "X")
    assert {line["rule"] for line in found["lines"]} == {"cross-validation", "name-probability"}
