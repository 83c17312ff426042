"""Places that the axes were driven to until a probe touched or centred them: indicated positions as commands.

Such rows have one measured point, the place of what was touched, and what the machine is off stands in the commands.
A few of them, read again and again while the machine drifts, show each error motion over micrometres of travel, where
a slope of -1 explains everything. They are written as an R-test has them: the commands that the nominal machine needs,
and the difference of the indicated ones from these in what was measured. The gaps are the same to second order.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask, rotation_matrix
from errormodel.machine import Machine, Vector
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.diameters import cross_slides, looks_like_diameters

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.chain import Chain
    from errormodel.surveys.file import Frame

FEWEST = 4  # rows a place, on average
NEAR_MM = 1.0  # of the nominal points, and of distances between places: what a machine is off
FAR_BELOW = 0.1  # of the distance to the next place: readings held by a machine that moves lie half of it apart
LEAST_MM = 2e-3  # of the nominal points: commands rounded to a micrometre lie less off
DIGITS = 6  # behind the decimal point, mm: positions of one pose are the same


def with_nominal_commands(
    table: pd.DataFrame, machine: Machine, frame: Frame, rotation: Vector | None
) -> tuple[pd.DataFrame, list[str]]:
    """The table of a survey with nominal commands in rows about a place that was touched, and a note.

    Parameters
    ----------
    rotation : stated rotation (Rx, Ry, Rz; rad) of the machine's reference into the measuring frame, or
        None. Then it is none, or that of the places where these are as far apart but turned.

    Raises
    ------
    InputError
        More rows are about such places if a lathe's cross slide was read in diameters.
    """
    of_place = _repeated(table, machine, frame)
    if not of_place:
        return table, []
    new, count, largest = _nominal(table, machine, frame, rotation, of_place)
    for joint in cross_slides(machine):
        halved = table.assign(**{joint.name: table[joint.name] / 2})
        if (more := _nominal(halved, machine, frame, rotation, of_place)[1]) > count:
            found = f"with half of it the touched places of {more} rows repeat, as it stands those of {count}"
            file = str(table["file"].iloc[of_place[0][0]])
            raise looks_like_diameters(joint.name, file, found, "If they are not, look for another mistake in it")
    if not count:
        return table, []
    note = (
        f"{count} rows have the place of what was touched as mx my mz and indicated positions of the axes as commands: "
        "their commands are taken as those of the machine without errors, and what the indicated positions are beside "
        f"these (up to {1e3 * largest:.3g} um) as what was measured. Tables of rows have both so"
    )
    return new, [note]


def touched_again(table: pd.DataFrame, chain: Chain, frame: Frame) -> Mask:
    """Rows (n,) of places that were given and read again: balls in many poses, those of a ball plate, a ring.

    Either most places are read at many commands; or a place is read at commands that differ by what scales read and a
    machine is off, far less than the next place is away (`_read_again`). Where an instrument had stopped, one of many
    places is read at many commands, and these differ by as much as those of other readings.
    """
    out = np.zeros(len(table), dtype=bool)
    joints = [j.name for j in chain.machine.joints]
    for places in _of_frames(table, joints, frame):
        at_many = (
            sum(map(len, places)) >= FEWEST * len(places) and np.median(_different(table, joints, places)) >= FEWEST
        )
        for rows in places if at_many else _read_again(table, chain, places):
            out[rows] = True
    return out


def note_read_again(table: pd.DataFrame, machine: Machine, frame: Frame) -> list[str]:
    """A note on the places that were read again at nearly the same position; none where there are none."""
    if not (every := [*_of_frames(table, [j.name for j in machine.joints], frame)]):
        return []
    from errormodel.chain import Chain

    chain = Chain(machine)
    found = [rows for places in every for rows in _read_again(table, chain, places)]
    if not found:
        return []
    return [
        f"{sum(map(len, found))} rows read {len(found)} places again: the same mx my mz to the last digit, at commands "
        "that are nearly the same. They are taken as places of what was probed, such as the balls of a calibrated "
        "plate, with indicated positions as commands, and as no copies"
    ]


def _read_again(table: pd.DataFrame, chain: Chain, places: list[Index]) -> list[Index]:
    """Rows of the places that were read again at nearly the same position, by the distances between nominal points.

    An instrument that had stopped reads the same in rows that follow each other: such rows are readings of a place only
    where most places are read so. Commands must differ, though at some of many places coarse scales read the same.
    """
    different = _different(table, [j.name for j in chain.machine.joints], places)
    if different.max() < 2:
        return []
    from scipy.spatial import KDTree

    rows, sizes = np.concatenate(places), np.array([len(own) for own in places])
    starts = np.cumsum(sizes) - sizes
    nominal = _points(chain, table.iloc[rows])
    first = nominal[starts]
    apart = np.maximum.reduceat(np.linalg.norm(nominal - np.repeat(first, sizes, axis=0), axis=1), starts)
    next_place = np.asarray(KDTree(first).query(first, k=2)[0])[:, 1]  # infinite of a single one
    near = (sizes > 1) & (apart < np.minimum(NEAR_MM, FAR_BELOW * next_place))
    if (near & (different > 1)).sum() < FEWEST:
        near &= different > 1  # else scales may read the same again as well
    if np.median(sizes) < 2:
        order = np.empty(len(table), dtype=np.intp)
        order[np.sort(rows)] = np.arange(len(rows))
        near &= [bool((np.diff(order[own]) > 1).all()) for own in places]  # left, and come back to each time
    return [own for own, so in zip(places, near, strict=True) if so]


def _different(table: pd.DataFrame, joints: list[str], places: list[Index]) -> Index:
    """Number of different commands at each place."""
    place = np.repeat(np.arange(len(places)), [len(rows) for rows in places])
    commands = table.iloc[np.concatenate(places)][joints].assign(place=place)
    return np.bincount(commands.drop_duplicates()["place"].to_numpy(), minlength=len(places))


def _repeated(table: pd.DataFrame, machine: Machine, frame: Frame) -> list[Index]:
    """Rows of each measured point that comes several times, at several positions of the linear joints."""
    linear = [j.name for j in machine.joints if j.type == "prismatic"]
    if len(linear) < 3:
        return []
    of_place = (
        rows
        for places in _of_frames(table, linear, frame)
        if sum(map(len, places)) >= FEWEST * len(places)  # else they are readings, of which some were repeated
        for rows in places
    )
    return [rows for rows in of_place if (table.iloc[rows][linear].nunique() > 1).any()]


def _of_frames(table: pd.DataFrame, joints: list[str], frame: Frame) -> Iterator[list[Index]]:
    """The rows of each measured point, by the measuring frames in which one comes several times."""
    frames = {"per-run": "run", "per-file": "file"}.get(frame)
    seen = np.flatnonzero(table[list(MEASURED)].notna().all(axis=1).to_numpy() & table[joints].notna().all(axis=1))
    labels = table[frames].to_numpy(dtype=object)[seen] if frames else np.full(len(seen), "", dtype=object)
    for label in dict.fromkeys(labels):
        own = seen[labels == label]
        if table.iloc[own].duplicated(subset=list(MEASURED)).any():
            yield [own[g] for g in table.iloc[own].groupby(list(MEASURED), sort=False).indices.values()]


def _nominal(
    table: pd.DataFrame, machine: Machine, frame: Frame, rotation: Vector | None, of_place: list[Index]
) -> tuple[pd.DataFrame, int, float]:
    """The table with nominal commands, the number of rows that have them, and how far (mm) the indicated ones lie."""
    from errormodel.chain import Chain

    linear = [j.name for j in machine.joints if j.type == "prismatic"]
    frames = {"per-run": "run", "per-file": "file"}.get(frame)
    chain, new, count, largest = Chain(machine), table.copy(), 0, 0.0
    nominal = np.full((len(table), 3), np.nan)
    touched, mistaken = dict[object, list[Index]](), set[object]()
    for rows in of_place:
        label = table[frames].iloc[rows[0]] if frames else ""
        nominal[rows] = _points(chain, table.iloc[rows])
        off = np.linalg.norm(nominal[rows] - np.median(nominal[rows], axis=0), axis=1)
        if np.median(off) <= NEAR_MM and off.max() > LEAST_MM:
            touched.setdefault(label, []).append(rows)
        elif np.median(off) > NEAR_MM and len(rows) >= FEWEST:
            mistaken.add(label)  # what is wrong with one place is wrong with all, though some lie where it is small
    for places in (own for label, own in touched.items() if label not in mistaken):
        middles = np.array([np.median(nominal[rows], axis=0) for rows in places])
        measured = table[list(MEASURED)].to_numpy(dtype=np.float64)
        turn = _turn(middles, measured[[rows[0] for rows in places]], rotation)
        if turn is None:
            continue
        for rows, middle in zip(places, middles, strict=True):
            part = table.iloc[rows].copy()
            slopes = np.stack([_points(chain, part.assign(**{j: part[j] + 1})) - nominal[rows] for j in linear], axis=2)
            if np.linalg.matrix_rank(slopes, tol=1e-6).min() < 3:
                continue
            moved = np.einsum("njk,nk->nj", np.linalg.pinv(slopes), nominal[rows] - middle)
            part[linear] = (part[linear].to_numpy() - moved).round(DIGITS)
            beside = (nominal[rows] - _points(chain, part)) @ turn.T
            new.loc[part.index, linear] = part[linear]
            new.loc[part.index, list(MEASURED)] = measured[rows] - beside
            count, largest = count + len(rows), max(largest, float(np.abs(beside).max()))
    return new, count, largest


def _points(chain: Chain, part: pd.DataFrame) -> Array:
    """Functional points (n, 3) of a machine without errors."""
    return np.asarray(chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(part))).T


def _turn(nominal: Array, measured: Array, stated: Vector | None) -> Array | None:
    """Rotation (3, 3) into the measuring frame that takes nominal places (k, 3) to measured ones; None: there is none.

    The stated one, or none; else, of three places and more, the one that fits them best.
    """
    from scipy.spatial.transform import Rotation

    a, b = nominal - nominal.mean(axis=0), measured - measured.mean(axis=0)
    turns = [np.eye(3) if stated is None else rotation_matrix(stated)]
    if np.linalg.matrix_rank(a, tol=NEAR_MM) > 1:
        turns.append(Rotation.align_vectors(b, a)[0].as_matrix())
    return next((t for t in turns if np.linalg.norm(a @ t.T - b, axis=1).max() <= NEAR_MM), None)
