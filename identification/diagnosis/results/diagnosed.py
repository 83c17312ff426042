"""A diagnosis with the fits and the search behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.results.findings import Diagnosis
from identification.diagnosis.search.candidates import Ranked
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.estimation.result import Fit


@dataclass(frozen=True)
class Diagnosed:
    """The diagnosis, the fits before it and of the extended machine, and how it was found.

    `ranking` is that of all candidates before anything was accepted. `parts` are the diagnoses of single joints that
    this one is put together from. `log` holds what was decided.
    """

    diagnosis: Diagnosis
    baseline: Fit
    final: Fit
    model: EffectModel
    ranking: list[Ranked]
    parts: tuple[Diagnosed, ...] = ()
    log: DecisionLog = field(default_factory=DecisionLog)


def numbered(diagnosed: Diagnosed) -> dict[int, Sequence[Step]]:
    """The growth's steps behind each finding, by its number; blunders and outliers have none."""
    left = [g for p in diagnosed.parts or (diagnosed,) for g in p.model.findings]
    out: dict[int, Sequence[Step]] = {}
    for number, finding in enumerate(diagnosed.diagnosis.findings, start=1):
        place = (finding.effect, finding.where, tuple(finding.driver))
        here = [g for g in left if (g[0].effect.effect, g[0].effect.where, g[0].effect.drivers) == place]
        if here:
            out[number] = here[0]
            left.remove(here[0])
    return out
