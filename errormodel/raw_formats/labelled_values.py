"""Lines of labelled values: ``P1 X=1.5 Y=2.5``, ``X: 1.5, Y: 2.5``, ``X1.5 Y2.5``, objects of JSON, frames of KRL.

KRL writes ``XP1={A1 10.5,A2 -90.0,...}``: a blank between label and number.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.cells import NUMBER, kind_of
from errormodel.raw_formats.table_columns import columns_of

_CLOCK = r"\d[\d.\-/T]*(?::\d+)+(?:[.,]\d+)?Z?"
_PAIR = re.compile(
    r"([\"']?)([^\W\d]\w*)\1(?:\s*[:=]\s*|\s+(?=[-+.\d])|(?<=\b[A-Z])(?=[-+]?\d+[.,]\d))"
    rf"(?:([\"'])([^\"']*)\3|({_CLOCK}|{NUMBER.pattern})(?![\w:]))"
)
LEAST_SHARE = 0.5  # of the lines with text must hold the same labels


class LabelledValues(RawFormat):
    """Lines with the same labels, two or more with numbers; words before the first label are the point's name."""

    name = "labelled-values"
    title = "lines of labelled values"
    source = "no description: labels and values are found in the file"
    fallback = True
    bare = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        try:
            return raw.text is not None and raw.layout is None and bool(_labels(raw))
        except InputError:  # a table with a broken row
            return False

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        labels = _labels(raw)
        if not labels:
            raise InputError(raw.name, "no lines of labelled values", "Leave --format out")
        rows, lines = [], []
        for number, line in enumerate(raw.lines, start=1):
            found = {m[2]: m for m in _PAIR.finditer(line)}
            if {*labels} <= {*found}:
                first = min(m.start() for m in found.values())
                rows.append([line[:first].strip(" \t{[(,;:"), *(_value(found[label]) for label in labels)])
                lines.append(number)
        names = ["point" if "point" not in labels else "label", *labels]
        table = ["\t".join(names), *("\t".join(row) for row in rows)]
        recording = columns_of(replace(raw, data="\n".join(table).encode()), asked)
        frame = recording.frame
        if not any(row[0] for row in rows):
            frame = frame.drop(columns=names[:1])
        notes = tuple(n for n in recording.notes if n != "columns separated by tabs")
        left = sum(bool(line.strip()) for line in raw.lines) - len(rows)
        if left:
            notes = (*notes, f"{left} line{'s' * (left > 1)} without these labels passed over")
        return replace(recording, frame=frame, lines=tuple(lines), notes=(*raw.notes, *notes))


def _value(match: re.Match[str]) -> str:
    """The text of a value, without its quotes."""
    return match[5] if match[5] is not None else match[4].strip()


def _labels(raw: RawFile) -> tuple[str, ...]:
    """Labels of most lines, in their order; none where too few lines agree or fewer than two are of numbers."""
    full = [line for line in raw.lines if line.strip()]
    found = [{m[2]: m for m in _PAIR.finditer(line)} for line in full]
    counts = Counter(tuple(own) for own in found if len(own) > 1)
    labels, most = max(counts.items(), key=lambda item: item[1], default=((), 0))
    if most < 2 or most < LEAST_SHARE * len(full):
        return ()
    own = [f for f in found if {*labels} <= {*f}]
    numbers = [label for label in labels if all(kind_of(_value(f[label])) == "number" for f in own)]
    return labels if len(numbers) > 1 else ()
