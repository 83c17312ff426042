"""Tables of positioning tests (ISO 230-2): target, measured position or deviation, cycle or run, direction.

Other columns are handed on as they are: times, temperatures and other channels are recorded beside the readings.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS, unit_of
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, ReadAs, Recording
from errormodel.raw_formats.direction_words import by_way, side_of, sides
from errormodel.raw_formats.positioning import axis_above, joint_for, motion_rows, other_axis
from errormodel.raw_formats.table_columns import columns_of, numbers
from errormodel.raw_formats.unit_words import unit_word
from errormodel.surveys.motion_sizes import usual_range
from errormodel.units import Quantity, is_unit, to_internal

TARGET = re.compile(
    r"target(position|pos|no)?|nominale?(position)?|setpoint|soll(wert|position|pos)?|ziel(wert|position)?|vorgabe|"
    r"consigne|cible|th\u00e9orique|theorique|teorico|teorica|theoretical",
    re.IGNORECASE,
)
_ACTUAL = re.compile(
    r"(actual|measured|read|ist|mess)?(position|pos)|actual|measured|reading|ist(wert)?|messwert|gemessen|"
    r"mesur(e|\u00e9e?)|misurat[oa]|misura|reale"
)
_DEVIATION = re.compile(r"(position(s|ier)?)?(deviation|error|dev|abweichung)")
_CYCLE = re.compile(r"cycle|run|pass|series|repeat|lauf|zyklus|serie|messlauf")
_SIDE = re.compile(r"dir(ection)?|approach|side|(anfahr)?richtung")
_COUNTED = re.compile(r"no|nr|i|number|n|index|#|punkt|point", re.IGNORECASE)
_CLOCK = re.compile(r"(time|zeit|date|datum|temps|ora|heure)[\s_]?(stamp)?.*")
LEAST_UNLIKE = 2e-4  # mm or rad: rounding of deviations and positions in tables
ROUNDED, COARSE = 10.0, 0.05  # times the median difference, up to so many mm: positions are written with fewer digits
FEW = 0.1  # share of the readings, up to which they may be lost or exchanged
MOST_NAMED = 5  # lines and targets that a message names
_UNIT = re.compile(r"_(mm|um|inch|deg|arcsec|urad|rad)$")


def _places(names: list[str]) -> dict[str, str]:
    """Columns of a positioning test by what they hold; the letter of the axis may stand before or behind a word."""
    out: dict[str, str] = {}
    for name in names:
        bare = re.sub(r"[\s_.\-]+", "", _UNIT.sub("", name.lower()))
        forms = {bare, re.sub(r"^[xyzuvwabc](?=..)", "", bare), re.sub(r"(?<=..)[xyzuvwabc]$", "", bare)}
        for what, pattern in (("target", TARGET), ("cycle", _CYCLE), ("side", _SIDE), ("deviation", _DEVIATION)):
            if what not in out and any(map(pattern.fullmatch, forms)):
                out[what] = name
                break
        else:
            if "actual" not in out and any(map(_ACTUAL.fullmatch, forms)):
                out["actual"] = name
    if "target" not in out and "deviation" in out and "actual" in out:  # positions beside their deviations
        out["target"] = out.pop("actual")
    return out


class PositioningTest(RawFormat):
    """One joint's readings at its targets; they become its error motion along its axis."""

    name = "positioning-test"
    title = "a positioning test of one joint"
    source = "ISO 230-2, table of measured deviations; names of columns as laboratories write them"
    seen = True
    uses = ("joint",)
    of_pairs = True
    columns = ("target", "actual", "deviation", "run", "cycle", "direction")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named:
            return False
        found = _places([*table.names])
        if "target" not in found or not {*found} & {"actual", "deviation"}:
            return False
        # nominal and actual alone: of one axis, if nothing else was measured or commanded
        rest = [n for k, n in enumerate(table.names) if table.numeric(k) and n not in found.values()]
        rest = [n for n in rest if not _COUNTED.fullmatch(n.strip())]
        alone = TARGET.search(found["target"]) is not None and "actual" in found and not rest
        alone &= not any(map(_CLOCK.fullmatch, map(str.lower, table.names)))  # a log, and what the controller read back
        return alone or bool({*found} & {"cycle", "side"})

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        table = columns_of(raw, asked)
        found = _places([str(n) for n in table.frame])
        frame = table.frame
        unit = unit_word(asked.units.get("target", table.units.get(found["target"], "mm")))
        hint = axis_in(found["target"]) or axis_above(raw)
        joint = joint_for(raw.name, asked, hint, rotary=is_unit(unit, "angle"))
        usual = "deg" if joint.type == "rotary" else "mm"
        quantity: Quantity = "angle" if joint.type == "rotary" else "length"
        target = numbers(table, found["target"], raw.name)
        if "deviation" in found:
            reading = numbers(table, found["deviation"], raw.name)
            own = unit_word(asked.units.get("deviation", table.units.get(found["deviation"], "")))
            if not is_unit(own or "?", quantity):
                what = f"the unit '{own}'" if own else "no unit"
                cure = f"Say it with --units deviation={'arcsec' if joint.type == 'rotary' else 'um'}, or what it is"
                raise InputError(raw.name, f"{what} of the column {found['deviation']}", cure)
        less, stated = np.full(len(frame), np.nan), ""
        if "actual" in found:
            actual = numbers(table, found["actual"], raw.name)
            stated = unit_word(asked.units.get("actual", table.units.get(found["actual"], unit)))
            less = to_internal(actual, stated, quantity) - to_internal(target, unit, quantity)
        if "deviation" in found:
            _refuse_unlike(table, found, raw.name, to_internal(reading, own, quantity), less)
            read_as = ReadAs("deviation", own)
        else:
            read_as = ReadAs("actual", stated)
            own, reading = "rad" if joint.type == "rotary" else "mm", less
        if joint.type == "prismatic":
            off = to_internal(reading, own, quantity)
            _refuse_far(to_internal(target, unit, quantity), off, table.lines, raw.name, found)
        side, turned = np.full(len(frame), np.nan), ""
        if "side" in found:
            name = found["side"]
            words = [*frame[name]]
            found_side = None if all(side_of(str(w)) for w in words) else by_way(words, target)
            if found_side is None:
                found_side = sides(words, lambda row: f"{raw.name}, line {table.lines[row]}, column {name}")
            else:
                rising = next(w for w, s in zip(words, found_side, strict=True) if s > 0)
                turned = f"{name}: '{rising}' taken as +, from smaller positions, as its targets go"
            side = found_side
        notes = [f"readings of {joint.name} along its axis", *other_axis(joint, asked, hint), *filter(None, [turned])]
        run = ["1"] * len(frame)
        if "cycle" in found:
            run = [f"{c:g}" if isinstance(c, float) else str(c) for c in frame[found["cycle"]]]
        elif "side" not in found:
            run, side = _passes(target)
            _refuse_unequal(target, run, side, table.lines, raw.name)
            notes.append(f"{found['target']}: nominal; {found['actual']}: measured; runs and sides by their order")
        position = to_internal(target, unit, quantity)
        rows = motion_rows(joint, np.degrees(position) if usual == "deg" else position, reading, own, run, side)
        units = {joint.name: usual} | {name: unit_of(name) for name in MOTIONS if name in rows}
        read = {name: read_as for name in MOTIONS if name in rows} | {joint.name: ReadAs("target", unit)}
        beside = [n for n in map(str, frame) if n not in found.values()]
        if twice := [n for n in beside if n in (*rows, *MOTIONS)]:
            notes.append(f"columns not used: {', '.join(twice)}")
        beside = [n for n in beside if n not in twice]
        rows[beside] = frame[beside]
        return Recording(
            rows, units | {n: table.units[n] for n in beside if n in table.units}, table.lines,
            (*table.notes, *notes), table.dated, length_unit=table.length_unit, beside_targets="actual" in found,
            read_as=read,
        )  # fmt: skip


def _refuse_unlike(table: Recording, found: dict[str, str], name: str, deviation: Array, less: Array) -> None:
    """InputError where deviations (n,) are not the actual positions less the nominal ones, (n,), but for rounding."""
    off, turned = np.abs(deviation - less), np.abs(deviation + less)
    if not np.isfinite(off).any():
        return
    rounded = float(np.nanmedian(off))
    least = 0.0 if np.nanmedian(turned) < rounded / ROUNDED else ROUNDED * rounded  # all of the other sign
    wrong = np.flatnonzero(off > max(min(least, COARSE), LEAST_UNLIKE))
    if len(wrong):
        row = int(wrong[0])
        more = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        raise InputError(
            f"{name}, line {table.lines[row]}{more}",
            f"{found['deviation']} is not {found['actual']} less {found['target']}: {deviation[row]:.6g} and "
            f"{less[row]:.6g} mm or rad",
            f"Say which holds: leave {found['deviation']} or {found['actual']} out (--columns {found['actual']}=-)",
        )


def _refuse_far(target: np.ndarray, off: np.ndarray, lines: Sequence[int], name: str, found: dict[str, str]) -> None:
    """InputError where few readings (n,) are farther off their targets (n,), mm, than those of a machine ever are.

    Where many are, it is their unit: that is judged with the survey.
    """
    good = np.isfinite(off) & np.isfinite(target)
    if not good.any():
        return
    most = usual_range(float(np.ptp(target[good])))
    far = np.flatnonzero(good & (np.abs(off - np.median(off[good])) > most))
    if not 0 < len(far) <= FEW * good.sum():
        return
    row = int(far[0])
    others = " and ".join(str(lines[k]) for k in far[1:MOST_NAMED])
    more = f"; so is line {others}" if others else ""
    swapped = any(abs(target[row] + off[row] - target[k]) < most for k in far[1:])
    said = ": they fit each other's targets, exchanged" if swapped else ""
    raise InputError(
        f"{name}, line {lines[row]}",
        f"a reading {off[row]:.6g} mm off its target, where the others are within {most:.2g} mm{more}{said}",
        f"Take the line out if its reading is lost, or see that {found['target']} is its target (copy the file first)",
    )


def _refuse_unequal(target: np.ndarray, run: list[str], side: np.ndarray, lines: Sequence[int], name: str) -> None:
    """InputError where passes that were found by the order of the targets (n,) do not have the same targets.

    A reading that is missing, or in another line, would count for another side.
    """
    passes: dict[tuple[str, float], list[int]] = {}
    for k, key in enumerate(zip(run, side.tolist(), strict=True)):
        passes.setdefault(key, []).append(k)
    targets = {key: frozenset(np.round(target[rows], 3).tolist()) for key, rows in passes.items()}
    usual = max(targets.values(), key=lambda own: (sum(own == other for other in targets.values()), len(own)))
    for key, own in targets.items():
        if own != usual:
            first, last = lines[passes[key][0]], lines[passes[key][-1]]
            lacks = ", ".join(f"{t:g}" for t in sorted(usual - own)[:MOST_NAMED]) or "none"
            more = ", ".join(f"{t:g}" for t in sorted(own - usual)[:MOST_NAMED])
            has = f" and has {more} more" if more else ""
            raise InputError(
                f"{name}, lines {first} to {last}",
                f"a pass by the order of its targets that lacks {lacks}{has}, where "
                "others do not: which readings belong to which side is not sure",
                "Put the lines in the order of measuring, or add columns of the run and of the direction (+ or -)",
            )


def axis_in(name: str) -> str:
    """The letter of an axis in a column's name, such as ``X soll``; empty where there is none."""
    letters = [word.upper() for word in re.split(r"[\s_.\-\[\]()/]+", name) if re.fullmatch(r"[A-Za-z]\d?", word)]
    return letters[0] if len(letters) == 1 else ""


def _passes(target: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Runs and sides of arrival of targets in the order of measuring: a pass is as far as they go one way."""
    step = np.sign(np.diff(target, prepend=np.nan))
    step[0] = next((s for s in step[1:] if s != 0), np.nan)
    for k in range(1, len(step)):  # the same target again: from the other side, where the way goes back behind it
        if step[k] == 0:
            step[k] = next((s for s in step[k + 1 :] if s != 0), step[k - 1])
    count, runs = {1.0: 0, -1.0: 0}, []
    for k, side in enumerate(step):
        count[side] = count.get(side, 0) + (k == 0 or side != step[k - 1])
        runs.append(str(max(count[side], 1)))
    return runs, step
