"""What no machine has: sizes of error motions beyond which a direction of the design is not determined. mm and rad."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.surveys.observations import is_unknown
from identification.observation.identifiability import Floors
from identification.observation.models import Kind, View
from identification.observation.normal_equations import RANK_SAMPLE_ROWS, sampled, weight_of
from identification.observation.sums import Sums

IMPLAUSIBLE_SHARE = 0.003  # of the machine's size: no machine has rigid error motions beyond it; by judgement
# Spread of the nominal points over what they lie off the nominal machine, up to which the errors alone make it; by
# judgement: a point that is touched has the first as large as the second
ONE_PLACE = 2.0


def floors_of(
    chain: Chain, views: Sequence[View], sums: Mapping[Kind, Sums], sigma: Mapping[Kind, float], each: float
) -> Floors:
    """Thresholds of the rank by the noise: least singular value and least norm of a column.

    A direction is dropped if its standard uncertainty exceeds any plausible error: a share of the machine's size,
    or what its points lie off the nominal machine if that is more. A column is dropped if one millimetre of it (at
    the end of the travel, with the longest lever) stays below the noise and less than a thousandth of it is
    observed: unmeasured motions show only through the tilt of the frame.

    Parameters
    ----------
    each : rows of the survey for each row of the views.
    """
    if not (seen := [v for v in views if v.of_tool and not v.turns and sums[v.kind].count]):
        return Floors()
    off = float(np.sqrt(sum(sums[k].square for k in {v.kind for v in seen}) / sum(map(weight_of, seen))))
    # of a common shift of all rows, mm
    shift = float(each * sum(weight_of(v) / sigma[v.kind] ** 2 for v in seen)) ** -0.5
    plausible = max(IMPLAUSIBLE_SHARE * chain.size, off)
    direction = max(shift / plausible, _of_errors(chain, [v for v in seen if v.kind == "position"], off))
    return Floors(direction=direction, lever=min(1e-3, shift))


def _of_errors(chain: Chain, views: Sequence[View], off: float) -> float:
    """Singular value that errors alone, to second order, give to the size of the machine; 0 where points spread.

    Where all commands take the functional point to one place, as onto a ball, a machine of any size fits them: M
    shows its size only by the places where the nominal machine would be, which are the errors themselves.
    """
    if not views:
        return 0.0
    zero, points = np.zeros(len(chain.ids)), list[Array]()
    for view in (sampled(v, RANK_SAMPLE_ROWS) for v in views):
        kernel = chain.kernel("nominal", (), view.fixed, view.outputs)
        points += [kernel.expand(functions) for _, functions in kernel.blocks(view.rows, zero)]
    spread = float(np.sqrt(np.hstack(points).var(axis=1).sum()))
    return spread / chain.size if spread <= ONE_PLACE * off else 0.0


def of_its_size(chain: Chain, views: Sequence[View], unknowns: Sequence[str], full: Array) -> Array:
    """Precision (unknowns,) of rigid error motions and set-ups whose prior moves the tip by the machine's size.

    `full` are the norms of their columns at full travel and lever.
    """
    reach = full / np.sqrt(sum(map(weight_of, views)))  # mm at the tip per unit of each
    rigid = np.isin(unknowns, [*{*chain.machine_ids} - chain.of_effects])
    set_up = np.array([is_unknown(name) for name in unknowns], dtype=bool)
    return np.where(rigid | set_up, np.square(reach / chain.size), 0.0)
