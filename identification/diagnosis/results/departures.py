"""What a finding departs from its textbook form by is no finding of its own.

The search compares what the rows show. Of a beam that twists, the geometry may take up most, and leave less than what
the beam departs from the textbook: that then looks like a further finding. So does the rest of what an instrument sees
move, by the cause of the first part.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import POINT_CHANNELS, root
from errormodel.conventions import FRAME, INSTRUMENT
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import LITTLE, MUCH, NEAR
from identification.diagnosis.decisions.log import DecisionLog, Outcome
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.model import EffectModel, done_by_groups, of_groups
from identification.diagnosis.search.refinement import smooth_departures
from identification.estimation.orthonormal_basis import orthonormal_basis


def with_departures_merged(model: EffectModel, log: DecisionLog) -> EffectModel:
    """The model with each finding that is a small departure of another one from its form as a refinement of that.

    Sizes are sums of squares of what findings do in the rows, with what the geometry hides of them.
    """
    if len(model.findings) < 2:
        return model
    done, mains = done_by_groups(model), [g[0].effect for g in model.findings]
    sizes, kept = [float(d @ d) for d in done], [list(g) for g in model.findings]
    for k in np.argsort(sizes, kind="stable").tolist():
        larger = [n for n in range(len(done)) if sizes[n] > sizes[k] and kept[n]]
        limits = {n: _limit(model.start, mains[k], done[k], mains[n]) for n in larger}
        if not any(limits.values()):
            continue
        whole = max((n for n in larger if limits[n]), key=lambda n: sizes[n])
        share = sizes[k] / sizes[whole]
        word: Outcome = "merged" if share < limits[whole] else "kept"
        log.add("departure-of-form", word, mains[k], share, limits[whole], beside=mains[whole])
        if word == "merged":
            kept[whole] += kept[k]
            kept[k] = []
    return of_groups(model.start, [g for g in kept if g])


def _limit(linear: LinearModel, part: Effect, done: Array, whole: Effect) -> float:
    """Share of a finding up to which another may be its departure, by the cause that they have in common; 0: none.

    Parameters
    ----------
    done : (N + ties,) what the other does in the rows.
    """
    if {part.where, whole.where} <= {FRAME, INSTRUMENT} and _causes(part) == _causes(whole):
        return MUCH  # one thing moves, in a form that no textbook has in full
    return LITTLE if _departs(linear, part, done, whole) else 0.0


def _causes(effect: Effect) -> set[str]:
    """Recorded channels that drive an effect, wherever the target was."""
    return {*map(root, effect.drivers)} - {*POINT_CHANNELS}


def _departs(linear: LinearModel, part: Effect, done: Array, whole: Effect) -> bool:
    """Whether a curve of positions is a smooth departure of a finding that positions drive, but for a tenth."""
    smooth = (part.flexible or part.empirical) and not part.random and part.overtone(1) is None
    textbook = not (whole.flexible or whole.empirical) and whole.overtone(1) is None
    joints = {j.name for j in linear.scene.moving}
    if not smooth or not textbook or not {*map(root, (*whole.drivers, *part.drivers))} <= joints:
        return False
    columns = np.zeros((0, linear.size))
    own = list(smooth_departures(linear, whole))
    if own:
        columns = np.pad(np.array(own), ((0, 0), (0, linear.size - len(own[0]))))
    left = linear.project(np.vstack([columns, linear.columns(whole)[0], done]))
    norms = np.linalg.norm(left[:-1], axis=1)
    seen = norms > NEAR * np.linalg.norm(np.vstack([columns, linear.columns(whole)[0]]), axis=1)
    basis = orthonormal_basis((left[:-1][seen] / norms[seen, None]).T)
    return float(np.sum((left[-1] @ basis) ** 2)) > (1 - NEAR) * float(left[-1] @ left[-1])
