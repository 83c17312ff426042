"""JAX: the exact chain in jax.numpy, its derivative by reverse mode, mapped over poses and compiled; 64 bit, CPU.

All 52 columns, (3n, 52). XLA may use all cores. The figure includes handing the array back to NumPy.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from tests.benchmarks.five_axis import IDS, JOINTS, TOOL, Array

__all__ = ["IDS", "build"]

jax.config.update("jax_enable_x64", True)


def _turn(axis: jax.Array, angle: jax.Array) -> jax.Array:
    cross = jnp.cross(jnp.eye(3), axis)
    return jnp.eye(3) + jnp.sin(angle) * cross + (1 - jnp.cos(angle)) * (cross @ cross)


def _small(e: jax.Array) -> jax.Array:
    x, y, z = jnp.eye(3)
    return _turn(x, e[0]) @ _turn(y, e[1]) @ _turn(z, e[2])


def position(p: jax.Array, q: jax.Array) -> jax.Array:
    """Actual position of the functional point, exact in the 52 parameters."""
    point, turn, at = jnp.zeros(3), jnp.eye(3), 0
    for k, (_, kind, direction, _) in enumerate(JOINTS):
        axis = jnp.array(direction)
        if kind == "rotary":
            d, e = jnp.sin(q[k] / 2) * p[at : at + 3], jnp.sin(q[k] / 2) * p[at + 3 : at + 6]
            point, turn, at = point + turn @ d, turn @ _small(e) @ _turn(axis, q[k]), at + 6
        else:
            rates = p[at + 1 : at + 4]
            d = q[k] * (1 + p[at]) * axis + q[k] ** 2 / 2 * jnp.cross(rates, axis)
            point, turn, at = point + turn @ d, turn @ _small(q[k] * rates), at + 4
        point, turn, at = point + turn @ p[at : at + 3], turn @ _small(p[at + 3 : at + 6]), at + 6
    return point + turn @ jnp.array(TOOL)


_DESIGN = jax.jit(jax.vmap(jax.jacrev(position), in_axes=(None, 0)))
_ZERO = np.zeros(len(IDS))


def build(q: Array) -> Array:
    return np.asarray(_DESIGN(_ZERO, q)).reshape(3 * len(q), -1)
