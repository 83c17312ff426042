"""Views of single readings (lengths, angles): rows of M contracted along the gradient of the reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from errormodel.arrays import Array, Rows, as_rows
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.kernel import Kernel
from errormodel.observation_kernel import kernels_of
from errormodel.observations.base import Observation
from errormodel.survey import Survey
from errormodel.surveys.observations import Group, groups
from identification.observation.frames import align
from identification.observation.models import View, anywhere_in_travels
from identification.observation.pose import IDENTITY, Pose

LEAST_STATIONS = 3  # known places of which distances determine a rigid motion


@dataclass(frozen=True, kw_only=True)
class ReadingView(View):
    """Readings of one observation whose unknowns (a station, a dead path, a zero) all rows share.

    Attributes
    ----------
    label : name of the observation; `observation`: its model.
    measured : (n,) mm or rad.
    quantities : (k,) numbers of the set-up in the model's order: known, or where the estimation of unknowns starts.
    free : names of the unknown ones, whose columns follow those of `ids`; unknowns are relative to where they start.
    in_frame : whether a point is known in a measuring frame whose pose is unknown: the first columns are that frame's.
    """

    label: str
    observation: Observation
    measured: Array
    quantities: Array
    free: tuple[str, ...] = ()
    in_frame: bool = False
    of_tool: ClassVar[bool] = True

    @property
    def exact_columns(self) -> int:
        return len(self.columns)

    @property
    def starts(self) -> dict[str, float]:
        """Where the estimation of each unknown starts, by the name of its column."""
        names = [q.name for q in self.observation.quantities()]
        columns = self.columns[len(self.ids) :]
        return {c: float(self.quantities[names.index(n)]) for c, n in zip(columns, self.free, strict=True)}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each unknown, by the name of its column."""
        units = {q.name: q.unit for q in self.observation.quantities()}
        return {c: units[n] for c, n in zip(self.columns[len(self.ids) :], self.free, strict=True)}

    def placed(self, pose: Pose) -> Self:
        """The view with its known point in a measuring frame of another pose."""
        own, names = self.quantities.copy(), [q.name for q in self.observation.quantities()]
        at = {q.name: q.value for q in self.observation.quantities()}
        where = [names.index(n) for n in self.observation.point]
        own[where] = pose.invert(np.array([[at[n] for n in self.observation.point]]))[0]
        return replace(self, quantities=own)

    def started(self, starts: Mapping[str, float]) -> Self:
        """The view with the estimation of its unknowns starting elsewhere, by the names of their columns."""
        own, names = self.quantities.copy(), [q.name for q in self.observation.quantities()]
        for name, column in zip(self.free, self.columns[len(self.ids) :], strict=True):
            own[names.index(name)] = starts[column]
        return replace(self, quantities=own)

    def part(self, rows: Rows) -> Self:
        return replace(super().part(rows), measured=self.measured[rows])

    def vector(self, unknowns: Mapping[str, int], values: Array, held: Array) -> Array:
        own = self.quantities.copy()
        names = [q.name for q in self.observation.quantities()]
        for name, column in zip(self.free, self.columns[len(self.ids) :], strict=True):
            if column in unknowns:
                own[names.index(name)] += values[unknowns[column]]
        return np.concatenate([super().vector(unknowns, values, held), own])

    def design(self, linearised: bool) -> Kernel:
        kernels = kernels_of(self.chain, self.observation)
        return kernels.kernel("linearised" if linearised else "design", self.ids, self.free)

    def gaps(self, p: Array) -> Iterator[tuple[slice, Array]]:
        kernel = kernels_of(self.chain, self.observation).kernel("value")
        for part, functions in kernel.blocks(self.rows, p):
            yield part, self.measured[None, part] - kernel.expand(functions)

    def beside_nominal(self) -> Array:
        """Readings less those of a machine without errors, from where the set-up's estimation starts, (n,); mm, rad."""
        return np.concatenate([gap[0] for _, gap in self.gaps(self.at_zero)])

    def levers(self) -> Array:
        """Change (6 * elements, 1, n) of the reading by each motion of each element at the last pose; mm, rad.

        With two poses, the rows behind are those of the motions at the first one.
        """
        kernel = kernels_of(self.chain, self.observation).kernel("levers")
        out = kernel(self.rows, self.at_zero)
        half = len(out) // self.observation.poses
        return np.vstack([out[-half:], out[:-half]])[:, None, :]

    def scattered(self, rng: np.random.Generator, poses: int) -> Self:
        """Random poses over the full travels, unless the set-up binds them to a circle, a line or a face."""
        more = self.part(np.arange(poses) % len(self))
        if not self.observation.anywhere:
            return more
        each = len(self.chain.channels)
        rows = list(more.rows)
        for first in range(0, each * self.observation.poses, each):
            rows[first : first + each] = anywhere_in_travels(self.chain, rows[first : first + each], rng)
        return replace(more, rows=as_rows(*rows))

    def norms(self) -> Array:
        """As of a position, or of an orientation, and of unknowns by their unit."""
        each, size = len(self.chain.channels), self.chain.size
        terms = self.chain.kernel("terms", self.ids)(self.rows[-each:], np.zeros(len(self.chain.ids)))
        motions = terms.reshape(-1, 6, len(self))[: len(self.ids)]
        shift, turn = (np.sqrt(np.square(m).sum(axis=1).mean(axis=1)) for m in (motions[:, :3], motions[:, 3:]))
        own = turn if self.turns else shift + size * turn
        # a length changes by as much as a shift, and by a lever's length of a turn; an angle by as much as a turn
        reach = {"mm": 1 / size, "rad": 1.0, "1": 1.0} if self.turns else {"mm": 1.0, "rad": size, "1": size}
        return np.append(own, [reach[unit] for unit in self.units.values()])


def reading_views(
    chain: Chain, survey: Survey, poses: Mapping[str, Pose], labels: Array, columns: Mapping[str, tuple[str, ...]]
) -> list[ReadingView]:
    """Views of the rows with single readings.

    Parameters
    ----------
    poses : measuring frames by label, as aligned; empty where the frame is the machine's own.
    labels : (rows,) label of each row's frame.
    columns : names of the six unknowns of each of these frames.

    Raises
    ------
    InputError
        Readings do not determine where an unknown starts, or some of a kind have a standard uncertainty only.
    """
    out: list[ReadingView] = []
    shared: dict[str, dict[str, float]] = {}  # where unknowns of all rows of an observation start, by its name
    for group in sorted(groups(survey.table, survey.observations), key=lambda g: -len(g.index)):
        in_frame = known_in_frame(group.observation) and bool(poses)
        for label in dict.fromkeys(labels[group.index]) if in_frame else [""]:
            own = labels[group.index] == label if in_frame else np.ones(len(group.index), dtype=bool)
            part = replace(
                group, index=group.index[own], readings=group.readings[own],
                sigma=None if group.sigma is None else group.sigma[own],
            )  # fmt: skip
            out.append(_view(chain, survey, part, poses[label] if in_frame else IDENTITY,
                             columns[label] if in_frame else chain.frame_ids, in_frame,
                             shared.setdefault(group.label, {})))  # fmt: skip
    _check_declared(survey, out)
    return sorted(out, key=lambda v: int(v.index[0]))


def placed_by_stations(chain: Chain, survey: Survey, known: Mapping[str, Pose], labels: Array) -> dict[str, Pose]:
    """Measuring frames that no position determines, from known stations and where lengths put these.

    Parameters
    ----------
    known : frames that positions determine, by label; `labels`: (rows,) label of each row's frame.

    Raises
    ------
    InputError
        Too few known stations to determine a frame.
    """
    places: dict[str, list[tuple[Array, Array]]] = {}
    nominal = chain.kernel("nominal", (), {}, (0, 1, 2))
    for group in groups(survey.table, survey.observations):
        every = group.observation.quantities()
        if not known_in_frame(group.observation):
            continue
        values = {q.name: q.value for q in every if q.value is not None}
        rest = {n: v for n, v in values.items() if n not in group.observation.point}
        for label in dict.fromkeys(labels[group.index]):
            own = labels[group.index] == label
            if label in known:
                continue
            rows = replace(group, index=group.index[own]).channels(chain, survey.table)
            found = places.setdefault(label, [])
            try:
                start = group.observation.start([nominal(rows).T], group.readings[own], rest)
            except ValueError as error:
                raise _no_frame(survey, label, str(error).partition(". ")[0]) from error
            at = [np.array([d[n] for n in group.observation.point]) for d in (start, values)]
            found.append((at[0], at[1]))
    out = {}
    for label, pairs in places.items():
        if len(pairs) < LEAST_STATIONS:
            raise _no_frame(survey, label, f"{len(pairs)} known station{'s' if len(pairs) > 1 else ''}")
        pose = align(np.array([at for at, _ in pairs]), np.array([stands for _, stands in pairs]))
        if len(pose.undetermined):
            raise _no_frame(survey, label, "known stations on one line")
        out[label] = pose
    return out


def _no_frame(survey: Survey, label: str, found: str) -> InputError:
    where = f"{survey.source}, measuring frame{f' of {label}' if label else ''}"
    cure = (
        "Write station: unknown, or frame: fixed where stations are given in the machine's own axes, or measure "
        f"mx my mz in some rows, or lengths from {LEAST_STATIONS} known stations that are not on a line"
    )
    return InputError(where, f"{found}: that does not determine the frame in which they are known", cure)


def known_in_frame(observation: Observation) -> bool:
    """Whether an observation has a known point, which is given in the measuring frame."""
    known = {q.name for q in observation.quantities() if q.value is not None}
    return bool(observation.point) and known >= {*observation.point}


def _view(
    chain: Chain,
    survey: Survey,
    group: Group,
    pose: Pose,
    frame: Sequence[str],
    in_frame: bool,
    shared: dict[str, float],
) -> ReadingView:
    """View of a group; `shared` has the starts of unknowns that other groups of the observation share with it."""
    observation = group.observation
    rows = group.channels(chain, survey.table)
    every = observation.quantities()
    known = {q.name: q.value for q in every if q.value is not None}
    if in_frame:
        at = pose.invert(np.array([[known[n] for n in observation.point]]))[0]
        known |= dict(zip(observation.point, at.tolist(), strict=True))
    each = len(chain.channels)
    nominal = chain.kernel("nominal", (), {}, (0, 1, 2))
    points = [nominal(rows[k : k + each]).T for k in range(0, len(rows), each)]
    free = tuple(q.name for q in observation.free)
    try:
        start = dict.fromkeys(free, 0.0) | shared
        if {*free} - {*shared}:
            start |= observation.start(points, group.readings, {**known, **shared})
    except ValueError as error:
        first = survey.table.iloc[group.index[0]]
        found, _, cure = str(error).partition(". ")
        raise InputError(f"{first['file']}, observation {group.label}", found, cure) from error
    shared |= {n: start[n] for n in free if not group.own(n)}
    rest = (*chain.machine_ids, *(i for i in chain.tool_ids if i not in chain.machine_ids))
    ids = (*chain.frame_ids, *rest) if in_frame else rest
    columns = (*frame, *rest) if in_frame else rest
    return ReadingView(
        kind=observation.type,
        chain=chain,
        ids=ids,
        columns=(*columns, *(group.unknown(n) for n in free)),
        rows=rows,
        whitener=np.ones(len(group.index)) if group.sigma is None else 1 / group.sigma,
        index=group.index,
        outputs=(3,) if observation.reading == "angle" else (0,),
        label=group.label,
        observation=observation,
        measured=group.readings,
        quantities=np.array([(known | start)[q.name] for q in every]),
        free=free,
        in_frame=in_frame,
    )


def stated(survey: Survey, views: Sequence[ReadingView]) -> frozenset[str]:
    """Kinds of readings whose uncertainty the survey states."""
    return frozenset(v.kind for v in views if _is_stated(survey, v))


def _is_stated(survey: Survey, view: ReadingView) -> bool:
    name = f"u_{view.observation.reading}"
    own = name in survey.table and bool(survey.table[name].iloc[view.index].notna().any())
    return view.observation.sigma is not None or own


def _check_declared(survey: Survey, views: Sequence[ReadingView]) -> None:
    """Raise InputError where only some observations of a type have a standard uncertainty."""
    for view in views:
        alike = [v for v in views if v.kind == view.kind]
        bare = [v.label for v in alike if not _is_stated(survey, v)]
        if bare and len(bare) < len(alike):
            found = f"'{bare[0]}' ({view.kind}) without a standard uncertainty, beside others with one"
            cure = "Give sigma: [a, b] in every observation of that type, or in none"
            raise InputError(str(survey.source), found, cure)
