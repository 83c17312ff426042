"""Symbolic kinematic chain: exact actual pose of the tool, and its derivative M by the error parameters.

Homogeneous transformations of rigid bodies with small constant or position-dependent errors. An element maps
coordinates of the next frame (tool side) into the previous one (workpiece side). Before the machine's elements comes
the measuring frame, after them the tool (functional point), each with six constant errors. All parameters are zero on
a nominal machine. Positions are those of the functional point in the axes of the reference on the workpiece side, mm;
orientations are those of the last frame; angles in rad.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from errormodel import conventions, effects
from errormodel.arrays import Array, as_rows
from errormodel.chain_terms import Term, column_of, constant_terms, joint_terms
from errormodel.channels import POINT_CHANNELS, columns
from errormodel.conventions import FRAME, MOTIONS, TOOL, Motion
from errormodel.effects.best_prediction import predicted_terms
from errormodel.exceptions import InputError, nearest
from errormodel.kernel import Kernel
from errormodel.location_errors import LocationError, location_of
from errormodel.machine import EffectSpec, Joint, Machine, Shape
from errormodel.rotations import rotation_about, rotation_xyz

if TYPE_CHECKING:
    import pandas as pd

TOOL_CHANNELS = ("tool_x", "tool_y", "tool_z")
What = Literal["nominal", "actual", "design", "linearised", "terms", "levers"]


@dataclass(frozen=True)
class Parameter:
    """One error parameter: identifier, element, motion and unit.

    Attributes
    ----------
    id : ``element.motion`` or ``element.motion.term``, such as ``X.dx.1``.
    element : the chain element that moves.
    motion : its small motion, in the axes of the workpiece-side frame.
    term : label of the function of position, or of the effect; "" for a constant.
    unit : of the parameter.
    symbol : ISO 230-1 symbol, or "".
    prior : standard deviation of a zero-mean prior, or None.
    low : physical lower bound.
    size : how large it physically is, of an effect's parameter (one standard deviation); infinite of others.
    """

    id: str
    element: str
    motion: Motion
    term: str
    unit: str
    symbol: str
    prior: float | None = None
    low: float = -math.inf
    size: float = math.inf

    @property
    def source(self) -> str:
        """Origin of its column in M, in words."""
        term = f", term {self.term}" if self.term else ""
        return f"{self.motion} of {self.element}{term}"


class Chain:
    """Kinematic chain of one machine in CasADi, with its NumPy kernels.

    Attributes
    ----------
    channels : tuple of str
        Row-wise inputs: the joints in chain order, ``tool_x tool_y tool_z``, then the channels of effects (names as in
        `errormodel.channels`). mm, rad, s, degC.
    parameters : tuple of Parameter
        Six of the measuring frame, the machine's in chain order (those of an effect after the element that it moves),
        six of the tool.
    effect_ids : tuple of tuples of str
        Parameter ids of each of the machine's effects, in the order of the effects.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        own = (*(j.name for j in machine.joints), *TOOL_CHANNELS)
        self._channel = {name: ca.SX.sym(name) for name in own}
        extra = [(n, *term) for n, spec in enumerate(machine.effects) for term in self._effect_terms(spec)]
        self.channels: tuple[str, ...] = tuple(self._channel)
        self.rows = ca.vertcat(*self._channel.values())
        parameters, known = list[Parameter](), set[str]()
        of_effects: list[list[str]] = [[] for _ in machine.effects]
        self._columns: list[tuple[int, Term]] = []  # (index of the element among all, term)
        for place, (name, terms) in enumerate(self._element_terms()):
            joint = 0 < place <= len(machine.elements) and isinstance(machine.elements[place - 1], Joint)
            self._tool_start = len(parameters)  # after the loop, that of the tool
            for number, term in (*((None, t) for t in terms), *((n, t) for n, element, t in extra if element == name)):
                identity = f"{name}.{term.motion}" + (f".{term.label}" if term.label else "")
                while identity in known:  # the same effect twice at one element
                    identity += "'"
                known.add(identity)
                symbol = conventions.iso_symbol(name, term.motion) if joint else ""
                parameters.append(
                    Parameter(
                        identity, name, term.motion, term.label, term.unit, symbol, term.prior, term.low, term.size
                    )
                )
                self._columns.append((place, term))
                if number is not None:
                    of_effects[number].append(identity)
        self.effect_ids = tuple(map(tuple, of_effects))
        self.parameters = tuple(parameters)
        self.ids = tuple(p.id for p in parameters)
        self.index = {identity: k for k, identity in enumerate(self.ids)}
        self.values = ca.SX.sym("p", len(parameters))

    def __reduce__(self) -> tuple[type[Chain], tuple[Machine]]:
        """Pickle the machine only; the symbols and kernels are rebuilt in the other process."""
        return Chain, (self.machine,)

    @cached_property
    def _content(self) -> bytes:
        return pickle.dumps((self.machine.elements, self.machine.tool, self.machine.effects))

    def __eq__(self, other: object) -> bool:
        """Chains of machines of one content are equal, and share their kernels."""
        return isinstance(other, Chain) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def _effect_terms(self, spec: EffectSpec) -> list[tuple[str, Term]]:
        """Terms of an effect's parameters, each with the name of the element that it moves."""
        try:
            effect = effects.make(spec)
        except InputError as error:
            raise InputError(f"{self.machine.source}, {error.where}", error.found, error.cure) from error
        out = []
        for term in predicted_terms(effect, self._symbol, self.machine):
            if term.element not in (FRAME, TOOL, *(e.name for e in self.machine.elements)):
                names = (e.name for e in self.machine.elements)
                raise InputError(f"effect {spec.effect}", f"no element {term.element}", nearest(term.element, names))
            column = column_of(term.motion)
            label = f"{spec.effect}-{term.label}" if term.label else spec.effect
            prior = term.size if effect.random or term.tied else None
            own = Term(next(iter(term.motion)), label, term.unit, column, prior, term.low, term.size)
            out.append((term.element, own))
        return out

    def _symbol(self, name: str) -> ca.SX:
        """Symbol of a channel; a new name is added to the channels of the chain."""
        if name in POINT_CHANNELS:
            return self.pose()[0][POINT_CHANNELS.index(name)]
        if name not in self._channel:
            self._channel[name] = ca.SX.sym(name)
        return self._channel[name]

    def _element_terms(self) -> list[tuple[str, list[Term]]]:
        own = [
            (e.name, constant_terms(e.motions) if isinstance(e, Shape) else joint_terms(e, self._channel[e.name]))
            for e in self.machine.elements
        ]
        names = {e.name for e in self.machine.elements}
        # where a member of the machine is called "frame", the measuring frame is named after its run
        frame, tool = (f"{n}[1]" if n in names else n for n in (FRAME, TOOL))
        return [(frame, constant_terms(MOTIONS)), *own, (tool, constant_terms(MOTIONS))]

    @cached_property
    def size(self) -> float:
        """Upper bound (mm) of the machine's extent, and so of the lever of an angular error."""
        travels = sum(max(abs(t) for t in j.travel) for j in self.machine.joints if j.type == "prismatic")
        arms = sum(float(np.linalg.norm(s.offset)) for s in self.machine.shapes)
        return max(travels + arms + float(np.linalg.norm(self.machine.tool)), 1.0)

    @cached_property
    def location_errors(self) -> list[LocationError]:
        """Squareness and parallelism of the axes as functions of the parameters."""
        return location_of(self.machine)

    @property
    def frame_ids(self) -> tuple[str, ...]:
        """Ids of the six parameters of the measuring frame: the small remainder after its alignment."""
        return self.ids[:6]

    @property
    def tool_ids(self) -> tuple[str, ...]:
        """Ids of the six parameters of the tool: offset of the functional point, orientation of the target's mount."""
        return tuple(self.ids[self._tool_start : self._tool_start + 6])

    @cached_property
    def of_effects(self) -> frozenset[str]:
        """Ids of the parameters of the machine's effects, as opposed to those of its error motions."""
        return frozenset(i for ids in self.effect_ids for i in ids)

    @cached_property
    def instrument_ids(self) -> frozenset[str]:
        """Parameters of effects of the instrument and of mistakes in a table: nothing of the machine moves by them."""
        kinds = (effects.registry()[spec.effect] for spec in self.machine.effects)
        pairs = zip(kinds, self.effect_ids, strict=True)
        return frozenset(i for kind, ids in pairs if not kind.traits().of_machine for i in ids)

    @cached_property
    def machine_ids(self) -> tuple[str, ...]:
        """Ids of the machine's own parameters: all but those of the measuring frame and the tool."""
        others = {*self.frame_ids, *self.tool_ids}
        return tuple(i for i in self.ids if i not in others)

    @cached_property
    def _motions(self) -> list[ca.SX]:
        motions = [ca.SX.zeros(6) for _ in range(len(self.machine.elements) + 2)]
        for k, (place, term) in enumerate(self._columns):
            motions[place] += self.values[k] * term.column
        return motions

    def pose(self, motions: Sequence[ca.SX] | None = None) -> tuple[ca.SX, ca.SX]:
        """Exact position (3, 1), mm, and orientation (3, 3) with the given motion of each element; None: nominal."""
        zero = ca.SX.zeros(6)
        point, turn = _move(motions[0] if motions else zero)
        for place, element in enumerate(self.machine.elements, start=1):
            step, rotation = self._transform(element, motions[place] if motions else zero)
            point, turn = point + turn @ step, turn @ rotation
        tip, rotation = _move(motions[-1] if motions else zero)
        return point + turn @ (self.tool_channels + tip), turn @ rotation

    def _transform(self, element: Shape | Joint, motion: ca.SX) -> tuple[ca.SX, ca.SX]:
        shift, turn = _move(motion)
        if isinstance(element, Shape):
            return ca.SX(ca.DM(element.offset)) + shift, turn @ rotation_xyz(ca.SX(ca.DM(element.rotation)))
        q, axis = self._channel[element.name], ca.SX(ca.DM(element.axis))
        if element.type == "prismatic":
            return q * axis + shift, turn
        half = rotation_about(axis, q / 2)  # first-order errors use sin(q/2) too: fewer functions per row
        return shift, turn @ half @ half

    @cached_property
    def _actual(self) -> tuple[ca.SX, ca.SX]:
        return self.pose(self._motions)

    @cached_property
    def _derivative(self) -> ca.SX:
        """Jacobian (6, p) of position and rotation vector, in the reference's axes, at any parameter values."""
        point, turn = self._actual
        here = ca.SX.sym("R", 3, 3)
        # sum of R_k x dR_k is twice the rotation vector that carries R into R + dR
        turned = sum((ca.cross(here[:, k], turn[:, k]) for k in range(3)), ca.SX.zeros(3)) / 2
        slope = ca.jacobian(ca.vertcat(point, turned), self.values)
        return ca.substitute(slope, here, turn)

    @cached_property
    def _design(self) -> ca.SX:
        """M, the Jacobian at zero parameters: levers of each element times its motion per unit of each parameter."""
        return ca.horzcat(*(self._levers[:, 6 * k : 6 * k + 6] @ term.column for k, term in self._columns))

    @property
    def element_names(self) -> tuple[str, ...]:
        """Names of all elements: the measuring frame, the machine's in chain order, the tool."""
        return (FRAME, *(e.name for e in self.machine.elements), TOOL)

    @cached_property
    def _levers(self) -> ca.SX:
        """Levers (6, 6 * elements): motion of the tool per unit of each motion of each element."""
        turns = [ca.SX.eye(3), ca.SX.eye(3)]  # before the motion of the frame, and of the first element
        for _, rotation in self.nominal_steps:
            turns.append(turns[-1] @ rotation)
        return self.levers_in(turns)

    @property
    def nominal_steps(self) -> list[tuple[ca.SX, ca.SX]]:
        """Offset (3, 1) and rotation (3, 3) of each of the machine's elements without errors."""
        return [self._transform(element, ca.SX.zeros(6)) for element in self.machine.elements]

    @property
    def tool_channels(self) -> ca.SX:
        """The tool's three channels as symbols (3, 1)."""
        return ca.vertcat(*(self._channel[c] for c in TOOL_CHANNELS))

    def term(self, identity: str) -> tuple[int, Term]:
        """Number of the element that a parameter moves, among all, and its term."""
        return self._columns[self.index[identity]]

    def levers_in(self, turns: Sequence[ca.SX]) -> ca.SX:
        """Levers (6, 6 * elements) in axes that `turns` (3, 3) of each element's motion carry its own axes into.

        Arms are summed from the tool back and not as differences of positions, so that a zero arm is exactly zero.
        """
        arm = self.tool_channels
        arms = [ca.SX.zeros(3)]  # a motion of the tool turns about the tip
        for step, rotation in reversed(self.nominal_steps):
            arms.append(rotation @ arm)
            arm = step + arms[-1]
        arms.append(arm)
        # an element's motion is applied after its offset and before its rotation; that of the frame first
        return ca.horzcat(*(_lever(t, a) for t, a in zip(turns, reversed(arms), strict=True)))

    def expression(self, what: What, ids: tuple[str, ...] = ()) -> ca.SX:
        """Return the symbolic expression of a kernel.

        ``nominal`` and ``actual``: (12, 1), position (mm) and the orientation's columns. ``design``: (6, len(ids)), M
        at zero parameters (mm and rad per unit); ``linearised``: the same at the parameters' present values. ``terms``:
        (6, len(ids) + 6), the motion of the own element per unit of each parameter, and the six motions themselves.
        ``levers``: (6, 6 * elements), the tool's motion per unit of each motion of each element (`element_names`).
        """
        if what == "nominal":
            point, turn = self.pose()
            return ca.vertcat(point, ca.vec(turn))
        if what == "actual":
            point, turn = self._actual
            return ca.vertcat(point, ca.vec(turn))
        columns = [self.index[i] for i in ids]
        if what == "levers":
            return self._levers
        if what == "terms":
            return ca.horzcat(*(self._columns[k][1].column for k in columns), ca.SX.eye(6))
        return (self._design if what == "design" else self._derivative)[:, columns]

    def kernel(
        self,
        what: What,
        ids: tuple[str, ...] = (),
        fixed: Mapping[str, float] | None = None,
        outputs: tuple[int, ...] | None = None,
    ) -> Kernel:
        """NumPy kernel of :meth:`expression`.

        Parameters
        ----------
        what : the expression, as in :meth:`expression`.
        ids : parameters of the columns of ``design``, ``linearised`` and ``terms``.
        fixed : values of channels that are equal in all rows, in mm, rad, s and degC.
        outputs : rows of the expression, e.g. (0, 1, 2) for positions only; None: all.
        """
        return self._kernel(what, ids, tuple(sorted((fixed or {}).items())), outputs)

    @lru_cache(maxsize=64)  # noqa: B019  of equal chains the first is kept
    def _kernel(
        self, what: What, ids: tuple[str, ...], fixed: tuple[tuple[str, float], ...], outputs: tuple[int, ...] | None
    ) -> Kernel:
        expression = self.expression(what, ids)
        if outputs is not None:
            expression = expression[list(outputs), :]
        return self.folded(expression, self.rows, fixed)

    def folded(self, expression: ca.SX, rows: ca.SX, fixed: Sequence[tuple[str, float]]) -> Kernel:
        """NumPy kernel of an expression of `rows`, the channels that are equal in all rows being folded in."""
        if fixed:
            symbols = ca.vertcat(*(self._channel[name] for name, _ in fixed))
            expression = ca.substitute(expression, symbols, ca.SX(ca.DM([value for _, value in fixed])))
        return Kernel(rows, self.values, expression)

    def vector(self, values: Mapping[str, float]) -> Array:
        """Parameter vector for the kernels from values by id; all others are 0."""
        vector = np.zeros(len(self.ids))
        for identity, value in values.items():
            vector[self.index[identity]] = value
        return vector

    def columns(self, table: pd.DataFrame) -> list[Array]:
        """Channels of the chain, each (n,), over all rows of a survey's table."""
        return as_rows(*columns(table, self.channels))

    def frames(self, position: Mapping[str, float]) -> NDArray[np.float64]:
        """Nominal frames (elements + 1, 4, 4) at one command: the reference, then that after each element; mm."""
        upper = self._frames([position.get(c, 0.0) for c in self.channels]).full().reshape(3, -1, 4).swapaxes(0, 1)
        return np.concatenate([upper, np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(upper), 1, 4))], axis=1)

    @cached_property
    def _frames(self) -> ca.Function:
        """Upper three rows (3, 4 (elements + 1)) of all nominal frames at given channels."""
        out = [ca.SX.eye(3), ca.SX.zeros(3)]  # rotation and point of each
        for step, rotation in self.nominal_steps:
            out += [out[-2] @ rotation, out[-1] + out[-2] @ step]
        return ca.Function("frames", [self.rows], [ca.horzcat(*out)])


def _lever(axes: ca.SX, arm: ca.SX) -> ca.SX:
    """Small motion (6, 6) of a point at `arm` per unit of translation along and rotation about the given axes."""
    return ca.vertcat(ca.horzcat(axes, -axes @ ca.skew(arm)), ca.horzcat(ca.SX.zeros(3, 3), axes))


def _move(motion: ca.SX) -> tuple[ca.SX, ca.SX]:
    return motion[:3], rotation_xyz(motion[3:])
