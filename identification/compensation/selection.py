"""Choice of tables for a control that holds fewer than the errors want: forward selection by the gain of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.controllers.tables import Term
from identification.compensation.designs import Design


def strongest(
    design: Design, errors: Array, most: int, used: Callable[[Sequence[Term]], int], aligned: bool = False
) -> list[int]:
    """Numbers of the tables to keep, in order.

    One table after the other is taken that removes most of the sum of squares, beside those taken before and the
    motions of the frame, for each table of the control that it needs (orthogonal matching pursuit by groups).

    Parameters
    ----------
    design, errors : of all tables; (3 n,) errors in the design's units.
    most : tables of the control that may be used.
    used : number of the control's tables that terms need, those that only multiply others included.
    aligned : whether the frame must not turn.
    """
    from scipy.linalg import cho_factor, cho_solve

    terms, gram = design.terms, design.gram.toarray()
    goal = np.asarray(-design.matrix.T @ errors, np.float64)
    ends = np.cumsum([0, *(t.size for t in terms)])
    columns = [np.arange(a, b) for a, b in pairwise(ends)]
    kept = [k for k, t in enumerate(terms) if not used([t])]
    motions = np.arange(ends[-1], len(goal))[: 3 if aligned else None]
    taken: Index = np.concatenate([motions, *(columns[k] for k in kept)])
    while True:
        factor = cho_factor(gram[np.ix_(taken, taken)]) if len(taken) else None
        best: tuple[float, int] | None = None
        held = [terms[k] for k in kept]
        for k, own in enumerate(columns):
            price = used([*held, terms[k]]) - used(held)
            if k in kept or used(held) + price > most:
                continue
            cross = gram[np.ix_(taken, own)]
            through = cho_solve(factor, cross) if factor is not None else cross
            rest = goal[own] - through.T @ goal[taken]
            gain = float(rest @ np.linalg.solve(gram[np.ix_(own, own)] - cross.T @ through, rest)) / price
            if best is None or gain > best[0]:
                best = gain, k
        if best is None:
            return sorted(kept)
        kept.append(best[1])
        taken = np.concatenate([taken, columns[best[1]]])
