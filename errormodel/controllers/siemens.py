"""Siemens Sinumerik: leadscrew errors (``$AA_ENC_COMP``), and cross errors with products of tables (``$AN_CEC``).

Interpolation is linear between equidistant points, and end values hold. LEC: one table per axis for both directions,
added to the actual value, so a positive value moves the axis back: the file holds errors; the value at the reference
point must be 0. CEC: a table has a base axis, a compensated axis and a direction, and may be multiplied by another
table: that one is here a lever arm (position in m) or the sine or 1 - cosine of a rotary axis. Tables of one
compensated axis add up.

Temperature: a linear function of position whose offset and slope (``$SA_TEMP_COMP_ABS_VALUE``, ``..._SLOPE``) the PLC
writes as temperatures change.

Source: SINUMERIK 840D sl/828D function manual Extended Functions (K3 Compensations), 6FC5397-1BP40-3BA1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.grids import spaced
from errormodel.controllers.rotary_lines import Line, remark, uncertainties
from errormodel.controllers.setup import FULL_TURN, Axis, Setup
from errormodel.controllers.tables import (
    Table,
    Tables,
    Term,
    check_points,
    even_step,
    factor,
    shift_lines,
    shift_terms,
    shifts_of,
)
from errormodel.controllers.text import Comment, Files, one_file
from errormodel.controllers.thermal import Growth, States, Thermal, sign_program, thermal
from errormodel.exceptions import InputError

SEMICOLON_COMMENT = Comment("; ")
NUMBER_PATTERN = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
LEC = re.compile(rf"\$AA_ENC_COMP(?:_(\w+))?\[0,(?:(\d+),)?(\w+)1\]=({NUMBER_PATTERN})")
CEC = re.compile(rf"\$AN_CEC(?:_(\w+))?\[(\d+)(?:,(\d+))?\]=\(?({NUMBER_PATTERN}|\w+1)\)?")
SIEMENS_THERMAL_DOUBT = "the sign (taken as that of $AA_ENC_COMP: a positive value moves the axis in minus direction)"
LEVER = re.compile(r"^; \[(\d+)\] only multiplies others: ((?:sin |cos )?\w+)$", re.MULTILINE)
# deg between points of a sine table: linear interpolation then errs by less than 0.03 % of the amplitude
SINE_STEP_DEG = 2.5
# $TC_CARR that hold each vector of swivel data
SWIVEL_NUMBERS = {
    "I1": "1 to 3", "I2": "4 to 6", "V1": "7 to 9", "V2": "10 to 12", "I3": "15 to 17", "I4": "18 to 20"
}  # fmt: skip


def _file(text: str) -> str:
    """Text without comments; archives must end with M17."""
    if not text.rstrip().endswith("M17"):
        raise InputError("files", "no M17: the archive is not whole", "Copy the file again")
    return "\n".join(line.split(";")[0] for line in text.splitlines())


def _grid(step: float, low: float, high: float, count: int, where: str) -> tuple[float, ...]:
    if step <= 0 or abs((high - low) / step + 1 - count) > 1e-6:
        found = f"{count} points from {low:g} to {high:g} in steps of {step:g}"
        raise InputError(where, found, "STEP must divide MAX - MIN, with one point more than steps")
    return spaced(low, step, count)


def temperature_file(found: Sequence[Growth]) -> dict[str, str]:
    """Machine and setting data of the control's temperature compensation, and the functions that the PLC evaluates."""
    sensor, zero = found[0].sensor, found[0].zero
    said = [
        "temperature compensation: K0[T] + tan beta[T] times [position - P0], for the middling folder's tables only",
        f"K0 and tan beta are zero at {sensor} = {zero:.3f}, the PLC [FB3 PUT] writes them as that changes:",
        "$SA_TEMP_COMP_ABS_VALUE = minus the mm, $SA_TEMP_COMP_SLOPE = minus the mm/mm, times the kelvin above",
        *(f"correct {g.line()}" for g in found),
        f"NOT CERTAIN: {SIEMENS_THERMAL_DOUBT}",
        "follow sign_test/temperature.txt first",
    ]
    lines = [*map(SEMICOLON_COMMENT.line, said), "CHANDATA(1)"]
    for g in found:
        lines += [
            f"$MA_TEMP_COMP_TYPE[{g.axis}1]=3",
            f"$SA_TEMP_COMP_REF_POSITION[{g.axis}1]=0",
            f"$SA_TEMP_COMP_ABS_VALUE[{g.axis}1]=0",
            f"$SA_TEMP_COMP_SLOPE[{g.axis}1]=0",
        ]
    axis = found[0].axis
    test = sign_program(axis, f"write $SA_TEMP_COMP_ABS_VALUE[{axis}1] = 0.05, as setting data or a line of its own")
    return {"TEMP_COMP.INI": "\n".join([*lines, "M17"]) + "\n", **test}


class Siemens(Controller):
    """Common part of both formats: axis names, comments, the programme of the check."""

    comment: ClassVar[Comment | None] = SEMICOLON_COMMENT
    backlash_parameter: ClassVar[str] = "MD32450 $MA_BACKLASH[0,{axis}]"
    dialect: ClassVar[Dialect | None] = Dialect(
        suffix=".MPF",
        comment=SEMICOLON_COMMENT,
        head=("TRAFOOF", "G17 G40 G90 G94 G500 G60 G710 D0"),
        move="SUPA G1 {axis}={to:.3f} F{feed:g}",
        end=("M30",),
        source="SINUMERIK 6FC5397-0BP40 K2 (SUPA: all frames, DRF and external offsets off, block by block), "
        "not checked in a manual: G710, D0, TRAFOOF and DIAMOF, and SUPA with G1",
        needs=("SUPA counts in machine coordinates; D0 takes the tool's offsets off; no tool in the spindle",),
        radii="DIAMOF",
    )

    def address(self, setup: Setup, name: str) -> str:
        return f"{name}1"

    def describe(self, lines: Sequence[Line], setup: Setup) -> list[str]:
        """Changes of the vectors of a swivel data set or 5-axis transformation (6FC5397-1DP40, IM9, 22.6 and 21.7)."""
        order, made = _swivel(lines)
        if not made:
            return super().describe(lines, setup)
        std = uncertainties(lambda x: _swivel(x)[1], lines)
        out = [
            f"swivel data of {order[0].axis} as rotary axis 1" + "".join(f" and {x.axis} as 2" for x in order[1:])
            + ", $TC_CARR of the data set n (as fine offsets $TC_CARR41 to 60), or the MD24500 to MD24572 of the "
            "transformation; with a kinematic chain ($NK_) the offset elements of these axes. Add, in mm x y z:"
        ]  # fmt: skip
        for k in sorted(made):
            digits = 7 if k.startswith("V") else 4
            numbers = " ".join(f"{v + 0.0:+.{digits}f}" for v in made[k])
            out.append(f"  {k} ($TC_CARR{SWIVEL_NUMBERS[k]}): {numbers}{remark(std.get(k), digits, self.comment)}")
        for n, one in enumerate(order, 1):
            way = " ".join(f"{v:+g}" for v in one.along)
            out.append(
                f"  (V{n} for a vector of length 1 along {way}; the other signs where the control has it the other way)"
            )
        out.append("the vectors are taken to end at the points of the axes that are named above (a tilt shifts others)")
        return [*out, "the closing vector only where the head or table cannot be changed; the sign is to be tested"]


def _swivel(lines: Sequence[Line]) -> tuple[tuple[Line, ...], dict[str, Array]]:
    """Axes 1 and 2 of the swivel data, and changes of its vectors; none for other machines."""
    heads, tables = ([x for x in lines if x.side == side] for side in ("head", "table"))
    at = {x.axis: np.array(x.shift) for x in lines}
    order: tuple[Line, ...]
    if len(heads) == 2 and not tables:
        order = (heads[0], heads[1])
        made = {"I2": at[heads[0].axis] - at[heads[1].axis], "I3": at[heads[1].axis]}
        made["I1"] = -(made["I2"] + made["I3"])
    elif len(tables) == 2 and not heads:
        order = (tables[1], tables[0])
        made = {"I2": at[tables[1].axis], "I3": at[tables[0].axis] - at[tables[1].axis]}
        made["I4"] = -(made["I2"] + made["I3"])
    elif len(heads) == 1 and len(tables) == 1:
        order = (heads[0], tables[0])
        head, table = (at[x.axis] for x in order)
        made = {"I2": head, "I1": -head, "I3": table, "I4": -table}
    elif len(lines) == 1 and tables:
        order = (tables[0],)
        made = {"I2": at[tables[0].axis], "I4": -at[tables[0].axis]}
    else:
        return (), {}
    return order, made | {f"V{n}": np.cross(x.tilt, x.along) for n, x in enumerate(order, 1)}


class SiemensLec(Siemens):
    """Leadscrew error compensation, ``$AA_ENC_COMP``."""

    sign_known: ClassVar[bool] = True

    name: ClassVar[str] = "siemens-lec"
    title: ClassVar[str] = "Siemens Sinumerik leadscrew error compensation ($AA_ENC_COMP)"
    source: ClassVar[str] = "SINUMERIK Extended Functions 6FC5397-1BP40-3BA1, K3, p. 237-242"
    needs: ClassVar[str] = (
        "a Sinumerik with leadscrew error compensation, memory for its points (MD38000), and the manufacturer's "
        "password"
    )
    back: ClassVar[str] = "MD32700 $MA_ENC_COMP_ENABLE = 0 and reset; reference the axes"
    most_points: ClassVar[int] = 1000

    def terms(self, setup: Setup) -> list[Term]:
        curves = self.curves(setup, [(m, m) for m in setup.linear if m in setup.moving], zero=True)
        return [*curves, *shift_terms(curves)]

    def thermal(self, states: States, setup: Setup) -> Thermal | None:
        return thermal(states, setup, self.emulate, temperature_file, SIEMENS_THERMAL_DOUBT)

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        lines = ["%_N_AX_EEC_INI", *header(self, setup, *shift_lines(tables)), "CHANDATA(1)"]
        for table in (t for t in tables if t.term.inputs):
            term, axis = table.term, f"{table.term.output}1"
            check_points(term, self.most_points)
            step = even_step(term)
            lines += [f"$AA_ENC_COMP[0,{k},{axis}]={-v:.6f}" for k, v in enumerate(table.values)]
            lines += [
                f"$AA_ENC_COMP_STEP[0,{axis}]={step:.9g}",
                f"$AA_ENC_COMP_MIN[0,{axis}]={term.grids[0][0]:.9g}",
                f"$AA_ENC_COMP_MAX[0,{axis}]={term.grids[0][-1]:.9g}",
                f"$AA_ENC_COMP_IS_MODULO[0,{axis}]=0",
            ]
        return {"AX_EEC.INI": "\n".join([*lines, "M17"]) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".ini")
        values: dict[str, list[float]] = {}
        keys: dict[str, dict[str, float]] = {}
        for key, _, axis, number in LEC.findall(_file(text)):
            if key:
                keys.setdefault(axis, {})[key] = float(number)
            else:
                values.setdefault(axis, []).append(-float(number))
        out = []
        for axis, v in values.items():
            k = keys.get(axis, {})
            grid = _grid(k.get("STEP", 0.0), k.get("MIN", 0.0), k.get("MAX", 0.0), len(v), f"{name}, axis {axis}")
            out.append(Table(Term(axis, (axis,), (grid,), zero=True), np.array(v)))
        return (*out, *shifts_of(text))

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "rename the axes X1, Y1, ... to this machine's axis names",
            "MD38000 $MA_MM_ENC_COMP_MAX_POINTS at least the points (back up first: memory is formatted anew)",
            "MD32700 $MA_ENC_COMP_ENABLE = 0, load AX_EEC.INI, MD32700 = 1, reset, reference the axes",
            "the table is zero at the reference point, and adds to the actual value: check with an indicator",
        ]


class SiemensCec(Siemens):
    """Sag and cross error compensation, ``$AN_CEC``."""

    sign_known: ClassVar[bool] = False
    other_sign: ClassVar[str] = "write the tables again with --invert"

    name: ClassVar[str] = "siemens-cec"
    title: ClassVar[str] = "Siemens Sinumerik cross error compensation ($AN_CEC), products of tables included"
    source: ClassVar[str] = "SINUMERIK Extended Functions 6FC5397-1BP40-3BA1, K3, p. 249-264; 840D sl p. 277"
    needs: ClassVar[str] = (
        "a Sinumerik with the option sag compensation (multi-dimensional), as many tables and points as are "
        "named, and the manufacturer's password"
    )
    back: ClassVar[str] = "MD32710 $MA_CEC_ENABLE = 0 and $SN_CEC_TABLE_ENABLE[t] = 0 for every t, then reset"
    doubt: ClassVar[str] = (
        "the sign of $AN_CEC (taken as that of $AA_ENC_COMP: a positive value moves the axis in minus direction), and "
        "that a table which only multiplies others does not act by itself while $SN_CEC_TABLE_ENABLE is 0 for it"
    )
    bidirectional: ClassVar[bool] = True
    most_points: ClassVar[int] = 200
    few_tables: ClassVar[int | None] = 8  # an 828D, and an 840D sl of four axes
    most_tables: ClassVar[int | None] = 55  # of 62 on an 840D sl, the rest being lever tables

    def terms(self, setup: Setup) -> list[Term]:
        out = self.curves(setup, [(m, i) for m in setup.linear for i in setup.moving])
        for name in setup.moving:
            for other in (o for o in setup.moving if o != name):
                kinds = ("sin ", "cos ") if setup.axis(other).rotary else ("",)
                grid = setup.grid(name, self.most_points)
                out += [Term(m, (name,), (grid,), factor=kind + other) for m in setup.linear for kind in kinds]
        return out

    def thermal(self, states: States, setup: Setup) -> Thermal | None:
        return thermal(states, setup, self.emulate, temperature_file, SIEMENS_THERMAL_DOUBT)

    def _lever(self, setup: Setup, name: str) -> tuple[Array, Array]:
        """Positions and values of a table that multiplies others."""
        axis = setup.axis(name.rpartition(" ")[2])
        low, high = np.floor(axis.measured[0]), np.ceil(axis.measured[1])
        if axis.rotary:
            high = low + SINE_STEP_DEG * np.ceil((high - low) / SINE_STEP_DEG)
        x = np.linspace(low, high, round((high - low) / SINE_STEP_DEG) + 1) if axis.rotary else np.array([low, high])
        full = np.zeros((len(x), len(setup.axes)))
        full[:, setup.place(axis.name)] = x
        return x, np.round(factor(setup, name, full), 9)

    def used(self, terms: Sequence[Term]) -> int:
        return len(terms) + len({t.factor for t in terms if t.factor})

    def needed(self, tables: Tables) -> str:
        count, own = self.used([t.term for t in tables]), len(tables)
        which = f" (t = {', '.join(map(str, range(count - own)))})" if count > own else ""
        return (
            f"{count} tables of $AN_CEC are needed: {own} corrections and {count - own} that only multiply "
            f"others{which}. An 840D sl has 2 a machine axis, an 828D has 8; compare MD18342, and the option for sag "
            "compensation"
        )

    def about(self, tables: Tables, setup: Setup) -> list[str]:
        return [
            *(() if self.heed(tables) else (self.needed(tables),)),
            *(
                f"{a.name} goes round: its tables are modulo ({a.measured[0]:g} to {a.measured[1]:g} deg), and it must "
                "be a modulo axis of that range (MD30310, MD30330)"
                for a in setup.ordered
                if a.turns
            ),
        ]

    def by_itself(self, tables: Tables, setup: Setup, q: Array) -> dict[str, float]:
        levers = {t.term.factor for t in tables if t.term.factor and " " not in t.term.factor}
        return {name: -float(q[0, setup.place(name)]) / 1000 for name in levers}

    def emulate(
        self, tables: Tables, setup: Setup, q: Array, direction: Array | None = None, longer: Array | None = None
    ) -> Array:
        sign = np.ones_like(q) if direction is None else direction
        out = np.zeros((len(q), len(setup.movers)))
        for table in tables:
            term = table.term
            own = Table(Term(term.output, term.inputs, term.grids, direction=term.direction), table.values)
            value = own.at(setup, q, sign)
            if term.factor:
                x, lever = self._lever(setup, term.factor)
                turns = setup.axis(term.factor.rpartition(" ")[2]).turns
                place = q[:, setup.place(term.factor.rpartition(" ")[2])]
                value = value * np.interp(x[0] + np.mod(place - x[0], FULL_TURN) if turns else place, x, lever)
            out[:, setup.movers.index(term.output)] += value
        return out

    def quantum(self, setup: Setup) -> float:
        # the rounding of every table, times the lever (m) by which it is multiplied
        return 1e-9 * len(self.terms(setup)) * max(1.0, *(abs(v) / 1000 for a in setup.axes for v in a.travel))

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        factors = list(dict.fromkeys(t.term.factor for t in tables if t.term.factor))
        number = {f: k for k, f in enumerate(factors)}  # numbers of the lever tables, which come first
        lines = ["%_N_NC_CEC_INI", *header(self, setup), "CHANDATA(1)"]
        for name, t in number.items():
            x, lever = self._lever(setup, name)
            axis = name.rpartition(" ")[2]
            lines.append(f"; [{t}] only multiplies others: {name}")
            lines += self._table(t, x, lever, setup.axis(axis), axis, 0, 0)
        for t, table in enumerate(tables, start=len(factors)):
            term = table.term
            check_points(term, self.most_points)
            even_step(term)
            multiply = number[term.factor] + 1 if term.factor else 0
            x = np.asarray(term.grids[0])
            source = setup.axis(term.inputs[0])
            lines += self._table(t, x, -table.values, source, term.output, term.direction, multiply)
        if len(tables) + len(factors) > 62:
            found = f"{len(tables) + len(factors)} tables, of which the control has 62"
            raise InputError("tables", found, "Leave some out")
        return {"NC_CEC.INI": "\n".join([*lines, "M17"]) + "\n"}

    @staticmethod
    def _table(t: int, x: Array, values: Array, source: Axis, target: str, direction: int, multiply: int) -> list[str]:
        return [
            *(f"$AN_CEC[{t},{k}]={v:.9f}" for k, v in enumerate(values)),
            f"$AN_CEC_INPUT_AXIS[{t}]=({source.name}1)",
            f"$AN_CEC_OUTPUT_AXIS[{t}]=({target}1)",
            f"$AN_CEC_STEP[{t}]={(x[-1] - x[0]) / (len(x) - 1):.9g}",
            f"$AN_CEC_MIN[{t}]={x[0]:.9g}",
            f"$AN_CEC_MAX[{t}]={x[-1]:.9g}",
            f"$AN_CEC_DIRECTION[{t}]={direction}",
            f"$AN_CEC_MULT_BY_TABLE[{t}]={multiply}",
            f"$AN_CEC_IS_MODULO[{t}]={int(source.turns)}",
        ]

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".ini")
        levers = {int(t): f for t, f in LEVER.findall(text)}
        values: dict[int, list[float]] = {}
        keys: dict[int, dict[str, str]] = {}
        for key, t, _, value in CEC.findall(_file(text)):
            if key:
                keys.setdefault(int(t), {})[key] = value
            else:
                values.setdefault(int(t), []).append(-float(value))
        out = []
        for t, v in values.items():
            k = keys.get(t, {})
            where = f"{name}, table {t}"
            try:
                step, low, high = (float(k[n]) for n in ("STEP", "MIN", "MAX"))
                source, target = k["INPUT_AXIS"][:-1], k["OUTPUT_AXIS"][:-1]
                direction, multiply = int(k["DIRECTION"]), int(k["MULT_BY_TABLE"])
            except KeyError as error:
                raise InputError(where, f"no $AN_CEC_{error.args[0]}", "Write the file again") from error
            grid = _grid(step, low, high, len(v), where)
            if t in levers:
                continue
            if multiply and multiply - 1 not in levers:
                found = f"multiplied by table {multiply - 1}, which is none of the lever tables"
                raise InputError(where, found, "Give the file as it was written, comments included")
            term = Term(target, (source,), (grid,), levers[multiply - 1] if multiply else "", direction)
            out.append(Table(term, np.array(v)))
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "rename the axes X1, Y1, ... to this machine's axis names",
            "MD18342 $MN_MM_CEC_MAX_POINTS[t] at least the points of table t (back up first: memory is formatted anew)",
            "MD32710 $MA_CEC_ENABLE = 0 for all axes, and $SN_CEC_TABLE_ENABLE[t] = 0 for every t: one that was on for "
            "other tables, such as those of the check of signs, may only multiply now; load NC_CEC.INI",
            "$SN_CEC_TABLE_ENABLE[t] = 1 for the tables that were loaded, but not for those marked 'only multiplies "
            "others': t is the first number of $AN_CEC[t,k] and counts from 0",
            "MD32710 = 1 for the compensated axes, reset, reference; MD32720 and MD32730 must allow the values",
        ]
