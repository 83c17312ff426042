"""Proof that single readings belong to their commands: what a machine without errors would read there.

What is unknown of a set-up (a station, a dead path, a zero) is taken as it fits the readings best. Readings in another
order, unit or sign leave much more than errors of a machine, and are refused with what fits instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.nominal import Nominal
from errormodel.observation_kernel import ObservationKernels, kernels_of
from errormodel.observations.base import LineError, Observation, StepError
from errormodel.surveys.columns import first_pose
from errormodel.units import factor
from identification.importing.partial import BETTER, FEWEST, FOREIGN, SHIFTS, UNITS
from identification.importing.sources import SourceFile
from identification.observation.frames import MACHINE_ERROR_SHARE

MOST = 0.8  # of the readings: so many lie within the misfit that is compared, single ones may be wrong
ALIKE = 3.0  # times the misfit of the best way: another one fits as well; by judgement
LARGE = 10 * MACHINE_ERROR_SHARE  # of the reach: errors of a sound machine leave less
SMALL = 0.01  # mm or rad at a metre: what lies so near has no mistake worth a refusal
STEPS = 4  # of Gauss and Newton, from a set-up that is near
ORDER_CURE = "Give the commands that were measured, in the order of measuring"
LINE = (
    "lengths along a straight line, taken as displacements along it: where the instrument stood does not show. `iso` "
    "needs no more (230-2, 230-6); `fit` and `diagnose` do: near: [x, y, z] of the observation in survey.yaml"
)
EXACT = 1e-6  # mm or rad: misfits below are alike
ANGLE = ("deg", "arcsec", "urad", "mrad", "rad")


@dataclass(frozen=True)
class Candidate:
    """A way in which readings may belong to commands.

    Attributes
    ----------
    command : (n,) row of the command of each reading, from 0.
    how : in words, as the end of "joined by ...".
    start : (n,) row of the first of two commands, of readings between two poses.
    run : (n,) label of the pass.
    skip : readings at the beginning that are left out, such as the zero at the first command itself.
    offset : s between two clocks, if any.
    """

    command: Index
    how: str
    start: Index | None = None
    run: tuple[str, ...] | None = None
    skip: int = 0
    offset: float | None = None


@dataclass(frozen=True)
class Chosen:
    """The way in which readings belong to commands; what to say of it; whether they do not show their set-up."""

    way: Candidate
    says: tuple[str, ...]
    unplaced: bool = False


@dataclass(frozen=True)
class Misfit:
    """What readings lie off those of a machine without errors.

    Attributes
    ----------
    size : within which most of them lie, mm or rad.
    rms : root mean square of all.
    reach : how far nominal readings and positions spread, mm (1 of angles).
    why : why the set-up could not be placed at all; empty where it was.
    interrupted : whether that is a step that stays.
    line : whether the points lie on a straight line, so that the place of the instrument does not show.
    """

    size: float
    rms: float
    reach: float
    why: str = ""
    interrupted: bool = False
    line: bool = False


@dataclass(frozen=True)
class Lying:
    """Readings beside those of a machine without errors, with the set-up that fits them best.

    Attributes
    ----------
    readings : (n,) mm or rad.
    kernels, rows : of the model on the chain, and its channels at the poses, each (n,).
    scalars : errors of the machine, all 0, and quantities of the set-up.
    free : names of the unknown quantities, which stand at `places` of the scalars.
    line : whether the points lie on a straight line, so that the place of the instrument does not show.
    """

    readings: Array
    kernels: ObservationKernels
    rows: list[Array]
    scalars: Array
    free: tuple[str, ...]
    places: list[int]
    line: bool = False

    def gap(self, readings: Array, scalars: Array) -> Array:
        """Readings less nominal ones, (n,)."""
        return np.asarray(readings - self.kernels.kernel("value")(self.rows, scalars)[0])

    def nominal_at(self, chain: Chain, commands: SourceFile) -> Array:
        """What would be read at all commands, one pose each, with this set-up."""
        rows = Nominal(chain, commands.recording.frame).channels(np.asarray(chain.machine.tool, dtype=np.float64))
        return np.asarray(self.kernels.kernel("value")([np.ascontiguousarray(c) for c in rows], self.scalars)[0])

    def size_in(self, order: Index) -> float:
        """Within which most readings in another order lie, the set-up adapted from where it stands."""
        readings, scalars = self.readings[order], self.scalars.copy()
        for _ in range(STEPS if self.free else 0):
            slopes = self.kernels.kernel("design", (), self.free)(self.rows, scalars).T
            scalars[self.places] += np.linalg.lstsq(slopes, self.gap(readings, scalars), rcond=1e-9)[0]
        return float(np.quantile(np.abs(self.gap(readings, scalars)), MOST))


def misfit(
    chain: Chain, commands: SourceFile, observation: Observation, candidate: Candidate, readings: Array
) -> Misfit:
    """How readings lie beside those of a machine without errors, the set-up as it fits them best."""
    each = _passes(observation, candidate, readings[candidate.skip :])
    parts = [_misfit(chain, commands, observation, part, own) for part, own in each]
    bad = next((p for p in parts if p.why), None)
    worst = max(p.size for p in parts)
    rms = float(np.sqrt(np.mean([p.rms**2 for p in parts])))
    return bad or Misfit(worst, rms, max(p.reach for p in parts), line=any(p.line for p in parts))


def _passes(observation: Observation, way: Candidate, readings: Array) -> Iterator[tuple[Candidate, Array]]:
    """The passes of which the set-up has a value each, with their readings; all at once where it has not."""
    if way.run is None or not observation.by_run:
        yield way, readings
        return
    runs = np.array(way.run)
    for run in dict.fromkeys(way.run):
        own = runs == run
        start = None if way.start is None else way.start[own]
        yield replace(way, command=way.command[own], start=start, run=None), readings[own]


def _misfit(
    chain: Chain, commands: SourceFile, observation: Observation, candidate: Candidate, readings: Array
) -> Misfit:
    try:
        there, reach = lying(chain, commands, observation, candidate, readings)
    except StepError as error:
        return Misfit(np.inf, np.inf, 1.0, str(error), interrupted=True)
    except ValueError as error:
        return Misfit(np.inf, np.inf, 1.0, str(error))
    gap = np.abs(there.gap(readings, there.scalars))
    return Misfit(float(np.quantile(gap, MOST)), float(np.sqrt(np.mean(gap**2))), reach, line=there.line)


def lying(
    chain: Chain, commands: SourceFile, observation: Observation, candidate: Candidate, readings: Array
) -> tuple[Lying, float]:
    """The readings with the set-up placed, and how far they reach, mm (1 of angles); ValueError where it cannot be."""
    table = commands.recording.frame
    here = table.iloc[candidate.command]
    if observation.poses == 1:
        tables = [here]
    elif candidate.start is not None:
        tables = [table.iloc[candidate.start], here]
    else:
        own = {j.name: first_pose(j.name) for j in chain.machine.joints}
        if not {*own.values()} <= {str(c) for c in table}:
            raise ValueError("commands without columns from_<joint>. Give them")
        tables = [here.assign(**{name: here[old] for name, old in own.items()}), here]
    tool = np.asarray(chain.machine.tool, dtype=np.float64)
    poses = [Nominal(chain, t) for t in tables]
    points = [p.points(tool) for p in poses]
    known = {q.name: q.value for q in observation.quantities() if q.value is not None}
    free = [q.name for q in observation.free]
    line = False
    try:
        start = observation.start(points, readings, known)
    except LineError as error:
        start, line = error.start, True
    values = dict.fromkeys(free, 0.0) | start | known
    names = [q.name for q in observation.quantities()]
    scalars = np.concatenate([np.zeros(len(chain.ids)), [values[n] for n in names]])
    rows = [np.ascontiguousarray(c) for p in poses for c in p.channels(tool)]
    places = [len(chain.ids) + names.index(n) for n in free]
    reach = 1.0 if observation.reading == "angle" else max(float(np.ptp(np.vstack(points), axis=0).max()), 1.0)
    return Lying(readings, kernels_of(chain, observation), rows, scalars, tuple(free), places, line), reach


def both_poses(chain: Chain, commands: SourceFile) -> bool:
    """Whether each row of commands has the two poses of a distance, in columns `X` and `from_X` of all joints."""
    first = [first_pose(j.name) for j in chain.machine.joints]
    table = commands.recording.frame
    return {*first} <= {*map(str, table)} and bool(table[first].notna().all(axis=None))


def chosen(
    chain: Chain, commands: SourceFile, observation: Observation, candidates: list[Candidate], readings: Array,
    where: str, read_as: float = 1.0,
) -> Chosen:  # fmt: skip
    """The way that fits; `read_as`: mm or rad a unit as which the file's numbers were read.

    Raises
    ------
    InputError
        None fits, or two do, or the readings fit far better in another order, unit or sign: it says which.
    """
    tried = [(misfit(chain, commands, observation, c, readings), c) for c in candidates]
    tried.sort(key=lambda one: one[0].size)
    best, way = tried[0]
    stopped = next(((m, c) for m, c in tried if m.interrupted), None)
    if best.why and stopped is not None:
        found, _, cure = stopped[0].why.partition(". ")
        return Chosen(stopped[1], (f"{found}. {cure.replace('(column run)', '(a column run of pairs.csv)')}",), True)
    if best.why or best.size > FOREIGN * best.reach:
        raise InputError(where, *_none(chain, commands, observation, candidates, readings, best, read_as))
    for other, its in tried[1:]:
        if other.size > ALIKE * best.size + EXACT or _same(way, its):
            continue
        found = f"readings that fit the commands in two ways: by {way.how}, and by {its.how}"
        raise InputError(where, found, "Give the commands once for each reading, or a plan with both poses in a row")
    says = _refuse_wrong_order(chain, commands, observation, way, readings, best, where, read_as)
    return Chosen(way, (*([LINE] if best.line else []), *says), best.line)


def _same(one: Candidate, other: Candidate) -> bool:
    """Whether two ways give every reading the same poses."""
    if one.skip != other.skip or not np.array_equal(one.command, other.command):
        return False
    if one.start is None or other.start is None:
        return one.start is other.start
    return np.array_equal(one.start, other.start)


def _none(
    chain: Chain, commands: SourceFile, observation: Observation, candidates: list[Candidate], readings: Array,
    best: Misfit, read_as: float,
) -> tuple[str, str]:  # fmt: skip
    """What is wrong where no way fits, and what to write: what fits instead, if anything does."""
    instead = _instead(chain, commands, observation, candidates, readings, best, read_as)
    if instead is not None:
        return f"{_size(best)}; {instead[0]}", instead[1]
    if best.why:
        found, _, cure = best.why.partition(". ")
        if "near:" in cure:
            cure += f", of one file or label as --observation 'LABEL={observation.type}, near: [x, y, z]'"
        return found, f"{cure}. See that these commands were measured, in this order, and the type of --observation"
    return _size(best), "See that these commands were measured, in this order, and the unit and type of the readings"


def _size(best: Misfit) -> str:
    return f"readings that lie {best.rms:.3g} off their commands" if not best.why else best.why.partition(". ")[0]


def _instead(
    chain: Chain, commands: SourceFile, observation: Observation, candidates: list[Candidate], readings: Array,
    before: Misfit, read_as: float,
) -> tuple[str, str] | None:  # fmt: skip
    """Another set-up, unit, sign or order in which the readings fit far better, with what to write."""
    changed = _by_pass(observation)
    if changed is not None:
        keys, model = changed
        for way in candidates:
            if way.run is not None and _better(misfit(chain, commands, model, way, readings), before):
                text = f"a set-up of its own for each pass fits ({way.how})"
                return text, f"Write --observation '{observation.type}, {keys}', if it was moved between the passes"
    for way in candidates:
        for words, order in _orders(len(readings)):
            if _better(misfit(chain, commands, observation, way, readings[order]), before):
                return f"{words} they fit", ORDER_CURE
    angles = observation.reading == "angle"
    units = (
        {u: factor(u, "angle") for u in ANGLE} if angles else {"mm": 1.0} | {u: f for f, u in UNITS.items() if f > 0}
    )
    for way in candidates:
        for unit, size in units.items():
            scaled = readings * (size / read_as)
            if abs(size / read_as - 1) > EXACT and _better(misfit(chain, commands, observation, way, scaled), before):
                return f"in {unit} they fit", f"Say it with --units {observation.reading}={unit}, if that is their unit"
        if _better(misfit(chain, commands, observation, way, -readings), before):
            column = f"--columns {observation.reading}=-NAME"
            return "with the other sign they fit", f"Turn it with {column}, NAME being the column of the readings"
    return None


def _better(after: Misfit, before: Misfit) -> bool:
    return not after.why and after.size < FOREIGN * after.reach and after.size * BETTER < before.size


def _orders(n: int) -> list[tuple[str, Index]]:
    rows = np.arange(n)
    out = [("in reversed order", rows[::-1])]
    for k in sorted((k for k in range(-SHIFTS, SHIFTS + 1) if k and abs(k) < n), key=abs):
        late = f"{abs(k)} row{'s' * (abs(k) > 1)} {'later' if k > 0 else 'earlier'}"
        out.append((f"taken {late}", np.roll(rows, -k)))
    return out


def _by_pass(observation: Observation) -> tuple[str, Observation] | None:
    """The observation with all its unknowns a pass, and the keys that say so; None where it has none."""
    keys = [k for k in type(observation).model_fields if getattr(observation, k) == "unknown"]
    if not keys:
        return None
    return ", ".join(f"{k}: per-run" for k in keys), observation.model_copy(update=dict.fromkeys(keys, "per-run"))


def _refuse_wrong_order(
    chain: Chain, commands: SourceFile, observation: Observation, way: Candidate, readings: Array, before: Misfit,
    where: str, read_as: float,
) -> list[str]:  # fmt: skip
    """Refuse readings that fit far better in another order, unit or sign; what else was looked for, in words."""
    if len(readings) < FEWEST:
        return [f"too few readings ({len(readings)}) to prove the join"]
    if before.size > LARGE * before.reach:
        instead = _instead(chain, commands, observation, [way], readings, before, read_as)
        if instead is not None:
            raise InputError(where, f"{_size(before)}; {instead[0]}", instead[1])
    shown = True
    for part, own in _passes(observation, way, readings[way.skip :]):
        there, reach = lying(chain, commands, observation, part, own)
        size = float(np.quantile(np.abs(there.gap(own, there.scalars)), MOST))
        others = [(words, there.size_in(order)) for words, order in _orders(len(own))]
        # readings that are alike whatever their order show nothing; the way back is another matter
        shown &= all(after > max(BETTER * size, SMALL) for words, after in others if words.startswith("taken"))
        if size < SMALL:
            continue
        for words, after in others:
            if after * BETTER < size and after < FOREIGN * reach:
                found = f"{_size(before)}; {words} they fit to {1e3 * after:.3g} um (urad)"
                raise InputError(where, found, ORDER_CURE)
    if not shown:
        return ["whether readings are shifted, exchanged or of another sign does not show: other orders fit as well"]
    said = ["no shift of the readings, no other order, unit or sign fits better"]
    if {q.name for q in observation.free} >= {*observation.point} and observation.point:
        said.append("which hand the axes have does not show: lengths fit their mirror image as well")
    return said
