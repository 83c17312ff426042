"""From raw files to a survey: read, joined, mapped in a ``survey.yaml``, and proved before anything is written."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.files import write_bytes_atomic
from errormodel.inputs import running
from errormodel.machine import Machine
from errormodel.nominal import Nominal
from errormodel.serial_chain import ONLY_SERIAL
from errormodel.survey import Survey, read_survey
from errormodel.surveys.file import SURVEY_FILE
from errormodel.surveys.pairs import PairTable
from errormodel.surveys.plausibility import near_travel
from identification.importing.clock_jumps import refuse_backwards, unordered_times
from identification.importing.copies import copy_notes
from identification.importing.end_points import computed_notes
from identification.importing.exchanged_rows import CURE as FOUND_CURE
from identification.importing.geometry import turns_tool
from identification.importing.leaving_out import open_measured, without_rows
from identification.importing.near_causes import other_cause
from identification.importing.nearest import find_pairing
from identification.importing.other_orders import CURE
from identification.importing.own_frames import frame_of, parted_by_runs
from identification.importing.pairing import LOCATION_ERROR_MM, NEAREST, Pairs, middles, pair, points_of
from identification.importing.partial import refuse_partial
from identification.importing.proof import Proof, prove, refuse_instead_of_target, refuse_unit, with_other_order
from identification.importing.readings import ReadingFile, SetUps, join_readings, set_ups
from identification.importing.roles import Kind
from identification.importing.sources import SourceFile, Wishes, open_source
from identification.importing.traces import Trace, ball_notes, traces_of
from identification.importing.unused_options import refuse_unused

OTHER_COMMANDS = (
    "In no frame do half of them lie on these commands, in any order: they are of another test, cut off, or the "
    "machine file is of another machine (a parallel machine, as a delta or a hexapod, is none that errormodel models)"
)
Both: TypeAlias = tuple[Array, Array]  # nominal and measured points

UNEVEN = 3.0  # times: so much more often is no reflector measured than another
MOST_TARGETS, FEWEST_OF_TARGET = 8, 4  # words of a column that may name reflectors, and rows of each; by judgement
ON_TRAVEL = 0.5  # of the commands: with fewer on the travels their unit is doubted, and not that of the measurements


@dataclass(frozen=True)
class Imported:
    """A survey made of raw files.

    Attributes
    ----------
    files : text of the files of its folder by their names, and bytes of the raw ones.
    sources : the measured files, the commands and the logs.
    pairs : of each measured file.
    survey : as it is read from these files.
    proof : that what was measured belongs to its commands.
    traces : of a bar along a circle, among the sources.
    readings : files of single readings, among the sources.
    set_ups : how single readings lie beside those of a machine without errors.
    notes : what needs attention.
    """

    machine: Machine
    files: Mapping[str, bytes]
    sources: tuple[SourceFile, ...]
    pairs: tuple[Pairs | None, ...]
    survey: Survey
    proof: Proof
    frame: str
    notes: tuple[str, ...]
    traces: tuple[Trace, ...] = ()
    readings: tuple[ReadingFile, ...] = ()
    set_ups: SetUps = field(default_factory=SetUps)


def import_files(
    machine: Machine, raws: Sequence[Path], commands: Path | None, wishes: Wishes, seed: int = 0
) -> Imported:
    """Read raw files, join them with their commands and prove the join.

    Parameters
    ----------
    machine : Machine
    raws : measured files, one or several stations, and logs of temperatures.
    commands : an NC programme, a plan, a log or a table with the joints' positions; None: they stand in the raw files.
    wishes : what the user says about the files.
    seed : of the search for the nearest commands.

    Raises
    ------
    InputError
        A file cannot be read, or what was measured does not follow the commands: then it says what fits instead.
    """
    names = [p.name for p in (*raws, *([commands] if commands else []))]
    folded = [name.casefold() for name in names]  # two that differ in case only are one on Windows and macOS
    twice = [name for name in names if folded.count(name.casefold()) > 1]
    if twice:
        raise InputError(twice[0], "two files of one name", "Give them different names: they are kept in one folder")
    commanded = None if commands is None else open_source(commands, machine, "commands", wishes)
    kind: Kind = "whole" if commanded is None else "measured"
    sources = [open_measured(path, machine, kind, wishes, len(raws) > 1) for path in raws]
    refuse_unused(wishes, sources, commanded)
    sources = without_rows(sources, wishes.leave_out)
    chain = Chain(machine)
    points = [s for s in sources if s.what == "points"]
    motions = [s for s in sources if s.what == "motions"]
    logs = [s for s in sources if s.what == "log"]
    traces = traces_of(sources)
    single = [s for s in sources if s.what == "single"]
    if wishes.observation is not None and not single:
        found = f"--observation {wishes.observation.type}, and no file with a column of single readings"
        cure = f"Leave it out, or say which column they are: --columns {wishes.observation.reading}=.."
        raise InputError(str(raws[0]), found, cure)
    if not points and not motions and not traces and not single:
        raise InputError(str(raws[0]), "nothing measured in it but channels of a log", _of_a_log(sources, machine))
    if commanded is None:
        for source in (*points, *single):
            _refuse_no_commands(source, machine)
    pairs = [pair(source, commanded, chain, wishes, seed) for source in points]
    pairs = _one_place_each(pairs)
    aligned = [_places(source, own, commanded, chain) for source, own in zip(points, pairs, strict=True)]
    for source, (nominal, measured) in zip(points, aligned, strict=True):
        # else the unit of the commands is wrong, as the survey's check says
        if _on_travels(commanded or source, machine):
            refuse_unit(nominal, measured, source.raw.name, source.mm_a_unit)
        refuse_partial(nominal, measured, source.raw.name)
    readings = join_readings(single, commanded, chain, wishes)
    warnings: list[str] = []
    points = [_with_clock(s, p, bool(logs), warnings) for s, p in zip(points, pairs, strict=True)]
    readings = [replace(r, source=_with_clock(r.source, r.pairs, bool(logs), warnings)) for r in readings]
    single = [r.source for r in readings]
    frame = frame_of(points, aligned, chain, wishes.frame)
    mapped = _files(points, motions, traces, readings, logs, pairs, commanded, wishes, turns_tool(machine))
    files = _stated(mapped, "frame", frame)
    survey = _survey_of(files, machine)
    if frame == "shared" and not wishes.frame and parted_by_runs(machine, survey):
        frame = "per-run"
        files = _stated(mapped, "frame", frame)
        survey = _survey_of(files, machine)
    if any(len(own.targets) == 1 for own in pairs):
        refuse_instead_of_target(machine, survey)
    try:
        proof = prove(machine, survey, any(p.averaged for p in pairs), len(points) > 0)
    except InputError as error:
        error = _with_nearest(error, points, pairs, aligned, commanded, chain, seed)
        raise InputError(error.where, error.found, f"{error.cure}{_other_targets(points)}") from error
    if commanded is not None and any(p.by_rows for p in pairs):
        proof = with_other_order(machine, survey, proof)
        if proof.other is not None and wishes.match != "order":  # who says the order has confirmed it
            warnings.append(f"{proof.other.text}. {CURE}")
    warnings += [text for text in (proof.too_good, proof.one_place and proof.one_place.note) if text]
    warnings += [f"{t.source.raw.path.name}: {t.copied}" for t in traces if t.copied]
    if warning := ball_notes(traces)[1]:
        warnings.append(warning)
    places = set_ups(chain, survey, readings)
    warnings += [*computed_notes(survey, places.lengths), *copy_notes(survey)]
    if warnings:
        survey, files = _with_notes(warnings, survey, files)
    everything = (
        *points, *single, *motions, *(t.source for t in traces), *logs, *([commanded] if commanded else []),
    )  # fmt: skip
    pairs = [*pairs, *(r.pairs for r in readings)]
    left = tuple(f"{s.raw.path.name}: columns not used: {', '.join(s.left)}" for s in everything if s.left)
    return Imported(
        machine, files, everything, (*pairs, *[None] * (len(everything) - len(pairs))), survey, proof, frame,
        tuple(dict.fromkeys((*left, *survey.notes))), tuple(traces), tuple(readings), places,
    )  # fmt: skip


def _with_clock(source: SourceFile, own: Pairs, needed: bool, warnings: list[str]) -> SourceFile:
    """A file as it is, or without its times where its clock was set; what is to be said of them goes to `warnings`.

    Raises
    ------
    InputError
        Its clock was set, and other files are joined by it (`needed`).
    """
    if own.offset is not None or "time" not in source.recording.frame:
        return source  # joined by time: the clock was judged there
    when, frame = source.column("time"), source.recording.frame
    groups: Index = np.zeros(source.rows, dtype=np.intp)
    labels = [n for n in ("run", "station", "target") if n in frame and not own.averaged]
    if labels:
        groups = np.array(frame.groupby(labels, sort=False).ngroup(), dtype=np.intp)
    text = unordered_times(when, groups, own.averaged)
    if not text:
        return source
    if own.averaged and needed:
        refuse_backwards(when, source.raw.name)
    warnings.append(f"{source.raw.path.name}: {text}")
    return source.without("time") if own.averaged else source


def _on_travels(commands: SourceFile, machine: Machine) -> bool:
    """Whether most positions of each linear joint lie within its travel."""
    linear = [j for j in machine.joints if j.type == "prismatic" and j.name in commands.recording.frame]
    return all(np.mean(near_travel(j, commands.column(j.name))) > ON_TRAVEL for j in linear)


def _with_notes(texts: list[str], survey: Survey, files: Mapping[str, bytes]) -> tuple[Survey, dict[str, bytes]]:
    """A survey whose ``survey.yaml`` states notes, which every command repeats."""
    return replace(survey, notes=(*survey.notes, *texts)), _stated(files, "notes", texts)


def _stated(files: Mapping[str, bytes], key: str, value: object) -> dict[str, bytes]:
    """The files with one more key in ``survey.yaml``."""
    return {**files, SURVEY_FILE: files[SURVEY_FILE] + _yaml({key: value}).encode()}


def _survey_of(files: Mapping[str, bytes], machine: Machine) -> Survey:
    """The survey that is read from the files of its folder."""
    with tempfile.TemporaryDirectory() as folder, running(None):
        for name, data in files.items():
            write_bytes_atomic(data, Path(folder) / name)
        return read_survey(Path(folder) / SURVEY_FILE, machine)


def _one_place_each(pairs: Sequence[Pairs]) -> list[Pairs]:
    """A target of one name in several files at one place, where its places in them are one to a location error."""
    first: dict[str, tuple[float, float, float]] = {}
    out = []
    for own in pairs:
        together = {n: first.setdefault(n, p) for n, p in own.targets.items()}
        near = all(np.linalg.norm(np.subtract(together[n], p)) < LOCATION_ERROR_MM for n, p in own.targets.items())
        out.append(replace(own, targets=together) if near else own)
    return out


def _places(source: SourceFile, own: Pairs, commanded: SourceFile | None, chain: Chain) -> Both:
    """Nominal and measured points of the readings of a file, each (n, 3) in mm."""
    table = (commanded or source).recording.frame.iloc[own.command]
    nominal = Nominal(chain, table)
    tool = np.tile(np.asarray(chain.machine.tool, dtype=np.float64), (len(own), 1))
    frame = source.recording.frame
    if own.targets:
        labels = frame["target"].astype(str).str.strip() if len(own.targets) > 1 else ["1"] * source.rows
        tool = np.array([own.targets[label] for label in np.asarray(labels)[own.first]])
    elif "tool_x" in frame:
        tool = frame[["tool_x", "tool_y", "tool_z"]].to_numpy(dtype=np.float64)[own.first]
    seen = points_of(source)
    return nominal.points(tool), middles(seen, own.first, own.last)


def _with_nearest(
    error: InputError, points: Sequence[SourceFile], pairs: Sequence[Pairs], aligned: Sequence[Both],
    commanded: SourceFile | None, chain: Chain, seed: int,
) -> InputError:  # fmt: skip
    """A refusal, with what the nearest commands would give where another way of joining was used."""
    if commanded is None or len(points) != 1 or pairs[0].how == NEAREST or pairs[0].targets:
        return error
    path = Nominal(chain, commanded.recording.frame).points(np.asarray(chain.machine.tool, dtype=np.float64))
    measured = aligned[0][1]
    found = find_pairing(path, measured, seed) if np.isfinite(measured).all() else None
    if found is None:
        cause = other_cause(path, measured, seed, points[0].mm_a_unit)
        if cause is not None:
            found_text = f"{error.found}. What fits instead: with --match nearest, {cause[0]}"
            return InputError(error.where, found_text, f"{cause[1]}; and add --match nearest")
        cure = error.cure.replace(ONLY_SERIAL, OTHER_COMMANDS)
        cure = cure.replace(" or name", "") if pairs[0].how == "name" else cure
        return InputError(error.where, f"{error.found}{commanded.broken_off}", cure)
    if found.ways > 1 or np.array_equal(found.command, pairs[0].command):
        return error
    own = found.command >= 0
    off = np.linalg.norm(measured[own] - found.pose.apply(path[found.command[own]]), axis=1)
    what = f"with --match nearest {int(own.sum())} of {len(own)} readings fit to {1e3 * float(np.median(off)):.0f} um"
    cure = FOUND_CURE if ONLY_SERIAL in error.cure else error.cure
    return InputError(error.where, f"{error.found}{commanded.broken_off}. What fits instead: {what}", cure)


def _other_targets(points: Sequence[SourceFile]) -> str:
    """Advice where a column of a few words that come again and again may name the reflectors."""
    for source in points:
        frame = source.recording.frame
        for name in source.left if "target" not in frame else ():
            column = frame.get(name)
            words = [] if column is None or column.dtype.kind == "f" else sorted({*column.astype(str)} - {"", "nan"})
            counts = [int((column.astype(str) == word).sum()) for word in words] if column is not None else []
            even = bool(counts) and min(counts) >= max(counts) / UNEVEN  # of a word of state one is rare
            if even and 1 < len(words) <= MOST_TARGETS and len(words) <= source.rows / FEWEST_OF_TARGET:
                shown = ", ".join(words[:3])
                return f". If the column {name} ({shown}) names the reflectors, say --columns target={name}"
    return ""


def _of_a_log(sources: Sequence[SourceFile], machine: Machine) -> str:
    """What to do with files in which nothing is measured, but where the axes stood may be."""
    cure = "Give the measured file too"
    axes = [j.name for j in machine.joints]
    if any({*axes} <= {*map(str, s.recording.frame)} | {*s.entry.columns} for s in sources):
        cure += (
            f". If {' '.join(axes)} are what the axes indicated at a ball, a mandrel or a bore that was probed, add "
            "columns mx my mz with its place, the same in all its rows (in the coordinates of the part, or 0 with a "
            "run and frame: per-run for each)"
        )
    return cure


def _refuse_no_commands(source: SourceFile, machine: Machine) -> None:
    names = [str(n) for n in source.recording.frame]
    missing = [j.name for j in machine.joints if j.name not in names and not ({*j.drives} <= {*names} and j.drives)]
    if missing:
        what = f"{source.title}: {source.rows} rows of {', '.join(names[:10])}{' ...' if len(names) > 10 else ''}"
        found = f"read as {what}; no command of {', '.join(missing)} in it"
        cure = f"Give --commands FILE (an NC programme, a plan, a log, a table), or --columns {missing[0]}=.."
        raise InputError(source.raw.name, found, cure)


def _files(
    points: Sequence[SourceFile], motions: Sequence[SourceFile], traces: Sequence[Trace],
    readings: Sequence[ReadingFile], logs: Sequence[SourceFile], pairs: Sequence[Pairs], commanded: SourceFile | None,
    wishes: Wishes, turned: bool,
) -> dict[str, bytes]:  # fmt: skip
    """Files of the survey's folder: the raw ones as they came, the map but for its frame, and the pairs.

    `turned`: whether a joint turns the last frame; else the first target is where the tool of the machine is.
    """
    single = [r.source for r in readings]
    read = (*points, *single, *motions, *(t.source for t in traces), *logs, *([commanded] if commanded else []))
    files = {s.entry.path: s.raw.data for s in read}
    entries: list[dict[str, Any]] = []
    joins = [*zip(points, pairs, strict=True), *((r.source, r.pairs) for r in readings)]
    labels = {id(r.source): r.label for r in readings if r.label}
    for number, (source, own) in enumerate(joins, start=1):
        entry = _plain(source)
        if commanded is not None:
            entry["commands"] = _plain(commanded)
        if commanded is not None or own.averaged or len(own) < source.rows:
            name = "pairs.csv" if len(joins) == 1 else f"pairs_{number}.csv"
            entry["pairs"] = name
            files[name] = PairTable(name, own.command, own.first, own.last, own.start, own.run).text().encode()
        if own.targets:
            held = None if turned else next(iter(own.targets))
            entry["targets"] = {n: list(p) if n == held else {"near": list(p)} for n, p in own.targets.items()}
        if number <= len(points) and wishes.axes == "tool":
            entry["axes"] = wishes.axes
        if id(source) in labels:
            entry["observation"] = labels[id(source)]
        entries.append(entry)
    entries += [_plain(source) for source in motions]
    entries += [_plain(t.source) | {"observation": t.label} for t in traces]
    block: dict[str, Any] = {"errormodel": 1, "files": entries}
    if traces or readings:
        block["observations"] = {t.label: t.entry for t in traces} | {
            k: e for r in readings for k, e in r.entries.items()
        }
    if logs:
        block["logs"] = [_plain(s) | ({"offset": wishes.log_offset} if wishes.log_offset else {}) for s in logs]
    files[SURVEY_FILE] = _yaml(block).encode()
    return files


def _plain(source: SourceFile) -> dict[str, Any]:
    """An entry of survey.yaml: only what differs from what is left out."""
    return source.entry.model_dump(exclude_defaults=True)


def _yaml(block: dict[str, Any]) -> str:
    """The map as text: one line a column, so that a correction is a line."""
    from io import StringIO

    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    def laid_out(value: Any) -> Any:
        if isinstance(value, dict):
            return CommentedMap({k: laid_out(v) for k, v in value.items()})
        if isinstance(value, list):
            out = CommentedSeq([laid_out(v) for v in value])
            if not any(isinstance(v, dict) for v in value):
                out.fa.set_flow_style()
            return out
        return value

    yaml, stream = YAML(), StringIO()
    yaml.width = 120
    yaml.indent(mapping=2, sequence=4, offset=2)
    yaml.dump(laid_out(block), stream)
    return stream.getvalue()
