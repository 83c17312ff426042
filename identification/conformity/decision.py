"""Decision rules: whether a quantity conforms with its limit, beside its uncertainty.

``guard-band``: ISO 14253-1. A quantity passes where its size is below the limit by more than the guard band, fails
where it is above it by more than the guard band, and between the two it cannot be decided. The guard band is 1.65
standard uncertainties: a quantity that passes (or fails) then does so with a probability of 95 % or more (one side of a
normal distribution). ``simple``: simple acceptance (JCGM 106): the size is compared with the limit itself, and the risk
of a wrong decision up to one half is shared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from errormodel.exceptions import InputError, nearest
from errormodel.surveys.record import Limit, Rule
from identification.iso_standards.base import COVERAGE_FACTOR, Quantity

GUARD_FACTOR = 1.65  # standard uncertainties: 95 % of a normal distribution lie below its mean + 1.645
Verdict = Literal["passes", "fails", "cannot be decided"]
ORDER: tuple[Verdict, ...] = ("fails", "cannot be decided", "passes")
RULES: Mapping[Rule, str] = {
    "guard-band": "ISO 14253-1, with a guard band of 1.65 standard uncertainties (conformity probability 95 %)",
    "simple": "simple acceptance (JCGM 106): the value against the limit, without a guard band",
}


@dataclass(frozen=True)
class Judgement:
    """A quantity, its limit, and the decision.

    Attributes
    ----------
    limit : mm or rad, for the quantity's length; `guard` : in the same unit.
    """

    quantity: Quantity
    limit: float
    stated: str
    guard: float
    verdict: Verdict
    reason: str

    def as_json(self) -> dict[str, Any]:
        return {
            "name": self.quantity.name, "value": self.quantity.value, "unit": self.quantity.unit,
            "expanded_uncertainty": self.quantity.expanded, "limit": self.limit, "limit_as_stated": self.stated,
            "guard_band": self.guard, "verdict": self.verdict, "reason": self.reason,
        }  # fmt: skip


@dataclass(frozen=True)
class Conformity:
    """All decisions of an evaluation.

    Attributes
    ----------
    verdict : the worst of them; None where there is no limit.
    unused : names in the tolerance that no quantity of this evaluation has.
    """

    rule: Rule
    judgements: tuple[Judgement, ...]
    unused: tuple[str, ...]

    @property
    def verdict(self) -> Verdict | None:
        found = {j.verdict for j in self.judgements}
        return next((v for v in ORDER if v in found), None)

    @property
    def by_severity(self) -> tuple[Judgement, ...]:
        """The decisions, worst first: what fails, and in it what is largest beside its limit."""

        def rank(j: Judgement) -> tuple[int, float]:
            size = abs(j.quantity.value) if np.isfinite(j.quantity.value) else 0.0
            return ORDER.index(j.verdict), -size / max(j.limit, 1e-300)

        return tuple(sorted(self.judgements, key=rank))

    def as_json(self) -> dict[str, Any]:
        return {
            "rule": self.rule, "rule_in_words": RULES[self.rule], "verdict": self.verdict,
            "decisions": [j.as_json() for j in self.judgements], "not_tested": list(self.unused),
        }  # fmt: skip


def judged(quantity: Quantity, limit: Limit, rule: Rule) -> Judgement:
    """The decision on one quantity, by the size of its value.

    Raises
    ------
    InputError
        The limit is of another unit.
    """
    if limit.unit != quantity.unit and not {limit.unit, quantity.unit} <= {"rad", "1"}:
        found = f"{limit.text}, while {quantity.name} is in {'µm' if quantity.unit == 'mm' else quantity.unit}"
        raise InputError(f"tolerance of {quantity.name}", found, "Write a limit in a unit of that kind")
    size, bound = abs(quantity.value), limit.at(quantity.length)
    if not np.isfinite(size):
        reason = f"it is not determined: {quantity.basis}"
        return Judgement(quantity, bound, limit.text, 0.0, "cannot be decided", reason)
    if rule == "simple":
        verdict: Verdict = "passes" if size <= bound else "fails"
        return Judgement(quantity, bound, limit.text, 0.0, verdict, "")
    if quantity.expanded is None:
        reason = f"its uncertainty is not known: {quantity.basis}"
        return Judgement(quantity, bound, limit.text, 0.0, "cannot be decided", reason)
    guard = GUARD_FACTOR * quantity.expanded / COVERAGE_FACTOR
    if size <= bound - guard:
        return Judgement(quantity, bound, limit.text, guard, "passes", "")
    if size > bound + guard:
        return Judgement(quantity, bound, limit.text, guard, "fails", "")
    reason = "it is closer to the limit than the guard band"
    return Judgement(quantity, bound, limit.text, guard, "cannot be decided", reason)


def conformity(quantities: Iterable[Quantity], limits: Mapping[str, Limit], rule: Rule) -> Conformity:
    """Decisions on all quantities that have a limit, by their own name (``X.A``) or else by their symbol (``A``)."""
    wanted = {_plain(name): limit for name, limit in limits.items()}
    used: set[str] = set()
    out = []
    for quantity in quantities:
        key = next((k for k in _names(quantity) if k in wanted), None)
        if key is not None:
            used.add(key)
            out.append(judged(quantity, wanted[key], rule))
    unused = tuple(name for name in limits if _plain(name) not in used)
    return Conformity(rule, tuple(out), unused)


def check_names(given: Mapping[str, Limit], quantities: Iterable[Quantity], where: str) -> None:
    """Raise InputError about a limit of something that was not evaluated; for limits that were given for this test."""
    known = {name for q in quantities for name in _names(q)}
    for name in given:
        if _plain(name) not in known:
            raise InputError(where, f"'{name}' is no quantity of this evaluation", nearest(_plain(name), known))


def _names(quantity: Quantity) -> list[str]:
    """Names under which a limit may be given: of the series, of its axis, of the symbol."""
    axis = quantity.of.partition(" ")[0]
    return [_plain(n) for n in dict.fromkeys((quantity.name, f"{axis}.{quantity.symbol}", quantity.symbol))]


def _plain(name: str) -> str:
    """One spelling of a name: arrows of ISO 230-2 may be written + and -."""
    text = " ".join(name.split())
    for sign, arrow in (("+", "↑"), ("-", "↓")):
        if text.endswith(sign) and text[:-1].rpartition(".")[2] in ("A", "E", "R"):
            text = text[:-1] + arrow
    return text
