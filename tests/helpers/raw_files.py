"""Tables as instruments and Windows programs write them, in any encoding, delimiter and header."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hypothesis import strategies as st

from errormodel.machine import Machine
from errormodel.raw_formats.base import Asked, Recording, format_of, open_raw

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252")
DELIMITERS = (",", ";", "\t", "|", " ")


@dataclass(frozen=True)
class Style:
    """How a table is written.

    Attributes
    ----------
    names : "plain", "none", "comment" (names behind ``#``).
    units : "none", "brackets", "parentheses", "row".
    """

    encoding: str = "utf-8"
    delimiter: str = ","
    comma: bool = False
    names: str = "plain"
    units: str = "none"
    comments: int = 0
    preamble: int = 0
    ends: bool = False
    newline: str = "\n"


STYLES = st.builds(
    Style,
    encoding=st.sampled_from(ENCODINGS),
    delimiter=st.sampled_from(DELIMITERS),
    comma=st.booleans(),
    names=st.sampled_from(["plain", "none", "comment"]),
    units=st.sampled_from(["none", "brackets", "parentheses", "row"]),
    comments=st.integers(0, 2),
    preamble=st.integers(0, 2),
    ends=st.booleans(),
    newline=st.sampled_from(["\n", "\r\n"]),
)


def written(
    style: Style, names: Sequence[str], units: Sequence[str], rows: Sequence[Sequence[float | str | None]]
) -> bytes:
    """The bytes of a table."""
    d = style.delimiter
    end = d if style.ends and d != " " else ""

    def cell(value: float | str | None) -> str:
        if value is None:
            return "NaN" if d == " " else ""
        text = value if isinstance(value, str) else repr(float(value))
        return text.replace(".", ",") if style.comma and not isinstance(value, str) else text

    heads = list(names)
    if style.units in ("brackets", "parentheses"):
        left, right = "[]" if style.units == "brackets" else "()"
        gap = "" if d == " " else " "
        heads = [f"{n}{gap}{left}{u}{right}" for n, u in zip(names, units, strict=True)]
    lines = [f"// made by a program, line {k}: Grad °" for k in range(style.comments)]
    lines += [f"Report of the instrument in the measuring room {'of the shop ' * k}" for k in range(style.preamble)]
    if style.names == "plain":
        lines.append(d.join(heads) + end)
    elif style.names == "comment":
        lines.append("# " + d.join(heads))
    if style.units == "row" and style.names == "plain":
        lines.append(d.join(units) + end)
    lines += [d.join(map(cell, row)) + end for row in rows]
    text = style.newline.join(lines) + style.newline
    return text.encode(style.encoding)


def read_back(
    folder: Path, data: bytes, machine: Machine | None = None, name: str = "raw.txt", **asked: str
) -> Recording:
    """A file with some bytes as its format reads it."""
    path = folder / name
    path.write_bytes(data)
    raw = open_raw(path, name)
    return format_of(raw).read(raw, Asked(machine, **asked))  # type: ignore[arg-type]
