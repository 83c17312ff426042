"""Times as instruments write them: ISO 8601, day first (``11.10.2022``), month first (``10/11/22``), of a day only.

With slashes a day above twelve shows the order; where none does, the user is asked.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.raw_formats.base import DateOrder

_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2}(?:[.,]\d+)?))?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
_ZONE = r"(?P<zone>Z|[-+]\d{2}:?\d{2})?"
ISO = re.compile(rf"(?P<y>\d{{4}})[-/.](?P<a>\d{{1,2}})[-/.](?P<b>\d{{1,2}})(?:[T\s]+{_CLOCK}\s*{_ZONE})?")
OTHER = re.compile(
    rf"(?P<a>\d{{1,2}})(?P<sign>[./-])(?P<b>\d{{1,2}})(?P=sign)(?P<y>\d{{4}}|\d{{2}})(?:[T,\s]+{_CLOCK})?"
)
ONLY_CLOCK = re.compile(_CLOCK)
DAY = 86400.0  # s


@dataclass(frozen=True)
class Times:
    """Times of a column.

    Attributes
    ----------
    seconds : (n,) since 1970 (UTC where a zone is stated), or since midnight without a date; NaN: none.
    dated : whether there is a date.
    order : "", "day-first" or "month-first", as read.
    open : a cell whose day and month may be either; empty where the order is known.
    """

    seconds: NDArray[np.float64]
    dated: bool
    order: str = ""
    open: str = ""


def looks_like_time(cell: str) -> bool:
    """Whether a cell is a date or a time of day."""
    cell = cell.strip().lstrip("'")
    return any(p.fullmatch(cell) for p in (ISO, OTHER, ONLY_CLOCK))


def times_of(cells: pd.Series[str], order: DateOrder = "") -> Times | None:
    """Times of a column of text; None where a cell is neither a time nor empty.

    Parameters
    ----------
    cells : text as it stands in the file; an apostrophe before it is that of a spreadsheet.
    order : of day and month, where the file does not show it.
    """
    texts = [c.strip().lstrip("'").strip() for c in cells.fillna("")]
    filled = [t for t in texts if t]
    if not filled:
        return None
    if all(ONLY_CLOCK.fullmatch(t) for t in filled):
        clock = np.array([_clock(ONLY_CLOCK.fullmatch(t)) if t else np.nan for t in texts])
        midnights = np.cumsum(np.nan_to_num(np.diff(clock, prepend=clock[0])) < -DAY / 2)
        return Times(clock + DAY * midnights, dated=False)
    matches = [(ISO.fullmatch(t) or OTHER.fullmatch(t)) if t else None for t in texts]
    if any(m is None for m, t in zip(matches, texts, strict=True) if t):
        return None
    other = [m for m in matches if m is not None and m.re is OTHER]
    found, unsure = "", ""
    if other:
        found, unsure = _order(other, order)
    seconds = np.array([_seconds(m, found) if m is not None else np.nan for m in matches])
    return Times(seconds, True, found, unsure)


def _order(matches: list[re.Match[str]], asked: DateOrder) -> tuple[str, str]:
    """Order of day and month, and a cell that leaves it open."""
    if any(int(m["a"]) > 12 for m in matches):
        return "day-first", ""
    if any(int(m["b"]) > 12 for m in matches):
        return "month-first", ""
    if all(m["sign"] == "." for m in matches):  # no country writes the month first with points
        return "day-first", ""
    if asked:
        return asked, ""
    if all(m["a"] == m["b"] for m in matches):
        return "day-first", ""
    return "day-first", matches[0][0]


def _clock(match: re.Match[str] | None) -> float:
    if match is None or match["h"] is None:
        return 0.0
    hour = int(match["h"])
    if match["half"]:
        hour = hour % 12 + 12 * (match["half"][0] in "pP")
    return 3600.0 * hour + 60.0 * int(match["m"]) + float((match["s"] or "0").replace(",", "."))


def _seconds(match: re.Match[str], order: str) -> float:
    """Seconds since 1970; NaN for a date that no calendar has."""
    year = int(match["y"]) + (2000 if len(match["y"]) == 2 else 0)
    iso = match.re is ISO
    month, day = int(match["a"]), int(match["b"])
    if not iso and order == "day-first":
        month, day = day, month
    try:
        date = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "D")
    except ValueError:
        return float("nan")
    zone = match["zone"] if iso else None
    shift = 0.0
    if zone and zone != "Z":
        shift = (1 if zone[0] == "+" else -1) * (3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:]))
    return float(date.astype("int64")) * DAY + _clock(match) - shift
