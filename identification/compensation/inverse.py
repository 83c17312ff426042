"""Inverse kinematics of the machine with errors: commands that reach wanted points, by Gauss-Newton on all rows.

A correction is small beside the machine, so one Jacobian serves several steps; it is computed again for rows whose
distance did not shrink enough.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from identification.compensation.field import Field

CLOSED_MM = 1e-6  # mm: distance from the wanted point that counts as reached, far below any instrument
# of the volume that the motions of three movers span, 1 where they are square: above it the plain inverse is as good as
# the pseudo-inverse; by judgement
REGULAR_VOLUME = 0.1
MOST_NEWTON_STEPS = 30  # a few suffice unless a point cannot be reached; by judgement
STALE_JACOBIAN_SHARE = 0.1  # of the distance before the step: more than this left renews the Jacobian; by judgement


def steps_towards(field: Field, jacobian: Array, gap: Array) -> Array:
    """Minimum-norm motion of the movers (n, m) that closes gaps (n, 3), mm; movers scaled by effect at the tip."""
    out: Array = np.einsum("nmi,ni->nm", closing(jacobian), gap)
    return out


def closing(jacobian: Array) -> Array:
    """Scaled pseudo-inverse (n, m, 3) of Jacobians (n, 3, m): motion of the movers per mm of gap."""
    size = np.sqrt(np.mean(np.square(jacobian).sum(axis=1), axis=0))
    scale = 1 / np.where(size > 1e-9, size, 1.0)
    scaled = jacobian * scale
    if scaled.shape[1] == scaled.shape[2] and np.abs(np.linalg.det(scaled)).min(initial=1.0) > REGULAR_VOLUME:
        return np.asarray(np.linalg.inv(scaled) * scale[:, None], np.float64)  # a tenth of the time of singular values
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-6) * scale[:, None], np.float64)


def inverse(
    field: Field,
    q: Array,
    direction: Array,
    target: Array | None = None,
    tool: Array | None = None,
    close: Array | None = None,
    within: float = CLOSED_MM,
) -> tuple[Array, Array]:
    """Commands whose actual point equals the wanted one.

    Parameters
    ----------
    q : (n, joints), mm and rad
        Commands of the error-free machine.
    direction : (n, joints) of +-1
        Directions of approach.
    target : (n, 3), mm
        Wanted points; None: the nominal ones at `q`.
    tool : (n, 3), mm
        Tool tips in the last frame; None: that of the machine.
    close : (n, movers, 3)
        Motion of the movers per mm of gap near `q` (:func:`closing`), from the other direction of approach or with
        another length of the tool; None: computed here.
    within : mm
        Distance from the wanted point that counts as reached; commands end at a tenth of it.

    Returns
    -------
    commands : (n, joints)
        `q` with changed positions of the movers.
    left : (n,), mm
        Distance from the wanted point; above `within` only where the movers cannot reach it.
    """
    wanted = field.nominal(q, tool) if target is None else target
    out, movers = q.copy(), list(field.movers)
    active = np.arange(len(q))
    left = np.zeros(len(q))
    before = np.zeros(len(q)) if close is None else np.full(len(q), np.inf)
    close = np.zeros((len(q), len(movers), 3)) if close is None else close.copy()
    reach = np.where(field.rotary[movers], field.chain.size, 1.0)
    for step in range(MOST_NEWTON_STEPS):
        part = None if tool is None else tool[active]
        gap = wanted[active] - field.actual(out[active], direction[active], part)
        left[active] = np.linalg.norm(gap, axis=1)
        if step == MOST_NEWTON_STEPS - 1 or not len(active):
            break
        stale = active[left[active] > STALE_JACOBIAN_SHARE * before[active]]
        if len(stale):
            tools = None if tool is None else tool[stale]
            close[stale] = closing(field.jacobian(out[stale], direction[stale], tools))
        before[active] = left[active]
        move = np.einsum("nmi,ni->nm", close[active], gap)
        limit = np.abs(move).max(axis=1, keepdims=True) / 5.0  # at most 5 mm or rad a step, for convergence
        out[active[:, None], movers] += move / np.maximum(limit, 1.0)
        settled = (np.abs(move) * reach).max(axis=1) < within / 100
        active = active[~(settled | (left[active] < within / 10))]
    return out, left
