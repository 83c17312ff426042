"""Straight and turning motions of single joints, found among the rows of a survey.

A series is all readings of one joint while the others stand still. Deviations are actual minus nominal, in mm in the
axes of the machine's reference (rows about a joint's error motions: in the axes of the joint's frame), after the best
frame of the survey as far as the points determine it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from errormodel.approach import one_way_each, passes
from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.conventions import ROTATIONS, TRANSLATIONS
from errormodel.machine import Joint, Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MOTION_UNCERTAINTIES, SIGMA_COLUMNS
from errormodel.surveys.motion_sizes import FEWEST_ROWS, REASON, central_range, usual_range
from identification.observation.assembly import frame_labels
from identification.observation.frames import align
from identification.observation.pose import IDENTITY, Pose
from identification.results.axis_lines import LEAST_MOVED, SAME_POSITION, spoken_place

DRAWS = 400  # of the declared noise: the standard uncertainty is then known to 3.5 % (1 / sqrt(2 draws))


@dataclass(frozen=True)
class Points:
    """Rows with measured points: deviations of all rows in the axes of the reference.

    Attributes
    ----------
    index : (n,) rows of the survey.
    nominal, deviation : (n, 3) mm; deviations are NaN where not measured.
    sigma : (n, 3) standard uncertainty of a reading in mm; None where none is declared.
    frames : poses by label.
    """

    index: Index
    nominal: Array
    deviation: Array
    sigma: Array | None
    frames: dict[str, Pose]


@dataclass(frozen=True)
class Series:
    """Readings of one joint while the others stand still.

    Attributes
    ----------
    joint : the joint that moves.
    at : where the others stand, in words; empty for error motions.
    q : (n,) commands, mm or rad.
    axis : (3,) unit vector of its motion, in the axes of `deviation`.
    deviation : (n, 3) mm; `turn` : (n, 3) rad; NaN where not measured.
    sigma, turn_sigma : (n, 3) declared standard uncertainties; None where there are none.
    direction : (n,) +-1, side of approach.
    index : (n,) rows of the survey.
    """

    joint: Joint
    at: str
    q: Array
    axis: Array
    deviation: Array
    turn: Array
    sigma: Array | None
    turn_sigma: Array | None
    direction: Array
    index: Index

    @property
    def label(self) -> str:
        """Name of the series: the joint, and where the others stand."""
        return f"{self.joint.name} ({self.at})" if self.at else self.joint.name

    @property
    def unit(self) -> str:
        return "mm" if self.joint.type == "prismatic" else "rad"

    @property
    def along(self) -> Array:
        """Positioning deviation (n,) in mm or rad: along the axis, or about it."""
        return _component(self.deviation if self.joint.type == "prismatic" else self.turn, self.axis)

    @property
    def along_sigma(self) -> Array | None:
        """Declared standard uncertainty (n,) of `along`."""
        sigma = self.sigma if self.joint.type == "prismatic" else self.turn_sigma
        return None if sigma is None else np.sqrt(_component(np.square(sigma), np.square(self.axis)))

    def sees(self, values: Array) -> bool:
        """Whether all of the values were measured."""
        return bool(np.isfinite(values).all())


def _component(values: Array, axis: Array) -> Array:
    """Component of vectors (n, 3) along an axis; a component that the axis does not have need not be measured."""
    used = np.abs(axis) > 1e-9
    return np.asarray(values[:, used] @ axis[used])


def measured_points(survey: Survey, machine: Machine, chain: Chain) -> Points | None:
    """The rows with measured points, in the axes of the reference; None where there are none."""
    table = survey.table
    index = np.flatnonzero(np.isfinite(survey.measured).any(axis=1))
    if not len(index):
        return None
    measured = survey.measured[index]
    rows = chain.columns(table.iloc[index].reset_index(drop=True))
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(rows).T
    labels = frame_labels(survey, survey.frame)[index]
    deviation = np.full_like(measured, np.nan)
    sigma = _sigma(survey, index, measured)
    frames: dict[str, Pose] = {}
    assumed = None
    if survey.frame_rotation is not None:
        from errormodel.arrays import rotation_matrix

        assumed = rotation_matrix(survey.frame_rotation)
    for label in dict.fromkeys(labels):
        own = np.flatnonzero(labels == label)
        pose = IDENTITY if survey.frame == "fixed" else align(nominal[own], measured[own], assumed=assumed)
        frames[str(label)] = pose
        # only what was measured: a turned frame mixes components, and needs all of them
        gap = measured[own] - pose.apply(nominal[own])
        plain = np.abs(pose.rotation - np.eye(3)).max() < 1e-2
        whole = np.isfinite(gap).all(axis=1)
        deviation[own[whole]] = gap[whole] @ pose.rotation
        if plain:
            deviation[own[~whole]] = gap[~whole]
    return Points(index, nominal, deviation, sigma, frames)


def _sigma(survey: Survey, index: Index, measured: Array) -> Array | None:
    """Declared standard uncertainties (n, 3) of points: of the rows where they have them, else of the instrument."""
    if all(name in survey.table for name in SIGMA_COLUMNS):
        own = survey.table[list(SIGMA_COLUMNS)].to_numpy(dtype=np.float64)[index]
        if np.isfinite(own).all():
            return own
    if not survey.sized:
        return None
    covariance = survey.instrument.covariance(measured)
    return None if covariance is None else np.sqrt(np.einsum("nii->ni", covariance))


# Series of each survey and machine (by identity), while `series_kept` holds them
_Kept = dict[tuple[int, int], tuple[Series, ...]]
_kept: ContextVar[_Kept | None] = ContextVar("kept", default=None)


@contextmanager
def series_kept() -> Iterator[None]:
    """Within it the series of a survey are found once: `doubts` and all standards ask for the same ones."""
    token = _kept.set({})
    try:
        yield
    finally:
        _kept.reset(token)


def series_of(survey: Survey, machine: Machine) -> tuple[Series, ...]:
    """All series of a survey: of rows about one joint first, then of points."""
    kept, key = _kept.get(), (id(survey), id(machine))
    if kept is not None and key in kept:
        return kept[key]
    points = measured_points(survey, machine, Chain(machine))
    found = (*_of_motions(survey, machine), *(() if points is None else _of_points(survey, machine, points)))
    if kept is not None:
        kept[key] = found
    return found


def doubts(survey: Survey, machine: Machine) -> list[str]:
    """Sentences on positioning deviations of points that are beyond those of machines: a unit that is wrong.

    Rows of error motions are judged where they are read (`errormodel.surveys.motion_sizes`).
    """
    out = []
    for series in series_of(survey, machine):
        if series.unit != "mm" or not series.at or np.isfinite(series.along).sum() < FEWEST_ROWS:
            continue
        way, size = float(np.ptp(series.q)), central_range(series.along)
        if size > usual_range(way):
            out.append(
                f"{series.label}: positioning deviations that vary by {size:.3g} mm, where those of a machine vary by "
                f"{usual_range(way):.2g} mm over {way:.4g} mm at most: {REASON}. See the units of commands and "
                "readings (units: in survey.yaml)"
            )
    return out


def _of_motions(survey: Survey, machine: Machine) -> Iterator[Series]:
    table = survey.table
    if "joint" not in table:
        return
    for joint in machine.joints:
        index = np.flatnonzero((table["joint"] == joint.name).to_numpy())
        if not len(index):
            continue
        part = table.iloc[index]
        moved = part[[*TRANSLATIONS]].to_numpy(dtype=np.float64)
        turned = part[[*ROTATIONS]].to_numpy(dtype=np.float64)
        sigmas = _motion_sigmas(survey, index)
        yield Series(
            joint, "", part[joint.name].to_numpy(dtype=np.float64), np.array(joint.axis), moved, turned, *sigmas,
            survey.direction(joint.name)[index], index,
        )  # fmt: skip


def _motion_sigmas(survey: Survey, index: Index) -> tuple[Array | None, Array | None]:
    table = survey.table
    out: list[Array | None] = []
    for names, motions in ((MOTION_UNCERTAINTIES[:3], TRANSLATIONS), (MOTION_UNCERTAINTIES[3:], ROTATIONS)):
        have = [n for n in names if n in table]
        if not have:
            out.append(None)
            continue
        values = np.full((len(index), 3), np.nan)
        for name in have:
            values[:, names.index(name)] = table[name].to_numpy(dtype=np.float64)[index]
        read = table[[*motions]].to_numpy(dtype=np.float64)[index]
        out.append(values if np.isfinite(values[np.isfinite(read)]).all() else None)
    return out[0], out[1]


def _of_points(survey: Survey, machine: Machine, points: Points) -> Iterator[Series]:
    joints = machine.joints
    q = survey.commands([j.name for j in joints])[points.index]
    tool = survey.tool[points.index]
    key = np.round(np.hstack([q, tool]) / SAME_POSITION).astype(np.int64)
    for k, joint in enumerate(joints):
        others = np.delete(key, k, axis=1)
        _, inverse = np.unique(others, axis=0, return_inverse=True)
        inverse = inverse.ravel()
        for code in dict.fromkeys(inverse.tolist()):
            own = _together(np.flatnonzero(inverse == code), key[:, k])
            if len(np.unique(key[own, k])) < 3 or np.ptp(q[own, k]) < LEAST_MOVED:
                continue
            low, high = own[np.argmin(q[own, k])], own[np.argmax(q[own, k])]
            step = points.nominal[high] - points.nominal[low]
            length = float(np.linalg.norm(step))
            axis = step / length if joint.type == "prismatic" and length > 0 else np.array(joint.axis)
            index = points.index[own]
            nothing = np.full((len(own), 3), np.nan)
            sides = sides_of(survey, joint, index, q[own, k])
            yield Series(
                joint, spoken_place(joints, q[own[0]], joint), q[own, k], axis, points.deviation[own], nothing,
                None if points.sigma is None else points.sigma[own], None, sides, index,
            )  # fmt: skip


def _together(own: Index, place: Index) -> Index:
    """Rows with a neighbour in the order of the rows: where lines cross, a row belongs to the one it was read in."""
    near = np.isin(own - 1, own) | np.isin(own + 1, own)
    return own[near] if len(np.unique(place[own[near]])) > 2 else own


def zeros_apart(survey: Survey, series: Series) -> bool:
    """Whether readings of a series from below and from above count from different zeros, or in different frames."""
    if survey.frame == "fixed":
        return False
    of_motions = not series.at and "joint" in survey.table
    labels = survey.table["run"].to_numpy(dtype=object) if of_motions else frame_labels(survey, survey.frame)
    return one_way_each(series.direction, labels[series.index])


def sides_of(survey: Survey, joint: Joint, index: Index, position: Array) -> Array:
    """Side of approach of each reading: as stated, else as in a test to and fro that overruns its last target."""
    if f"dir_{joint.name}" in survey.table:
        return survey.direction(joint.name)[index]
    runs = np.unique(survey.table["run"].to_numpy(dtype=str)[index], return_inverse=True)[1]
    return passes(position, runs)
