"""Aerotech A3200 and Automation1: calibration files ``.cal``, one- and two-dimensional.

Corrections in um are added to the position, alike in both directions of travel. Several tables add up; interpolation
is linear, and the last value holds beyond the ends. Axis numbers count from 1. The first position is minus the OFFSET.

Source: help.aerotech.com/automation1, Axis Calibration; published generators of such files for the 2-D offsets.
"""

from __future__ import annotations

import re
from itertools import combinations
from typing import ClassVar

import numpy as np

from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.grids import spaced
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_points, even_step
from errormodel.controllers.text import Comment, Files, Lines, one_file
from errormodel.exceptions import InputError

MOST_2D_NODES = 300  # nodes of one 2-D table, a third of it where there are more than three pairs of axes; by judgement


def _key(lines: Lines, text: str, name: str) -> float:
    match = re.search(rf"\b{name}\s*=\s*([-+.\deE]+)", text)
    if match is None:
        raise lines.error(1, f"no {name}", "Write the file again")
    return float(match[1])


def _tables(name: str, text: str) -> list[tuple[Lines, list[str], list[list[float]]]]:
    """Header lines and values of each table of a file."""
    lines = Lines.of(name, text, (";", "'"))
    out: list[tuple[Lines, list[str], list[list[float]]]] = []
    starts, rows, open_ = list[str](), list[list[float]](), False
    for number, line in lines.lines:
        if line.upper().startswith(":START"):
            starts.append(line)
            open_ = True
        elif line.upper().startswith(":END"):
            out.append((lines, starts, rows))
            starts, rows, open_ = [], [], False
        elif not open_:
            raise lines.error(number, f"'{line[:40]}' outside a table", "Begin every line of the header with :START")
        else:
            rows.append(lines.numbers(number, line))
    if open_ or not out:
        raise InputError(name, "no :END: the table is not whole", "Copy the file again")
    return out


class Aerotech(Controller):
    """Common part of both formats; moves in machine coordinates are in no public source, so the check is in words."""

    comment: ClassVar[Comment | None] = Comment("; ")
    sign_known: ClassVar[bool] = False
    other_sign: ClassVar[str] = "write the tables again with --invert, or add NEGCOR to every table"
    dialect: ClassVar[Dialect | None] = None
    backlash_parameter: ClassVar[str] = (
        "the backlash distance of {axis} (BacklashDistance on many versions: compare the manual)"
    )
    first_number: ClassVar[int | None] = 1
    number_form: ClassVar[str] = "axis {}"


class Aerotech1d(Aerotech):
    """One-dimensional tables, one per axis."""

    name: ClassVar[str] = "aerotech-1d"
    title: ClassVar[str] = "Aerotech axis calibration, one-dimensional (.cal)"
    source: ClassVar[str] = "help.aerotech.com/automation1/Content/Axis-Calibration.htm"
    needs: ClassVar[str] = "Automation1 or A3200 with axes that home (or absolute encoders); user units of mm and deg"
    back: ClassVar[str] = "remove the file under Configure > Calibration and reset (Automation1), CALDISABLE (A3200)"
    doubt: ClassVar[str] = "the sign (taken as a correction that is added; NEGCOR turns it round)"

    def terms(self, setup: Setup) -> list[Term]:
        return self.curves(setup, [(m, m) for m in setup.linear if m in setup.moving])

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        lines, comment = header(self, setup), self.comment or Comment("; ")
        for table in tables:
            check_points(table.term, self.most_points)
            step, first = even_step(table.term), table.term.grids[0][0]
            axis = self.number(setup, table.term.output)
            lines += [
                comment.line(f"axis {axis} is {table.term.output}"),
                f":START {axis} SAMPLEDIST={step:.9g} POSUNIT=PRIMARY CORUNIT=PRIMARY/1000",
                f":START OFFSET={-first:.9g}",
                *(f"{1e3 * v:.5f}" for v in table.values),
                ":END",
            ]
        return {"axes.cal": "\n".join(lines) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        out = []
        for lines, starts, rows in _tables(*one_file(files, ".cal")):
            head = " ".join(starts)
            step, first = _key(lines, head, "SAMPLEDIST"), -_key(lines, head, "OFFSET")
            letter = self.numbered(setup, int(starts[0].split()[1]))
            values = 1e-3 * np.array([v for row in rows for v in row])
            grid = spaced(first, step, len(values))
            out.append(Table(Term(letter, (letter,), (grid,)), -values if "NEGCOR" in head else values))
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare the axis numbers above: in the file they count from 1, elsewhere in Automation1 from 0",
            "Configure > Calibration (Automation1), or LOADCALFILE and CALENABLE (A3200); home the axes",
            "incremental encoders: HOMEOFFSET, absolute ones: ABSOLUTEFEEDBACKOFFSET, if zero is not at the marker",
        ]


class Aerotech2d(Aerotech):
    """Two-dimensional tables, one per pair of axes, with two or three outputs."""

    name: ClassVar[str] = "aerotech-2d"
    title: ClassVar[str] = "Aerotech axis calibration, two-dimensional (.cal)"
    source: ClassVar[str] = Aerotech1d.source
    needs: ClassVar[str] = "Automation1 or A3200 with axes that home (or absolute encoders); user units of mm and deg"
    back: ClassVar[str] = (
        "remove the file under Configure > Calibration 2D and reset (Automation1), CALDISABLE 2D (A3200)"
    )
    doubt: ClassVar[str] = (
        "the sign (taken as a correction that is added; NEGCOR turns it round), that tables of several pairs of axes "
        "may move the same axis, and the sign of OFFSETROW and OFFSETCOL (taken as minus the first position)"
    )
    most_points: ClassVar[int] = 500

    def suits(self, setup: Setup) -> None:
        super().suits(setup)
        if len(setup.moving) < 2 or len(setup.linear) < 2:
            found = f"{len(setup.linear)} linear axes that correct"
            raise InputError(f"--controller {self.name}", found, "Use --controller aerotech-1d")

    def terms(self, setup: Setup) -> list[Term]:
        self.suits(setup)
        pairs = list(combinations(setup.moving, 2))
        nodes = MOST_2D_NODES if len(pairs) <= 3 else MOST_2D_NODES // 3
        return [
            Term(m, pair, grids)
            for pair in pairs
            for grids in [setup.lattice(pair, self.most_points, nodes)]
            for m in setup.linear
        ]

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        groups: dict[tuple[object, ...], list[Table]] = {}
        for table in tables:
            groups.setdefault((table.term.inputs, table.term.grids), []).append(table)
        lines, comment = header(self, setup), self.comment or Comment("; ")
        for group in groups.values():
            term = group[0].term
            step = [even_step(term, k) for k in range(2)]
            for k in range(2):
                check_points(term, self.most_points, k)
            # an output without corrections is written too, since a cell has two or three values
            outputs = [t.term.output for t in group]
            outputs += [m for m in setup.linear if m not in outputs][: max(0, 2 - len(outputs))]
            number = [self.number(setup, n) for n in (*term.inputs, *outputs)]
            third = f"OUTAXIS3={number[4]} " if len(outputs) == 3 else ""
            values = {t.term.output: t.values for t in group}
            cells = np.stack([values.get(o, np.zeros(term.shape)) for o in outputs], axis=-1)
            names = dict(zip(number, (*term.inputs, *outputs), strict=True))
            lines += [
                comment.line(", ".join(f"axis {k} is {names[k]}" for k in sorted(names))),
                "; RowAxis ColumnAxis OutputAxis1 OutputAxis2 SampDistRow SampDistCol NumCols",
                f":START2D {' '.join(map(str, number[:4]))} {step[0]:.9g} {step[1]:.9g} {term.shape[1]}",
                f":START2D {third}POSUNIT=PRIMARY CORUNIT=PRIMARY/1000 "
                f"OFFSETROW={-term.grids[0][0]:.9g} OFFSETCOL={-term.grids[1][0]:.9g}",
                *("  ".join(" ".join(f"{1e3 * v:.5f}" for v in cell) for cell in row) for row in cells),
                ":END",
            ]
        return {"axes_2d.cal": "\n".join(lines) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        out = []
        for lines, starts, rows in _tables(*one_file(files, ".cal")):
            words = starts[0].split()[1:]
            head = " ".join(starts[1:])
            if len(words) < 7:
                raise lines.error(1, f":START2D with {len(words)} figures where 7 belong", "Write the file again")
            number, steps, columns = [int(w) for w in words[:4]], [float(w) for w in words[4:6]], int(words[6])
            match = re.search(r"OUTAXIS3\s*=\s*(\d+)", head)
            number += [int(match[1])] if match else []
            names = [self.numbered(setup, k) for k in number]
            first = [-_key(lines, head, k) for k in ("OFFSETROW", "OFFSETCOL")]
            width = columns * (len(names) - 2)
            if any(len(r) != width for r in rows):
                raise lines.error(1, f"a row that has not {width} figures", "Give every row all columns")
            values = 1e-3 * np.array(rows).reshape(len(rows), columns, -1) * (-1.0 if "NEGCOR" in head else 1.0)
            shape = (len(rows), columns)
            grids = tuple(map(spaced, first, steps, shape))
            inputs = (names[0], names[1])
            out += [Table(Term(o, inputs, grids), values[:, :, k]) for k, o in enumerate(names[2:])]
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare the axis numbers above: in the file they count from 1, elsewhere in Automation1 from 0",
            "Configure > Calibration 2D (Automation1), or LOADCALFILE with 2D_CAL and CALENABLE 2D (A3200)",
            "every line of a table's header begins with :START2D",
        ]
