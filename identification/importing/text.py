"""Proof of a join in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array
from errormodel.survey import Survey
from identification.importing.exchanged_rows import FEWEST_PROVED
from identification.importing.importing import Imported
from identification.importing.proof import Proof
from identification.importing.readings import reading_lines
from identification.importing.sources import What
from identification.importing.standing import standing_lines
from identification.importing.traces import trace_lines
from identification.importing.words import LISTED
from identification.results.terminal import counted

WORDS: dict[What, str] = {
    "points": "measured",
    "motions": "error motions",
    "readings": "lengths of a bar",
    "single": "single readings",
    "log": "log",
    "commands": "commands",
}
FRAMES = {
    "per-file": "each file has a measuring frame of its own",
    "per-run": "each run or station has a measuring frame of its own",
    "fixed": "the measuring frame is that of the machine",
}
YEARS = 3e8  # s between two clocks: one has dates, the other counts from a start of its own
ONE_PLACE_MM = 0.01  # commands of one place are rounded, the coarsest to a hundredth
MINUTE = 120.0  # s: longer offsets are said in minutes


def import_lines(imported: Imported) -> list[str]:
    """Lines that the command line prints: what was read, how it was joined, and how well it fits."""
    return [*_read(imported), *_joined(imported), *_fits(imported)]


def _read(imported: Imported) -> Iterator[str]:
    for source in imported.sources:
        frame = source.recording.frame
        what = WORDS[source.what]
        yield f"{source.raw.path.name}: {source.title}, {counted(len(frame), 'row')} ({what})"
        columns = source.entry.columns
        if columns:
            yield "  columns: " + ", ".join(f"{ours} = {theirs}" for ours, theirs in columns.items())
        for note in source.recording.notes:
            yield f"  {note}"
        yield f"  kept as {source.entry.path}, SHA-256 {source.entry.sha256[:12]}..."


def _joined(imported: Imported) -> Iterator[str]:
    yield ""
    for source, own in zip(imported.sources, imported.pairs, strict=True):
        if own is None:
            continue
        if own.how:
            kind = "dwell" if own.averaged else "reading"
            of = counted(own.readings, kind)
            yield f"joined {len(own)} of {of} with {counted(own.commands, 'command')} by {own.how}"
        else:
            yield f"{len(own)} rows with their commands in {source.raw.path.name}"
        if own.offset is not None:
            yield f"  {_clock(source.raw.path.name, own.offset)}"
        for note in own.notes:
            yield f"  {note}"
    yield from _channels(imported)
    if imported.frame != "shared":
        yield f"  {FRAMES[imported.frame]}"


def _channels(imported: Imported) -> Iterator[str]:
    """What no proof shows: rows outside a log, and the zero of a programme."""
    table = imported.survey.table
    logs = [s for s in imported.sources if s.what == "log"]
    for name in (str(c) for s in logs for c in s.recording.frame if c in table and c != "time"):
        bare = int(table[name].isna().sum())
        if bare:
            yield f"  {name} of {bare} of {len(table)} rows is not known: they lie outside its log (--log-offset)"
    if logs:
        yield "  whether the clocks of logs are right, nothing proves: see when the log begins"
    turning = any(j.type == "rotary" for j in imported.machine.joints)
    if any(s.entry.offsets for s in imported.sources if s.what == "commands") and not turning:
        yield "  the zero of the programme is taken as --offset states it: points of linear axes do not prove it"


def _clock(name: str, offset: float) -> str:
    """How the clock of a file is set against that of the commands."""
    if abs(offset) < YEARS:
        return f"the clock of {name} is {_seconds(offset)} the commands'"
    zero = np.datetime64(round(abs(offset)), "s")
    return f"the clock of {'the commands' if offset > 0 else name} begins to count at {zero} of the other"


def _seconds(offset: float) -> str:
    size = abs(offset)
    text = f"{size:.4g} s" if size < MINUTE else f"{size / 60:.4g} min" if size < 3600 else f"{size / 3600:.5g} h"
    return f"{text} {'ahead of' if offset >= 0 else 'behind'}"


def _fits(imported: Imported) -> Iterator[str]:
    proof, survey = imported.proof, imported.survey
    yield from trace_lines(imported.traces)
    yield from reading_lines(survey, imported.readings, imported.set_ups)
    if len(proof.rows):
        yield from proof_lines(proof, survey)
    else:
        yield from _without_points(survey)
    bare = [s.raw.path.name for s in imported.sources if s.what == "motions" and not s.recording.beside_targets]
    if bare:
        yield (
            f"{', '.join(bare)}: deviations have no place of their own: rows that are shifted by one, or two that are "
            "exchanged, do not show"
        )


def _without_points(survey: Survey) -> Iterator[str]:
    if np.isfinite(survey.measured).any():
        yield "no row has x, y and z: a shift, other order, unit or sign would have shown, an exchange of two not"
    if "joint" in survey.table:
        yield f"{counted(int((survey.table['joint'] != '').sum()), 'row')} of error motions"


def _places(points: Array) -> int:
    """How many places there are among points (n, 3) mm, `FEWEST_PROVED` at most."""
    count = 0
    while len(points) and count < FEWEST_PROVED:
        points = points[np.linalg.norm(points - points[0], axis=1) > ONE_PLACE_MM]
        count += 1
    return count


def proof_lines(proof: Proof, survey: Survey) -> Iterator[str]:
    """How well the points lie on the commanded ones, what else was looked for, and how repeats scatter."""
    figures = f"{_length(proof.rms_um)} rms (median {_length(proof.median_um)}, largest {_length(proof.max_um)})"
    yield f"after alignment the measured points lie {figures} from the nominal machine; they reach {proof.reach:.0f} mm"
    places = _places(proof.nominal)
    if survey.indicated:
        yield "commands are what the axes indicated at what was touched: there is no join to prove"
    elif proof.one_place is not None:
        yield proof.one_place.text
    elif places < FEWEST_PROVED:
        yield f"too few places ({places}) to prove the join: exchanged rows or a shift may not show"
    else:
        if proof.other is not None:
            yield proof.other.text
        hand = "" if proof.flat else " or hand"
        signs = "sign, unit" if hand else "sign or unit"
        yield f"no shift or exchange of rows, no other {signs}{hand} fits better"
        if proof.flat:
            yield "which hand the axes have does not show: points in a plane fit their mirror image as well"
    yield from standing_lines(proof.standings, survey)
    yield from (step.text for step in proof.steps)
    if proof.repeats:
        yield f"{proof.repeats} commands measured several times: {_length(proof.repeat_um)} scatter of a coordinate"
    if np.isfinite(proof.dwell_um):
        size = _length(proof.dwell_um)
        yield f"scatter of a reading within dwells, taken as its standard uncertainty: {size} (median)"
    if len(proof.wild):
        rows = survey.table["row"].to_numpy()[proof.wild]
        more = " ..." if len(rows) > LISTED else ""
        yield f"far from their commands: rows {', '.join(map(str, rows[:LISTED]))}{more} (fit with --robust)"
    yield from proof.probable
    yield from proof.follows


def _length(um: float) -> str:
    return f"{um / 1e3:.3g} mm" if um >= 1e3 else f"{um:.3g} um"
