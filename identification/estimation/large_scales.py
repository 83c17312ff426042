"""Notes on linear axes whose fitted scale is none that a screw, a rack or a linear encoder has."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.conventions import TRANSLATIONS
from identification.estimation.estimate import Estimate
from identification.estimation.result import Fit

# mm a mm: the coarsest screws of ISO 3408-3 (grade 10) are off by 210 um in 300 mm. Aluminium does so by 30 K
LARGEST_SCALE = 0.21 / 300


def large_scales(fit: Fit) -> Iterator[str]:
    """A note for each linear joint along x, y or z whose scale is significantly beyond `LARGEST_SCALE`.

    By the parameter of first order of its own positioning error, where that is identified as one of the joint alone.
    """
    s = fit.solution
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    place = {s.groups.ids[j]: k for k, j in enumerate(s.groups.base)}
    for joint in fit.chain.machine.joints:
        axis = np.abs(joint.axis)
        name = f"{joint.name}.{TRANSLATIONS[int(np.argmax(axis))]}.1"
        if joint.type != "prismatic" or np.count_nonzero(axis) != 1 or name not in place:
            continue
        k = place[name]
        members = [i for i, c in zip(s.groups.ids, s.groups.coefficients[k], strict=True) if abs(c) > 0]
        if any(i != name and not i.startswith("frame") for i in members):
            continue
        # a Legendre polynomial is 1 at the end of the travel, in mm; a slope is a scale
        per = 1.0 if fit.chain.parameters[fit.chain.index[name]].unit == "1" else 2 / float(np.ptp(joint.travel))
        scale = per * float(s.values[s.groups.base[k]]) * float(joint.axis[int(np.argmax(axis))])
        beyond = Estimate(abs(scale) - LARGEST_SCALE, per * float(std[k]))
        if beyond.value > 0 and beyond.significant:
            yield (
                f"{joint.name} goes {1e3 * abs(scale):.3g} mm too {'far' if scale > 0 else 'short'} in a metre "
                f"(+- {1e3 * beyond.std:.2g}), more than the coarsest screws do ({1e3 * LARGEST_SCALE:.1g} mm): look "
                f"for a gear ratio, a pitch or steps a mm that are set wrong, for another unit of {joint.name} or of "
                "the readings, or for axes or a scale (an encoder, a reference) far from 20 degC"
            )
