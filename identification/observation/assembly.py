"""Assembly of the estimation problem: views and unknowns of a fit from the rows of a survey.

Measuring frames are aligned to the nominal points, rows are whitened by their standard uncertainties, and rows without
a measured value are left out. Units: mm and rad.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask, as_rows, rotation_matrix
from errormodel.chain import Chain, What
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.exceptions import InputError
from errormodel.machine import Joint
from errormodel.surveys.columns import SIGMA_COLUMNS
from errormodel.surveys.observations import is_unknown
from identification.observation.frames import MACHINE_ERROR_SHARE, align, mean_rotation
from identification.observation.models import Kind, MotionView, OrientationView, PositionView, View, fixed_tool
from identification.observation.pose import IDENTITY, Pose
from identification.observation.readings import ReadingView, placed_by_stations, reading_views, stated

if TYPE_CHECKING:
    from errormodel.survey import Survey


@dataclass(frozen=True)
class Problem:
    """The estimation problem of a chain and a survey.

    Attributes
    ----------
    views : observation models of the rows.
    unknowns : names of all unknowns, those of the frames first.
    frames : pose by label ("" for the one shared frame; empty if the frame is fixed).
    labels : (n,) of str, the frame of each row of the survey.
    declared : kinds of observation whose uncertainty the survey states.
    mount : (3, 3) orientation of a 6-D target in the last frame, or None.
    """

    chain: Chain
    views: tuple[View, ...]
    unknowns: tuple[str, ...]
    frames: dict[str, Pose]
    labels: Array
    declared: frozenset[Kind]
    mount: Array | None = None

    @property
    def readings(self) -> tuple[ReadingView, ...]:
        """Views of single readings."""
        return tuple(v for v in self.views if isinstance(v, ReadingView))

    @property
    def angular(self) -> frozenset[Kind]:
        """Kinds of observation that are angles."""
        return frozenset(v.kind for v in self.views if v.turns)

    def place(self) -> dict[str, int]:
        """Index of each unknown by name."""
        return {name: k for k, name in enumerate(self.unknowns)}

    def storing_design(self) -> Problem:
        """The same with M of its views stored where that is quicker; of the same rows once."""
        views = list[View]()
        for view in self.views:
            views.append(view.storing_design(views))
        return replace(self, views=tuple(views))


def frame_labels(survey: Survey, mode: str | None = None) -> Array:
    """Label (n,) of each row's measuring frame: "" where all share one, else the name of the run or file.

    `mode` replaces the survey's own ``frame``.
    """
    mode = mode or survey.frame
    if mode in ("shared", "fixed"):
        return np.full(len(survey), "", dtype=object)
    return survey.table["run" if mode == "per-run" else "file"].to_numpy(dtype=object)


def frame_columns(chain: Chain, label: str) -> tuple[str, ...]:
    """Names of a frame's six unknowns: ``frame.dx`` ..., or ``frame[2].dx`` for run 2."""
    return tuple(f"frame[{label}].{m}" for m in MOTIONS) if label else chain.frame_ids


def determined_columns(chain: Chain, label: str, pose: Pose) -> tuple[str, ...]:
    """Names of the frame's unknowns that its points determine.

    Where the points lie on a line, the rotation about the axis of the reference nearest to it is left out: the two
    others span all rotations but the one about the line. Of two undetermined axes, the two are left out that the
    determined one is farthest from.
    """
    columns = frame_columns(chain, label)
    open_axes = {int(np.argmax(np.abs(axis))) for axis in pose.undetermined}
    if len(pose.undetermined) == 2:
        open_axes = {0, 1, 2} - {int(np.argmax(np.abs(np.cross(*pose.undetermined))))}
    return tuple(c for k, c in enumerate(columns) if k - 3 not in open_axes)


def build(
    chain: Chain,
    survey: Survey,
    held: Array | None = None,
    ids: Sequence[str] | None = None,
    mount: Array | None = None,
    poses: Mapping[str, Pose] | None = None,
) -> Problem:
    """The estimation problem of a survey.

    Parameters
    ----------
    held : (chain parameters,) known parameters, mm and rad, of a test file: frames are then aligned to the predicted
        points instead of the nominal ones.
    ids : parameters that are unknown besides the frames'; None: those of the machine.
    mount : (3, 3) known orientation of a 6-D target in the last frame; None: estimated from the rows.
    poses : known poses of the measuring frames by label; None: found from the rows.

    Raises
    ------
    InputError
        No row holds a measured value, or only some rows of a kind have a standard uncertainty.
    """
    table = survey.table
    joint = table["joint"].to_numpy(dtype=object) if "joint" in table else np.full(len(table), "", dtype=object)
    volumetric = np.flatnonzero(joint == "")
    labels = frame_labels(survey)
    p = np.zeros(len(chain.ids)) if held is None else held
    own = tuple(chain.machine_ids if ids is None else ids)
    views: list[View] = []
    frames: dict[str, Pose] = {}
    free: list[str] = []
    sized: set[bool] = set()  # whether positions of a frame have a standard uncertainty
    seen = np.asarray(np.isfinite(survey.measured).any(axis=1))
    turned = _rotations(survey)
    channels = chain.columns(survey.table) if len(volumetric) else []
    fixed = fixed_tool(chain, channels) if channels else {}  # the same in all frames, which then share kernels
    exact: What = "actual" if p.any() else "nominal"
    mounts = []
    for label in dict.fromkeys(labels[volumetric].tolist()):
        own_rows = volumetric[labels[volumetric] == label]
        index = own_rows[seen[own_rows]]
        if not len(index):
            continue
        rows = as_rows(*(c[index] for c in channels))
        pose = IDENTITY
        if survey.frame != "fixed" and poses is not None:
            frames[label] = pose = poses[label]
            free += frame_columns(chain, label)
        elif survey.frame != "fixed":
            nominal = chain.kernel(exact, (), fixed, (0, 1, 2))(rows, p)
            pose = align(
                nominal.T, survey.measured[index], _row_weights(survey, index),
                assumed=_assumed(survey), largest=MACHINE_ERROR_SHARE * chain.size,
            )  # fmt: skip
            frames[label] = pose
            free += frame_columns(chain, label)
        rest = (*own, *(i for i in chain.tool_ids if i not in own))
        whitener, known = _whitener(survey, index)
        sized.add(known)
        position = PositionView(
            kind="position",
            chain=chain,
            ids=(*chain.frame_ids, *rest),
            columns=(*frame_columns(chain, label), *rest),
            rows=rows,
            whitener=whitener,
            index=index,
            fixed=fixed,
            measured=np.nan_to_num(survey.measured[index]),
            pose=pose,
        )
        views.append(position)
        here = own_rows[np.isfinite(turned[own_rows]).all(axis=(1, 2))] if turned is not None else own_rows[:0]
        if turned is not None and len(here):
            angles = OrientationView(
                chain=chain,
                ids=position.ids,
                columns=position.columns,
                rows=as_rows(*(c[here] for c in channels)),
                whitener=np.ones(len(here)),
                index=here,
                fixed=fixed,
                turned=turned[here],
                pose=pose,
            )
            views.append(angles)
            last = chain.kernel(exact, (), fixed, tuple(range(3, 12)))(angles.rows, p).reshape(3, 3, -1).T
            mounts.append(last.transpose(0, 2, 1) @ pose.rotation.T @ turned[here])
    if len(sized) > 1:
        found = "standard uncertainties in some measuring frames and none in others"
        raise InputError(str(survey.source), found, "Give sigma in every row or in none, or declare the instrument")
    declared: frozenset[Kind] = frozenset({"position"} if True in sized and survey.sized else ())
    if mounts:
        mount = mean_rotation(np.concatenate(mounts)) if mount is None else mount
        views = [replace(v, mount=mount) if isinstance(v, OrientationView) else v for v in views]
        own = (*own, *(i for i in chain.tool_ids[3:] if i not in own))
    motion_views, zeros = _motion_views(chain, survey, joint)
    if ids is None:
        # a fixed frame without positions: error motions are relative to the machine's own zero
        free += zeros if views or survey.frame != "fixed" else []
        views += motion_views
        declared |= _stated(survey, motion_views)
        if survey.frame != "fixed":
            more = placed_by_stations(chain, survey, frames, labels)
            frames |= more
            free += [c for label in more for c in frame_columns(chain, label)]
        readings = reading_views(chain, survey, frames, labels, {la: frame_columns(chain, la) for la in frames})
        free += dict.fromkeys(c for v in readings for c in v.starts)
        views += readings
        declared |= stated(survey, readings)
    if not views:
        raise InputError(str(survey.source), "no row holds a measured value", "Give mx my mz in at least one row")
    return Problem(chain, tuple(views), (*free, *own), frames, labels, declared, mount)


def _assumed(survey: Survey) -> Array | None:
    """The rotation (3, 3) that the survey states for its measuring frames, if it does."""
    return None if survey.frame_rotation is None else rotation_matrix(survey.frame_rotation)


def _rotations(survey: Survey) -> Array | None:
    """Measured orientations (n, 3, 3) of a 6-D target, NaN where missing; None without them."""
    if "mrx" not in survey.table:
        return None
    from scipy.spatial.transform import Rotation

    vectors = survey.table[["mrx", "mry", "mrz"]].to_numpy(dtype=float)
    out = np.full((len(vectors), 3, 3), np.nan)
    whole = np.isfinite(vectors).all(axis=1)
    out[whole] = Rotation.from_rotvec(vectors[whole]).as_matrix()
    return out


def _sigmas(survey: Survey, index: Index) -> Array | None:
    if not any(name in survey.table for name in SIGMA_COLUMNS):
        return None
    sigmas = survey.table.reindex(columns=SIGMA_COLUMNS).to_numpy(dtype=float)[index]
    measured = np.isfinite(survey.measured[index])
    bare = (np.isnan(sigmas) & measured).any(axis=1)
    if bare.all() and np.isnan(sigmas).all():
        return None
    if bare.any():
        row = survey.table.iloc[index[np.flatnonzero(bare)[0]]]
        raise InputError(
            f"{row['file']}, row {row['row']}, column sigma",
            "a measured value without a standard uncertainty, in a measuring frame where others have one",
            "Give sigma (or sigma_x sigma_y sigma_z) in every row, or in none",
        )
    return np.where(measured, sigmas, 0.0)


def _row_weights(survey: Survey, index: Index) -> Array | None:
    """Weights 1/sigma (n,) for the alignment; None if not stated."""
    sigmas = _sigmas(survey, index)
    return None if sigmas is None else 1 / np.linalg.norm(sigmas, axis=1)


def _whitener(survey: Survey, index: Index) -> tuple[Array, bool]:
    """Whitener of positions, and whether the survey states their uncertainty (columns take precedence)."""
    measured = survey.measured[index]
    missing = ~np.isfinite(measured)
    sigmas = _sigmas(survey, index)
    covariance = None
    if sigmas is not None:
        if not missing.any() and (sigmas == sigmas[:, :1]).all():
            return 1 / sigmas[:, 0], True
        covariance = np.einsum("ij,jk->ijk", sigmas**2, np.eye(3))
    else:
        covariance = survey.instrument.covariance(np.nan_to_num(measured))
    known = covariance is not None
    if covariance is None:
        if not missing.any():
            return np.ones(len(index)), False
        covariance = np.broadcast_to(np.eye(3), (len(index), 3, 3))
    return marginal_whitener(covariance, missing), known


def marginal_whitener(covariance: Array, missing: Mask) -> Array:
    """Whiteners (n, 3, 3) of the measured components, with zero rows for missing ones.

    Parameters
    ----------
    covariance : (n, 3, 3) of all components, mm^2.
    missing : (n, 3) components that were not measured.
    """
    covariance = covariance.copy()
    covariance[missing] = 0.0
    covariance.transpose(0, 2, 1)[missing] = 0.0
    covariance[:, range(3), range(3)] += missing
    whitener = np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
    whitener[missing] = 0.0
    return whitener


def _motion_views(chain: Chain, survey: Survey, joint: Array) -> tuple[list[View], list[str]]:
    """Views of error-motion rows, and names of their zeros: one for each joint, run and motion."""
    views: list[View] = []
    zeros: list[str] = []
    table = survey.table
    channels = chain.columns(table) if (joint != "").any() else []
    runs = table["run"].to_numpy(dtype=object)
    for name in dict.fromkeys(joint[joint != ""]):
        ids = tuple(i for i in chain.machine_ids if chain.parameters[chain.index[i]].element == name)
        for run in dict.fromkeys(runs[joint == name]):
            rows = np.flatnonzero((joint == name) & (runs == run))
            zero = tuple(f"zero[{name}, run {run}].{m}" for m in MOTIONS)
            for k, motion in enumerate(MOTIONS):
                if motion not in table:
                    continue
                values = table[motion].to_numpy(dtype=float)
                index = rows[np.isfinite(values[rows])]
                if not len(index):
                    continue
                rows_seen = as_rows(*(np.nan_to_num(c[index]) for c in channels))
                sigma = table[f"u_{motion}"].to_numpy(dtype=float)[index] if f"u_{motion}" in table else np.ones(1)
                views.append(
                    MotionView(
                        kind="displacement" if motion in TRANSLATIONS else "angle",
                        chain=chain,
                        ids=ids,
                        columns=(*ids, *zero),
                        rows=rows_seen,
                        whitener=np.broadcast_to(1 / np.where(np.isnan(sigma), 1.0, sigma), len(index)).copy(),
                        index=index,
                        outputs=(k,),
                        measured=values[index],
                    )
                )
                zeros.append(zero[k])
    return views, zeros


def _stated(survey: Survey, views: Sequence[View]) -> frozenset[Kind]:
    """Kinds of error-motion readings whose uncertainty the survey states.

    Raises
    ------
    InputError
        Only some readings of a kind have a standard uncertainty, so that their relative weight is unknown.
    """
    table, stated = survey.table, dict[Kind, bool]()
    for view in views:
        name = f"u_{MOTIONS[view.outputs[0]]}"
        column = table[name].to_numpy(dtype=float) if name in table else np.full(len(table), np.nan)
        known = np.isfinite(column[view.index])
        odd = view.index[known != stated.setdefault(view.kind, bool(known[0]))]
        if len(odd):
            row = table.iloc[odd[0]]
            found = f"{view.kind} readings with a standard uncertainty beside others without"
            cure = f"Give the uncertainty of every {view.kind} that was read ({name} and the like), or of none"
            raise InputError(f"{row['file']}, row {row['row']}, column {name}", found, cure)
    return frozenset(kind for kind, known in stated.items() if known)


def group_order(chain: Chain, unknowns: Sequence[str]) -> list[int]:
    """Order in which unknowns may be the base of a group: set-ups, link lengths, link angles, joints, zeros, frames.

    Measuring frames come late, so that a group with both is named after the machine's parameter. Stations and the like
    come first: what moves them all alike is the place of the machine among them, and its other groups are free of them.
    So do places of targets that nobody knows: what cannot be told from them is no error of the machine.
    """
    joints = {e.name for e in chain.machine.elements if isinstance(e, Joint)}

    def rank(k: int) -> tuple[int, int]:
        name = unknowns[k]
        if is_unknown(name):
            return -1, k
        if name not in chain.index or name in chain.frame_ids or name in chain.tool_ids:
            return (3 if name.startswith("zero[") else 5 if name in chain.tool_ids else 4), k
        parameter = chain.parameters[chain.index[name]]
        if name in chain.of_effects and math.isinf(parameter.size):
            return -1, k
        if parameter.element in joints:
            return 2, k
        return (0 if parameter.motion in TRANSLATIONS else 1), k

    return sorted(range(len(unknowns)), key=rank)
