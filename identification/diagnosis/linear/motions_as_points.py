"""Conversion of a joint's error motions into points that the joint carries, so that a survey of them can be diagnosed.

Six motions of a joint move the functional point and two others far beside it; the components of these that show each
motion once are what a tracker would have measured there. All other joints stand in the middle of their travel.

Where fewer were read, or of several joints, each joint is a machine of its own: its displacements are those of a point
in its place, its rotations those of points beside it. The zero of each run is an unknown of that machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from errormodel import effects, joint_models
from errormodel.approach import direction
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.conventions import MOTIONS, ROTATIONS, TRANSLATIONS, Motion
from errormodel.effects.base import axis_motion
from errormodel.effects.unnamed import Unnamed
from errormodel.machine import EffectSpec, Joint, Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, MOTION_UNCERTAINTIES, SIGMA_COLUMNS
from errormodel.surveys.observations import groups
from identification.runtime.progress import Progress

ASIDE = 5000.0  # mm: far enough that the noise of a component is that of the angle that it shows
POINTS = (((0.0, 0.0, 0.0), (0, 1, 2)), ((ASIDE, 0.0, 0.0), (1, 2)), ((0.0, ASIDE, 0.0), (2,)))


BESIDE = 1000.0  # mm: a microradian there is a micrometre
AROUND: tuple[tuple[tuple[float, float, float], tuple[Motion, ...]], ...] = (
    ((BESIDE, 0.0, 0.0), ("eb", "ec")),
    ((0.0, BESIDE, 0.0), ("ea",)),
)


@dataclass(frozen=True)
class Carried:
    """The displacements of one joint, or its rotations, as a machine and a survey of points.

    `turning`: they are rotations, and all lengths those at a metre's distance.
    """

    joint: str
    turning: bool
    machine: Machine
    survey: Survey

    def __str__(self) -> str:
        return f"{'rotations' if self.turning else 'displacements'} of {self.joint}"

    def telling(self, progress: Progress) -> Progress:
        """What is done to this part, by its name."""
        return lambda text: progress(f"{text}, {self}")


def carried(machine: Machine, survey: Survey) -> list[Carried]:
    """A survey of error motions only, joint by joint; none where positions were measured, or lengths or angles."""
    table = survey.fit.table
    if (
        any(groups(table, survey.observations))
        or "joint" not in table
        or not len(table)
        or survey.fit.measured.size - np.isnan(survey.fit.measured).sum()
    ):
        return []
    return [
        part
        for joint in machine.joints
        for motions in (TRANSLATIONS, ROTATIONS)
        if (part := _of_joint(machine, joint, motions, survey)) is not None
    ]


def _of_joint(machine: Machine, joint: Joint, motions: tuple[Motion, ...], survey: Survey) -> Carried | None:
    table = survey.table
    about = table[table["joint"] == joint.name]
    read = [m for m in motions if m in table and about[m].nunique() > 1]  # what never changes holds nothing
    keep = (table["joint"] == joint.name) & table[read].notna().any(axis=1)
    if not (keep & (table["role"] == "fit")).any():
        return None
    others = [c for j in machine.joints if j is not joint for c in (j.name, f"dir_{j.name}")]
    bare = table.assign(**{f"dir_{joint.name}": direction(table, joint.name)})[keep]
    own = bare.drop(columns=["joint", *MOTIONS, *MOTION_UNCERTAINTIES, *SIGMA_COLUMNS, *others], errors="ignore")
    own[[*MEASURED]] = np.nan
    turning, free = motions == ROTATIONS, survey.frame != "fixed"
    parts = []
    for offset, shown in AROUND if turning else (((0.0, 0.0, 0.0), TRANSLATIONS),):
        part = own.copy()
        part[list(TOOL_CHANNELS)] = _behind(joint, bare[joint.name].to_numpy(dtype=np.float64), np.array(offset))
        nominal = np.add.outer(bare[joint.name].to_numpy(), np.zeros(3)) * (joint.type == "prismatic") * joint.axis
        for motion in (m for m in shown if m in read):
            axis = np.eye(3)[MOTIONS.index(motion) % 3]
            way = np.cross(axis, offset) if turning else axis
            k = int(np.argmax(np.abs(way)))
            part[MEASURED[k]] = nominal[:, k] + offset[k] + way[k] * bare[motion]
            if f"u_{motion}" in bare:
                part[SIGMA_COLUMNS[k]] = abs(way[k]) * bare[f"u_{motion}"]
        parts.append(part)
    points = pd.concat(parts).sort_index(kind="stable")
    points = points[points[[*MEASURED]].notna().any(axis=1)].reset_index(drop=True)
    zeros = (*_zeros(joint.name, bare[bare["role"] == "fit"], read), *_slopes(joint, read)) if free else ()
    alone = Machine(
        machine.name, (_turned(joint) if turning else joint,), (0.0, 0.0, 0.0), (*_effects_at(machine, joint), *zeros)
    )
    return Carried(joint.name, turning, alone, replace(survey, table=points, frame="fixed", motions_of=joint.name))


def _behind(joint: Joint, q: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Points (n, 3) in the last frame that lie at `offset` from the joint, whatever its position (n,)."""
    from scipy.spatial.transform import Rotation

    if joint.type == "prismatic":
        return np.tile(offset, (len(q), 1))
    return Rotation.from_rotvec(np.outer(-q, joint.axis)).apply(offset)


def _turned(joint: Joint) -> Joint:
    """The joint with its rotations only; what first-order angles make of the path is none of these."""
    models = {
        m: joint_models.registry()[b.kind].rotation_alone(joint, b.n) for m, b in joint.models.items() if m in ROTATIONS
    }
    return replace(joint, models=models)


def _zeros(joint: str, rows: pd.DataFrame, read: list[Motion]) -> Iterator[EffectSpec]:
    """The instrument's zero of each run and motion."""
    for run in dict.fromkeys(rows["run"].astype(str)):
        for motion in read:
            if rows.loc[rows["run"].astype(str) == run, motion].notna().any():
                yield EffectSpec(Unnamed.effect, {"element": joint, "motion": motion, "driver": f"run({run})"})


def _slopes(joint: Joint, read: list[Motion]) -> Iterator[EffectSpec]:
    """How a straightedge lay along a joint whose model has no such slope: it is in every reading across the joint."""
    middle, half = sum(joint.travel) / 2, (joint.travel[1] - joint.travel[0]) / 2
    for motion in read if joint.type == "prismatic" else ():
        model = joint.models.get(motion)
        across = motion in TRANSLATIONS and motion != axis_motion(joint)
        if across and (model is None or not joint_models.registry()[model.kind].has_slope(joint, motion)):
            options = {"element": joint.name, "motion": motion, "driver": joint.name, "center": middle}
            yield EffectSpec(Unnamed.effect, {**options, "half_range": half})


def _effects_at(machine: Machine, joint: Joint) -> Iterator[EffectSpec]:
    """The machine's effects that move this joint by itself."""
    for spec in machine.effects:
        effect = effects.make(spec)
        if effect.where == joint.name and not {j.name for j in machine.joints if j is not joint} & {*effect.drivers}:
            yield spec


def as_points(machine: Machine, survey: Survey) -> Survey:
    """A survey of all six motions of one joint from the machine's own zero as one of points; any other as it is.

    That is their zero where the frame is fixed, or where each comes with its uncertainty, as a registration against the
    cold machine gives them; an instrument starts every run from a zero of its own.
    """
    table = survey.table
    if survey.frame != "fixed" and not {*MOTION_UNCERTAINTIES} <= {*table.columns}:
        return survey
    if not {"joint", *MOTIONS} <= {*table.columns} or table[list(MOTIONS)].isna().to_numpy().any():
        return survey
    joints = table["joint"].unique()
    if len(joints) != 1 or not joints[0]:
        return survey
    chain = Chain(machine)
    place = 6 * chain.element_names.index(joints[0])
    bare = table.drop(columns=["joint", *MOTIONS, *MOTION_UNCERTAINTIES], errors="ignore")
    for joint in machine.joints:
        if joint.name != joints[0]:
            bare[joint.name] = sum(joint.travel) / 2
    motions = table[list(MOTIONS)].to_numpy(dtype=np.float64)
    known = {*MOTION_UNCERTAINTIES} <= {*table.columns}
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
            u = table[list(MOTION_UNCERTAINTIES)].to_numpy(dtype=np.float64)
            part[list(SIGMA_COLUMNS)] = np.sqrt(np.einsum("kcn,nk->nc", arms**2, u**2))
        parts.append(part)
    points = pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)
    return replace(survey, table=points, frame="fixed", motions_of=str(joints[0]))
