"""Whether what else is there contradicts the name of an effect: the name of a part of something else is none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.decisions.log import DecisionLog, ratio
from identification.diagnosis.results.findings import Finding
from identification.diagnosis.results.physical_limits import nameless
from identification.diagnosis.results.recorded_functions import CLOCK
from identification.diagnosis.results.residual_dependence import Dependence
from identification.diagnosis.search.criteria import base_channels
from identification.diagnosis.search.forward_selection import LEAK
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.refinement import OWN
from identification.diagnosis.search.scoring import Step

MOSTLY = 0.5  # of a finding


def checked_remainder(
    finding: Finding, effect: Effect, dependence: Dependence | None, log: DecisionLog, wandering_um: float = 0.0
) -> Finding:
    """The finding without its name where as much is left that depends on its drivers as is no departure from its form.

    Sizes are those of rows: what the finding gains of rows that were left out, and what the dependence explains; what
    wanders (`wandering_um` a coordinate) depends on the time.
    """
    left = [(_causes(dependence.channels), dependence.size_um)] if dependence else []
    left += [(_causes((CLOCK,)), np.sqrt(3) * wandering_um)] if wandering_um else []
    own = {_joint(c) for c in base_channels(effect)}
    size = max((um for causes, um in left if causes & own), default=0.0)
    if not size or effect.empirical or finding.nameless:
        return finding
    before, after = finding.heldout_rms_um.before, finding.heldout_rms_um.after
    share = ratio(size**2, max(before**2 - after**2, 0.0))
    log.add("remainder-of-name", "refused" if share > OWN else "kept", effect, share, OWN)
    return nameless(finding, f"beside it {size:.1f} um are left that follow the same") if share > OWN else finding


def checked_form(finding: Finding, model: EffectModel, group: Sequence[Step], log: DecisionLog) -> Finding:
    """The finding without its name where refinements explain more of it than the form of that name does.

    Further causes of the name itself, such as a second sensor or lag of a thermal effect, are of its form.
    """
    main = group[0].effect
    named = [s.effect for s in group if s.effect.effect == main.effect]
    if len(group) == len(named) or main.empirical or main.random or finding.nameless:
        return finding
    without = form = model.without(group)
    for effect in named:
        form = form.with_effect(effect)
    share = ratio(without.square - form.square, without.square - model.linear.square)
    log.add("share-of-form", "kept" if share > MOSTLY else "refused", main, share, MOSTLY)
    return finding if share > MOSTLY else nameless(finding, f"that form explains {share:.0%} of it")


def checked_share(finding: Finding, model: EffectModel, group: Sequence[Step], log: DecisionLog) -> Finding:
    """The finding without its name where it explains so little beside the largest one that it may be a part of that."""

    def explains(group: Sequence[Step]) -> float:
        return model.without(group).square - model.linear.square

    others = [g for g in model.findings if g[0] is not group[0] and not g[0].effect.random]
    largest = max(others, key=explains, default=None)
    if largest is None or group[0].effect.empirical or finding.nameless:
        return finding
    share = ratio(explains(group), explains(largest))
    log.add(
        "share-of-largest",
        "kept" if share > LEAK else "refused",
        group[0].effect,
        share,
        LEAK,
        beside=largest[0].effect,
    )
    if share > LEAK:
        return finding
    main = largest[0].effect
    return nameless(
        finding, f"it is so small beside {main.effect} of {main.where} that it may be what that form leaves"
    )


def _causes(channels: Sequence[str]) -> set[str]:
    """Base channels; time and temperatures as one, a joint's path and direction as the joint."""
    return {"temperature" if n == CLOCK or n.startswith("T_") else n for n in map(_joint, channels)}


def _joint(channel: str) -> str:
    return channel.rpartition("(")[2].rstrip(")").removeprefix("dir_")
