"""What is to be said of single surveys: notes of their own, values far from all others, copies of one another."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.formats import SUFFIXES
from identification.fleets.parts import Failure

if TYPE_CHECKING:
    from identification.fleets.collecting import Collected, Entry
    from identification.fleets.comparison import Compared, Quantity

USUAL_SHARE = 0.5  # of a type's surveys, from which on a note says nothing of one machine


@dataclass(frozen=True)
class Noted:
    """One note, as it stands in the first survey that has it but for numbers, and all surveys that have it."""

    text: str
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Far:
    """A survey with values far outside the other surveys of its machine and those of its type.

    Attributes
    ----------
    quantities, of : how many of how many quantities.
    quantity, place : the one that lies farthest, and where in it the survey is.
    """

    entry: Entry
    quantities: int
    of: int
    quantity: Quantity
    place: int


def noted(entries: Sequence[Entry]) -> list[Noted]:
    """Notes of surveys, each once whatever its numbers, those of fewest surveys first."""
    groups: dict[str, tuple[str, list[Entry]]] = {}
    for entry in entries:
        for text in dict.fromkeys(map(str, (entry.data or {}).get("notes", ()))):
            name = PurePosixPath(entry.row.survey).name
            own = text.removeprefix(f"{name}: ")
            _, having = groups.setdefault(re.sub(r"\d+(\.\d+)?", "0", own), (own, []))
            if entry not in having[-1:]:
                having.append(entry)
    return sorted((Noted(text, tuple(having)) for text, having in groups.values()), key=lambda n: len(n.entries))


def own_notes(collected: Collected) -> dict[str, list[tuple[Entry, str]]]:
    """Of each machine the notes that fewer than half of its type's surveys have."""
    out: dict[str, list[tuple[Entry, str]]] = {}
    for machines in collected.types().values():
        entries = [e for own in machines.values() for e in own]
        for note in noted(entries):
            if len(note.entries) < USUAL_SHARE * len(entries) or len(machines) == 1:
                for e in note.entries:
                    out.setdefault(e.row.id, []).append((e, note.text))
    return out


def far_surveys(collected: Collected, compared: Compared) -> list[Far]:
    """Surveys that lie far outside, by the rate of false ones that was asked for: Bonferroni over a type's surveys."""
    out = []
    for t in compared.types:
        machines = collected.types().get(t.name, {})
        entries = [e for m in t.machines for e in machines.get(m, ())]
        found: dict[int, list[tuple[float, Quantity, int]]] = {}
        for q in t.quantities:
            limit = compared.rate / max(len(entries) * len(t.quantities), 1)
            for place in np.flatnonzero(q.far <= limit).tolist():
                found.setdefault(int(q.entries[place]), []).append((float(q.far[place]), q, place))
        for k, own in sorted(found.items()):
            _, farthest, place = min(own, key=lambda f: f[0])
            out.append(Far(entries[k], len(own), len(t.quantities), farthest, place))
    return out


def without_copies(collected: Collected) -> Collected:
    """Surveys of one machine that are byte for byte an earlier one are no further measurement: they count as failed."""
    seen: dict[tuple[str, tuple[str, ...]], Entry] = {}
    entries = []
    for e in collected.entries:
        first = seen.setdefault((e.row.id, e.tables), e) if e.tables else e
        if first is not e:
            found = f"{e.row.survey}: byte for byte {first.row.survey}, the survey of row {first.row.number}"
            failure = Failure(f"{found}, and no further measurement. Take the row out, or name the file that was meant")
            entries.append(replace(e, data=None, part="", seal="", failure=failure))
        else:
            entries.append(e)
    return replace(collected, entries=tuple(entries))


def copies(collected: Collected) -> Iterator[str]:
    """Sentences on surveys of different machines that are byte for byte the same."""
    seen: dict[tuple[str, ...], Entry] = {}
    for e in collected.entries:
        first = seen.setdefault(e.tables, e) if e.tables and e.data is not None else e
        if first.row.id != e.row.id:
            yield (
                f"row {e.row.number}, {e.row.id}: {e.row.survey} is byte for byte {first.row.survey} "
                f"of {first.row.id} in row {first.row.number}"
            )


def tables_of(sources: Sequence[Mapping[str, Any]], number: int) -> tuple[str, ...]:
    """Digests of the tables that a survey was read from."""
    own = (s for s in sources if s["of"] == number and PurePosixPath(s["path"]).suffix.lower() in SUFFIXES)
    return tuple(sorted(str(s["sha256"]) for s in own))
