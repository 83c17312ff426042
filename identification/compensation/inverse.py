"""The command that reaches a wanted point: Gauss-Newton on the exact kinematics, all rows at once.

A correction is small beside the machine, so that the derivative at the first command serves all steps; where a step
does not bring the point much nearer, it is taken again.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from identification.compensation.field import Field

CLOSED = 1e-6  # mm
STEPS = 30
NEARER = 0.1  # of the gap: what a step with an old derivative may leave


def steps_towards(field: Field, jacobian: Array, gap: Array) -> Array:
    """Smallest motion of the movers (n, m) that closes gaps (n, 3) as far as they can, each mover by its own reach."""
    out: Array = np.einsum("nmi,ni->nm", closing(jacobian), gap)
    return out


def closing(jacobian: Array) -> Array:
    """(n, m, 3): the motion of `steps_towards` per mm of a gap."""
    size = np.sqrt(np.mean(np.square(jacobian).sum(axis=1), axis=0))
    scale = 1 / np.where(size > 1e-9, size, 1.0)
    return np.asarray(np.linalg.pinv(jacobian * scale, rcond=1e-6) * scale[:, None], np.float64)


def inverse(
    field: Field, q: Array, direction: Array, target: Array | None = None, tool: Array | None = None
) -> tuple[Array, Array]:
    """Commands whose actual point is the wanted one.

    Parameters
    ----------
    q : (n, joints), mm and rad
        What a perfect machine would be commanded.
    direction : (n, joints) of +-1
    target : (n, 3), mm
        Wanted points; None: the nominal ones at `q`.

    Returns
    -------
    commands : (n, joints)
        `q` with other positions of the movers.
    left : (n,), mm
        Distance from the wanted point; above `CLOSED` only where the movers cannot reach it.
    """
    wanted = field.nominal(q, tool) if target is None else target
    out, movers = q.copy(), list(field.movers)
    active = np.arange(len(q))
    left = np.zeros(len(q))
    close, before = np.zeros((len(q), len(movers), 3)), np.zeros(len(q))
    reach = np.where(field.rotary[movers], field.chain.size, 1.0)
    for step in range(STEPS):
        part = None if tool is None else tool[active]
        gap = wanted[active] - field.actual(out[active], direction[active], part)
        left[active] = np.linalg.norm(gap, axis=1)
        if step == STEPS - 1 or not len(active):
            break
        stale = active[left[active] > NEARER * before[active]]
        if len(stale):
            tools = None if tool is None else tool[stale]
            close[stale] = closing(field.jacobian(out[stale], direction[stale], tools))
        before[active] = left[active]
        move = np.einsum("nmi,ni->nm", close[active], gap)
        limit = np.abs(move).max(axis=1, keepdims=True) / 5.0  # mm or rad: never a leap
        out[active[:, None], movers] += move / np.maximum(limit, 1.0)
        settled = (np.abs(move) * reach).max(axis=1) < CLOSED / 100
        active = active[~(settled | (left[active] < CLOSED / 10))]
    return out, left
