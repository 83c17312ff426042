"""How large an expansion of each linear axis a recording leaves possible: in it, it was not found."""

from __future__ import annotations

import numpy as np

from errormodel.effects.scale_expansion import ScaleExpansion
from identification.diagnosis.linear.linear_model import LinearModel
from identification.estimation.result import Fit
from identification.uncertainty.unseen_expansion import BEFOREHAND, Expansions, at_constant_size


def open_expansions(linear: LinearModel, final: Fit) -> Expansions:
    """Root mean square of the posterior of each axis' coefficient of expansion, 1/K, by each temperature that varied.

    Bayesian linear regression on what the model leaves: a normal prior of the same size, and the noise.
    """
    out = dict[str, dict[str, float]]()
    variance = linear.square / max(linear.freedom, 1)
    for joint in at_constant_size(final.chain.machine):
        for sensor in linear.scene.sensors:
            (left,) = linear.project(linear.columns(ScaleExpansion(joint=joint, sensor=sensor))[0])
            precision = float(left @ left) / variance + 1 / BEFOREHAND**2
            mean = float(left @ linear.residual) / variance / precision
            out.setdefault(joint, {})[sensor] = float(np.sqrt(mean**2 + 1 / precision))
    return out
