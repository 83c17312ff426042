"""Normal priors about zero that parameters have beforehand: of random effects, and of the physical size of effects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain


def known_beforehand(chain: Chain, unknowns: Sequence[str], effect_sizes: float | None) -> Array:
    """Precision (unknowns,) of the normal priors about zero: 1/variance, 0 where there is none."""
    out = np.zeros(len(unknowns))
    for k, name in enumerate(unknowns):
        if name in chain.index:
            parameter = chain.parameters[chain.index[name]]
            wide = np.inf if effect_sizes is None else effect_sizes * parameter.size
            out[k] = (wide if parameter.prior is None else parameter.prior) ** -2
    return out
