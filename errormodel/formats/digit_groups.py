"""Separators between groups of three digits: ``1.234,5`` ``1,234.5`` ``1 234,5`` ``1'234.5``.

A point or comma before three digits may be such a separator or the decimal sign. The other cells of the file decide;
where they do not, the file is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

_BLANKS = " '\u2019\u00a0\u202f"  # between groups in French, Swiss and ISO 80000 style: never a decimal sign
_GROUPS_OF_BLANKS = rf"^[-+]?[1-9]\d{{0,2}}(?:[{_BLANKS}]\d{{3}})+(?:[.,]\d+)?$"


@dataclass(frozen=True)
class Ungrouped:
    """Columns without separators between groups, which were taken out, and the first ambiguous cell."""

    columns: dict[str, pd.Series[str]]
    separators: frozenset[str]
    ambiguous: tuple[str, int] | None  # column, row from 0


def ungrouped(columns: Mapping[str, pd.Series[str]]) -> Ungrouped:
    """Take the separators between groups of digits out of the columns of numbers of one file."""
    out = {name: text.fillna("").str.strip() for name, text in columns.items()}
    removed = set[str]()
    for name, text in out.items():
        grouped = text.str.contains(_GROUPS_OF_BLANKS, regex=True)
        if grouped.any():
            removed.add("blank")
            out[name] = text.mask(grouped, text.str.replace(f"[{_BLANKS}]", "", regex=True))
    for group, decimal in ((".", ","), (",", ".")):
        g, d = rf"\{group}", rf"\{decimal}"
        certain = rf"^[-+]?[1-9]\d{{0,2}}(?:(?:{g}\d{{3}})+{d}\d+|(?:{g}\d{{3}}){{2,}})$"
        possible = rf"^[-+]?[1-9]\d{{0,2}}(?:{g}\d{{3}})+(?:{d}\d+)?$"
        sure = any(t.str.contains(certain, regex=True).any() for t in out.values())
        other = any(t.str.contains(rf"^[-+]?\d*{d}\d+$", regex=True).any() for t in out.values())
        if not (sure or other):
            continue
        for name, text in out.items():
            grouped = text.str.contains(possible, regex=True)
            if not grouped.any() or (text.str.contains(g, regex=True) & ~grouped).any():
                continue  # elsewhere in the column the sign is a decimal one
            if not sure:
                return Ungrouped(out, frozenset(removed), (name, int(np.argmax(grouped.to_numpy()))))
            removed.add(group)
            out[name] = text.mask(grouped, text.str.replace(group, "", regex=False))
    return Ungrouped(out, frozenset(removed), None)
