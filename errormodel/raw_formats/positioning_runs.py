"""Tables of positioning tests (ISO 230-2) with their runs side by side: a row (or a column) a target position.

``1↑ 1↓ 2↑ 2↓``, ``Run 1 +``, ``F1 B1``, ``vor 1 zurück 1``: each run of each direction is a column, or a row of the
same table the other way round. Columns of means and of other results are passed over.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.conventions import MOTIONS, unit_of
from errormodel.exceptions import InputError
from errormodel.formats.base import as_numbers
from errormodel.machine import Joint
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, ReadAs, Recording
from errormodel.raw_formats.cells import kind_of, split
from errormodel.raw_formats.direction_words import side_of
from errormodel.raw_formats.layout import Layout
from errormodel.raw_formats.positioning import axis_above, joint_for, motion_rows, other_axis
from errormodel.raw_formats.positioning_test import TARGET, axis_in
from errormodel.raw_formats.table_columns import table_of_text
from errormodel.raw_formats.unit_words import bracketed, unit_word, without_tail
from errormodel.units import Quantity, is_unit, to_internal

MOST_ROWS = 200  # of a table with a row a run: there are some ten, and means below them
MOST_RUNS = 20  # of a direction, that `--columns 1+=..` can name
NEAR = 0.05  # of the range of the targets: readings that lie so near to these are positions, no deviations
_RUN = frozenset((
    "run", "runs", "lauf", "messlauf", "cycle", "zyklus", "series", "serie", "reihe", "messreihe", "messung", "pass",
    "measurement", "no", "nr", "j", "dev", "deviation", "abweichung", "error", "ist", "actual", "position", "approach",
    "x",
))  # fmt: skip
_SHORT = frozenset(("no", "nr", "j", "x", "position", "ist", "actual", "error", "dev", "deviation", "abweichung"))
_HEADS = _RUN | {"direction", "dir", "richtung", "anfahrrichtung"}  # above the columns of numbers and sides
_TOKEN = re.compile(r"[^\W\d_]+|\d+|[\u2190-\u2193+\-\u2013\u2212]")
_AGAIN = re.compile(r"\s*\((\d+)\)$")  # behind a name that comes again
_PLACE = re.compile(r"(mess)?pos(ition)?|p(unkt)?|x|y|z|u|v|w|a|b|c", re.IGNORECASE)
_COUNTED = re.compile(r"i|no|nr|(target|ziel|punkt|point)?\s*(no|nr|number|i)\.?", re.IGNORECASE)
_AXIS = re.compile(r"(.*?)[\s_.]*\b([xyz])", re.IGNORECASE)
_STATED = re.compile(
    r"(?:deviation|abweichung|error|dev\.?)\w*\s*(?:in|[\[(:/=,;])\s*(\w+(?:/m\b)?)", re.IGNORECASE
)  # a unit above the table


@dataclass(frozen=True)
class Runs:
    """Readings (targets, runs) as they stand, with the number and the side of each run."""

    targets: Array
    readings: Array
    numbers: tuple[int, ...]
    sides: tuple[float, ...]
    lines: tuple[int, ...]
    target_unit: str
    unit: str
    hint: str
    left: tuple[str, ...]


class PositioningRuns(RawFormat):
    """One joint's readings, a column (or a row) a run; they become its error motion along its axis."""

    name = "positioning-runs"
    title = "a positioning test of one joint, its runs side by side"
    source = "ISO 230-2, table of results; names of columns as laboratories write them"
    uses = ("joint",)
    of_pairs = True
    columns = ("target", "deviation", "actual", *(f"{k}{s}" for k in range(1, MOST_RUNS + 1) for s in "+-"))

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        return table is not None and (runs_in(table) is not None or len(_without_side(table)) > 1)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        table = table_of_text(raw)
        runs = runs_in(table)
        if runs is None:
            bare = _without_side(table)
            found = f"no target positions beside runs with their directions, among {', '.join(table.names[:12])}"
            if bare:
                found = f"runs side by side of which it does not say the direction: {', '.join(bare[:6])}"
            one, two = (*bare, "A", "B")[:2]
            cure = f"Say it run by run: --columns 1+={one},1-={two},2+=.. where they went there and back, "
            cure += f"1+={one},2+={two},.. "
            cure += (
                "where all came from smaller positions (- from larger ones); target=.. is the column of the positions"
            )
            raise InputError(raw.name, found, cure)
        stated = unit_word(
            asked.units.get("target", runs.target_unit or table.length_unit or _unit_above(table) or "mm")
        )
        hint = axis_in(runs.hint) or axis_above(raw)
        joint = joint_for(raw.name, asked, hint, rotary=is_unit(stated, "angle"))
        quantity: Quantity = "angle" if joint.type == "rotary" else "length"
        if not is_unit(stated, quantity):
            usual = "deg" if joint.type == "rotary" else "mm"
            if runs.target_unit or "target" in asked.units:
                found = f"target positions in '{stated}', and {joint.name} is {joint.type}"
                raise InputError(raw.name, found, f"Say --units target={usual}, or another --joint")
            stated = usual
        target = to_internal(runs.targets, stated, quantity)
        deviation, what, read_as = _deviations(raw, asked, runs, target, joint, stated)
        rows = [(k, i) for k in range(len(runs.numbers)) for i in _way(target, runs.sides[k]).tolist()]
        rows = [(k, i) for k, i in rows if np.isfinite(deviation[i, k])]
        run, at = (np.array(part, dtype=np.intp) for part in zip(*rows, strict=True))
        position = np.degrees(target[at]) if joint.type == "rotary" else target[at]
        frame = motion_rows(
            joint, position, deviation[at, run], "rad" if joint.type == "rotary" else "mm",
            [str(runs.numbers[k]) for k in run], np.array(runs.sides)[run],
        )  # fmt: skip
        usual = "deg" if joint.type == "rotary" else "mm"
        units = {joint.name: usual} | {name: unit_of(name) for name in MOTIONS if name in frame}
        count = len({*runs.numbers})
        ways = f"{count} run{'s' * (count > 1)}{', both ways' if len({*runs.sides}) > 1 else ', one way'}"
        notes = [*raw.notes, f"{len(target)} targets, {ways}; {what} of {joint.name} along its axis"]
        notes += other_axis(joint, asked, hint)
        if runs.left:
            notes.append(f"not used: {', '.join(runs.left)}")
        if missing := int(np.isnan(deviation).sum()):
            notes.append(f"{missing} readings missing")
        lines = tuple(runs.lines[i] for i in at) if runs.lines else ()
        read = {n: read_as for n in MOTIONS if n in frame} | {joint.name: ReadAs("target", stated)}
        return Recording(frame, units, lines, tuple(notes), beside_targets=read_as.word == "actual", read_as=read)


def _deviations(
    raw: RawFile, asked: Asked, runs: Runs, target: Array, joint: Joint, usual: str
) -> tuple[Array, str, ReadAs]:
    """Readings less targets in mm or rad, what the readings were, and the word for them with their unit.

    `usual`: unit of the targets, which positions beside them have where they state none.
    """
    quantity: Quantity = "angle" if joint.type == "rotary" else "length"
    said = next((asked.units[w] for w in ("deviation", "actual") if w in asked.units), runs.unit)
    unit = unit_word(said)
    if unit and not is_unit(unit, quantity):
        raise InputError(raw.name, f"the unit '{unit}' of readings of {joint.name}", f"Say --units deviation={usual}")
    values = to_internal(runs.readings, unit or usual, quantity)
    span = float(np.ptp(target))
    off = values - target[:, None]
    if "deviation" not in asked.units and span > 0 and float(np.nanmax(np.abs(off))) < NEAR * span:
        return np.asarray(off), "measured positions", ReadAs("actual", unit or usual)
    if not unit:
        _refuse_other_targets(raw.name, runs, target, values, span)
        cure = f"Say it with --units deviation={'arcsec' if joint.type == 'rotary' else 'um'}, or what it is"
        raise InputError(raw.name, "no unit of the deviations", cure)
    return np.asarray(values), f"deviations in {unit}", ReadAs("deviation", unit)


def _refuse_other_targets(name: str, runs: Runs, target: Array, values: Array, span: float) -> None:
    """InputError where readings (targets, runs) are positions near other targets than their own."""
    whole = np.flatnonzero(np.isfinite(values).all(axis=0))
    off = np.abs(np.sort(values[:, whole], axis=0) - np.sort(target)[:, None])
    if not len(whole) or not off.max() < NEAR * span:
        return
    wrong = np.abs(values[:, whole] - target[:, None]) >= NEAR * span
    i, k = (int(part[0]) for part in np.nonzero(wrong))
    found = f"positions that lie near other targets than their own: {runs.readings[i, whole[k]]:.6g} at target "
    found += f"{runs.targets[i]:.6g}, and {int(wrong.sum()) - 1} more"
    raise InputError(name, found, "See the order of the targets: readings are shifted by one, or two are exchanged")


def _way(target: Array, side: float) -> Index:
    """Targets in the order in which a run comes to them."""
    order = np.argsort(target, kind="stable")
    return order if side > 0 else order[::-1]


def run_of(name: str) -> tuple[int, float] | None:
    """Number of the run (0: none) and the side that a name states; None where it names no run of a direction."""
    text = without_tail(name.strip()).lower()
    again = _AGAIN.search(text)
    text = re.sub(r"(?<=[^\W\d_])[-_](?=\d)", " ", _AGAIN.sub("", text) if again else text)
    tokens = _TOKEN.findall(text)
    words = [t for t in tokens if not t.isdecimal()]
    numbers = [int(t) for t in tokens if t.isdecimal()]
    ways = [w for w in words if w not in _RUN and side_of(w) is not None]
    if len(ways) > 1:
        ways = [w for w in ways if w not in ("-", "\u2013")] or ways
    if len(ways) != 1 or len(numbers) > 1 or any(w not in _RUN and side_of(w) is None for w in words):
        return None
    side = side_of(ways[0])
    assert side is not None
    number = numbers[0] if numbers else int(again[1]) if again else 0
    return number, side


def _numbered(found: Sequence[tuple[int, float]]) -> list[int] | None:
    """Numbers of runs, counted where the names have none; None where one comes twice in one direction."""
    count: Counter[float] = Counter()
    out = []
    for number, side in found:
        count[side] += 1
        out.append(number or count[side])
    pairs = {*zip(out, [side for _, side in found], strict=True)}
    return out if len(pairs) == len(out) else None


def runs_in(table: Layout) -> Runs | None:
    """The runs in a table, a column each or a row each; None where there are none."""
    return None if _of_axes(table) else _by_columns(table) or _by_rows(table)


def _of_axes(table: Layout) -> bool:
    """Whether columns are coordinates (`Actual X`, `Actual Z`): Z is no way back (`zurück`) then."""
    heads: dict[str, set[str]] = {}
    for name in table.names if table.named else ():
        if axis := _AXIS.fullmatch(name.strip()):
            heads.setdefault(axis[1].lower(), set()).add(axis[2].lower())
    return any(len(letters) > 1 for letters in heads.values())


def _by_columns(table: Layout) -> Runs | None:
    own = {k: run for k, n in enumerate(table.names) if (run := run_of(n)) is not None and table.numeric(k)}
    own = {k: run for k, run in own.items() if not _PLACE.fullmatch(table.names[k].strip())}
    units = {table.units[k] for k in own if table.units[k]}
    letters = all(len(table.names[k].strip()) == 1 and table.names[k].isalpha() for k in own)
    if not table.named or len(own) < 2 or len(units) > 1 or letters:  # F: a feed; H, V, R: polar coordinates
        return None
    rest = [k for k in range(len(table.names)) if k not in own and table.numeric(k)]
    rest = [k for k in rest if not _COUNTED.fullmatch(table.names[k])]
    named = [k for k in rest if TARGET.search(table.names[k]) or _PLACE.fullmatch(table.names[k].strip())]
    counted = len(own) > 2 or any(number for number, _ in own.values())  # `time, up, down` may be anything
    place = named[0] if named else rest[0] if len(rest) == 1 and counted else None
    numbers = _numbered([*own.values()])
    if place is None or numbers is None:
        return None
    return Runs(
        _values(table.column(place)), np.column_stack([_values(table.column(k)) for k in own]), tuple(numbers),
        tuple(side for _, side in own.values()), table.lines, table.units[place],
        units.pop() if len(units) == 1 else _stated(table), table.names[place],
        tuple(n for k, n in enumerate(table.names) if k not in own and k != place and not _COUNTED.fullmatch(n)),
    )  # fmt: skip


def _by_rows(table: Layout) -> Runs | None:
    width = len(table.names)
    if len(table.rows) > MOST_ROWS:
        return None
    values = [k for k in range(width) if sum(kind_of(c) == "number" for c in table.column(k)) > len(table.rows) / 2]
    heads = [k for k in range(width) if k not in values]
    if len(values) < 2 or not 0 <= len(heads) <= 2:
        return None
    if not heads or (len(heads) == 1 and values[0] < heads[0]):  # a column of numbers of runs before that of directions
        heads, values = sorted({*heads, values[0]}), values[1:]
    if max(heads) > min(values):
        return None
    labels = [bracketed(" ".join(row[k] for k in heads).strip()) for row in table.rows]
    own = {i: run for i, (label, _) in enumerate(labels) if (run := run_of(label)) is not None}
    own = {i: run for i, run in own.items() if not _PLACE.fullmatch(labels[i][0])}
    rest = [i for i, (label, _) in enumerate(labels) if i not in own and not _COUNTED.fullmatch(label.strip())]
    named = [i for i in rest if not labels[i][0] or TARGET.search(labels[i][0]) or _PLACE.fullmatch(labels[i][0])]
    named += [i for i in rest if all(w in _HEADS for w in _TOKEN.findall(labels[i][0].lower()))]
    numbers = _numbered([*own.values()])
    if not named or numbers is None or len({side for _, side in own.values()}) < 2:
        return None
    line = named[0]
    cells = np.array([_values([row[k] for k in values]) for row in table.rows])
    steps = np.diff(cells[line])
    if not ((steps > 0).all() or (steps < 0).all()):  # a list of points with such names
        return None
    units = {labels[i][1] for i in own if labels[i][1]}
    return Runs(
        cells[line], cells[[*own]].T, tuple(numbers), tuple(side for _, side in own.values()), (),
        labels[line][1], units.pop() if len(units) == 1 else _stated(table), labels[line][0],
        tuple(labels[i][0] for i in rest if i != line),
    )  # fmt: skip


def _without_side(table: Layout) -> list[str]:
    """Columns that are numbered runs of which no direction is stated, beside one of positions."""
    own = []
    for k, name in enumerate(table.names if table.named else ()):
        tokens = _TOKEN.findall(name.lower())
        words = [t for t in tokens if not t.isdecimal()]
        if len(words) == 1 and len(tokens) == 2 and words[0] in _RUN - _SHORT and table.numeric(k):
            own.append(name)
    rest = [n for k, n in enumerate(table.names) if table.numeric(k) and n not in own and not _COUNTED.fullmatch(n)]
    return own if len(rest) == 1 and (TARGET.search(rest[0]) or _PLACE.fullmatch(rest[0].strip())) else []


def _stated(table: Layout) -> str:
    """The unit of the deviations that a line above the table states."""
    found = {unit_word(m[1]) for line in (*table.preamble, *table.comments) for m in _STATED.finditer(line)}
    own = [unit for unit in found if is_unit(unit, "length") or is_unit(unit, "angle")]
    return own[0] if len(own) == 1 else ""


def _unit_above(table: Layout) -> str:
    """The unit of length in a cell of its own above the table; empty where there is none or more than one."""
    cells = {unit_word(cell) for line in table.preamble for cell in split(line, table.delimiter) if cell}
    own = [unit for unit in cells if unit in ("mm", "inch")]
    return own[0] if len(own) == 1 else ""


def _values(cells: Sequence[str]) -> Array:
    """Cells as numbers, NaN where there is none; a comma is a decimal sign."""
    import pandas as pd

    values, bad = as_numbers(pd.Series([*cells], dtype="str"), True)
    return np.where(bad, np.nan, values)
