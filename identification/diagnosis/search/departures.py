"""What moves as a finding does, by its cause, and is a small part of it, is the departure of that from its form.

The search compares what the rows show. Of a beam that twists, the geometry may take up most, and leave less than what
the beam departs from the textbook: that then looks like a finding of its own.
"""

from __future__ import annotations

from errormodel.channels import root
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import LITTLE
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.criteria import moves
from identification.diagnosis.search.model import EffectModel, of_groups, sizes_of_groups


def with_departures_merged(model: EffectModel, log: DecisionLog) -> EffectModel:
    """The model with each finding that does little beside another one of its kind as a refinement of that.

    Parameters
    ----------
    model : its findings, each of which may become a refinement of the largest one that it may be a part of.
    log : takes down each comparison by its share: of the sums of squares of what both do, with what is hidden of them.
    """
    groups = model.findings
    mains = [g[0].effect for g in groups]
    wholes = {
        k: [n for n, whole in enumerate(mains) if may_be_part(model.start, part, whole)] for k, part in enumerate(mains)
    }
    if not any(wholes.values()):
        return model
    sizes, kept = sizes_of_groups(model), [list(g) for g in groups]
    for k, able in wholes.items():
        if not able:
            continue
        whole = max(able, key=lambda n: sizes[n])
        share = sizes[k] / max(sizes[whole], 1e-300)
        little = share < LITTLE
        log.add("departure-of-form", "merged" if little else "kept", mains[k], share, LITTLE, beside=mains[whole])
        if little:
            kept[whole] += groups[k]
            kept[k].clear()
    return of_groups(model.start, [g for g in kept if g])


def may_be_part(linear: LinearModel, part: Effect, whole: Effect) -> bool:
    """Whether a smooth curve of positions can be the departure of a finding from its textbook form.

    It makes motions of the same place that the finding makes too, by what drives that or by its own axis's position.
    """
    joints = {j.name for j in linear.scene.moving}
    causes = {*map(root, whole.drivers)}
    smooth = (part.flexible or part.empirical) and not part.random and part.overtone(1) is None
    return (
        smooth
        and not (whole.flexible or whole.empirical)
        and part.where == whole.where
        and causes <= joints
        and set() < {*map(root, part.drivers)} <= causes | {whole.where}
        and moves(linear, part) <= moves(linear, whole)
    )
