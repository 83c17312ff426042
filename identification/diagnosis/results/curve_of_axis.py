"""An error motion that follows its own axis's position alone is its geometry of higher order, whatever its form.

A knee, a dent and a sag are such curves with a name of their own. Where none of these is likelier than not, what they
have in common still is; and a function without a name of that motion by that position has one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from errormodel.channels import root
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import EVEN, MUCH
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.results.findings import Alternative, Finding, probabilities_of
from identification.diagnosis.results.recorded_functions import Functions, alike_motions
from identification.diagnosis.search.criteria import moves
from identification.diagnosis.search.model import EffectModel, done_by_groups
from identification.diagnosis.search.scoring import Step


def of_its_axis(model: EffectModel, group: Sequence[Step], instead: Functions | None) -> tuple[Effect | None, float]:
    """The curve of its own axis that a finding is whose name is refused, and its probability; None where it is none.

    Parameters
    ----------
    group : the steps of the finding in the model.
    instead : the function without a name that explains as much, where the name is refused for that.
    """
    main, probabilities = group[0].effect, probabilities_of(group[0])
    forms = [s.effect for s in (group[0], *group[0].alternatives) if _by_its_own(s.effect, main.where)]
    curve = next((e for e in forms if e.flexible), None)
    if curve is None or not all(_by_its_own(s.effect, main.where) for s in group):
        return None, 0.0
    others = [g[0].effect for g in model.findings if g[0] is not group[0] and g[0].effect.where == main.where]
    if any(e.empirical or e.effect == curve.effect for e in others):
        return None, 0.0  # of which it may be a part
    if instead is not None:
        return curve, probabilities[main.effect] if {*map(root, instead.channels)} == {main.where} else 0.0
    if probabilities[main.effect] >= EVEN:  # it has a name, beside which as much is left
        return None, 0.0
    return curve, sum(probabilities[name] for name in {e.effect for e in forms})


def _by_its_own(effect: Effect, axis: str) -> bool:
    return not effect.empirical and effect.where == axis and {*map(root, effect.drivers)} == {axis}


def part_of_more(model: EffectModel, group: Sequence[Step], log: DecisionLog) -> str:
    """In words the finding without a name, by the axis and another one, that a curve of the axis may be a part of.

    What two positions move has a mean along each. Where it is not small beside the curve it may be all that is there.
    """
    main, found = group[0].effect, model.findings
    if not main.flexible or {*map(root, main.drivers)} != {main.where}:
        return ""
    alike = {place for own in moves(model.start, main) for place in (own, *alike_motions(model.start, *own))}
    unnamed = [k for k, g in enumerate(found) if _by_more(g[0].effect, main.where)]
    more = [k for k in unnamed if moves(model.start, found[k][0].effect) & alike]
    if not more:
        return ""
    sizes = [float(done @ done) for done in done_by_groups(model)]
    own = next(size for size, g in zip(sizes, found, strict=True) if g[0] is group[0])
    largest = max(more, key=lambda k: sizes[k])
    share, other = sizes[largest] / max(own, 1e-300), found[largest][0].effect
    log.add("part-of-more", "refused" if share > MUCH else "kept", main, share, MUCH, beside=other)
    return f"it may be a part of what {' and '.join(map(root, other.drivers))} move together" if share > MUCH else ""


def _by_more(effect: Effect, axis: str) -> bool:
    """Whether an effect without a name follows the position of an axis and something else."""
    return effect.empirical and {axis} < {*map(root, effect.drivers)}


def as_curve(finding: Finding, curve: Effect, reason: str, probability: float) -> Finding:
    """The finding by the name of a curve of its axis, in a form whose own name is refused for a reason."""
    word = curve.effect
    if finding.effect == word:
        return replace(finding, probability=probability)
    form = f"{finding.effect} of {finding.where}"
    own = Alternative(finding.effect, finding.where, 0.0, False, finding.motion, finding.driver, 0.0)
    return replace(
        finding,
        effect=word,
        statement=(
            f"{word.capitalize()} of {finding.where}: an error motion by its own position. It follows the form of a "
            f"{form}, but cannot be called one: {reason}. As that form it reads: {finding.statement}"
        ),
        brief=f"{word} of {finding.where}, in the form of a {finding.brief or form}",
        positive="",
        probability=probability,
        alternatives=[own, *(a for a in finding.alternatives if a.effect != word)],
    )
