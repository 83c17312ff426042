"""Geometric errors of a fitted machine as a function of the commands, without instrument, frame and target.

Commands in mm and rad (controllers: mm and deg), points in mm in the axes of the machine's reference frame.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np

from errormodel.approach import direction
from errormodel.arrays import Array, as_rows
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.channels import AHEAD_CHANNEL, DERIVED_CHANNEL, channel, plays_among, root
from errormodel.controllers.axes import directions_at_zero
from errormodel.exceptions import InputError
from errormodel.kernel import Kernel
from errormodel.machine import Joint
from errormodel.machine_rests import RESUMED_CHANNEL
from identification.compensation.by_position import Mean, means_of
from identification.compensation.rows import CONDITIONS, taken_up
from identification.results.stored_fit import StoredFit

if TYPE_CHECKING:
    import pandas as pd

LEAST_NEW_DIRECTION = 0.3  # share of a unit axis outside the span of the chosen ones: enough to add a direction

# of a hysteresis, rms in the survey's rows, that the direction of travel may leave where tables follow it; by judgement
BY_DIRECTION = 0.6


@dataclass(frozen=True)
class Field:
    """Exact positions and their derivatives at commands q (n, joints) in mm and rad.

    Attributes
    ----------
    chain, values : the kinematic chain, and its parameters without those of frame, tool and instrument.
    movers : columns of the joints that carry out corrections.
    state : value of every channel that is neither joint, tool nor direction (temperatures, feed, time).
    means : channels whose mean by the position of a joint is taken in place of that.
    description : (joints, 6) small displacements (mm, rad, in the joints' frames) of rotary axes of the nominal
        machine, which a controller's kinematic description holds; empty: none.
    short : joints with a play whose strokes in the survey did not take it up, mostly.
    knows_paths : whether it is known what of a play a path has taken up; if not, it is all by the direction of travel,
        or where strokes are short none.
    """

    chain: Chain
    values: Array
    movers: tuple[int, ...]
    state: Mapping[str, float] = field(default_factory=dict)
    description: tuple[tuple[float, ...], ...] = ()
    short: frozenset[str] = frozenset()
    knows_paths: bool = True
    means: Mapping[str, Mean] = field(default_factory=dict)

    @classmethod
    def of(cls, fit: StoredFit, table: pd.DataFrame) -> Field:
        """The field of a fit; other channels at the median of its survey's rows (`table`).

        Raises
        ------
        InputError
            An effect depends on what the rows do not have.
        """
        chain = fit.chain
        left_out = {*chain.frame_ids, *chain.tool_ids, *chain.instrument_ids}
        known = {i: v for i, v in fit.values.items() if i in chain.index and i not in left_out}
        return replace(cls.without_errors(chain, table), values=chain.vector(known))

    @classmethod
    def without_errors(cls, chain: Chain, table: pd.DataFrame) -> Field:
        """The field of a machine whose parameters are all 0; other channels at the median of the rows of `table`.

        Raises
        ------
        InputError
            An effect depends on what the rows do not have.
        """
        numeric = table.select_dtypes("number").median()
        state = {str(name): float(value) for name, value in numeric.items() if np.isfinite(value)}
        ahead = [name for name in chain.channels if AHEAD_CHANNEL.fullmatch(name) and root(name) in table]
        state |= {name: float(np.nanmedian(channel(table, name))) for name in ahead}
        known = {*state, *TOOL_CHANNELS, *(j.name for j in chain.machine.joints)}
        for name in map(root, chain.channels):
            if name not in known and not name.startswith(("dir_", "run(", "of(")):
                found = f"no column '{name}', which an effect of this machine needs"
                raise InputError("residuals.csv", found, "Run the fit again")
        return cls(chain, chain.vector({}), movers_of(chain), state, short=_short_strokes(chain, table))

    @property
    def joints(self) -> tuple[Joint, ...]:
        return self.chain.machine.joints

    def at(self, state: Mapping[str, float]) -> Field:
        """The same machine in another state."""
        means = {name: mean for name, mean in self.means.items() if name not in state}
        return replace(self, state={**self.state, **state}, means=means)

    def following(self, table: pd.DataFrame) -> Field:
        """The same machine with the means of its channels by position, where the rows of `table` show one."""
        return replace(self, means=means_of(table, self.joints, [*self.conditions]))

    def beside(self, name: str, by: float) -> Field:
        """The same machine with a channel beside its mean by position."""
        return replace(self, means={**self.means, name: self.means[name].shifted(by)})

    def of_joints(self, names: Collection[str]) -> Field:
        """The same machine with the errors of these joints only."""
        own = np.array([p.element in names for p in self.chain.parameters])
        return replace(self, values=np.where(own, self.values, 0.0))

    @property
    def conditions(self) -> dict[str, float]:
        """Channels of the model that are conditions of use (temperatures, time, load, feed), with their values here."""
        names = sorted({n if AHEAD_CHANNEL.fullmatch(n) else root(n) for n in self.chain.channels})
        return {name: self.state[name] for name in names if name.startswith(CONDITIONS) and name in self.state}

    @cached_property
    def reversing(self) -> frozenset[str]:
        """Joints whose errors depend on the direction of approach."""
        names = [c[4:] for c in self.chain.channels if c.startswith("dir_")]
        plays = {joint for joint, _ in self.plays}
        return frozenset(names) | (plays if self.knows_paths else plays - self.short)

    @cached_property
    def plays(self) -> tuple[tuple[str, float], ...]:
        """Joint and width (mm, rad) of each position after a play, in the order of the chain's channels."""
        return tuple((joint, width) for _, joint, width in plays_among(self.chain.channels))

    @property
    def without_paths(self) -> Field:
        """The same machine as tables see it, which know the direction of travel and not the path before.

        Where strokes are short hysteresis is at its mean, zero: by the direction it would be off by its whole size
        after a short stroke.
        """
        return replace(self, knows_paths=False) if self.plays else self

    def rows(
        self, q: Array, direction: Array, tool: Array | None = None, own: Mapping[str, Array] | None = None
    ) -> list[Array]:
        """The chain's channels at commands; `tool` (n, 3) in place of the machine's, `own`: see `Rows.own`.

        `direction` is (n, joints) of +-1. Positions after a play are then those after long strokes; further columns,
        one for each of `plays`, say which share (-1 to 1) of it each row's path has taken up.
        """
        n, place = len(q), {j.name: k for k, j in enumerate(self.joints)}
        shares = iter(direction[:, len(place) :].T)
        tips = np.tile(self.chain.machine.tool, (n, 1)) if tool is None else tool
        out = []
        for name in self.chain.channels:
            call = DERIVED_CHANNEL.fullmatch(name)
            if own and name in own:
                out.append(own[name])
            elif name in place:
                out.append(q[:, place[name]])
            elif name in TOOL_CHANNELS:
                out.append(tips[:, TOOL_CHANNELS.index(name)])
            elif name.startswith("dir_"):
                out.append(direction[:, place[name[4:]]])
            elif call and call[1] == "play":
                k = place[call[2]]
                share = next(shares, direction[:, k])
                if not self.knows_paths:
                    share = np.zeros(n) if call[2] in self.short else direction[:, k]
                out.append(q[:, k] - share * float(call[3]) / 2)
            elif again := RESUMED_CHANNEL.fullmatch(name):
                out.append(np.full(n, float(again[1])))
            else:  # in the steady state a lagged channel equals the channel itself
                out.append(self._held(call[2] if call else name, q))
        return as_rows(*out)

    def _held(self, name: str, q: Array) -> Array:
        """Values (n,) of a channel that is no input of tables, at commands."""
        mean = self.means.get(name)
        return np.full(len(q), self.state.get(name, 0.0)) if mean is None else mean.at(q)

    def actual(
        self, q: Array, direction: Array, tool: Array | None = None, own: Mapping[str, Array] | None = None
    ) -> Array:
        """Actual positions (n, 3), mm."""
        kernel = self.chain.kernel("actual", outputs=(0, 1, 2))
        return kernel(self.rows(q, direction, tool, own), self.values).T

    def nominal(self, q: Array, tool: Array | None = None) -> Array:
        """Nominal positions (n, 3), mm."""
        out: Array = self.chain.kernel("nominal", outputs=(0, 1, 2))(self.rows(q, np.ones_like(q), tool)).T
        for k, motion in enumerate(self.description):
            if any(motion):
                out = np.asarray(out + self.displaced(q, k, tool) @ np.array(motion), np.float64)
        return out

    def displaced(self, q: Array, k: int, tool: Array | None = None) -> Array:
        """Motion of the tip (n, 3, 6) per mm or rad by which the axis of rotary joint `k` lies elsewhere."""
        from scipy.spatial.transform import Rotation

        levers = self.levers(q, tool)[0][:, :, 6 * k : 6 * k + 6]
        axis = np.asarray(self.joints[k].axis, np.float64)
        turn = Rotation.from_rotvec(q[:, k, None] * axis).as_matrix()
        turned = np.concatenate([levers[:, :, :3] @ turn, levers[:, :, 3:] @ turn], axis=2)
        return np.asarray(levers - turned, np.float64)

    @cached_property
    def turns_at_zero(self) -> Array:
        """Rotations (joints, 3, 3) of the joints' frames in the reference, all joints at zero."""
        frames, machine = self.chain.frames({}), self.chain.machine
        return np.array([frames[k][:3, :3] for k, e in enumerate(machine.elements) if isinstance(e, Joint)])

    def jacobian(self, q: Array, direction: Array, tool: Array | None = None) -> Array:
        """Actual motion of the tip (n, 3, movers) per mm or rad of each mover."""
        slope = _slope(self.chain, "actual")(self.rows(q, direction, tool), self.values)
        return slope.reshape(len(self.joints), 3, -1).transpose(2, 1, 0)[:, :, list(self.movers)]

    def levers(self, q: Array, tool: Array | None = None) -> tuple[Array, Array]:
        """Motion of the tip per mm or rad of the six error motions of each joint, and per mm or deg of each joint.

        Shapes (n, 3, 6 joints) and (n, 3, joints), in mm.
        """
        rows = self.rows(q, np.ones_like(q), tool)
        names = self.chain.element_names
        columns = [6 * names.index(j.name) + m for j in self.joints for m in range(6)]
        every = self.chain.kernel("levers", outputs=(0, 1, 2))(rows).reshape(-1, 3, len(q))
        tip = _slope(self.chain, "nominal")(rows, self.values).reshape(len(self.joints), 3, -1).transpose(2, 1, 0)
        return every[columns].transpose(2, 1, 0), tip * np.where(self.rotary, np.pi / 180, 1.0)

    @property
    def rotary(self) -> Array:
        return np.array([j.type == "rotary" for j in self.joints])

    def inward(self, q: Array) -> Array:
        """Convert commands from controller units (mm, deg) to mm and rad."""
        return np.where(self.rotary, np.radians(q), q)

    def outward(self, q: Array) -> Array:
        """Convert commands from mm and rad to controller units (mm, deg)."""
        return np.where(self.rotary, np.degrees(q), q)


@lru_cache(maxsize=16)
def _slope(chain: Chain, what: Literal["actual", "nominal"]) -> Kernel:
    """Derivative of the tip's position with respect to every joint."""
    import casadi as ca

    point = chain.expression(what)[:3]
    return Kernel(chain.rows, chain.values, ca.jacobian(point, chain.rows)[:, : len(chain.machine.joints)])


def movers_of(chain: Chain) -> tuple[int, ...]:
    """Joints that carry out corrections: one linear joint per direction, the longest first.

    All joints where the linear ones do not span three directions and others exist.
    """
    machine = chain.machine
    joints, axes = machine.joints, directions_at_zero(machine, chain)
    linear = [k for k, j in enumerate(joints) if j.type == "prismatic"]
    chosen: list[int] = []
    for k in sorted(linear, key=lambda k: joints[k].travel[0] - joints[k].travel[1]):
        basis = np.linalg.qr(axes[chosen].T)[0] if chosen else np.zeros((3, 0))
        if np.linalg.norm(axes[k] - basis @ (basis.T @ axes[k])) > LEAST_NEW_DIRECTION:
            chosen.append(k)
    if len(chosen) == 3 or len(linear) == len(joints):
        return tuple(sorted(chosen))
    return tuple(range(len(joints)))


def _short_strokes(chain: Chain, table: pd.DataFrame) -> frozenset[str]:
    """Joints with a play of which rows are better known by its mean than by the direction of travel."""
    out = set[str]()
    for (_, joint, _), share in zip(plays_among(chain.channels), taken_up(chain, table).T, strict=True):
        if np.mean((share - direction(table, joint)) ** 2) > BY_DIRECTION**2 * np.mean(share**2):
            out.add(joint)
    return frozenset(out)


def other_states(
    field: Field, table: pd.DataFrame, states: Sequence[Mapping[str, float]], loose: Sequence[str]
) -> list[Mapping[str, float]]:
    """States beside the middle one of `states`: the others of them, and the ends that each of the channels `loose` had.

    `loose`: other channels of the model that nothing follows; `table`: the rows of the survey.
    """
    middle = len(states) // 2
    out = [state for k, state in enumerate(states) if k != middle]
    for name in loose:
        recorded = table[name].dropna().to_numpy(dtype=np.float64) if name in table else np.zeros(0)
        ends = sorted({float(v) for v in (recorded.min(), recorded.max())}) if len(recorded) else []
        out += [{**states[middle], name: end} for end in ends if end != field.state.get(name)]
    return out
