"""One measured file with its commands: readings found, matched, and what is left over with its reason."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.nominal import Nominal
from errormodel.surveys.columns import MEASURED
from identification.importing.dwell_commands import ONE_PLACE, dwells_of, left_moving, rests_of
from identification.importing.dwells import Dwells
from identification.importing.geometry import fitted_targets, turns_tool
from identification.importing.matching import NAMED, Matched, by_name, by_order, by_time, common_names
from identification.importing.near_causes import refuse_cause
from identification.importing.nearest import find_pairing
from identification.importing.sources import SourceFile, Wishes
from identification.importing.words import LISTED, row_ranges
from identification.observation.frames import align
from identification.results.terminal import counted

TARGET_GAIN = 3.0  # times: so much nearer must targets of their own bring the points, to be taken
LOCATION_ERROR_MM = 1.0  # a single target so near to the tool is the tool: axes are beside their places; by judgement
FEW_TO_FIT = 8  # rows a target, from which on a functional point is fitted
NEAREST = "the nearest command after a robust alignment"
STANDS = 1e-4  # of the reach: so far may commands go on while readings stand still


@dataclass(frozen=True)
class Pairs:
    """Readings of a file and their commands.

    Attributes
    ----------
    command : (n,) row of the command of each reading, from 0; those of one file without commands are its own rows.
    first, last : (n,) rows of each reading in the measured file, from 0.
    how : how they were joined, in words; empty where commands and measurements stand in one table.
    notes : what is left over, and why.
    readings, commands : how many there were.
    targets : functional points (mm) that were fitted, by target.
    offset : s between the clocks, if any.
    start : (n,) row of the command at which each distance begins, of readings between two poses.
    run : (n,) label of the pass that each reading is of, where there are several.
    """

    command: Index
    first: Index
    last: Index
    how: str
    notes: tuple[str, ...]
    readings: int
    commands: int
    targets: dict[str, tuple[float, float, float]]
    offset: float | None = None
    start: Index | None = None
    run: tuple[str, ...] | None = None

    def __len__(self) -> int:
        return len(self.command)

    @property
    def by_rows(self) -> bool:
        """Whether only the order of the rows distinguishes the ways in which a symmetric plan fits."""
        return self.how.startswith("order") or self.how == NEAREST

    @property
    def averaged(self) -> bool:
        """Whether a reading is a mean of several rows."""
        return bool((self.last > self.first).any())


def points_of(source: SourceFile) -> Array:
    """Measured coordinates (n, 3), NaN where a component is missing."""
    frame = source.recording.frame
    empty = np.full(source.rows, np.nan)
    return np.column_stack([source.column(m) if m in frame else empty for m in MEASURED])


def middles(points: Array, first: Index, last: Index) -> Array:
    """Means of the points (n, 3) from `first` to `last`, each (k,); NaN where a component was not measured."""
    if np.array_equal(first, last):
        return points[first]
    parts = [points[a : b + 1] for a, b in zip(first, last, strict=True)]
    return np.array([[c[np.isfinite(c)].mean() if np.isfinite(c).any() else np.nan for c in p.T] for p in parts])


def pair(source: SourceFile, commands: SourceFile | None, chain: Chain, wishes: Wishes, seed: int) -> Pairs:
    """Find the readings of a measured file and the command of each.

    Raises
    ------
    InputError
        They cannot be joined in the way that was asked for, or in none.
    """
    points = points_of(source)
    seen = np.isfinite(points).any(axis=1)
    alone = commands is None
    if not seen.any():
        raise InputError(source.raw.name, "nothing measured in any row", "Give the file that holds the measurements")
    expected = source.rows if alone else commands.rows if commands is not None else 0
    labels = source.recording.frame.get("target")
    dwells, rests, side_by_side = None, None, False
    if wishes.dwell and not (labels is not None and labels.nunique() > 1):
        dwells = dwells_of(points, source, commands, chain)
        side_by_side = dwells is not None and not alone and expected == int(seen.sum())
    rows = np.flatnonzero(seen)
    first, last = (rows, rows) if dwells is None else (dwells.first, dwells.last)
    notes = reading_notes(source, dwells, int((~seen).sum()))
    if commands is None:
        nominal = Nominal(chain, source.recording.frame.iloc[first])
        own = Pairs(first, first, last, "", tuple(notes), len(first), source.rows, {})
        return _with_targets(own, source, nominal, points, chain)
    middle = middles(points, first, last)
    nominal = Nominal(chain, commands.recording.frame)
    timed = {"time"} <= {*map(str, source.recording.frame)} & {*map(str, commands.recording.frame)}
    if side_by_side and wishes.match in ("auto", "order") and not (timed and wishes.match == "auto"):
        path = nominal.points(np.asarray(chain.machine.tool))
        found = row_by_row(path, first, last, source.raw.name)
    else:
        rests = rests_of(commands, chain) if commands.rows > len(first) else None
        found = _match(source, commands, chain, nominal, middle, first, last, points, wishes, seed, rests)
        if dwells is not None and found.offset is not None:
            path = nominal.points(np.asarray(chain.machine.tool))
            found, more = left_moving(
                found, path, commands.column("time"), source.column("time"), dwells, source.raw.name
            )
            notes += more
        if rests is not None and not np.isin(found.command[found.command >= 0], rests).all():
            rests = None
    command = found.command
    kept = command >= 0
    if not kept.any():
        found_text = f"none of {len(command)} readings has a command of {commands.raw.name}"
        raise InputError(source.raw.name, found_text, "Give the commands that were measured, or another --match")
    if rests is None:
        notes += left_over(source, commands, command, first)
    else:
        every = np.arange(commands.rows)  # no command on the way was to be measured
        notes += [*left_over(source, commands, command, first, every), *rest_notes(commands, rests, command)]
    out = Pairs(
        command[kept], first[kept], last[kept], found.how, tuple(notes), len(command), commands.rows, {}, found.offset
    )
    own_nominal = Nominal(chain, commands.recording.frame.iloc[out.command])
    return _with_targets(out, source, own_nominal, points, chain, commands.raw.name if wishes.offsets else "")


def row_by_row(path: Array, first: Index, last: Index, name: str) -> Matched:
    """Commands of the dwells of a log beside a log of commands (n, 3): those of the same rows.

    Raises
    ------
    InputError
        The commands move while the readings stand still.
    """
    middle = (first + last) // 2
    quarter = np.maximum((last - first) // 4, 1)
    reach = float(np.ptp(path, axis=0).max())
    moved = np.array(
        [float(np.ptp(path[m - q : m + q + 1], axis=0).max()) for m, q in zip(middle, quarter, strict=True)]
    )
    bad = moved > STANDS * reach
    if bad.any():
        row = int(bad.argmax())
        found = (
            f"two logs of {len(path)} rows each that do not run side by side: in rows {first[row] + 1} to "
            f"{last[row] + 1} the readings stand still and the commands move by {moved[row]:.3g} mm"
        )
        cure = "Say which columns are the times of both (--columns time=.., --command-columns time=..), or --no-dwells"
        raise InputError(name, found, cure)
    return Matched(middle, "row, of two logs side by side")


def reading_notes(source: SourceFile, dwells: Dwells | None, unseen: int) -> list[str]:
    """Dwells that were found, and rows that were left out."""
    notes = []
    if unseen:
        notes.append(f"left out: {counted(unseen, 'row')} in which nothing was measured")
    if dwells is not None:
        sizes = dwells.last - dwells.first + 1
        size = int(np.median(sizes))
        text = f"{counted(len(dwells), 'dwell')} of {size} readings (median) in a log of {source.rows} rows"
        text += f"; {dwells.moving} readings on the way left out" if dwells.moving else ""
        text += f"; {counted(dwells.short, 'place')} too short for a dwell" if dwells.short else ""
        if len(dwells.turning):
            text += f"; no rest but a turn of the way: {row_ranges(dwells.turning)}"
        notes.append(text)
    return notes


def _match(
    source: SourceFile, commands: SourceFile, chain: Chain, nominal: Nominal, middle: Array, first: Index, last: Index,
    points: Array, wishes: Wishes, seed: int, rests: Index | None,
) -> Matched:  # fmt: skip
    """The way of joining that was asked for, or the first of name, time, order and nearest that works."""
    own, commanded = source.recording.frame, commands.recording.frame
    names = "point" in own and "point" in commanded
    clocks = "time" in own and "time" in commanded
    how = wishes.match
    path = nominal.points(np.asarray(chain.machine.tool))
    if how == "name" and not names:
        lacking = source if "point" not in own else commands
        option = "--columns" if lacking is source else "--command-columns"
        raise InputError(lacking.raw.name, "no names of points", f"Say which column they are: {option} point=..")
    if names and how in ("auto", "name"):
        share = common_names([own["point"].iloc[k] for k in first], list(commanded["point"]))
        if how == "name" or share >= NAMED:
            return by_name([own["point"].iloc[k] for k in first], list(commanded["point"]))
    if how == "time" and not clocks:
        lacking = source if "time" not in own else commands
        raise InputError(lacking.raw.name, "no time", "Say which column it is with --columns time=.., or join by order")
    if clocks and (how == "time" or (how == "auto" and commands.rows != len(first))):
        when = source.column("time")
        centre = np.array([np.nanmean(when[a : b + 1]) for a, b in zip(first, last, strict=True)])
        same = source.recording.dated and commands.recording.dated
        return by_time(
            path, commands.column("time"), points, when, centre, same_clock=same, name=commands.raw.name,
            measured=source.raw.name,
        )  # fmt: skip
    if how in ("auto", "order"):
        found = by_order(len(first), commands.rows, path, middle, commands.recording.again)
        if found is None and rests is not None:
            found = by_order(len(first), len(rests), path[rests], middle)
            found = None if found is None else replace(found, command=rests[found.command])
        if found is not None:
            return found
        if _reach(path) < ONE_PLACE:
            few, file = (len(first), source) if len(first) < commands.rows else (commands.rows, commands)
            text = (
                f"{len(first)} readings and {commands.rows} commands of {commands.raw.name}, all at one place, where "
            )
            text += f"only their order or their names can join them; {abs(len(first) - commands.rows)} more or less"
            cure = (
                f"See which rows {file.raw.path.name} lacks ({few}), and give a command a reading; or name the poses "
            )
            cure += "in both files and join with --match name (--columns point=.., --command-columns point=..)"
            raise InputError(source.raw.name, text, cure)
        if how == "order":
            text = f"{len(first)} readings and {commands.rows} commands"
            text += "" if rests is None else f", which rest {len(rests)} times"
            cure = "Join with --match nearest, which finds what is missing; or give the commands that were measured"
            raise InputError(source.raw.name, text, cure)
    return _nearest(source, commands, path, middle, seed, rests)


def rest_notes(commands: SourceFile, rests: Index, command: Index) -> list[str]:
    """That only rests of a log were joined, and which were not measured."""
    idle = np.setdiff1d(rests, command)
    notes = [f"{counted(len(rests), 'rest')} in a log of {commands.rows} commands: readings are taken there"]
    return [*notes, f"not measured: {counted(len(idle), 'rest')} ({_shown(commands, idle)})"] if len(idle) else notes


def _nearest(
    source: SourceFile, commands: SourceFile, path: Array, middle: Array, seed: int, rests: Index | None
) -> Matched:
    if not np.isfinite(middle).all():
        raise InputError(source.raw.name, "components that were not measured", "Join by name or order: --match order")
    if rests is not None:
        found = find_pairing(path[rests], middle, seed)
        if found is not None and found.ways == 1:
            return Matched(np.where(found.command < 0, -1, rests[found.command]), NEAREST)
    found = find_pairing(path, middle, seed)
    if found is None:
        text = (
            f"{len(middle)} readings that lie in no frame on the {len(path)} commands of {commands.raw.name}"
            f"{commands.broken_off}; "
            f"the points reach {_reach(middle):.0f} mm, the commands {_reach(path):.0f} mm"
        )
        refuse_cause(path if rests is None else path[rests], middle, seed, source.mm_a_unit, source.raw.name, text)
        again = [note for note in commands.recording.notes if "counted as one pose" in note]
        text += f"; {again[0]}" if again else ""
        cure = "See that machine, tool, units and hand are right, and that these commands were measured"
        cure += "; where such a place was measured twice, give the commands as a table with a row each" if again else ""
        raise InputError(source.raw.name, text, cure)
    if found.ways > 1:
        text = f"{found.ways} ways to lay the points on the commands, which look the same from several sides"
        raise InputError(source.raw.name, text, "Join with --match order or name, or measure a pose off the pattern")
    return Matched(found.command, NEAREST)


def _reach(points: Array) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def left_over(
    source: SourceFile, commands: SourceFile, command: Index, first: Index, start: Index | None = None
) -> list[str]:
    """Readings without a command, and commands without a reading; `start`: where readings between two poses begin."""
    notes = []
    bare = first[command < 0]
    if len(bare):
        notes.append(f"without a command: {counted(len(bare), 'reading')} ({_shown(source, bare)})")
    idle = np.setdiff1d(np.arange(commands.rows), command if start is None else np.append(command, start))
    if len(idle) and len(idle) < 0.9 * commands.rows:
        notes.append(f"not measured: {counted(len(idle), 'command')} ({_shown(commands, idle)})")
    return notes


def _shown(source: SourceFile, rows: Index) -> str:
    """Rows as a person finds them: names, or lines."""
    frame, lines = source.recording.frame, source.recording.lines
    some = rows[:LISTED]
    if "point" in frame:
        text = ", ".join(str(frame["point"].iloc[k]) for k in some)
    elif lines:
        text = "line " + ", ".join(str(lines[k]) for k in some)
    else:
        text = "row " + ", ".join(str(k + 1) for k in some)
    return text + (" ..." if len(rows) > LISTED else "")


def _with_targets(
    pairs: Pairs, source: SourceFile, nominal: Nominal, points: Array, chain: Chain, programme: str = ""
) -> Pairs:
    """Functional points of the targets, where a machine with rotary joints shows them and they are not the tool.

    `programme`: whose offset the user stated: a single target beside the tool may as well be a wrong offset.

    Raises
    ------
    InputError
        It is that, or the tool is another: nothing measured shows which.
    """
    frame = source.recording.frame
    several = "target" in frame and frame["target"].nunique() > 1
    if "tool_x" in frame or not (several or turns_tool(chain.machine)) or not np.isfinite(points[pairs.first]).all():
        return pairs
    labels = frame["target"].astype(str).str.strip().to_numpy()[pairs.first] if several else np.full(len(pairs), "1")
    names, label = np.unique(labels.astype(str), return_inverse=True)
    label = label.ravel().astype(np.intp)
    if len(pairs) < FEW_TO_FIT * len(names):
        return pairs
    measured = middles(points, pairs.first, pairs.last)
    tool = np.asarray(chain.machine.tool, dtype=np.float64)
    plain = nominal.points(tool)
    before = float(np.median(np.linalg.norm(measured - align(plain, measured).apply(plain), axis=1)))
    tools, pose = fitted_targets(nominal, measured, label, np.tile(tool, (len(names), 1)))
    reached = pose.apply(nominal.points(tools[label]))
    after = float(np.median(np.linalg.norm(measured - reached, axis=1)))
    moved = float(np.linalg.norm(tools - tool, axis=1).max())
    if not after * TARGET_GAIN < before:
        return pairs
    if not several and moved < LOCATION_ERROR_MM:
        apart = ", ".join(f"{v:.2f}" for v in tools[0] - tool)
        text = (
            f"the points lie {before:.3g} mm off, with the tool displaced by {apart} mm {after:.3g} mm: an offset, the"
        )
        return replace(
            pairs, notes=(*pairs.notes, f"{text} tool, or errors of location of axes, as which a fit takes it")
        )
    if not several and programme:
        at, apart = (", ".join(f"{v:.2f}" for v in p) for p in (tools[0], tools[0] - tool))
        found = (
            f"points {before:.3g} mm off with its offset and the tool of the machine; with the tool displaced by "
            f"{apart} mm they fit to {after:.3g} mm. The offset is wrong by so much, or the target was not the tool"
        )
        raise InputError(
            programme, found, f"Correct --offset; or write where it was as tool: in machine.yaml (about [{at}])"
        )
    places = {str(n): tuple(round(float(v), 4) for v in t) for n, t in zip(names, tools, strict=True)}
    words = "; ".join(f"{n}: {', '.join(f'{v:.2f}' for v in p)}" for n, p in places.items())
    what = f"{len(names)} targets" if several else "the target"
    note = f"{what} placed in the last frame by the measurements themselves, {words} mm: with the tool of the machine "
    note += f"the points lie {before:.3g} mm off, so {after:.3g} mm"
    if not several:
        note += (
            f". It lies {moved:.3g} mm from the tool: if that is known, an offset is wrong, or the machine's geometry"
        )
    return replace(pairs, targets=places, notes=(*pairs.notes, note))  # type: ignore[arg-type]
