"""Volume to be compensated: surveyed travels, sample poses over them, and the machine as axes of a controller.

Commands in mm and rad, points in mm in the axes of the reference frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, corners_of_cube
from errormodel.controllers.axes import axis_letters, directions_at_zero, origins_at_zero, wanted_axes
from errormodel.controllers.grids import nodes
from errormodel.controllers.probing import Gap
from errormodel.controllers.setup import FULL_TURN, Axis, Setup
from errormodel.controllers.tables import Table, Tables, Term
from errormodel.exceptions import InputError
from identification.compensation.field import Field
from identification.compensation.inverse import closing, inverse, steps_towards
from identification.compensation.sample import Sample, frame_motion
from identification.observation.pose import IDENTITY, Pose
from identification.uncertainty.measured_range import TURN, all_round

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

LEAST_MOVED_SHARE = 0.003  # of the travel: a joint that moved less counts as not surveyed; by judgement
MOST_VOLUME_CORNERS = 64  # corners of the volume in a sample: all those of six joints
MOST_TIMES = 16  # times of a warm-up that get tables of their own; by judgement
INTERPOLATION_SHARE = 0.005  # of the largest correction: permitted error of linear interpolation; by judgement
NODE_MM = 1e-4  # mm: nodes are reached to a tenth of it, a tenth of the last digit that is written
LENGTH_STEP = 100.0  # mm of tool length over which corrections are differenced: angles are small, so it is linear
TURN_SLACK = 1e-4  # rad by which a travel may differ from a full turn: that of degrees with two decimals
# numbers of intervals to try along a joint, in ascending order
INTERVAL_COUNTS = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128, 192, 256, 384, 512, 1024)


@dataclass(frozen=True)
class Volume:
    """Measured region of a machine: the travel of each joint that the survey covered.

    Attributes
    ----------
    low, high : (joints,) mm and rad; the commands of joints that did not move are `low` = `high`.
    free : whether the workpiece's frame is free (the survey's was), so that a small motion of it costs nothing.
    pose : given pose of the workpiece's frame, which is then no longer free. Thermal growth is no motion of the
        workpiece, so all states of a machine share one pose.
    turns : whether a free frame may rotate as well. Single-joint error motions have an unknown zero, but the
        directions of the machine's own axes.
    origin : state in which the reference point is taken to lie right, where `pose` says so (`counted_from`).
    every : whether that is so of every state, each in itself.
    held : ends (joints,) from which on a correction is that of the edge; None: `low` and `high`.
    """

    field: Field
    low: Array
    high: Array
    free: bool
    pose: Pose | None = None
    turns: bool = True
    origin: Mapping[str, float] | None = None
    every: bool = False
    held: tuple[Array, Array] | None = None

    @classmethod
    def of(cls, field: Field, table: pd.DataFrame, free: bool, turns: bool = True) -> Volume:
        """The hull of measured travels, within the machine's own.

        Raises
        ------
        InputError
            No joint moved.
        """
        q = table[[j.name for j in field.joints]].to_numpy(dtype=np.float64)
        travel = np.array([j.travel for j in field.joints])
        low, high = np.maximum(q.min(axis=0), travel[:, 0]), np.minimum(q.max(axis=0), travel[:, 1])
        still = high - low <= LEAST_MOVED_SHARE * (travel[:, 1] - travel[:, 0])
        if still.all():
            found = "no joint moved in the survey of this fit: there is nowhere to correct"
            raise InputError("residuals.csv", found, "Measure along the travels, as `errormodel plan` says")
        middle = np.median(q, axis=0)
        # a rotary axis that goes round: what the survey left out of its turn lies between what it saw
        goes = field.rotary & (np.abs(np.ptp(travel, axis=1) - TURN) < TURN_SLACK)
        round_ = np.array([bool(may) and all_round(positions) for may, positions in zip(goes, q.T, strict=True)])
        low, high = np.where(round_, travel[:, 0], low), np.where(round_, travel[:, 0] + TURN, high)
        return cls(field, np.where(still, middle, low), np.where(still, middle, high), free, turns=turns)

    def at(self, state: Mapping[str, float]) -> Volume:
        """The same volume with the machine in another state."""
        there = replace(self, field=self.field.at(state))
        return there.counted_from(state, every=True) if self.every else there

    def counted_from(self, origin: Mapping[str, float], every: bool = False) -> Volume:
        """The same volume, whose errors count from where the tip is in a state with all axes at the reference point.

        Tables then leave that place as it is. Readings of single joints do not show it: each has an unknown zero.
        """
        there = self._at_reference(self.field.at(origin))
        return replace(self, pose=Pose(np.eye(3), there), origin=origin, every=every)

    @property
    def reference_moved(self) -> float:
        """How far from its right place the tip is with all axes at the reference point, mm."""
        target = np.zeros(3) if self.pose is None else self.pose.translation
        return float(np.linalg.norm(self._at_reference(self.field) - target))

    @property
    def reference(self) -> str:
        """The reference point in words: axes that moved, at zero or the nearest to it, mm and deg."""
        place, moved = self.field.outward(self.clamp(np.zeros(len(self.low)))), self.high > self.low
        return " ".join(
            f"{j.name}={v + 0.0:g}" for j, v, m in zip(self.field.joints, np.round(place, 3), moved, strict=True) if m
        )

    def _at_reference(self, field: Field) -> Array:
        """Error (3,), mm, at the reference point, mean of both directions of approach."""
        q = np.tile(self.clamp(np.zeros(len(self.low))), (2, 1))
        return np.asarray(
            (field.actual(q, np.array([[1.0], [-1.0]]) * np.ones_like(q)) - field.nominal(q)).mean(axis=0)
        )

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """Whether each joint goes round: its region is a full turn, of which both ends are the same place."""
        return np.logical_and(self.field.rotary, np.abs(self.high - self.low - TURN) < TURN_SLACK)

    @cached_property
    def planned(self) -> Volume:
        """The same volume as corrections see it that know the direction of travel at most, and no path."""
        field = self.field.without_paths
        return self if field is self.field else replace(self, field=field)

    def clamp(self, q: Array) -> Array:
        """Nearest command inside the volume: commands outside are corrected as its boundary is."""
        return np.clip(q, self.low, self.high)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest commands (joints,) up to which the correction follows the model."""
        return self.held or (self.low, self.high)

    def poses(self, count: int, seed: int) -> tuple[Array, Array]:
        """Sobol points over the volume and directions of approach (+-1), both (count, joints)."""
        from scipy.stats import qmc

        n = len(self.low)
        unit = qmc.Sobol(2 * n, seed=seed).random_base2(int(np.ceil(np.log2(max(count, 2)))))[:count]
        return self.low + unit[:, :n] * (self.high - self.low), np.where(unit[:, n:] < 0.5, -1.0, 1.0)

    def corners(self) -> tuple[Array, Array]:
        """Corners of the volume, at most `MOST_VOLUME_CORNERS`, with directions of approach."""
        moving = np.flatnonzero(self.high > self.low)
        pick = corners_of_cube(len(moving), MOST_VOLUME_CORNERS)
        q = np.tile(self.low, (len(pick), 1))
        q[:, moving] = self.low[moving] + pick * (self.high - self.low)[moving]
        return q, np.where(np.arange(len(q))[:, None] % 2, np.ones_like(q), -np.ones_like(q))

    @cached_property
    def frame(self) -> Pose:
        """Motion of the workpiece's frame with the least mean square error, or the given pose."""
        if self.pose is not None:
            return self.pose
        q, came = self.poses(512, 7)
        nominal = self.field.nominal(q)
        return best_frame(self.field.actual(q, came) - nominal, nominal, self.turns) if self.free else IDENTITY

    def target(self, q: Array, tool: Array | None = None) -> Array:
        """Wanted points (n, 3) of commands."""
        return self.frame.apply(self.field.nominal(q, tool))

    def ideal(self, q: Array, direction: Array, tool: Array | None = None) -> Array:
        """Commands that reach the wanted points; beyond the `ends` the correction of the edge is used."""
        inside = np.clip(q, *self.ends)
        reached, _ = inverse(self.field, inside, direction, self.target(inside, tool), tool)
        return q + (reached - inside)

    def nodes(self, terms: Sequence[Term], setup: Setup) -> list[Array] | None:
        """Corrections at the nodes of a lattice over all axes, of each term's shape; None for any other structure."""
        return self._nodes(terms, setup, (0.0,))[0] if self._lattice(terms, setup) else None

    @staticmethod
    def _lattice(terms: Sequence[Term], setup: Setup) -> bool:
        """Whether all terms are on one lattice over all axes."""
        return not any(t.inputs != setup.moving or t.grids != terms[0].grids or t.direction or t.factor for t in terms)

    def _nodes(self, terms: Sequence[Term], setup: Setup, lengths: Sequence[float]) -> list[list[Array]]:
        """Corrections at the nodes for each of some lengths of the tool, mm beyond that of the machine's.

        One Jacobian serves all of them and both directions of approach.
        """
        mesh = nodes(terms[0].grids)
        q = np.tile(self.field.outward(self.low), (len(mesh), 1))
        q[:, [setup.place(i) for i in setup.moving]] = mesh
        inner, ahead = self.field.inward(q), np.ones_like(q)
        sides = (1, -1) if self.field.reversing else (1,)
        tips = [
            np.tile(np.asarray(setup.tool) + longer * np.asarray(setup.along_tool), (len(q), 1)) for longer in lengths
        ]
        close = closing(self.field.jacobian(inner, ahead, tips[0]))
        found = []
        for tip in tips:
            target = self.target(inner, tip)
            both = [inverse(self.field, inner, sign * ahead, target, tip, close, NODE_MM)[0] for sign in sides]
            found.append(self._at_nodes(terms, setup, inner, np.mean(both, axis=0)))
        return found

    def _at_nodes(self, terms: Sequence[Term], setup: Setup, inner: Array, reached: Array) -> list[Array]:
        """Corrections in the shapes of the terms, from commands (n, joints) and those that reach the points."""
        moved = self.field.outward(reached - inner)
        out = [moved[:, setup.place(t.output)].reshape(t.shape) for t in terms]
        for axis, name in enumerate(setup.moving):
            if setup.axis(name).turns:  # both ends are the same place
                for values in out:
                    ends = np.moveaxis(values, axis, 0)
                    ends[0] = ends[-1] = (ends[0] + ends[-1]) / 2
        return out

    def followed(self, terms: Sequence[Term], longer: Sequence[Term], setup: Setup) -> Tables:
        """Corrections at the nodes of a lattice over all axes that moved, and their change per mm of tool length.

        Raises
        ------
        ValueError
            The terms are no such lattice.
        """
        if not self._lattice(terms, setup):
            raise ValueError("terms that follow the length of the tool are on a lattice over all axes")
        usual, long = self._nodes(terms, setup, (0.0, LENGTH_STEP))
        slopes = [(v - u) / LENGTH_STEP for u, v in zip(usual, long, strict=True)]
        return tuple(Table(t, v) for t, v in zip((*terms, *longer), (*usual, *slopes), strict=True))

    def sample(self, setup: Setup, count: int, seed: int = 1) -> Sample:
        """Poses for the reduction: Sobol points and corners, each from both directions if the direction matters.

        Tables without a direction then fit the mean of both. With random directions such a table would fit the random
        draw, and nearly every pose would have nearly the largest error.
        """
        field = self.field
        parts = [self.poses(count, seed), self.corners()]
        q, came = np.vstack([p[0] for p in parts]), np.vstack([p[1] for p in parts])
        if field.reversing:
            q, came = np.vstack([q, q]), np.vstack([came, -came])
        nominal = field.nominal(q)
        motion = field.levers(q)[1][:, :, list(field.movers)]
        wanted = nominal if self.pose is None else self.pose.apply(nominal)
        frame = frame_motion(nominal, self.free and self.pose is None, self.turns)
        sides = 2 if field.reversing else 1
        return Sample(field.outward(q), came, field.actual(q, came) - wanted, motion, frame, sides)

    @cached_property
    def intervals(self) -> list[int]:
        """Number of linear intervals that represent the corrections along each joint."""
        starts, came = self.poses(6, 3)
        out = []
        steps = INTERVAL_COUNTS[-1]
        share = np.linspace(0.0, 1.0, steps + 1)
        largest = max(float(np.abs(self._correction(*self.poses(256, 5))).max()), 1e-9)
        for k in range(len(self.low)):
            if self.high[k] <= self.low[k]:
                out.append(1)
                continue
            q = np.repeat(starts, steps + 1, axis=0)
            q[:, k] = np.tile(self.low[k] + share * (self.high[k] - self.low[k]), len(starts))
            c = self._correction(q, np.repeat(came, steps + 1, axis=0)).reshape(len(starts), steps + 1, -1)
            out.append(next((n for n in INTERVAL_COUNTS if _interpolated(c, n) < INTERPOLATION_SHARE * largest), steps))
        return out

    def _correction(self, q: Array, came: Array) -> Array:
        """First-order corrections, scaled to mm at the tip for each mover."""
        jacobian = self.field.jacobian(q, came)
        step = steps_towards(self.field, jacobian, self.target(q) - self.field.actual(q, came))
        return np.asarray(step * np.linalg.norm(jacobian, axis=1), np.float64)

    def gap(self, setup: Setup) -> Gap:
        """Function that gives the height error (mm) of a probe relative to the nozzle at positions on the bed."""
        field, machine = self.field, self.field.chain.machine
        offset = dict(zip("XY", setup.probe or (0.0, 0.0), strict=True))
        up = np.asarray(setup.axis("Z").along)
        beside = np.sum([v * np.asarray(setup.axis(a).along) for a, v in offset.items()], axis=0)
        turn = field.chain.frames({})[-1][:3, :3]

        def height(q: Array, tool: Array) -> Array:
            inner, tools = field.inward(q), np.tile(tool, (len(q), 1))
            return np.asarray((field.actual(inner, np.ones_like(inner), tools) - field.nominal(inner, tools)) @ up)

        def gap(q: Array) -> Array:
            carriage = q.copy()
            for axis, value in offset.items():
                carriage[:, setup.place(axis)] -= value
            nozzle = np.asarray(machine.tool)
            return height(carriage, nozzle + turn.T @ beside) - height(q, nozzle)

        return gap

    def _measured(self, k: int) -> tuple[float, float]:
        """Ends of the region of a joint, mm or deg; of one that goes round exactly a turn."""
        unit = 180 / np.pi if self.field.rotary[k] else 1.0
        low, high = float(self.low[k] * unit), float(self.high[k] * unit)
        return (round(low, 4), round(low, 4) + FULL_TURN) if self.turning[k] else (low, high)

    def setup(
        self, points: int | None, resolution: float | None, axes: str | None = None
    ) -> tuple[Setup, tuple[str, ...]]:
        """The machine in terms of the controller's axes, and notes on axes that have other names there.

        Parameters
        ----------
        points : points per axis; None: as many as the errors need.
        resolution : least increment of the controller, mm; None: the usual one.
        axes : letters and numbers given by the user (``X=1,Y=2``, see :mod:`errormodel.controllers.axes`).
        """
        field, machine = self.field, self.field.chain.machine
        along, centre = directions_at_zero(machine, field.chain), origins_at_zero(machine, field.chain)
        said = {} if axes is None else wanted_axes(axes, [j.name for j in machine.joints])
        letters, unsure = axis_letters(machine.joints, along, said)
        given = ((letter, said.get(j.name)) for letter, j in zip(letters, machine.joints, strict=True))
        numbers = {letter: one.number for letter, one in given if one and one.number is not None}
        travel = np.array([j.travel for j in machine.joints])
        unit = np.where(field.rotary, 180 / np.pi, 1.0)
        known = tuple(
            Axis(
                letters[k], j.name, j.type == "rotary",
                (float(travel[k, 0] * unit[k]), float(travel[k, 1] * unit[k])),
                self._measured(k),
                (float(along[k][0]), float(along[k][1]), float(along[k][2])),
                self.intervals[k],
                (float(centre[k][0]), float(centre[k][1]), float(centre[k][2])),
            )
            for k, j in enumerate(machine.joints)
        )  # fmt: skip
        notes = tuple(
            f"joint {a.joint} is taken as axis {a.name} of the controller" for a in known if a.name != a.joint
        )
        reversing = frozenset(a.name for a in known if a.joint in field.reversing)
        setup = Setup(
            machine.name, known, tuple(known[k].name for k in field.movers), reversing, machine.tool,
            resolution, points, lambda q: field.levers(field.inward(q)),
            numbers=numbers, unsure=unsure,
        )  # fmt: skip
        return setup, notes


def _interpolated(values: Array, intervals: int) -> float:
    """Largest error of linear interpolation of curves (lines, steps + 1, k)."""
    size = values.shape[1]
    x = np.arange(size) / (size - 1)
    nodes = np.linspace(0, 1, intervals + 1)
    at = np.rint(nodes * (size - 1)).astype(int)
    k = np.clip(np.searchsorted(x[at], x, side="right") - 1, 0, intervals - 1)
    share = (x - x[at][k]) / (x[at][k + 1] - x[at][k])
    pieces = values[:, at[k]] * (1 - share)[:, None] + values[:, at[k + 1]] * share[:, None]
    return float(np.abs(values - pieces).max())


def best_frame(errors: Array, points: Array, turns: bool = True) -> Pose:
    """Small rigid motion, or shift without `turns`, that fits errors (n, 3) at points (n, 3), mm, by least squares."""
    from scipy.spatial.transform import Rotation

    if not turns:
        return Pose(np.eye(3), errors.mean(axis=0))
    middle = points.mean(axis=0)
    small = np.linalg.lstsq(frame_motion(points, True).reshape(-1, 6), errors.ravel(), rcond=1e-9)[0]
    turn = Rotation.from_rotvec(small[3:]).as_matrix()
    return Pose(turn, middle + small[:3] - turn @ middle)


def levels(table: pd.DataFrame, channels: list[str]) -> list[dict[str, float]]:
    """States of the machine that get tables of their own, each a mapping of channels to values.

    Cold, middle and warm rows where temperatures varied; each time of a warm-up measured at a few times; otherwise one
    empty state.
    """
    warmth = [c for c in dict.fromkeys(channels) if c.startswith("T_") and c in table]
    known = [c for c in warmth if np.ptp(table[c].dropna().to_numpy(dtype=np.float64)) > 1.0]
    if not known:
        times = np.unique(table["time"].dropna()) if "time" in channels and "time" in table else np.zeros(0)
        return [{"time": float(t)} for t in times] if 1 < len(times) <= MOST_TIMES else [{}]
    full = table[known].dropna()
    order = full.mean(axis=1).sort_values(kind="stable").index
    picked = [order[round(share * (len(order) - 1))] for share in (0.05, 0.5, 0.95)]
    return [{str(c): float(full.loc[i, c]) for c in known} for i in picked]


State = Mapping[str, float]
