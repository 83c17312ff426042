"""Files of single readings in an import: their entries of ``observations:``, their commands, and how they lie there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from errormodel.chain import Chain
from errormodel.exceptions import InputError, nearest
from errormodel.observations.base import Observation
from errormodel.survey import Survey
from identification.diagnosis.data_checks.readings import Lengths, length_lines, lengths_of, refuse_exchanged
from identification.estimation.checks import FOREIGN_MACHINE_SHARE
from identification.importing.pairing import Pairs
from identification.importing.reading_pairs import Joined, labels_of, own_labels, pair_readings
from identification.importing.sources import SourceFile, Wishes
from identification.observation.assembly import build
from identification.observation.readings import ReadingView

MOST_PLACES = 20  # set-ups that are listed


@dataclass(frozen=True)
class ReadingFile:
    """A file of single readings with its place in a survey.

    Attributes
    ----------
    source : the file.
    label : its entry of ``observations:``; empty where a column of the file names them.
    entries : entries of ``observations:`` by their names.
    joined : its readings and commands.
    """

    source: SourceFile
    label: str
    entries: dict[str, dict[str, Any]]
    joined: Joined

    @property
    def pairs(self) -> Pairs:
        """Of readings and commands."""
        return self.joined.pairs


@dataclass(frozen=True)
class SetUps:
    """How single readings lie beside those of a machine without errors.

    Attributes
    ----------
    lengths : of each observation of lengths.
    places : where each set-up then roughly stands, as sentences.
    """

    lengths: tuple[Lengths, ...] = ()
    places: tuple[str, ...] = ()


def join_readings(
    sources: Sequence[SourceFile], commands: SourceFile | None, chain: Chain, wishes: Wishes
) -> list[ReadingFile]:
    """Files of single readings with the commands of each reading.

    Raises
    ------
    InputError
        They cannot be joined.
    """
    out: list[ReadingFile] = []
    if not wishes.observations:
        return out
    labels = labels_of([*sources])
    known = {label for s, own in zip(sources, labels, strict=True) for label in own_labels(s) or [own]}
    for label in wishes.observations:
        if label and label not in known:
            raise InputError("--observation", f"'{label}', which is read nowhere", nearest(label, sorted(known)))
    for source, label in zip(sources, labels, strict=True):
        own = own_labels(source)
        models = {one: wishes.observation_of(one) for one in own or [label]}
        entries = {one: _entry(model) for one, model in models.items()}
        joined = pair_readings(source, commands, chain, wishes, models)
        out.append(ReadingFile(source, "" if own else label, entries, joined))
    return out


def _entry(observation: Observation) -> dict[str, Any]:
    """An entry of ``observations:``, its type first."""
    return {"type": observation.type, **observation.model_dump(exclude_defaults=True, exclude={"type"})}


def set_ups(chain: Chain, survey: Survey, readings: Sequence[ReadingFile]) -> SetUps:
    """How the readings of an imported survey lie beside those of a machine without errors.

    Raises
    ------
    InputError
        Some stand in each other's row.
    """
    if not readings or any(r.joined.unplaced for r in readings):
        return SetUps()
    problem = build(chain, survey)
    lengths = lengths_of(chain, problem.views)
    refuse_exchanged(survey, lengths)
    for own in lengths:
        if own.far_mm > FOREIGN_MACHINE_SHARE * chain.size:
            found = f"half of the readings of {own.label} lie {own.far_mm:.3g} mm and more beside the nominal machine"
            cure = "Look for a wrong unit (--units length=..), sign, column, tool or known number of the observation"
            raise InputError(str(readings[0].source.raw.name), found, cure)
    return SetUps(tuple(lengths), tuple(_places(problem.readings)))


def _places(views: Sequence[ReadingView]) -> Iterator[str]:
    """Where set-ups stand, a line an observation or a run of it."""
    lines: dict[str, dict[str, float]] = {}
    for view in views:
        for name, value in view.starts.items():
            entry, _, quantity = name.removeprefix("observation[").partition("].")
            lines.setdefault(entry, {})[quantity] = value
    for entry, own in lines.items():
        yield f"set-up of {entry}, roughly (mm, rad): {', '.join(f'{n} {v:.6g}' for n, v in own.items())}"


def reading_lines(survey: Survey, readings: Sequence[ReadingFile], found: SetUps) -> Iterator[str]:
    """What is said of single readings: how they lie, where the set-ups stand, and what else was looked for."""
    yield from length_lines(survey, found.lengths)
    yield from found.places[:MOST_PLACES]
    yield from dict.fromkeys(s for r in readings for s in r.joined.says)
