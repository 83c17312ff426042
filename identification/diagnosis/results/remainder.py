"""Whether what is left beside a named effect contradicts its name: the name of a part of something else is none."""

from __future__ import annotations

from errormodel.effects.base import Effect
from identification.diagnosis.decisions.log import DecisionLog, ratio
from identification.diagnosis.results.findings import Finding
from identification.diagnosis.results.physical_limits import nameless
from identification.diagnosis.results.residual_dependence import Dependence
from identification.diagnosis.search.criteria import base_channels
from identification.diagnosis.search.refinement import OWN


def checked_remainder(finding: Finding, effect: Effect, dependence: Dependence | None, log: DecisionLog) -> Finding:
    """The finding without its name where as much is left that depends on its drivers as is no departure from its form.

    Sizes are those of rows that were left out: what the finding gains there, and what the dependence predicts.
    """
    if dependence is None or effect.empirical or not _causes(dependence) & {_joint(c) for c in base_channels(effect)}:
        return finding
    before, after = finding.heldout_rms_um.before, finding.heldout_rms_um.after
    share = ratio(dependence.size_um**2, max(before**2 - after**2, 0.0))
    log.add("remainder-of-name", "refused" if share > OWN else "kept", effect, share, OWN)
    if not share > OWN:
        return finding
    return nameless(finding, f"beside it {dependence.size_um:.1f} um are left that follow the same")


def _causes(dependence: Dependence) -> set[str]:
    """Base channels of a dependence; time and temperatures as one, a joint's path and direction as the joint."""
    names = {_joint(name) for name in dependence.channels}
    return {"temperature" if n == "time" or n.startswith("T_") else n for n in names}


def _joint(channel: str) -> str:
    return channel.rpartition("(")[2].rstrip(")").removeprefix("dir_")
