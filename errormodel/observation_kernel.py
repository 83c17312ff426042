"""Kernels of observation models on a chain: the reading, and its derivative by error parameters and quantities.

A reading is a function of the tool's pose at one command or two. Its derivative by the machine's parameters is the
gradient by each pose times M there: rows of M contracted to one. mm and rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Literal
from weakref import WeakKeyDictionary

import casadi as ca

from errormodel.chain import Chain
from errormodel.kernel import Kernel
from errormodel.observations.base import Observation, Tip

What = Literal["value", "design", "linearised", "levers"]
_MADE: WeakKeyDictionary[Chain, dict[type[Observation], ObservationKernels]] = WeakKeyDictionary()


def kernels_of(chain: Chain, observation: Observation) -> ObservationKernels:
    """The kernels of an observation's model on a chain, made once."""
    own = _MADE.setdefault(chain, {})
    kind = type(observation)
    if kind not in own:
        own[kind] = ObservationKernels(chain, observation)
    return own[kind]


class ObservationKernels:
    """Expressions of one observation model on one chain, and kernels made of them.

    Row inputs are the chain's channels, once a pose; scalars are the chain's parameters, then the quantities of the
    set-up in the model's order.
    """

    def __init__(self, chain: Chain, observation: Observation) -> None:
        self.parameters = len(chain.ids)
        self.names = tuple(q.name for q in observation.quantities())
        self._model, self._poses = type(observation), observation.poses
        self._chain_values, self._first = chain.values, chain.rows
        self._rows = [chain.rows, *(ca.SX.sym("second", chain.rows.numel()) for _ in range(1, self._poses))]
        self._quantities = ca.SX.sym("q", len(self.names))
        self._expressions = {w: chain.expression(w) for w in ("nominal", "actual", "levers")}
        self._designs = {w: chain.expression(w, chain.ids) for w in ("design", "linearised")}
        self._place = dict(chain.index)
        self._kernels: dict[tuple[What, tuple[str, ...], tuple[str, ...]], Kernel] = {}

    def kernel(self, what: What, ids: tuple[str, ...] = (), free: tuple[str, ...] = ()) -> Kernel:
        """Kernel of an expression.

        Parameters
        ----------
        what : ``value`` (1): the reading in exact kinematics. ``design``: its derivative (1, ids + free) at zero errors
            and given quantities, ``linearised``: at given parameters, too. ``levers`` (1, 6 * elements): by each motion
            of each element at zero errors; of two poses both, that of the first before that of the second.
        ids : parameters of the chain; `free`: quantities; the columns, in this order.
        """
        key = (what, ids, free)
        if key not in self._kernels:
            scalars = ca.vertcat(self._chain_values, self._quantities)
            self._kernels[key] = Kernel(ca.vertcat(*self._rows), scalars, self._expression(what, ids, free))
        return self._kernels[key]

    def _expression(self, what: What, ids: tuple[str, ...], free: tuple[str, ...]) -> ca.SX:
        if what == "value":
            return self._reading([self._tip("actual", k) for k in range(self._poses)], self._of)
        at_zero = what != "linearised"
        slopes, by_quantity = self._gradient
        tips = [self._expressions["nominal" if at_zero else "actual"], self._expressions["nominal"]]
        here = [ca.vertcat(*(self._at(t, k) for t in tips)) for k in range(self._poses)]
        places, where = ca.vertcat(*self._places), ca.densify(ca.vertcat(*here))
        slopes, by_quantity = (ca.substitute(e, places, where) for e in (slopes, by_quantity))
        if what == "levers":
            parts = [slopes[:, 6 * k : 6 * k + 6] @ self._at(self._expressions["levers"], k) for k in self._each]
            return ca.horzcat(*parts)
        columns = [self._place[i] for i in ids]
        own = ca.SX.zeros(1, len(columns))
        for k in self._each:
            own += slopes[:, 6 * k : 6 * k + 6] @ self._at(self._designs[what][:, columns], k)
        return ca.horzcat(own, by_quantity[:, [self.names.index(n) for n in free]])

    @property
    def _each(self) -> range:
        return range(self._poses)

    @property
    def _of(self) -> dict[str, ca.SX]:
        return {name: self._quantities[k] for k, name in enumerate(self.names)}

    def _at(self, expression: ca.SX, pose: int) -> ca.SX:
        """An expression of the chain at one of the poses."""
        return expression if pose == 0 else ca.substitute(expression, self._first, self._rows[pose])

    def _tip(self, what: str, pose: int) -> Tip:
        return _tip(self._at(self._expressions[what], pose), self._at(self._expressions["nominal"], pose))

    def _reading(self, tips: list[Tip], of: Mapping[str, ca.SX]) -> ca.SX:
        return self._model.value(tips, of)

    @cached_property
    def _places(self) -> list[ca.SX]:
        """Symbols of actual and nominal position and orientation, (24, 1) a pose."""
        return [ca.SX.sym(f"place{k}", 24) for k in self._each]

    @cached_property
    def _gradient(self) -> tuple[ca.SX, ca.SX]:
        """Derivative (1, 6 * poses) by a small motion of each pose, and (1, quantities), at the symbols of places."""
        small = [ca.SX.sym(f"small{k}", 6) for k in self._each]
        tips = []
        for place, motion in zip(self._places, small, strict=True):
            turn = ca.reshape(place[3:12], 3, 3)
            moved = ca.vertcat(place[:3] + motion[:3], ca.vec(turn + ca.skew(motion[3:]) @ turn))
            tips.append(_tip(moved, place[12:]))
        reading = self._reading(tips, self._of)
        motions = ca.vertcat(*small)
        still = ca.SX.zeros(motions.numel())
        slopes = ca.substitute(ca.jacobian(reading, motions), motions, still)
        return slopes, ca.substitute(ca.jacobian(reading, self._quantities), motions, still)


def _tip(actual: ca.SX, nominal: ca.SX) -> Tip:
    """A pose from position and orientation columns (12, 1), and the nominal ones."""
    rotation, start = ca.reshape(actual[3:12], 3, 3), ca.reshape(nominal[3:12], 3, 3)
    # the sum of s_k x r_k over the columns is twice the rotation vector that carries s into r, to third order
    turned = sum((ca.cross(start[:, k], rotation[:, k]) for k in range(3)), ca.SX.zeros(3)) / 2
    return Tip(actual[:3], rotation, turned)
