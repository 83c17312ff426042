"""Result of a fleet for the Python API: tables, what is out, what is common, storage."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.fleets.collecting import ALARM, Collected
from identification.fleets.comparison import EFFECT, LEVEL, TREND, Compared, Quantity, Test
from identification.fleets.partial_pooling import Normal
from identification.fleets.remarks import Far, Noted, far_surveys, noted, own_notes
from identification.fleets.text import fleet_lines, reason
from identification.results.results_folder import ResultsFolder
from identification.runtime.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "errormodel.fleet/1"
MOST_NOTES = 2  # of a machine's surveys, beside what it is out by
MOST_CSV_ROWS = 100_000  # of a table that is written as CSV beside Parquet
TABLES = ("machines", "surveys", "parameters", "findings", "normal", "standing", "common", "failures")
NO_RESULT, NORMAL, UNKNOWN = "no result", "normal", "not compared"


class FleetResult:
    """Result of `identification.fleet`; all tables are DataFrames.

    Attributes
    ----------
    collected : what came of each survey; `compared` : of all together.
    taken : parts that an earlier run had finished.
    """

    def __init__(self, collected: Collected, compared: Compared, taken: int = 0) -> None:
        self.collected, self.compared, self.taken = collected, compared, taken

    @cached_property
    def surveys(self) -> pd.DataFrame:
        """One row a survey of the list: what came of it, and the folder of its results (``part``)."""
        return self.collected.surveys()

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """One row a quantity of each survey: ``value``, ``std`` (k = 1) in ``unit`` (mm, rad and their ratios)."""
        return self.collected.parameters()

    @cached_property
    def findings(self) -> pd.DataFrame:
        """One row a finding of each survey."""
        return self.collected.findings()

    @cached_property
    def failures(self) -> pd.DataFrame:
        """One row a survey that failed, and why."""
        return self.collected.failures()

    @property
    def common(self) -> pd.DataFrame:
        """One row an effect at a place, or a parameter, of a type: how many of its machines have it, and the others."""
        return self.compared.common

    @cached_property
    def normal(self) -> pd.DataFrame:
        """One row a quantity of each type: mean over its machines, their spread, scatter of one, trend a year."""
        import pandas as pd

        rows = []
        for t in self.compared.types:
            for q in t.quantities:
                level = q.level
                rows.append(
                    {"type": t.name, "parameter": q.what.id, "group": q.what.group, "symbol": q.what.symbol,
                     "unit": q.what.unit, "machines": len(q.machines), "surveys": q.surveys,
                     "learned_from": int(level.kept.sum()), "mean": level.mean, "mean_std": level.mean_std,
                     "spread": level.spread, "spread_low": level.low, "spread_high": level.high,
                     "within": q.each.within, "moves_mm": q.moves}
                    | _trend_of(q.trend)
                )  # fmt: skip
        return pd.DataFrame(rows)

    @cached_property
    def standing(self) -> pd.DataFrame:
        """One row a quantity of each machine: its own estimate, the pooled one, how far it is from the others."""
        import pandas as pd

        found = {
            (t.machine, t.kind, id(t.quantity))
            for t, counts in zip(self.compared.tests, self.compared.verdict.tests, strict=True)
            if counts
        }
        parts, start = [], 0
        for t in self.compared.types:
            parts += [self._standing(t.name, t.machines, q, start, found) for q in t.quantities]
            start += len(t.machines)
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["id", "type", "parameter"])

    def _standing(
        self, kind: str, machines: tuple[str, ...], q: Quantity, start: int, found: set[tuple[int, str, int]]
    ) -> pd.DataFrame:
        import pandas as pd

        n = len(q.machines)
        trend = {
            name: np.full(n, np.nan) for name in ("trend", "trend_std", "trend_pooled", "trend_pooled_std", "trend_p")
        }
        if q.trend is not None:
            for name, own in zip(
                trend,
                (
                    q.each.trends[q.dated],
                    np.sqrt(q.each.trend_variances[q.dated]),
                    q.trend.pooled,
                    q.trend.pooled_std,
                    q.trend.p,
                ),
                strict=True,
            ):
                trend[name][q.dated] = own
        out, drifts = ([(start + int(m), k, id(q)) in found for m in q.machines] for k in (LEVEL, TREND))
        # no member of its type, or its surveys no members of one machine: what it is, its own surveys say
        own = np.array(out) | np.array(drifts) | (q.each.stretch > 1)
        values, std = q.each.values, np.sqrt(q.each.variances) * q.each.stretch
        for name in ("trend", "trend_std"):
            pooled = name.replace("trend", "trend_pooled")
            trend[pooled][own] = trend[name][own]
        return pd.DataFrame(
            {"id": [machines[m] for m in q.machines], "type": kind, "parameter": q.what.id, "symbol": q.what.symbol,
             "unit": q.what.unit, "value": values, "std": std,
             "pooled": np.where(own, values, q.level.pooled), "pooled_std": np.where(own, std, q.level.pooled_std),
             "t": q.level.t, "p": q.level.p, "out": out}
            | trend
            | {"drifts": drifts}
        )  # fmt: skip

    @cached_property
    def machines(self) -> pd.DataFrame:
        """One row a machine, those to visit first before the others: ``state``, ``q``, ``effect_um``, ``why``."""
        import pandas as pd

        compared, found, notes = self.compared, self.found, own_notes(self.collected)
        place = {m: k for k, m in enumerate(compared.machines)}
        rows = []
        for identity, entries in self.collected.machines().items():
            first, k = entries[0], place.get(identity)
            tests = found.get(identity, [])
            alarm = any(f["effect"] == ALARM for f in entries[-1].findings)
            judged = k is not None and np.isfinite(compared.verdict.p[k])
            state = (
                tests[0].kind
                if tests
                else ALARM
                if alarm
                else NORMAL
                if judged
                else UNKNOWN
                if k is not None
                else NO_RESULT
            )
            why = [reason(t) for t in tests[:3]]
            if tests:
                why += [f"note of {e.row.survey}: {text}" for e, text in notes.get(identity, ())[:MOST_NOTES]]
            if alarm and not tests:
                why = [str(f["statement"]) for f in entries[-1].findings[:3]]
            if k is None and first.failure is not None:
                why = [first.failure.message]
            rows.append(
                {"id": identity, "type": first.type or compared.type_of.get(identity, "")}
                | {c: first.row.labels[c] for c in self.collected.listing.labels}
                | {"surveys": len(entries), "failed": sum(e.failure is not None for e in entries), "state": state,
                   "out": identity in found, "p": float("nan") if k is None else float(compared.verdict.p[k]),
                   "q": float("nan") if k is None else float(compared.verdict.q[k]),
                   "reasons": len(tests), "effect_um": effect_um(tests), "why": "; ".join(why)}
            )  # fmt: skip
        table = pd.DataFrame(rows)
        order = {LEVEL: 0, "trend": 0, EFFECT: 0, ALARM: 1, NORMAL: 2, UNKNOWN: 3, NO_RESULT: 4}
        table["_rank"] = table["state"].map(order)
        table = table.sort_values(["_rank", "effect_um", "q"], ascending=[True, False, True], kind="stable")
        table = table.drop(columns="_rank").reset_index(drop=True)
        table.insert(0, "rank", np.arange(1, len(table) + 1))
        return table

    @cached_property
    def notes(self) -> list[Noted]:
        """Notes of the surveys, each once, with the surveys that have it."""
        return noted(self.collected.entries)

    @cached_property
    def far(self) -> list[Far]:
        """Surveys whose values lie far outside their machine's other surveys and their type."""
        return far_surveys(self.collected, self.compared)

    @cached_property
    def found(self) -> dict[str, list[Test]]:
        """Machines that are out, and the tests that say so."""
        return self.compared.found()

    @property
    def complete(self) -> bool:
        """Whether no survey failed."""
        return not len(self.failures)

    def as_json(self) -> dict[str, Any]:
        """Content of ``fleet.json``."""
        from errormodel import __version__

        visit = self.machines[self.machines["state"].isin([LEVEL, "trend", EFFECT, ALARM])]
        return {
            "schema": SCHEMA,
            "version": __version__,
            "command": self.collected.command,
            "list": self.collected.listing.name,
            "false_alarm_rate": self.compared.rate,
            "machines": len(self.machines),
            "surveys": len(self.surveys),
            "failed": len(self.failures),
            "types": [
                {"type": t.name, "machines": len(t.machines), "quantities": len(t.quantities),
                 "out": sum(m in self.found for m in t.machines)}
                for t in self.compared.types
            ],
            "visit_first": visit[["rank", "id", "type", "state", "q", "effect_um", "why"]].to_dict("records"),
            "common": self.common[self.common["common"]].drop(columns="common").to_dict("records"),
            "failures": self.failures.to_dict("records"),
            "notes": [
                {"text": n.text, "surveys": [e.named for e in n.entries]} for n in self.notes
            ],
            "far_surveys": [f.entry.named | {"quantities": f.quantities, "of": f.of} for f in self.far],
        }  # fmt: skip

    def summary(self) -> str:
        """What the command line prints of it."""
        return "\n".join(fleet_lines(self))

    def report(self) -> str:
        """``fleet.html``: a page that holds all it shows."""
        from identification.report.fleet import fleet_page

        return fleet_page(self)

    def save(self, folder: str | Path | ResultsFolder, *, progress: Progress = silent) -> Path:
        """Write all tables, ``fleet.json`` and ``fleet.html``, as a whole or not at all.

        Parameters
        ----------
        folder : str, Path or ResultsFolder
        progress : callable
            Called with the name of each long part; returns a context manager around it.

        Returns
        -------
        Path
            The folder.
        """
        from errormodel.files import write_csv, write_parquet, write_text_atomic
        from identification.results.json_text import dumps

        out = folder if isinstance(folder, ResultsFolder) else ResultsFolder(Path(folder), "fleet")
        out.check()
        with out.replaced() as part:
            with progress("Writing tables"):
                for name in TABLES:
                    table = getattr(self, name)
                    write_parquet(table, part / f"{name}.parquet")
                    if len(table) <= MOST_CSV_ROWS:
                        write_csv(table, part / f"{name}.csv")
                write_text_atomic(dumps(self.as_json()), part / "fleet.json")
            with progress("Drawing the page"):
                write_text_atomic(self.report(), part / "fleet.html")
        return out.path

    def __repr__(self) -> str:
        return f"<FleetResult: {len(self.machines)} machines, {len(self.surveys)} surveys, {len(self.found)} out>"

    def _repr_html_(self) -> str:
        return str(self.machines.head(20).to_html(index=False, float_format=lambda x: f"{x:.3g}"))


def effect_um(tests: list[Test]) -> float:
    """What all that is found of a machine does at the tool: root sum of squares, each quantity once.

    Figures of standards are ranges of the same readings, looked at in several ways: the largest counts.
    """
    if not tests:
        return float("nan")
    best: dict[object, float] = {}
    for t in tests:
        q = t.quantity
        figure = q is not None and not q.what.members and not q.what.is_log
        key = "figure" if figure else t.shown if q is None else id(q)
        best[key] = max(best.get(key, 0.0), float(np.nan_to_num(t.size_um)))
    return float(np.sqrt(sum(v**2 for v in best.values())))


def _trend_of(trend: Normal | None) -> dict[str, float]:
    names = ("trend_machines", "trend_mean", "trend_mean_std", "trend_spread", "trend_p")
    if trend is None:
        return dict(zip(names, (0.0, *[float("nan")] * 4), strict=True))
    numbers = (len(trend.kept), trend.mean, trend.mean_std, trend.spread, trend.p_mean)
    return dict(zip(names, map(float, numbers), strict=True))
