"""Error motions of one joint as points that the joint carries, so that a survey of them can be diagnosed.

Six motions of a joint move the functional point and two others far beside it; the components of these that show each
motion once are what a tracker would have measured there. All other joints stand in the middle of their travel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.conventions import MOTIONS
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.survey_columns import MEASURED, SIGMA, UNCERTAINTY

ASIDE = 5000.0  # mm: far enough that the noise of a component is that of the angle that it shows
POINTS = (((0.0, 0.0, 0.0), (0, 1, 2)), ((ASIDE, 0.0, 0.0), (1, 2)), ((0.0, ASIDE, 0.0), (2,)))


def as_points(machine: Machine, survey: Survey) -> Survey:
    """A survey of all six motions of one joint as one of points; any other survey as it is."""
    table = survey.table
    if not {"joint", *MOTIONS} <= {*table.columns} or table[list(MOTIONS)].isna().to_numpy().any():
        return survey
    joints = table["joint"].unique()
    if len(joints) != 1 or not joints[0]:
        return survey
    chain = Chain(machine)
    place = 6 * chain.element_names.index(joints[0])
    bare = table.drop(columns=["joint", *MOTIONS, *UNCERTAINTY], errors="ignore")
    for joint in machine.joints:
        if joint.name != joints[0]:
            bare[joint.name] = sum(joint.travel) / 2
    motions = table[list(MOTIONS)].to_numpy(dtype=np.float64)
    known = {*UNCERTAINTY} <= {*table.columns}
    parts = []
    for offset, components in POINTS:
        part = bare.copy()
        part[list(TOOL_CHANNELS)] = np.add(machine.tool, offset)
        rows = chain.columns(part)
        nominal = chain.kernel("nominal", outputs=(0, 1, 2))(rows)
        arms = chain.kernel("levers", (), {}, (0, 1, 2))(rows, np.zeros(len(chain.ids)))
        arms = arms.reshape(-1, 3, len(part))[place : place + 6]
        moved = nominal + np.einsum("kcn,nk->cn", arms, motions)
        for c, name in enumerate(MEASURED):
            part[name] = moved[c] if c in components else np.nan
        if known:
            u = table[list(UNCERTAINTY)].to_numpy(dtype=np.float64)
            part[list(SIGMA)] = np.sqrt(np.einsum("kcn,nk->nc", arms**2, u**2))
        parts.append(part)
    points = pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)
    return replace(survey, table=points, frame="fixed", motions_of=str(joints[0]))
