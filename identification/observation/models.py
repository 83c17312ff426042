"""Observation models of survey rows: one view per kind of observation and measuring frame.

A view streams, block by block, the distinct functions of its design matrix M and the gap between the measured value and
the prediction of the exact kinematics. M itself is never stored. Gaps and design are in the axes of the machine's
reference, mm and rad; the whitener of a view scales them to one standard uncertainty.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from errormodel.arrays import Array, Index, Mask, Rows, as_rows
from errormodel.chain import TOOL_CHANNELS, Chain, What
from errormodel.channels import root
from errormodel.kernel import KERNEL_BLOCK_ROWS, Kernel
from errormodel.turned_design import turned_kernel
from identification.observation.pose import IDENTITY, Pose
from identification.observation.stored_design import MANY, StoredDesign

# Kind of observation: position, orientation, displacement, angle, or the type of an entry of observations:. Each has a
# noise level of its own, where none is declared
Kind = str


@dataclass(frozen=True, kw_only=True)
class View(ABC):
    """Rows with the same observation model.

    Attributes
    ----------
    kind : kind of observation; rows of a kind share a noise level where no uncertainty is declared.
    chain, ids : the chain and its parameters that this view depends on.
    columns : for each of `ids`, the name of the unknown (a frame's parameters carry the frame's label).
    rows : the chain's channels, each (n,), mm and rad.
    whitener : (n,) 1/sigma, or (n, 3, 3) ``L`` with ``L'L`` the inverse covariance in the measuring frame;
        0 for components that were not measured.
    index : (n,) row numbers in the survey.
    fixed : channels that are constant over all rows: folded into the kernels, which saves time.
    outputs : observed components: 0 to 2 translation, 3 to 5 rotation about x, y, z.
    what : kernel of the chain that gives the design.
    of_tool : whether rows depend on the pose of the tool, and so on all elements; else on one joint alone.
    constant_design : whether M at zero errors follows from the rows alone, and from no number of a set-up.
    stored : M at zero errors of the rows that it names, where it is kept.
    """

    of_tool: ClassVar[bool] = True
    constant_design: ClassVar[bool] = False

    kind: Kind
    chain: Chain
    ids: tuple[str, ...]
    columns: tuple[str, ...]
    rows: list[Array]
    whitener: Array
    index: Index

    fixed: Mapping[str, float] = field(default_factory=dict)
    outputs: tuple[int, ...] = (0, 1, 2)
    what: What = "design"
    stored: StoredDesign | None = None

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def weight(self) -> float | None:
        """The weight of all rows, where it is one: 1/sigma."""
        own = self.whitener
        return float(own[0]) if own.ndim == 1 and len(own) and bool((own == own[0]).all()) else None

    @property
    def count(self) -> int:
        """Number of scalar observations."""
        if self.whitener.ndim > 1:
            return int(self.components.sum())
        rows = int((self.whitener > 0).sum()) if self.weight is None else len(self) * (self.weight > 0)
        return rows * len(self.outputs)

    @property
    def components(self) -> Mask:
        """Mask of measured components, (n, outputs); all True for a view with one weight per row."""
        if self.whitener.ndim == 1:
            return np.ones((len(self), len(self.outputs)), dtype=bool)
        return np.asarray(np.abs(self.whitener).sum(axis=2) > 0)

    @property
    def turns(self) -> bool:
        """Whether its values are angles, rad, and not lengths, mm."""
        return self.outputs[0] >= 3

    @property
    def exact_columns(self) -> int:
        """Number of leading columns that `gaps` takes at their values; the rest are offsets of the values."""
        return len(self.ids)

    def vector(self, unknowns: Mapping[str, int], values: Array, held: Array) -> Array:
        """Scalars of the view's kernels: held values, replaced by `values` where a column is unknown."""
        p = held.copy()
        for identity, column in zip(self.ids, self.columns, strict=False):  # a motion view's zeros are not the chain's
            if column in unknowns:
                p[self.chain.index[identity]] = values[unknowns[column]]
        return p

    @property
    def at_zero(self) -> Array:
        """Scalars of the view's kernels on a machine without errors."""
        return self.vector({}, np.zeros(0), np.zeros(len(self.chain.ids)))

    def scattered(self, rng: np.random.Generator, poses: int) -> Self:
        """The view with random poses over the full travels, as many as are asked for."""
        more = self.part(np.arange(poses) % len(self))
        return replace(more, rows=as_rows(*anywhere_in_travels(self.chain, more.rows, rng)))

    def norms(self) -> Array:
        """Norms (columns,) of the columns of M over its poses, mm or rad: root sum of the components' mean squares."""
        n = len(self)
        terms = self.chain.kernel("terms", self.ids, self.fixed)(self.rows, np.zeros(len(self.chain.ids)))
        motions = terms.reshape(-1, 6, n)[: len(self.columns)]
        shift, turn = (np.sqrt(np.square(m).sum(axis=1).mean(axis=1)) for m in (motions[:, :3], motions[:, 3:]))
        return np.asarray(turn if self.turns else shift + self.chain.size * turn)

    def part(self, rows: Rows) -> Self:
        """The view with a subset of its rows."""
        parts = [c[rows] for c in self.rows]
        own = parts if isinstance(rows, slice) else as_rows(*parts)
        stored = None if self.known_design is None else self.known_design.part(rows, own)
        return replace(self, rows=own, whitener=self.whitener[rows], index=self.index[rows], stored=stored)

    def storing_design(self, beside: Sequence[View] = ()) -> Self:
        """The view with its M at zero errors stored, where that has many columns and few entries that are not zero.

        Parameters
        ----------
        beside : views of which one may have stored it already.
        """
        if not self.constant_design or len(self.columns) < MANY or self.known_design is not None:
            return self
        own = self.chain, self.ids, self.rows
        known = (stored.of_view(*own) for view in beside if (stored := view.known_design) is not None)
        made = next((stored for stored in known if stored is not None), None)
        return replace(self, stored=made or StoredDesign.of(*own, self.fixed))

    @property
    def known_design(self) -> StoredDesign | None:
        """M at zero errors of these rows, where it is kept."""
        return self.stored if self.stored is not None and self.stored.rows is self.rows else None

    def design(self, linearised: bool) -> Kernel:
        """Kernel of M (outputs x ids, column by column) at zero errors, or at given parameters if `linearised`."""
        what = "linearised" if linearised and self.what == "design" else self.what
        return self.chain.kernel(what, self.ids, self.fixed, self.outputs)

    @property
    def any_axes(self) -> bool:
        """Whether sums over the rows are the same in any axes: positions with one weight a row."""
        return self.whitener.ndim == 1 and self.what == "design" and self.outputs == (0, 1, 2)

    def in_other_axes(self, p: Array) -> tuple[Kernel, Callable[[slice], list[Array]]]:
        """Kernel of M at zero errors and of the gap at `p` in the axes of `errormodel.turned_design`, and its rows."""
        raise NotImplementedError

    def pose_at(self, p: Array, outputs: tuple[int, ...]) -> Iterator[tuple[slice, Array]]:
        """Outputs of the exact pose at the chain's parameters `p`, (len(outputs), m) per block."""
        stored = self.known_design
        if stored is not None and p.any() and (found := stored.pose(p, outputs)) is not None:
            return found
        kernel = self.chain.kernel("actual" if p.any() else "nominal", (), self.fixed, outputs)
        return ((part, kernel.expand(functions)) for part, functions in kernel.blocks(self.rows, p))

    @property
    def commanded(self) -> Array:
        """Orientations (n, 3, 3) of the last frame in the reference's axes, without errors."""
        parts = self.pose_at(np.zeros(len(self.chain.ids)), tuple(range(3, 12)))
        return np.concatenate([turned.reshape(3, 3, -1).transpose(2, 1, 0) for _, turned in parts])

    @abstractmethod
    def gaps(self, p: Array) -> Iterator[tuple[slice, Array]]:
        """Measured minus predicted at the chain's parameters `p`, mm or rad: (len(outputs), m) per block."""

    def whiten(self, part: slice, vectors: Array) -> Array:
        """Scale vectors (..., outputs, m) in the axes of the reference to units of one sigma."""
        return vectors * self.whitener[part]


def anywhere(view: View, poses: int) -> View:
    """The view with random poses over the full travels, and the tools, components and other channels of its rows."""
    return view.scattered(np.random.default_rng(0), poses)


def anywhere_in_travels(chain: Chain, rows: Sequence[Array], rng: np.random.Generator) -> list[Array]:
    """The chain's channels with joints at random in their travels, and what has a play as far behind as in the rows."""
    names = chain.channels
    joints = [rng.uniform(*j.travel, len(rows[0])) for j in chain.machine.joints]
    moved = [*joints, *rows[len(joints) :]]
    for k, name in enumerate(names):
        if name.startswith("play("):
            joint = names.index(root(name))
            moved[k] = joints[joint] + rows[k] - rows[joint]
    return moved


def fixed_tool(chain: Chain, rows: Sequence[Array]) -> dict[str, float]:
    """Tool components that are constant over all rows of the chain's channels."""
    start = chain.channels.index(TOOL_CHANNELS[0])
    columns = rows[start : start + 3]
    return {n: float(c[0]) for n, c in zip(TOOL_CHANNELS, columns, strict=True) if len(c) and (c == c[0]).all()}


@dataclass(frozen=True, kw_only=True)
class PositionView(View):
    """Positions of the functional point in a measuring frame of known pose; small frame parameters follow the pose."""

    constant_design: ClassVar[bool] = True

    measured: Array  # (n, 3) mm in the measuring frame, 0 where not measured
    pose: Pose = IDENTITY

    def in_other_axes(self, p: Array) -> tuple[Kernel, Callable[[slice], list[Array]]]:
        kernel = turned_kernel(self.chain, "actual" if p.any() else "nominal", self.ids, self.fixed)
        return kernel, lambda span: [*(c[span] for c in self.rows), *self.pose.invert(self.measured[span]).T]

    def part(self, rows: Rows) -> Self:
        return replace(super().part(rows), measured=self.measured[rows])

    def gaps(self, p: Array) -> Iterator[tuple[slice, Array]]:
        for part, here in self.pose_at(p, self.outputs):
            yield part, self.pose.invert(self.measured[part]).T - here

    def levers(self) -> Array:
        """Displacement (6 * elements, 3, n) by each motion of each element at zero errors, mm."""
        arms = self.chain.kernel("levers", (), self.fixed, self.outputs)(self.rows, np.zeros(len(self.chain.ids)))
        return arms.reshape(-1, 3, len(self))

    def whiten(self, part: slice, vectors: Array) -> Array:
        if self.whitener.ndim == 1:
            return vectors * self.whitener[part]
        turned = self.whitener[part] @ self.pose.rotation
        white: Array = np.einsum("mij,...jm->...im", turned, vectors, optimize=True)
        return white


@dataclass(frozen=True, kw_only=True)
class GapView(View):
    """Stored gaps of another view at fixed parameters, for linear models.

    `identification.observation.normal_equations.accumulate` overwrites them with the residual at its last values.
    """

    gap: Array  # (outputs, n) measured minus predicted, in the axes of the reference

    def in_other_axes(self, p: Array) -> tuple[Kernel, Callable[[slice], list[Array]]]:
        kernel = turned_kernel(self.chain, "given", self.ids, self.fixed)
        return kernel, lambda span: [c[span] for c in (*self.rows, *self.gap)]

    def part(self, rows: Rows) -> Self:
        return replace(super().part(rows), gap=self.gap[:, rows])

    def gaps(self, p: Array) -> Iterator[tuple[slice, Array]]:
        for start in range(0, len(self), KERNEL_BLOCK_ROWS):
            part = slice(start, min(start + KERNEL_BLOCK_ROWS, len(self)))
            yield part, self.gap[:, part]

    @classmethod
    def of(cls, view: View, p: Array) -> GapView:
        """Store the gaps of a view at the chain's parameters `p`."""
        gap = np.empty((len(view.outputs), len(view)))
        for part, block in view.gaps(p):
            gap[:, part] = block
        return cls(
            kind=view.kind, chain=view.chain, ids=view.ids, columns=view.columns, rows=view.rows,
            whitener=view.whitener, index=view.index, fixed=view.fixed, outputs=view.outputs, what=view.what, gap=gap,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class OrientationView(View):
    """Orientations of a 6-D target: `mount` (3, 3) is the target in the last frame, `turned` (n, 3, 3) as measured."""

    constant_design: ClassVar[bool] = True

    turned: Array
    pose: Pose = IDENTITY
    mount: Array = field(default_factory=lambda: np.eye(3))
    kind: Kind = "orientation"
    outputs: tuple[int, ...] = (3, 4, 5)

    def part(self, rows: Rows) -> Self:
        return replace(super().part(rows), turned=self.turned[rows])

    def gaps(self, p: Array) -> Iterator[tuple[slice, Array]]:
        from scipy.spatial.transform import Rotation

        for part, turned in self.pose_at(p, tuple(range(3, 12))):
            here = turned.reshape(3, 3, -1).transpose(2, 1, 0)
            seen = self.pose.rotation.T @ self.turned[part] @ self.mount.T
            yield part, Rotation.from_matrix(seen @ here.transpose(0, 2, 1)).as_rotvec().T

    def levers(self) -> Array:
        """Rotation (6 * elements, 3, n) by each motion of each element at zero errors, rad."""
        arms = self.chain.kernel("levers", (), self.fixed, self.outputs)(self.rows, np.zeros(len(self.chain.ids)))
        return arms.reshape(-1, 3, len(self))


@dataclass(frozen=True, kw_only=True)
class MotionView(View):
    """Readings of one error motion of one joint, relative to the zero of the instrument.

    The last six columns are the instrument's zeros; only that of this motion (``outputs[0]``) has an effect.
    """

    of_tool: ClassVar[bool] = False

    measured: Array  # (n,) mm or rad
    what: What = "terms"

    def part(self, rows: Rows) -> Self:
        return replace(super().part(rows), measured=self.measured[rows])

    def gaps(self, p: Array) -> Iterator[tuple[slice, Array]]:
        kernel = self.design(linearised=False)
        values = np.concatenate([[p[self.chain.index[i]] for i in self.ids], np.zeros(6)])
        for part, functions in kernel.blocks(self.rows, p):
            yield part, self.measured[None, part] - values @ kernel.expand(functions)
