"""M and the gap of a position in the axes in which they take the fewest steps.

Least squares with one weight a row do not depend on the axes in which a row is written. Behind a rotary table, columns
of all that the table does not turn are free of its sine and cosine: a five-axis machine has half as many distinct
functions there, and a third of their products.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import casadi as ca

from errormodel.machine import Joint

if TYPE_CHECKING:
    from errormodel.chain import Chain
    from errormodel.kernel import Kernel

Gap = Literal["nominal", "actual", "given"]


def turns_before(chain: Chain) -> list[int]:
    """Rotary joints before the motion of each element: the measuring frame, the machine's in chain order, the tool."""
    out = [0, 0]
    for element in chain.machine.elements:
        out.append(out[-1] + (isinstance(element, Joint) and element.type == "rotary"))
    return out


def axes_of(chain: Chain, ids: Sequence[str]) -> int:
    """Number of rotary joints behind which the axes lie that are the fewest rotations away from the columns' own.

    That is the median of what `turns_before` says of the columns.
    """
    before, names = turns_before(chain), chain.element_names
    first = {name: before[k] for k, name in reversed(list(enumerate(names)))}
    own = sorted(first.get(chain.parameters[chain.index[i]].element, before[-1]) for i in ids)
    return own[(len(own) - 1) // 2] if own else 0


def turned_kernel(chain: Chain, gap: Gap, ids: tuple[str, ...], fixed: Mapping[str, float]) -> Kernel:
    """NumPy kernel of M at zero parameters, (3, len(ids)), and behind it of the gap, (3, 1), in the axes of `axes_of`.

    The chain's channels have three further rows behind them: the measured position, or the given gap, in the axes of
    the reference, mm.

    Parameters
    ----------
    gap : measured position minus that of the ``nominal`` machine, or of the ``actual`` one at the parameters' values;
        or the gap itself is ``given``.
    ids, fixed : as of `Chain.kernel`.
    """
    return _kernel(chain, gap, ids, tuple(sorted(fixed.items())))


@lru_cache(maxsize=16)
def _kernel(chain: Chain, gap: Gap, ids: tuple[str, ...], fixed: tuple[tuple[str, float], ...]) -> Kernel:
    measured = ca.SX.sym("measured", 3)
    return chain.folded(_turned(chain, gap, ids, measured), ca.vertcat(chain.rows, measured), fixed)


def _turned(chain: Chain, gap: Gap, ids: Sequence[str], measured: ca.SX) -> ca.SX:
    base = turns_before(chain)[1:].index(axes_of(chain, ids))  # the axes are those before the motion of this element
    steps = chain.nominal_steps
    turns = [ca.SX.eye(3) for _ in range(len(steps) + 1)]
    for k in range(base + 1, len(turns)):
        turns[k] = turns[k - 1] @ steps[k - 1][1]
    for k in range(base - 1, -1, -1):
        turns[k] = turns[k + 1] @ steps[k][1].T
    levers = chain.levers_in([turns[0], *turns])[:3, :]
    columns = [levers[:, 6 * k : 6 * k + 6] @ term.column for k, term in (chain.term(i) for i in ids)]
    seen = turns[0] @ measured
    if gap == "nominal":
        seen -= sum((t @ s for t, (s, _) in zip(turns, steps, strict=False)), turns[-1] @ chain.tool_channels)
    elif gap == "actual":
        seen = turns[0] @ (measured - chain.expression("actual")[:3])
    return ca.horzcat(*columns, seen)
