"""JAX: the exact chain on numbers, its derivative by reverse mode, mapped over poses and compiled; 64 bit, CPU.

All 52 columns, (3n, 52). Written on numbers because that runs more than three times as fast as on 3 x 3 arrays. XLA may
use all cores. The figure includes handing the array back to NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from tests.benchmarks.five_axis import IDS, JOINTS, TOOL, Array

__all__ = ["IDS", "build"]

jax.config.update("jax_enable_x64", True)

Numbers = Sequence[jax.Array | float]


def _turned(v: Numbers, angle: jax.Array, axis: int) -> list[jax.Array]:
    """`v` turned about a coordinate axis."""
    s, c = jnp.sin(angle), jnp.cos(angle)
    out, j, k = list(v), (axis + 1) % 3, (axis + 2) % 3
    out[j], out[k] = c * v[j] - s * v[k], s * v[j] + c * v[k]
    return out


def _moved(v: Numbers, d: Numbers, e: Numbers) -> list[jax.Array]:
    """``d + Rx Ry Rz v``."""
    for axis in (2, 1, 0):
        v = _turned(v, e[axis], axis)
    return [a + b for a, b in zip(d, v, strict=True)]


def position(p: jax.Array, q: jax.Array) -> jax.Array:
    """Actual position of the functional point, exact in the 52 parameters: from the tool back to the workpiece."""
    v: Numbers = TOOL
    left = list(p)
    for k in reversed(range(len(JOINTS))):
        _, kind, axis, _ = JOINTS[k]
        left, own = left[:-6], left[-6:]
        v = _moved(v, own[:3], own[3:])
        if kind == "rotary":
            left, own = left[:-6], [jnp.sin(q[k] / 2) * a for a in left[-6:]]
            v = _moved(_turned(v, q[k], axis.index(1.0)), own[:3], own[3:])
        else:
            left, (scale, a, b, c) = left[:-4], left[-4:]
            bend = (b * axis[2] - c * axis[1], c * axis[0] - a * axis[2], a * axis[1] - b * axis[0])
            d = [q[k] * (1 + scale) * u + q[k] ** 2 / 2 * w for u, w in zip(axis, bend, strict=True)]
            v = _moved(v, d, [q[k] * r for r in (a, b, c)])
    return jnp.stack(v)


_DESIGN = jax.jit(jax.vmap(jax.jacrev(position), in_axes=(None, 0)))
_ZERO = np.zeros(len(IDS))


def build(q: Array) -> Array:
    return np.asarray(_DESIGN(_ZERO, q)).reshape(3 * len(q), -1)
