"""Certificate of a test: one page that a customer reads, then figures, tables, charts and the digests of all inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from errormodel import __version__
from errormodel.surveys.record import RecordForm
from identification.conformity.decision import RULES, Verdict
from identification.conformity.text import cells, headline, limit_text
from identification.report.page import page
from identification.report.pictures import Picture, picture
from identification.report.record_head import head_of

if TYPE_CHECKING:
    from identification.iso_standards.base import Evaluation, Quantity, Sheet
    from identification.results.evaluation_result import EvaluationResult

FIRST_PAGE_ROWS = 12  # quantities of the first page, which is one sheet of paper
SIGNS: dict[Verdict, str] = {"passes": "✓", "fails": "✗", "cannot be decided": "?"}
ORDER: dict[Verdict, int] = {"fails": 0, "cannot be decided": 1, "passes": 2}


class Row(NamedTuple):
    """A quantity as a table has it."""

    name: str
    words: str
    value: str
    expanded: str
    unit: str
    limit: str
    verdict: str
    sign: str


class Part(NamedTuple):
    """Section of one standard."""

    number: str
    title: str
    source: str
    rows: list[Row]
    decided: bool
    sheets: tuple[Sheet, ...]
    drawn: list[Picture]
    notes: tuple[str, ...]


def certificate(result: EvaluationResult) -> str:
    """``certificate.html``: a self-contained HTML page; same input, same text."""
    record = result.record or RecordForm()
    judged = {id(j.quantity): j for j in result.conformity.judgements}

    def row(q: Quantity) -> Row:
        j = judged.get(id(q))
        verdict: Verdict | None = None if j is None else j.verdict
        return Row(
            q.name, q.words, *cells(q), "" if j is None else limit_text(j),
            verdict or "", "" if verdict is None else SIGNS[verdict],
        )  # fmt: skip

    every = [q for e in result.evaluations for q in e.quantities]
    first = [j.quantity for j in result.conformity.by_severity] or every
    limits = sorted({j.verdict for j in result.conformity.judgements}, key=ORDER.__getitem__)
    return page(
        "certificate.html",
        machine=result.machine,
        verdict=result.verdict,
        headline=headline(result.conformity),
        rule=RULES[result.conformity.rule],
        decided=bool(limits),
        head=head_of(result.record)._replace(missing=result.missing),
        number=record.number or "",
        titles=[e.title for e in result.evaluations],
        sources=list(dict.fromkeys(e.source for e in result.evaluations)),
        rows=[row(q) for q in first[:FIRST_PAGE_ROWS]],
        more=max(len(first) - FIRST_PAGE_ROWS, 0),
        unused=result.conformity.unused,
        parts=[_part(e, [row(q) for q in e.quantities]) for e in result.evaluations],
        reasons=[(j.quantity.name, j.reason) for j in result.conformity.judgements if j.reason],
        notes=result.survey_notes,
        unknown=list(dict.fromkeys(q.basis for q in every if q.expanded is None and np.isfinite(q.value))),
        undetermined=_undetermined(every),
        inputs=result.inputs,
        version=__version__,
    )


def _undetermined(every: Sequence[Quantity]) -> list[tuple[str, str]]:
    """Names of quantities that are not determined, by their reason."""
    reasons = dict.fromkeys(q.basis for q in every if not np.isfinite(q.value))
    return [(", ".join(q.name for q in every if not np.isfinite(q.value) and q.basis == why), why) for why in reasons]


def _part(e: Evaluation, rows: list[Row]) -> Part:
    drawn = [picture(c.draw, c.caption, c.alt) for c in e.charts]
    return Part(e.number, e.title, e.source, rows, any(r.verdict for r in rows), e.sheets, drawn, e.notes)
