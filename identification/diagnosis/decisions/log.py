"""The decision log of a diagnosis: each decision about a candidate, with its rule, value and threshold.

A log is handed along the stages, as the progress is; without one nothing is recorded. It decides nothing. Searches that
run at the same time have a log each, which are joined in the order of the searches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypeVar

from errormodel.effects.base import Effect

Outcome = Literal[
    "passed",  # a check that found nothing
    "found",  # a check that found something
    "not considered",  # a candidate that this survey cannot show
    "scored",  # a candidate's evidence, beside what has been accepted so far
    "examined",  # one of the best of a round, its shape optimised
    "set aside",  # not preferred in this round; it may come again in the next
    "preferred",  # to be tested for acceptance
    "accepted",  # a test that was passed
    "refused",  # a test that was failed
    "added",  # a finding of its own
    "merged",  # into another finding, as its refinement
    "replaced",  # by what it is compared with
    "removed",  # a finding that was taken out again
    "kept",  # in the model that was chosen
    "compared",  # an alternative of a finding, or another model
]
COLUMNS = (
    "part", "search", "round", "stage", "rule", "outcome", "effect", "where", "driver", "value", "threshold", "scale",
    "gain", "compared_with",
)  # fmt: skip
MAIN = "1"  # the search that begins with nothing


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision.

    Attributes
    ----------
    rule : a name of `RULES`, which has its stage and the scale of its value.
    effect, where, driver : the candidate; of a check of the data only `where`, the column or the rows.
    value, threshold : what was compared, on the rule's scale.
    gain : gain in log likelihood of a candidate that was scored, else None.
    compared_with : the other candidate or model, or what was looked at, in words.
    part : the joint's motions that were diagnosed by themselves; empty where positions were measured.
    search : "1" for the first; "1.2" for the second one that began with an alternative; "2" for the first again,
        after the rows or their weights had changed.
    round : effects that had been accepted before.
    """

    rule: str
    outcome: Outcome
    effect: str = ""
    where: str = ""
    driver: str = ""
    value: float | None = None
    threshold: float | None = None
    gain: float | None = None
    compared_with: str = ""
    part: str = ""
    search: str = ""
    round: int = 0

    @property
    def place(self) -> str:
        """The candidate as ``effect@where``."""
        return f"{self.effect}@{self.where}"


class HasEffect(Protocol):
    """What holds a candidate: a step of the search."""

    @property
    def effect(self) -> Effect: ...


S = TypeVar("S", bound=HasEffect)
Candidate = Effect | str | None


class DecisionLog:
    """Decisions in their order."""

    def __init__(self, search: str = MAIN) -> None:
        self.search = search
        self.round = 0
        self.followed: set[object] = set()  # keys that were examined, whose scores are of interest in later rounds
        self._decisions: list[Decision] = []

    def __iter__(self) -> Iterator[Decision]:
        return iter(self._decisions)

    def __len__(self) -> int:
        return len(self._decisions)

    @property
    def recording(self) -> bool:
        return True

    def begin(self, round_: int) -> None:
        """What follows is decided beside so many accepted effects."""
        self.round = round_

    def add(
        self,
        rule: str,
        outcome: Outcome,
        candidate: Candidate = None,
        value: float | None = None,
        threshold: float | None = None,
        *,
        beside: Candidate = None,
        gain: float | None = None,
    ) -> None:
        """One decision; a candidate that is a text is a column, rows or a model."""
        effect, where, driver = _parts(candidate)
        other = named(beside) if isinstance(beside, Effect) else beside or ""
        self._decisions.append(
            Decision(rule, outcome, effect, where, driver, value, threshold, gain, other, "", self.search, self.round)
        )

    def compared(
        self, rule: str, effect: str, where: str, driver: str, value: float | None, threshold: float | None, beside: str
    ) -> None:
        """An alternative that is known by its words."""
        self._decisions.append(
            Decision(
                rule, "compared", effect, where, driver, value, threshold, None, beside, "", self.search, self.round
            )
        )

    def set_aside(
        self,
        rule: str,
        before: Iterable[S],
        after: Sequence[S],
        value: Callable[[S], float],
        threshold: float,
        beside: Candidate = None,
    ) -> None:
        """The steps of `before` that are not in `after`, by a rule that compares their values with a threshold."""
        kept = set(map(id, after))
        for step in before:
            if id(step) not in kept:
                self.add(rule, "set aside", step.effect, value(step), threshold, beside=beside)

    def again(self) -> None:
        """The search begins anew, with other rows or weights."""
        self.search, self.round, self.followed = str(int(self.search.split(".")[0]) + 1), 0, set()

    def branch(self, number: int) -> DecisionLog:
        """A log for a search that runs beside others; to be joined."""
        own = DecisionLog(f"{self.search}.{number}")
        own.followed = set(self.followed)
        return own

    def join(self, other: Iterable[Decision], part: str = "") -> None:
        """Decisions of another log, about a part of the survey if one is named."""
        self._decisions += [replace(d, part=part) for d in other] if part else other


class _Unrecorded(DecisionLog):
    """A log that takes nothing down."""

    @property
    def recording(self) -> bool:
        return False

    def begin(self, round_: int) -> None:
        pass

    def add(self, *_: object, **__: object) -> None:
        pass

    def set_aside(self, *_: object, **__: object) -> None:
        pass

    def compared(self, *_: object, **__: object) -> None:
        pass

    def again(self) -> None:
        pass

    def branch(self, number: int) -> DecisionLog:
        return self

    def join(self, other: Iterable[Decision], part: str = "") -> None:
        pass


UNRECORDED: DecisionLog = _Unrecorded()


def ratio(one: float, other: float) -> float:
    """A ratio for the log; infinite over nothing."""
    return float(one / other) if other > 0 else float("inf")


def named(effect: Effect) -> str:
    """A candidate as it stands in the log: ``effect@where``."""
    return f"{effect.effect}@{effect.where}"


def _parts(candidate: Candidate) -> tuple[str, str, str]:
    if isinstance(candidate, Effect):
        return candidate.effect, candidate.where, " ".join(candidate.drivers)
    return "", candidate or "", ""
