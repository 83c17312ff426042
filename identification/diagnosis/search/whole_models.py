"""Evidence of a finding's other names by whole models: each with all that it needs beside it.

A name that departs from its textbook form is scored by what such a departure could explain. What it does explain, a
search shows that begins with the name; or, where no search did or the name was given up in it, the model with it in the
finding's place. A name that makes the whole model likelier takes the finding's place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from identification.diagnosis.decisions.constants import CHOSEN, LEAST_EVIDENCE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, named
from identification.diagnosis.search.model import EffectModel, of_groups
from identification.diagnosis.search.scoring import Step, posterior


@dataclass(frozen=True)
class Whole:
    """A model's findings (``effect@where``), and its log posterior: of an arm the model itself takes 100 MB."""

    names: frozenset[str]
    log_posterior: float

    @classmethod
    def of(cls, model: EffectModel) -> Whole:
        return cls(frozenset(named(main.effect) for main, *_ in model.findings), model.log_posterior)


def weighed_as_whole(model: EffectModel, found: Sequence[Whole], log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model with the evidence of other names of its findings as far as whole models with them have it.

    Parameters
    ----------
    found : models that searches have found, of the same linear model.
    """
    groups = model.findings
    for k, (main, *more) in enumerate(groups):
        if main.effect.empirical:
            continue
        weighed = list[Step]()
        for other in main.alternatives:
            if other.effect.empirical or posterior(other) < posterior(main) - LEAST_EVIDENCE:
                weighed.append(other)
                continue
            lead = max([_replaced(model, k, other), *(_instead(model, main, other, m) for m in found)])
            log.add("whole-model", "compared", other.effect, lead, beside=main.effect)
            evidence = max(main.evidence + lead + main.log_prior - other.log_prior, 0.0)
            weighed.append(replace(other, evidence=evidence))
        weighed.sort(key=lambda s: -s.evidence)
        groups[k] = [replace(main, alternatives=tuple(weighed)), *more]
    return of_groups(model.start, groups)


def with_likelier_names(model: EffectModel, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model with another name in the place of each that makes the whole model less likely, beyond a near-tie.

    No flexible one: a curve makes up for what a name's textbook form lacks, and this the posterior of names leaves out.

    Parameters
    ----------
    model : with its alternatives weighed by whole models (`weighed_as_whole`).
    """
    for k in range(len(model.findings)):
        main, *more = model.findings[k]
        able = [s for s in main.alternatives if not (s.effect.empirical or s.effect.flexible)]
        leads = [(_replaced(model, k, s), s) for s in able if posterior(s) > posterior(main)]
        lead, other = max(leads, key=lambda own: own[0], default=(0.0, main))
        if main.effect.empirical or lead <= CHOSEN:
            continue
        log.add("whole-model", "preferred", other.effect, lead, CHOSEN, beside=main.effect)
        others = sorted((s for s in (main, *main.alternatives) if s is not other), key=lambda s: -s.evidence)
        groups = model.findings
        groups[k] = [replace(other, alternatives=tuple(others), parent=None), *more]
        model = of_groups(model.start, groups)
    return model


def _replaced(model: EffectModel, number: int, other: Step) -> float:
    """Log posterior of the model with another name in a finding's place, over its own."""
    groups = model.findings
    groups[number] = [replace(other, parent=None), *groups[number][1:]]
    return of_groups(model.start, groups).log_posterior - model.log_posterior


def _instead(model: EffectModel, main: Step, other: Step, found: Whole) -> float:
    """Log posterior over the model's of one that was found, if it has another name and not the finding's."""
    there = named(other.effect) in found.names and named(main.effect) not in found.names
    return found.log_posterior - model.log_posterior if there else float("-inf")
