"""Run order of a plan: approach from both sides, drift uncorrelated with position, repeated first poses.

The order is found by random search: it minimises the share of backlash and drift that the geometry absorbs.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index

ORDERS_PER_BATCH = 100  # orders scored together
ORDER_BATCHES = 40  # batches of random exchanges: limits the time


def revisits(count: int, rank: int, components: int = 3) -> int:
    """Number of the `count` rows that repeat the first ones: a twentieth, at least two, none where rows are scarce.

    Each gives so many `components`, readings.
    """
    wanted = max(2, count // 20)
    return wanted if components * (count - wanted) >= 2 * rank else 0


def directions(positions: Array) -> Array:
    """Approach direction, +-1, of positions (..., n) in order, as `errormodel.approach.direction` derives it."""
    signs = np.sign(np.diff(positions, axis=-1))
    signs = np.concatenate([signs[..., :1], signs], axis=-1)
    for k in range(1, signs.shape[-1]):  # a joint that stands still keeps its sign
        signs[..., k] = np.where(signs[..., k] == 0, signs[..., k - 1], signs[..., k])
    return np.where(signs == 0, 1.0, signs)


def arranged(X: Array, positions: Array, levers: Array, shifts: Array, repeat: int, seed: int) -> Index:
    """An order (n + repeat,) of n poses, with the first `repeat` of them repeated at the end.

    It minimises the share of each joint's backlash and of a linear drift in each direction that the geometry absorbs.

    Parameters
    ----------
    X : (n, c, r) whitened rows of the poses.
    positions : (n, joints), mm and rad.
    levers : (joints, n, c) whitened motion of the functional point per unit along (about) each joint's axis.
    shifts : (3, n, c) whitened motion per unit shift of the reference along x, y, z.
    """
    n = len(X)
    rng = np.random.default_rng([seed, 2])

    def whole(orders: Index) -> Index:
        return np.concatenate([orders, orders[:, :repeat]], axis=1)

    rows = whole(np.arange(n)[None])[0]
    q, _ = np.linalg.qr(X[rows].reshape(-1, X.shape[2]))
    # the basis is taken per pose: both visits of a repeated pose have the same rows
    basis = q.reshape(len(rows), X.shape[1], -1)[:n]
    moved = np.concatenate([levers, shifts])
    inner = np.einsum("jni,nir->jnr", moved, basis)
    square = np.square(moved).sum(axis=2)
    clock = np.linspace(-1, 1, n + repeat)

    def score(orders: Index) -> Array:
        at = whole(orders)
        signs = directions(positions[at].transpose(0, 2, 1))  # (b, joints, n)
        clocks = np.broadcast_to(clock, (len(orders), 3, n + repeat))
        course = np.concatenate([signs, clocks], axis=1)
        total = np.zeros(len(orders))
        for k in range(len(moved)):
            sums = np.zeros((len(orders), n))
            np.add.at(sums, (np.arange(len(orders))[:, None], at), course[:, k])
            absorbed = np.square(sums @ inner[k]).sum(axis=1)
            size = (np.square(course[:, k]) * square[k][at]).sum(axis=1)
            total += np.log(np.maximum(1 - absorbed / np.maximum(size, 1e-300), 1e-6))
        return total

    orders = np.array([rng.permutation(n) for _ in range(ORDERS_PER_BATCH)])
    values = score(orders)
    best, value = orders[np.argmax(values)], float(values.max())
    for _ in range(ORDER_BATCHES):
        orders = np.tile(best, (ORDERS_PER_BATCH, 1))
        for row in orders:
            one, two = rng.integers(0, n, 2)
            row[[one, two]] = row[[two, one]]
        values = score(orders)
        if values.max() > value:
            best, value = orders[np.argmax(values)], float(values.max())
    return np.asarray(whole(best[None])[0])
