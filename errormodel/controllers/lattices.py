"""Corrections on a lattice over all axes that moved, which represents any error that depends on their positions."""

from __future__ import annotations

import math

from errormodel.controllers.base import Controller, Rewriter, instead
from errormodel.controllers.setup import MOST_LATTICE_NODES, Setup
from errormodel.controllers.tables import Term
from errormodel.exceptions import InputError

# intervals needed over intervals given: linear interpolation errors grow with its square; by judgement
MOST_COARSENING = 4
MOST_NAMED_AXES = 3  # of a grid that is too large: those with the most positions


def lattice_terms(controller: Controller, setup: Setup) -> list[Term]:
    """One table of each correcting axis, all on the same lattice.

    Raises
    ------
    InputError
        A lattice that follows the errors has too many nodes.
    """
    names = setup.moving
    grids = setup.lattice(names, controller.most_points, MOST_LATTICE_NODES)
    coarse = any(MOST_COARSENING * (len(g) - 1) < setup.axis(n).intervals for n, g in zip(names, grids, strict=True))
    if setup.points is None and (coarse or math.prod(len(g) for g in grids) > MOST_LATTICE_NODES):
        most = sorted(names, key=lambda n: -setup.axis(n).intervals)[:MOST_NAMED_AXES]
        along = ", ".join(f"{setup.axis(n).intervals + 1} along {n}" for n in most)
        raise InputError(
            f"--controller {controller.name}",
            f"a grid over {len(names)} axes that follows the errors needs more than {MOST_LATTICE_NODES} nodes, "
            f"{along}",
            f"Use --controller {instead(Rewriter)}, which needs no grid, or a control with tables of single axes, or "
            "survey a smaller part of the travels; --points writes a coarser grid, and what that leaves is printed",
        )
    return [Term(m, names, grids) for m in setup.movers]
