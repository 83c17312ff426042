"""Raw lists of single readings (lengths, angles) with their commands: which reading belongs to which pose, or two.

A list holds numbers in the order of measuring. Which commands they are of is decided by what a machine without errors
would read there: several readings a command, several passes, from the first command, from the one before, or in pairs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from errormodel.arrays import Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.nominal import Nominal
from errormodel.observations import registry
from errormodel.observations.base import Observation
from errormodel.surveys.checks import run_labels
from errormodel.surveys.columns import OBSERVATION
from errormodel.units import factor
from errormodel.yamlfile import parse, validate
from identification.importing.dwell_commands import at_rows, dwells_of_logs, left_moving, rests_of, suspects
from identification.importing.dwells import Dwells, find_dwells
from identification.importing.matching import NAMED, Matched, by_name, by_time, common_names
from identification.importing.pairing import Pairs, left_over, reading_notes, rest_notes, row_by_row
from identification.importing.reading_gaps import with_gaps
from identification.importing.reading_proof import Candidate, Chosen, both_poses, chosen
from identification.importing.sources import SourceFile, Wishes

OPTION = "--observation"


LABELLED = re.compile(r"\s*([^\[\]{},:=]+?)\s*=(.*)", re.DOTALL)  # A=station-distance, near: [0, 0, 500]


def observations_of(said: str | Mapping[str, object] | Sequence[str | Mapping[str, object]]) -> dict[str, Observation]:
    """Observations that the user names, by the label of their entries; under "" what holds for all others.

    Parameters
    ----------
    said : ``station-distance``, ``"line-angle, axis: [0, 1, 0]"``, ``"A=station-distance, near: [0, 0, 500]"``, a
        mapping, or several of them.

    Raises
    ------
    InputError
        There is no such type, a key is missing or wrong, one is named twice, or they are of several types.
    """
    out: dict[str, Observation] = {}
    for one in [said] if isinstance(said, str | Mapping) else said:
        match = LABELLED.fullmatch(one) if isinstance(one, str) else None
        label, own = match.groups() if match else ("", one)
        if not own:
            continue
        if label in out:
            raise InputError(OPTION, f"{label or 'one for all'} twice", "Write each label once, such as A=TYPE")
        out[label] = _observation(own)
    types = {o.type for o in out.values()}
    if len(types) > 1:
        found = f"several types: {', '.join(sorted(types))}"
        raise InputError(OPTION, found, "Import readings of each type apart, and list their files in one survey.yaml")
    return out


def _observation(said: str | Mapping[str, object]) -> Observation:
    """The observation of a type with keys behind it, as in ``survey.yaml``."""
    known = registry()
    if isinstance(said, str):
        text = said.strip()
        text = text if text.startswith("{") else f"{{type: {text}}}"
        document = parse(text, OPTION)
    else:
        from errormodel.yamlfile import Document

        document = Document(OPTION, dict(said), {(): 1})
    kind = document.data.get("type")
    if not isinstance(kind, str) or kind not in known:
        from errormodel.exceptions import nearest

        cure = nearest(str(kind), known) if kind else f"Write one of {', '.join(known)}"
        raise InputError(OPTION, f"'{kind}', no type of observation", cure)
    model = known[kind]
    filled = {**model.listed(), **document.data}
    return validate(replace(document, data=filled), model)


@dataclass(frozen=True)
class Joined:
    """Readings with their commands; what to say of how they fit; whether they do not show where it stands."""

    pairs: Pairs
    says: tuple[str, ...]
    unplaced: bool


def labels_of(sources: list[SourceFile]) -> list[str]:
    """Names of the entries of ``observations:`` of files of readings: those of the files, each once."""
    names = ["".join("_" if c in "[]," else c for c in Path(s.raw.path.name).stem) or "readings" for s in sources]
    return [n if names.count(n) == 1 else f"{n}_{k}" for k, n in enumerate(names, start=1)]


def own_labels(source: SourceFile) -> list[str]:
    """Labels that stand in the file itself, in the order of their first row; empty where it has none."""
    frame = source.recording.frame
    return list(dict.fromkeys(frame[OBSERVATION].astype(str))) if OBSERVATION in frame else []


def pair_readings(
    source: SourceFile,
    commands: SourceFile | None,
    chain: Chain,
    wishes: Wishes,
    observations: Mapping[str, Observation],
) -> Joined:
    """Readings of a file and the command, or the two commands, of each.

    Parameters
    ----------
    observations : by the labels that stand in the file; a single one where it has none.

    Raises
    ------
    InputError
        They cannot be joined in the way that was asked for, in none, or in several.
    """
    first = next(iter(observations.values()))
    values = source.column(first.reading)
    seen = np.isfinite(values)
    if not seen.any():
        raise InputError(source.raw.name, "nothing measured in any row", "Give the file that holds the readings")
    if commands is None:
        rows = np.flatnonzero(seen)
        own = Pairs(
            rows, rows, rows, "", tuple(reading_notes(source, None, int((~seen).sum()))), len(rows), len(seen), {}
        )
        return Joined(own, (), False)
    if wishes.match == "nearest":
        found = "single readings, which have no place of their own to be near to"
        raise InputError(source.raw.name, found, "Join by order, name or time: --match order")
    parts: list[Pairs] = []
    ways: list[Chosen] = []
    notes: list[str] = []
    rests: Index | None = None
    labels = own_labels(source)
    for label in labels or [""]:
        own_rows = (
            source.recording.frame[OBSERVATION].astype(str).to_numpy() == label if label else np.ones(len(seen), bool)
        )
        part, way, more, own_rests = _part(
            source, commands, chain, wishes, observations.get(label, first), np.flatnonzero(own_rows), label
        )
        rests = own_rests if own_rests is not None else rests
        parts.append(part)
        ways.append(way)
        notes += more
    starts = [p.start for p in parts if p.start is not None]
    runs = [p.run for p in parts if p.run is not None]
    command = np.concatenate([p.command for p in parts])
    start = np.concatenate(starts) if len(starts) == len(parts) else None
    every = start if rests is None else np.arange(commands.rows)  # no command on the way was to be measured
    notes += left_over(source, commands, command, np.concatenate([p.first for p in parts]), every)
    notes += [] if rests is None else rest_notes(commands, rests, command)
    out = replace(
        parts[0], command=command, first=np.concatenate([p.first for p in parts]),
        last=np.concatenate([p.last for p in parts]), notes=tuple(notes), readings=sum(p.readings for p in parts),
        start=start,
        run=tuple(r for run in runs for r in run) if len(runs) == len(parts) else None,
    )  # fmt: skip
    says = [s for way in ways for s in way.says]
    return Joined(out, tuple(dict.fromkeys(says)), any(way.unplaced for way in ways))


def _part(
    source: SourceFile, commands: SourceFile, chain: Chain, wishes: Wishes, observation: Observation, rows: Index,
    label: str,
) -> tuple[Pairs, Chosen, list[str], Index | None]:  # fmt: skip
    """The readings of one observation in a file; the rests of the log, where these are their commands."""
    values = source.column(observation.reading)[rows]
    seen = np.flatnonzero(np.isfinite(values))
    if not len(seen):
        raise InputError(source.raw.name, f"no reading of '{label}' in any row", "Take its rows out of the file's map")
    expected = commands.rows
    dwells = None
    side_by_side = False
    if wishes.dwell and not _fits(len(seen), expected, observation.poses):
        dwells = find_dwells(values[:, None])
    elif wishes.dwell and len(seen) == expected and observation.poses == 1:
        path = Nominal(chain, commands.recording.frame).points(np.asarray(chain.machine.tool))
        dwells = dwells_of_logs(find_dwells(values[:, None]), commands, chain)
        side_by_side = dwells is not None
    first, last = (seen, seen) if dwells is None else (dwells.first, dwells.last)
    log, rests = commands, None
    if wishes.dwell and observation.poses == 1 and not side_by_side and not _fits(len(first), expected, 1):
        rests = rests_of(log, chain)  # readings are taken where a log of the way rests
    if rests is not None:
        commands = at_rows(log, rests)
        expected = commands.rows
    notes = reading_notes(source, dwells, len(values) - len(seen))
    notes = [f"{label}: {note}" if label else note for note in notes]
    means = np.array([np.nanmean(values[a : b + 1]) for a, b in zip(first, last, strict=True)])
    where = f"{source.raw.name}, observation {label}" if label else source.raw.name
    found = None
    if side_by_side and wishes.match in ("auto", "order"):
        beside = row_by_row(path, first, last, source.raw.name)
        found = Candidate(beside.command, beside.how)
    else:
        found = _named_or_timed(source, commands, chain, wishes, observation, rows[first], rows[last])
    if found is not None and found.offset is not None and dwells is not None:
        path = Nominal(chain, commands.recording.frame).points(np.asarray(chain.machine.tool))
        timed = Matched(found.command, found.how, found.offset)
        timed, more = left_moving(
            timed, path, commands.column("time"), source.column("time")[rows], dwells, source.raw.name
        )
        found = replace(found, command=timed.command)
        notes += more
    if found is not None:
        kept = found.command >= 0
        candidates = [replace(found, command=found.command[kept])]
        if not kept.any():
            text = f"none of {len(kept)} readings has a command of {commands.raw.name}"
            raise InputError(where, text, "Give the commands that were measured, or another --match")
    else:
        kept = np.ones(len(first), dtype=bool)
        candidates = [*_by_order(len(first), expected, observation.poses)]
        if both_poses(chain, commands):  # then nobody counts from another command
            candidates = [c for c in candidates if c.start is None] or candidates
    if not candidates and wishes.match in ("auto", "order"):
        passing = with_gaps(chain, commands, observation, means)
        candidates = [] if passing is None else [passing]
    if not candidates:
        raise InputError(where, *_counts(len(first), source, commands, observation, dwells, rests is not None))
    candidates = [_with_runs(c, source, rows[first[kept]]) for c in candidates]
    own = source.recording.read_as.get(observation.reading)
    read_as = factor(own.unit, observation.reading) if own is not None and own.unit else 1.0
    found_way = chosen(chain, commands, observation, candidates, means[kept], where, read_as)
    best = found_way.way
    a, b = rows[first[kept]][best.skip :], rows[last[kept]][best.skip :]
    command = best.command if rests is None else rests[best.command]
    pairs = Pairs(command, a, b, best.how, (), len(first), log.rows, {}, best.offset, best.start, best.run)
    return pairs, found_way, notes, rests


def _with_runs(way: Candidate, source: SourceFile, rows: Index) -> Candidate:
    """A way in which the passes are those of the file, where it names them; `rows`: the first of each reading."""
    frame = source.recording.frame
    if way.run is not None or way.start is not None or "run" not in frame:
        return way
    return replace(way, run=tuple(map(str, run_labels(frame["run"].iloc[rows].astype(str)))))


def _fits(count: int, commands: int, poses: int) -> bool:
    return any(True for _ in _by_order(count, commands, poses))


def _counts(
    count: int, source: SourceFile, commands: SourceFile, observation: Observation, dwells: Dwells | None, rests: bool
) -> tuple[str, str]:
    """What does not agree where the numbers of readings and commands allow no order."""
    what = "rests in the log of commands" if rests else f"commands{commands.broken_off}"
    found = f"{count} {'readings' if dwells is None else 'dwells'} and {commands.rows} {what}"
    found += "" if dwells is None else suspects(dwells, commands.rows)
    if observation.poses > 1:
        found += (
            "; between two poses there are as many readings as commands, one fewer, half as many, or so many passes"
        )
    found += "; they fit as the first commands or as the last no better" if count < commands.rows else ""
    both = [c for c in ("point", "time") if c in source.recording.frame and c in commands.recording.frame]
    options = {"point": "name", "time": "time"}
    ways = " or ".join(f"--match {options[c]}" for c in both)
    cure = "Give the commands that were measured, a row a reading (as a table or plan)"
    return found, f"{cure}, or join by {ways}" if ways else cure


def _named_or_timed(
    source: SourceFile, commands: SourceFile, chain: Chain, wishes: Wishes, observation: Observation, first: Index,
    last: Index,
) -> Candidate | None:  # fmt: skip
    """Commands by name or by clock, where that is asked for or works; None: by order."""
    own, commanded = source.recording.frame, commands.recording.frame
    how = wishes.match
    names = "point" in own and "point" in commanded
    if how in ("name", "time") and observation.poses > 1:
        found = f"readings between two poses, and --match {how}"
        raise InputError(
            source.raw.name, found, "Join by order, or give a plan with columns from_<joint> as --commands"
        )
    if how == "name" and not names:
        lacking, option = (source, "--columns") if "point" not in own else (commands, "--command-columns")
        raise InputError(lacking.raw.name, "no names of points", f"Say which column they are: {option} point=..")
    if names and observation.poses == 1 and how in ("auto", "name"):
        measured = [own["point"].iloc[k] for k in first]
        if how == "name" or common_names(measured, list(commanded["point"])) >= NAMED:
            found_by = by_name(measured, list(commanded["point"]))
            return Candidate(found_by.command, found_by.how)
    clocks = "time" in own and "time" in commanded
    if how == "time" and not clocks:
        lacking, option = (source, "--columns") if "time" not in own else (commands, "--command-columns")
        raise InputError(lacking.raw.name, "no time", f"Say which column it is with {option} time=.., or join by order")
    orders = _fits(len(first), commands.rows, observation.poses)
    if clocks and (how == "time" or (how == "auto" and not orders)):
        when = source.column("time")
        centre = np.array([np.nanmean(when[a : b + 1]) for a, b in zip(first, last, strict=True)])
        path = Nominal(chain, commanded).points(np.asarray(chain.machine.tool))
        readings = source.column(observation.reading)
        timed = by_time(
            path, commands.column("time"), np.column_stack([readings, 0 * readings, 0 * readings]), when, centre,
            same_clock=source.recording.dated and commands.recording.dated, name=commands.raw.name,
            measured=source.raw.name,
        )  # fmt: skip
        return Candidate(timed.command, timed.how, offset=timed.offset)
    return None


def _by_order(count: int, commands: int, poses: int) -> Iterator[Candidate]:
    """Ways in which so many readings, in their order, may belong to so many commands."""
    if poses == 1:
        yield from _repeated(count, np.arange(commands), None, "order", 0)
        return
    every = np.arange(commands)
    yield from _repeated(count, every, None, "order, as the commands have both poses", 0)
    if commands > 1:
        yield from _repeated(
            count, every[1:], np.zeros(commands - 1, dtype=np.intp), "order, from the first command", 0
        )
        yield from _repeated(count, every[1:], every[:-1], "order, from the command before", 0)
        if count == commands:
            start = np.zeros(commands - 1, dtype=np.intp)
            yield Candidate(every[1:], "order, from the first command, where the first reading is of", start, skip=1)
    if commands % 2 == 0:
        yield from _repeated(count, every[1::2], every[::2], "order, a reading a pair of commands", 0)


def _repeated(count: int, command: Index, start: Index | None, how: str, skip: int) -> Iterator[Candidate]:
    """A reading a place; or several, one after the other or in passes."""
    size = len(command)
    if not size or count % size:
        return
    times = count // size
    if times == 1:
        yield Candidate(command, how, start, skip=skip)
        return
    rows = np.arange(count)
    for place, words, run in (
        (rows // times, f"{times} readings each", None),
        (rows % size, f"{times} passes", tuple(str(k // size + 1) for k in rows.tolist())),
    ):
        yield Candidate(command[place], f"{how}, {words}", None if start is None else start[place], run, skip)
