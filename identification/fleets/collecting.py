"""From the records of all parts to tables: surveys, parameters, findings, failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.fleets.estimates import Estimates
from identification.fleets.listing import Listing, Row
from identification.fleets.parts import Failure, Task, failed_rows
from identification.fleets.remarks import tables_of, without_copies
from identification.results.folder_contents import FAILURE_COLUMNS, PARTS

if TYPE_CHECKING:
    import pandas as pd

ALARM = "alarm"  # what `monitor` finds
NUMBERS = ("rows", "rms_um", "heldout_um", "noise_um")
FINDING = ("effect", "where", "motion", "driver", "probability", "p_value", "size_um", "statement")


@dataclass(frozen=True)
class Entry:
    """One survey of the list with what came of it.

    Attributes
    ----------
    type : of the machine, as the list or else the machine's file says; "" where neither is known.
    data : of its record; None where it failed.
    part : its folder of results, below that of the fleet; `seal` : SHA-256 of the manifest there.
    tables : digests of the tables that it was read from.
    """

    row: Row
    type: str
    data: Mapping[str, Any] | None
    part: str
    failure: Failure | None = None
    seal: str = ""
    tables: tuple[str, ...] = ()

    @property
    def estimates(self) -> Estimates:
        assert self.data is not None
        return Estimates.of_json(self.data["estimates"])

    @property
    def named(self) -> dict[str, Any]:
        """Which survey it is."""
        return {"row": self.row.number, "id": self.row.id, "survey": self.row.survey}

    @property
    def findings(self) -> Sequence[Mapping[str, Any]]:
        return () if self.data is None else self.data.get("findings", ())


@dataclass(frozen=True)
class Collected:
    """All surveys of a fleet, in the order of the list; `reports`: whether each part has a report."""

    command: str
    listing: Listing
    entries: tuple[Entry, ...]
    reports: bool = False

    def machines(self) -> dict[str, list[Entry]]:
        """Surveys of each machine, in the order of the list."""
        out: dict[str, list[Entry]] = {}
        for entry in self.entries:
            out.setdefault(entry.row.id, []).append(entry)
        return out

    def types(self) -> dict[str, dict[str, list[Entry]]]:
        """Surveys that were done, by type and machine."""
        out: dict[str, dict[str, list[Entry]]] = {}
        for identity, entries in self.machines().items():
            done = [e for e in entries if e.data is not None]
            if done:
                out.setdefault(done[0].type, {})[identity] = done
        return out

    def surveys(self) -> pd.DataFrame:
        """One row a survey of the list, failed ones too."""
        import pandas as pd

        rows = []
        for e in self.entries:
            data = e.data or {}
            rows.append(
                {"row": e.row.number, "id": e.row.id, "type": e.type, "machine": e.row.machine, "survey": e.row.survey,
                 "date": e.row.dated}
                | {c: e.row.labels[c] for c in self.listing.labels}
                | {"status": "failed" if e.data is None else "done", "verdict": data.get("verdict", "")}
                | {name: _number(data.get(name)) for name in NUMBERS}
                | {"findings": len(e.findings), "notes": len(data.get("notes", ())), "part": e.part, "seal": e.seal}
            )  # fmt: skip
        return pd.DataFrame(rows)

    def parameters(self) -> pd.DataFrame:
        """One row a quantity of each survey, in mm, rad and their ratios."""
        import pandas as pd

        columns: dict[str, list[Any]] = {
            c: []
            for c in ("row", "id", "type", "survey", "date", "parameter", "group", "symbol", "unit", "value", "std")
        }
        for e in self.entries:
            if e.data is None:
                continue
            known = e.estimates
            std = np.sqrt(np.diag(known.covariance))
            for w, value, s in zip(known.what, known.values, std, strict=True):
                cells = (e.row.number, e.row.id, e.type, e.row.survey, e.row.dated, w.id, w.group, w.symbol, w.unit)
                for name, cell in zip(columns, (*cells, float(value), float(s)), strict=True):
                    columns[name].append(cell)
        return pd.DataFrame(columns)

    def findings(self) -> pd.DataFrame:
        """One row a finding of each survey."""
        import pandas as pd

        rows = [
            {"row": e.row.number, "id": e.row.id, "type": e.type, "survey": e.row.survey, "date": e.row.dated}
            | {name: _cell(f.get(name)) for name in FINDING}
            for e in self.entries
            for f in e.findings
        ]
        names = ["row", "id", "type", "survey", "date", *FINDING]
        table = pd.DataFrame(rows, columns=names)
        numbers = ["probability", "p_value", "size_um"]
        return table.astype(dict.fromkeys(numbers, float) | {n: str for n in names if n not in (*numbers, "row")})

    def failures(self) -> pd.DataFrame:
        """One row a survey that failed: what to do about it."""
        return failures_of([(e.row, e.failure) for e in self.entries if e.failure is not None])


def failures_of(failed: Sequence[tuple[Row, Failure]]) -> pd.DataFrame:
    """Table of surveys that failed, and why."""
    import pandas as pd

    rows = [(row.number, row.id, row.survey, failure.wrong_input, failure.message) for row, failure in failed]
    return pd.DataFrame(rows, columns=list(FAILURE_COLUMNS))


def tasks_of(listing: Listing, make: Any, by_machine: bool) -> list[Task]:
    """The parts of a list: one a survey, or one a machine with its surveys by date."""
    if not by_machine:
        return [make((row,)) for row in listing.rows]
    machines: dict[tuple[str, str], list[Row]] = {}
    for row in listing.rows:
        machines.setdefault((row.id, row.machine), []).append(row)
    return [
        make(tuple(sorted(rows, key=lambda r: (np.nan_to_num(r.date, nan=np.inf), r.number))))
        for rows in machines.values()
    ]


def collected(
    command: str, listing: Listing, tasks: Sequence[Task], results: Mapping[int, Mapping[str, Any] | Failure]
) -> Collected:
    """Put together what came of each task, in the order of the list."""
    entries = []
    for k, task in enumerate(tasks):
        result = results[k]
        part = f"{PARTS}/{task.key}"
        failed = {row.number: failure for row, failure in failed_rows(task, result)}
        for number, row in enumerate(task.rows):
            if row.number in failed or isinstance(result, Failure):
                entries.append(Entry(row, row.type, None, "", failed[row.number]))
            else:
                kind = row.type or str(result["machine"])
                tables = tables_of(result["sources"], number)
                entries.append(Entry(row, kind, result["surveys"][number], part, None, str(result["seal"]), tables))
    whole = Collected(command, listing, tuple(sorted(entries, key=lambda e: e.row.number)), tasks[0].options.reports)
    return without_copies(whole)


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _cell(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return value
