"""Why a diagnosis found what it found: its decision log, read back and put in words."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError, nearest
from identification.diagnosis.decisions.fates import Fate, Place
from identification.diagnosis.decisions.log import COLUMNS, Decision
from identification.diagnosis.decisions.records import as_rows, from_rows
from identification.diagnosis.decisions.stages import CHECKED
from identification.diagnosis.decisions.summary import parts_of
from identification.diagnosis.results.findings import SCHEMA
from identification.results import manifest
from identification.results.versions import read_json, reason_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

FILE = "decisions.csv"
DIAGNOSIS = "diagnosis.json"
MOST_PLACES = 12  # of an effect without a place


class Explanation:
    """Result of `identification.explain`.

    Attributes
    ----------
    findings : effect and place of each finding of the diagnosis.
    asked : the effects at places that it is about, in their order; empty for all stages.
    notes : what cannot be checked of the folder that it was read from.
    """

    def __init__(
        self,
        log: Sequence[Decision],
        diagnosis: Mapping[str, Any],
        asked: str | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        self._log, self._diagnosis, self.notes = list(log), diagnosis, notes
        self.findings: list[Place] = [(f["effect"], f["where"]) for f in diagnosis["findings"]]
        self._parts = parts_of(self._log, self.findings)
        self.asked = [] if asked is None else self._places(asked)

    @classmethod
    def of(cls, folder: Path, asked: str | None = None) -> Explanation:
        """Read the folder of a diagnosis.

        Raises
        ------
        InputError
            The folder holds no diagnosis, or one of a version without a decision log, or a file was changed; or there
            is no such effect or place.
        """
        from identification.results.results_folder import whole

        with whole(folder):
            diagnosis, log = _read(folder)
            notes = manifest.missing(folder)
        return cls(log, diagnosis, asked, notes)

    @cached_property
    def decisions(self) -> pd.DataFrame:
        """The decision log, of what was asked for: one row a decision (columns as in ``decisions.csv``)."""
        import pandas as pd

        table = pd.DataFrame(as_rows(self._log), columns=list(COLUMNS))
        if not self.asked:
            return table
        own = [place in self.asked for place in zip(table["effect"], table["where"], strict=True)]
        return table[own].reset_index(drop=True)

    @property
    def fates(self) -> list[Fate]:
        """What became of each effect at a place that was asked for."""
        return [fate for fate, _ in self._fates()]

    def summary(self) -> str:
        """What the command line prints of it."""
        return "\n".join(self._lines())

    def plot(self) -> Figure:
        """Candidates by stage: the gain in log likelihood of each, round by round, and where it dropped out."""
        from identification.plots.decisions import draw_decisions

        return draw_decisions(self._parts, self.asked)

    def draw(self, path: str | Path) -> None:
        """Write the figure to a file (.svg, .png or .pdf)."""
        from identification.plots import style

        style.save(self.plot(), Path(path))

    def _lines(self) -> Iterator[str]:
        from identification.results.explanation_text import fate_lines, overview_lines

        if not self.asked:
            whole = [] if "" in self._parts else [d for d in self._log if not d.part]
            yield from overview_lines(self._parts, whole, self._diagnosis)
            return
        for number, (fate, part) in enumerate(self._fates()):
            if number:
                yield ""
            if part:
                yield f"==== {part}"
            yield from fate_lines(fate, self._parts[part], self._diagnosis)

    def _fates(self) -> list[tuple[Fate, str]]:
        out = []
        for effect, where in self.asked:
            known = [p for p, h in self._parts.items() if (effect, where) in h.of_place] or list(self._parts)[:1]
            out += [(self._parts[part].fate(effect, where), part) for part in known]
        return out

    def _places(self, asked: str) -> list[Place]:
        """The effects at places of ``EFFECT[@PLACE]``: the findings first, then by their first score."""
        from errormodel.effects import registry

        effect, at, where = asked.partition("@")
        known: dict[Place, float] = dict.fromkeys(self.findings, float("inf"))
        for history in self._parts.values():
            for place in history.of_place:
                score = history.first_scores.get(place)
                known.setdefault(place, -1.0 if score is None or score.value is None else score.value)
        effects = {*registry(), *CHECKED, *(e for e, _ in known)}
        if effect not in effects:
            raise InputError("EFFECT", f"there is no effect '{effect}'", nearest(effect, effects))
        places = {w for _, w in known}
        if at and where not in places:
            raise InputError("EFFECT@PLACE", f"there is no place '{where}' in this diagnosis", nearest(where, places))
        if at:
            return [(effect, where)]
        own = sorted((p for p in known if p[0] == effect), key=lambda p: -known[p])
        return own[:MOST_PLACES] or [(effect, "")]


def _read(folder: Path) -> tuple[dict[str, Any], list[Decision]]:
    from identification.results import manifest

    made = manifest.read(folder)
    if not folder.is_dir():
        raise InputError(str(folder), "there is no such folder", "Give the folder of a diagnosis")
    if not (folder / DIAGNOSIS).is_file():
        held = made.made_by if made is not None else "no results"
        cure = "Run `errormodel diagnose MACHINE SURVEY --out DIR`, and give that folder"
        raise InputError(str(folder), f"it holds {held}, and no diagnosis", cure)
    if not (folder / FILE).is_file():
        found = f"its diagnosis has no {FILE}: an earlier version wrote it"
        raise InputError(str(folder), found, "Run `errormodel diagnose` again with this version")
    try:
        diagnosis = read_json(folder / DIAGNOSIS, SCHEMA, "Give the folder of a diagnosis")
        diagnosis["findings"] = [dict(f, probability=float(f["probability"])) for f in diagnosis["findings"]]
        with (folder / FILE).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        found = f"its diagnosis cannot be read ({reason_of(error)})"
        raise InputError(str(folder), found, "Run `errormodel diagnose` again") from error
    if not rows:  # every diagnosis decides something: its verdict at least
        raise InputError(str(folder / FILE), "no decision in it", "Run `errormodel diagnose` again")
    return diagnosis, from_rows(rows, str(folder / FILE))
