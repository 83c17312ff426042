"""Volumetric compensation of the ISG kernel, sold by Beckhoff as TF5280: error parameters in ISG_CSV.

White-space separated tables: a header of argument and parameter names, rows below, ``//`` before comments, ``#`` before
a further header. Offsets in mm, angles in rad; arguments in mm, and degrees for rotary axes. Errors may be tabulated
over several axes.

Temperature: a linear function of position for each axis, whose offset and coefficient the PLC writes.

Source: Beckhoff Infosys TF5280, pages 296423819 (parameters), 296429067 (ISG CSV), 296390283 (configuration), and the
kernel's documentation at isg-stuttgart.de (temperature compensation: 308654475, and TF5200 15266957451).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from errormodel.controllers.axes import in_order
from errormodel.controllers.base import header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.grids import nodes
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_increasing, check_points
from errormodel.controllers.text import Comment, Files, Lines, one_file
from errormodel.controllers.thermal import Growth, States, Thermal, sign_program, thermal
from errormodel.controllers.volumetric import KINEMATIC, Volumetric
from errormodel.exceptions import InputError

SIGN_DOUBT = (
    "the sign of the parameters (taken as errors, actual minus nominal; `negate XYZ` in the list turns them round) and "
    "the point an angle's lever is counted from (taken as machine zero, P0X P0Y P0Z, for linear axes and as the centre "
    "PXC PYC PZC for a rotary one)"
)

LIST_COMMENT = Comment("# ")
ISG_THERMAL_DOUBT = "the sign (taken as that of a deviation: a positive value moves the axis in minus direction)"


def temperature_file(found: Sequence[Growth]) -> dict[str, str]:
    """Axis parameters of the kernel's own temperature compensation, and the functions that the PLC evaluates."""
    sensor, zero = found[0].sensor, found[0].zero
    said = [
        "temperature compensation: offset_0[T] + coefficient[T] times [position - position_0], axis by axis",
        "for the parameters of the middling folder only; of each axis into its own list",
        f"offset and coefficient are zero at {sensor} = {zero:.3f}, the PLC writes them as that changes:",
        "temp_comp_offset_0 = -1e4 times the mm, temp_comp_coefficient = -1e6 times mm/mm, times the kelvin above",
        *(f"correct {g.line()}" for g in found),
        f"NOT CERTAIN: {ISG_THERMAL_DOUBT}",
        "follow sign_test/temperature.txt first",
    ]
    lines = list(map(LIST_COMMENT.line, said))
    for g in found:
        lines += [
            f"kopf.log_achs_name {g.axis}",
            "lr_param.temp_comp 1",
            "lr_param.temp_comp_position_0 0",
            "lr_param.temp_comp_offset_0 0",
            "lr_param.temp_comp_coefficient 0",
        ]
    test = sign_program(found[0].axis, "write lr_param.temp_comp_offset_0 = 500 into its list, and load that")
    return {"temp_comp.lis": "\n".join(lines) + "\n", **test}


class Kernel(Volumetric):
    """Common part of the kernel's formats."""

    comment: ClassVar[Comment | None] = Comment("// ")
    sign_known: ClassVar[bool] = False
    other_sign: ClassVar[str] = "add the line 'negate XYZ' to vol_comp_0.lis, or write the tables again with --invert"
    backlash_parameter: ClassVar[str] = "getriebe[0].lose of {axis} (P-AXIS-00103; P-AXIS-00021 switches it on)"
    first_number: ClassVar[int | None] = 1
    number_form: ClassVar[str] = "logical axis {}"
    dialect: ClassVar[Dialect | None] = Dialect(
        suffix=".nc",
        comment=Comment("(", ")"),
        opening=("%{name}",),
        head=("G90 G71 G94 D0", "#MCS ON"),
        move="G01 {axis}{to:.3f} F{feed:g}",
        end=("#MCS OFF", "M30"),
        needs=(
            "#MCS counts in machine coordinates; it needs the licence Transformations: without it drive there by hand",
            "the unit of F is mm/min: check it, it is configured",
        ),
        source="infosys.beckhoff.com tf5200_programming_manual 208517515 (#MCS ON: offsets and transformations off)",
    )

    def about(self, tables: Tables, setup: Setup) -> list[str]:
        tip = " ".join(f"{v:g}" for v in setup.tool)
        lines = [
            "levers: the file states P0X P0Y P0Z = 0; nothing else on the control may set them, nor IDX IDY IDZ. They "
            f"are those of the tool's tip at {tip} (--tool): N0X N0Y N0Z, which make the kernel add the tool's length, "
            "must not be set"
        ]
        centres = [a.name for a in setup.ordered if a.rotary and a.name in self.measured(setup)]
        if centres:
            lines.append(
                f"centres of {', '.join(centres)} (PXC ...) stand in the file, from where the tip is with all axes at "
                "zero: compare them with the control's kinematics; workpiece_axes 0 counts every axis as one that "
                "moves the tool, as errormodel does"
            )
        return lines

    def backlash_value(self, setup: Setup, axis: str, size: float) -> str:
        unit = "0.0001 deg" if setup.axis(axis).rotary else "0.1 um"
        return f"{round(1e4 * size):+d} (in {unit})"


def configuration(controller: Kernel, setup: Setup, file: str, form: str, names: tuple[str, ...]) -> str:
    """List file that names axes, chain and parameter file."""
    return "\n".join(
        [
            LIST_COMMENT.line("volumetric compensation: logical axis numbers, to be those of this controller"),
            *(f"{name} {controller.number(setup, name)}" for name in in_order(names)),
            f"chain {''.join(names)}",
            "workpiece_axes 0",
            "interpolation GRID",
            f"file[0] {file}",
            f"file_format[0] {form}",
            "",
        ]
    )


class Isg(Kernel):
    """Error parameters in ISG_CSV."""

    name: ClassVar[str] = "isg"
    title: ClassVar[str] = "Beckhoff TF5280 / ISG kernel volumetric compensation (ISG_CSV)"
    source: ClassVar[str] = "infosys.beckhoff.com TF5280: 296423819, 296429067, 296390283"
    needs: ClassVar[str] = (
        "an ISG kernel or TwinCAT CNC with volumetric compensation (licence TF5280); linear axes X, Y and Z"
    )
    back: ClassVar[str] = "#VOLCOMP OFF [ID0]; take vol_comp[0] out of the start-up list and restart"
    doubt: ClassVar[str] = SIGN_DOUBT
    most_points: ClassVar[int] = 2000

    def thermal(self, states: States, setup: Setup) -> Thermal | None:
        return thermal(states, setup, self.emulate, temperature_file, ISG_THERMAL_DOUBT)

    def structures(self, setup: Setup) -> list[list[Term]]:
        """Six motions per axis over its own position; then also translations of the last linear axis over all of them.

        The latter represent errors that are no rigid motion of one axis, such as sag that depends on two positions.
        """
        linear = tuple(a for a in self.measured(setup) if not setup.axis(a).rotary)
        plain = self.terms(setup)
        if not linear:
            return [plain]
        lattice = setup.lattice(linear, self.most_points, 160)
        last = linear[-1]
        more = [
            Term(t.output, linear, lattice) if t.output[:2] in ("EX", "EY", "EZ") and t.inputs == (last,) else t
            for t in plain
        ]
        return [plain, more]

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        groups: dict[tuple[object, ...], list[Table]] = {}
        for table in tables:
            for axis in range(len(table.term.inputs)):
                check_points(table.term, self.most_points, axis)
                check_increasing(table.term, axis)
            groups.setdefault((table.term.inputs, table.term.grids), []).append(table)
        constants = self.kinematics(setup)
        lines = [*header(self, setup), " ".join(constants), " ".join(f"{v:.9g}" for v in constants.values())]
        for group in groups.values():
            term = group[0].term
            lines.append("#")
            lines.append(" ".join([*term.inputs, *(t.term.output for t in group)]))
            values = np.column_stack([t.values.ravel() for t in group])
            lines += [
                " ".join([*(f"{x:.9g}" for x in q), *(f"{v:.9e}" for v in e)])
                for q, e in zip(nodes(term.grids), values, strict=True)
            ]
        text = "\n".join(lines) + "\n"
        count = sum(t.term.size for t in tables) + len(constants)
        start = (
            f"{LIST_COMMENT.line('start-up list')}\nvol_comp[0].file_name vol_comp_0.lis\n"
            f"vol_comp[0].max_records {count}\n"
        )
        return {
            "vol_comp_0.csv": text,
            "vol_comp_0.lis": configuration(self, setup, "vol_comp_0.csv", "ISG_CSV", self.measured(setup)),
            "hochlauf.lis": start,
        }

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".csv")
        lines = Lines.of(name, text, ("//",))
        out: list[Table] = []
        head: list[str] = []
        start, rows = 0, list[list[float]]()

        def close() -> None:
            if head and not all(map(KINEMATIC.fullmatch, head)):
                out.extend(_block(lines, start, head, rows))

        for number, line in lines.lines:
            if line.startswith("#"):
                close()
                head, rows = [], []
            elif not head:
                head, start = line.split(), number
            else:
                rows.append(lines.numbers(number, line, len(head)))
        close()
        if not out:
            raise InputError(name, "no tables", "Give an ISG_CSV file")
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare the logical axis numbers in vol_comp_0.lis; add the lines of hochlauf.lis to the control's "
            "start-up list, with the path of vol_comp_0.lis (do not copy hochlauf.lis itself: it would replace the "
            "control's)",
            "copy vol_comp_0.csv and vol_comp_0.lis to the controller and restart it (licence TF5280)",
            "NC: #VOLCOMP ON [ID0]; to load again: #VOLCOMP OFF, then #VOLCOMP [ID0 UPDATE]",
            "leave leadscrew and cross compensations of these axes as they were when the survey was measured",
        ]


def _block(lines: Lines, number: int, head: list[str], rows: list[list[float]]) -> list[Table]:
    """Tables of one header and its rows."""
    inputs = tuple(h for h in head if len(h) == 1)
    data = np.array(rows).reshape(-1, len(head))
    grids = tuple(tuple(np.unique(data[:, k]).tolist()) for k in range(len(inputs)))
    if head[: len(inputs)] != list(inputs) or not np.array_equal(nodes(grids), data[:, : len(inputs)]):
        raise lines.error(number, "rows that are no grid in order", "Give every node once, the last argument fastest")
    return [
        Table(Term(h, inputs, grids), data[:, k].reshape([len(g) for g in grids]))
        for k, h in enumerate(head)
        if len(h) > 1
    ]
