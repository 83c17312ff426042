"""Plain CSV table of corrections over a grid of all axes, for any controller or script that can read it."""

from __future__ import annotations

from itertools import product
from typing import ClassVar

import numpy as np

from errormodel.controllers.base import Controller
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.grids import nodes
from errormodel.controllers.lattices import lattice_terms
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_increasing, check_points
from errormodel.controllers.text import Comment, Files, Lines, one_file
from errormodel.exceptions import InputError


class CsvGrid(Controller):
    """One row per node, first axis slowest; multilinear between nodes, the last value beyond them; mm and deg."""

    name: ClassVar[str] = "csv"
    title: ClassVar[str] = "plain CSV grid over all axes"
    source: ClassVar[str] = "errormodel's own"
    needs: ClassVar[str] = "a control, a post-processor or a program of your own that adds corrections to positions"
    test: ClassVar[str] = (
        "look up a node and a place between nodes by hand, and compare with what your program adds there"
    )
    scale_setting: ClassVar[str] = (
        "steps a mm of {axis}: multiply by {steps:.6f}, or leave it, since this table holds it as well"
    )
    back: ClassVar[str] = "send the plain positions again"
    general: ClassVar[bool] = True
    comment: ClassVar[Comment | None] = None
    sign_known: ClassVar[bool] = True
    dialect: ClassVar[Dialect | None] = None
    backlash_parameter: ClassVar[str] = ""
    lettered: ClassVar[bool] = False
    linear_only: ClassVar[bool] = False
    most_points: ClassVar[int] = 1025

    def terms(self, setup: Setup) -> list[Term]:
        return lattice_terms(self, setup)

    def quantum(self, setup: Setup) -> float:
        return 1e-7

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        names = tables[0].term.inputs
        for axis in range(len(names)):
            check_points(tables[0].term, self.most_points, axis)
            check_increasing(tables[0].term, axis)
        header = [*names, *(f"d{t.term.output}" for t in tables)]
        places = map(",".join, product(*([f"{v:.9g}" for v in g] for g in tables[0].term.grids)))
        form = ",".join(["%s", *("%.7f" for _ in tables)])
        rows = [form % row for row in zip(places, *(t.values.ravel().tolist() for t in tables), strict=True)]
        return {"correction.csv": "\n".join([",".join(header), *rows]) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".csv")
        lines = Lines.of(name, text)
        header = lines.lines[0][1].split(",") if lines.lines else []
        outputs = [h[1:] for h in header if h.startswith("d") and h[1:] in setup.movers]
        names = tuple(h for h in header if h in setup.names)
        if not outputs or [*names, *(f"d{o}" for o in outputs)] != header:
            raise lines.error(1, f"header '{','.join(header)[:60]}'", "Write axes, then corrections such as dX")
        data = lines.rows(1, len(header), ",")
        grids = tuple(tuple(np.unique(data[:, k]).tolist()) for k in range(len(names)))
        wanted = nodes(grids)
        if len(wanted) != len(data) or not np.array_equal(wanted, data[:, : len(names)]):
            found = f"{len(data)} rows that are not the {len(wanted)} nodes of a grid in order"
            raise InputError(name, found, "Give every node once, the last axis fastest")
        return tuple(
            Table(Term(o, names, grids), data[:, len(names) + k].reshape([len(g) for g in grids]))
            for k, o in enumerate(outputs)
        )

    def own_check(self, setup: Setup, tables: Tables) -> dict[str, str]:
        return {}  # no particular control is known

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "add dX, dY, ... (mm or deg) to the commanded positions; multilinear between nodes, the last value beyond",
            "positions and corrections are in mm and degrees, whatever units machine.yaml and the survey have: where "
            "your program counts in inches, divide both by 25.4",
            "leave other compensations as they were when the survey was measured",
        ]
