"""The command that reaches a wanted point: Gauss-Newton on the exact kinematics, all rows at once."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from identification.compensation.field import Field

CLOSED = 1e-6  # mm
STEPS = 30


def steps_towards(field: Field, jacobian: Array, gap: Array) -> Array:
    """Smallest motion of the movers (n, m) that closes gaps (n, 3) as far as they can, each mover by its own reach."""
    size = np.sqrt(np.mean(np.square(jacobian).sum(axis=1), axis=0))
    scale = 1 / np.where(size > 1e-9, size, 1.0)
    out: Array = np.einsum("nmi,ni->nm", np.linalg.pinv(jacobian * scale, rcond=1e-6), gap) * scale
    return out


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
    reach = np.where(field.rotary[movers], field.chain.size, 1.0)
    for step in range(STEPS):
        part = None if tool is None else tool[active]
        gap = wanted[active] - field.actual(out[active], direction[active], part)
        left[active] = np.linalg.norm(gap, axis=1)
        if step == STEPS - 1 or not len(active):
            break
        move = steps_towards(field, field.jacobian(out[active], direction[active], part), gap)
        limit = np.abs(move).max(axis=1, keepdims=True) / 5.0  # mm or rad: never a leap
        out[active[:, None], movers] += move / np.maximum(limit, 1.0)
        settled = (np.abs(move) * reach).max(axis=1) < CLOSED / 100
        active = active[~(settled | (left[active] < CLOSED / 10))]
    return out, left
