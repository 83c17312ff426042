"""Predicted readings of observations at commanded poses, and the motion of the machine as a whole in predictions.

mm and rad; standard uncertainties with k = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array, as_rows
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.exceptions import InputError
from errormodel.observation_kernel import kernels_of
from errormodel.survey import Survey
from errormodel.surveys.observations import Group, groups
from identification.observation.assembly import frame_columns, frame_labels
from identification.observation.readings import known_in_frame
from identification.results.stored_fit import StoredFit

RIGID_POSES = 200  # random poses over the travels, to which a motion of the whole machine is fitted

Variance = Callable[[StoredFit, list[str], Array], Array]


def predicted_readings(fit: StoredFit, points: Survey, variance: Variance) -> dict[str, Array]:
    """Readings of rows of observations and their standard uncertainties, by column: ``length``, ``u_length`` ...

    Parameters
    ----------
    points : commands with a column ``observation`` and its entries; unknown numbers of set-ups are those of the fit.
    variance : of rows with a design (columns, 1, n), by the names of the columns.

    Raises
    ------
    InputError
        The fit has no value of an unknown.
    """
    out: dict[str, Array] = {}
    labels = frame_labels(points, fit.frame_mode)
    for group in groups(points.table, points.observations, read=False):
        in_frame = known_in_frame(group.observation) and bool(fit.frames)
        for label in dict.fromkeys(labels[group.index]) if in_frame else [""]:
            own = labels[group.index] == label if in_frame else np.ones(len(group.index), dtype=bool)
            part = replace(group, index=group.index[own])
            used = label if label in fit.frames else next(iter(fit.frames), "")
            values, std = _of_group(fit, points, part, used if in_frame else None, variance)
            column = group.observation.reading
            for name, new in ((column, values), (f"u_{column}", std)):
                out.setdefault(name, np.full(len(points), np.nan))[part.index] = new
    return out


def _of_group(
    fit: StoredFit, points: Survey, group: Group, label: str | None, variance: Variance
) -> tuple[Array, Array]:
    """Readings (n,) of one group and their standard uncertainties."""
    chain, observation = fit.chain, group.observation
    frame = chain.frame_ids if label is None else frame_columns(chain, label)
    columns = (*frame, *chain.ids[6:])
    p = np.array([fit.values.get(c, 0.0) if label is not None or k >= 6 else 0.0 for k, c in enumerate(columns)])
    every = observation.quantities()
    values = {q.name: q.value for q in every if q.value is not None}
    if label is not None:
        at = fit.frames[label].invert(np.array([[values[n] for n in observation.point]]))[0]
        values |= dict(zip(observation.point, at.tolist(), strict=True))
    for q in observation.free:
        name = group.unknown(q.name)
        if name not in fit.set_ups:
            found = f"the fit has no {name}"
            cure = "Give the observation the name, the runs and the type that it has in the fitted survey"
            raise InputError(f"{points.source}, observation {group.label}", found, cure)
        values[q.name] = fit.set_ups[name]
    scalars = np.append(p, [values[q.name] for q in every])
    rows = group.channels(chain, points.table)
    kernels = kernels_of(chain, observation)
    ids = tuple(i for k, i in enumerate(chain.ids) if i not in chain.tool_ids and (label is not None or k >= 6))
    free = tuple(q.name for q in observation.free)
    design = kernels.kernel("design", ids, free)(rows, scalars)[:, None, :]
    names = [*(columns[chain.index[i]] for i in ids), *(group.unknown(n) for n in free)]
    return kernels.kernel("value")(rows, scalars)[0], np.sqrt(variance(fit, names, design)[0])


def rigid_parts(chain: Chain, ids: Sequence[str]) -> Array:
    """Small rigid motion (6, ids) of the machine as a whole per unit of each parameter, over its travels.

    By least squares at random poses with the machine's tool and all other channels zero: what readings alone do not
    show, and what is taken out of predictions from them.
    """
    rng = np.random.default_rng(0)
    known = dict(zip(TOOL_CHANNELS, chain.machine.tool, strict=True))
    joints = {j.name: rng.uniform(*j.travel, RIGID_POSES) for j in chain.machine.joints}
    rows = as_rows(*(joints.get(c, np.full(RIGID_POSES, known.get(c, 0.0))) for c in chain.channels))
    rigid = chain.kernel("design", chain.frame_ids, outputs=(0, 1, 2))(rows).reshape(6, -1).T
    columns = chain.kernel("design", tuple(ids), outputs=(0, 1, 2))(rows).reshape(len(ids), -1).T
    return np.asarray(np.linalg.lstsq(rigid, columns, rcond=None)[0])
