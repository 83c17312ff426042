"""Reader of PLY point clouds: the columns of element `vertex`, as text or binary of either byte order.

The format is Greg Turk's (Stanford, 1994). Other elements, such as faces, are skipped. The header is checked against
the size of the file before memory is allocated.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from identification.registration.refusals import CURE, too_short, unreadable

PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
# prefix of NumPy types by format of the file
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MOST_HEADER_BYTES = 1 << 20  # bytes in which the header must end; by judgement


@dataclass
class _Element:
    """Element of the header: number of rows, and type of each property; `lists` names those of varying length."""

    name: str
    count: int
    properties: dict[str, str] = field(default_factory=dict)
    lists: list[str] = field(default_factory=list)

    def row(self, order: str) -> np.dtype[np.void]:
        """Data type of a row as stored in binary."""
        return np.dtype([(name, f"{order}{kind}") for name, kind in self.properties.items()])


def read_ply(path: Path, name: str) -> dict[str, Array]:
    """Coordinates of the vertices of a PLY file.

    Parameters
    ----------
    path : Path
    name : str
        The path as the user wrote it, for messages.

    Returns
    -------
    dict of array (n,)
        Those of the columns x, y and z that the file has, in its unit.

    Raises
    ------
    InputError
        The file is not a PLY, is truncated, or an element of varying length precedes the vertices.
    """
    with path.open("rb") as file:
        order, elements = _header(file, name)
        position = next((k for k, e in enumerate(elements) if e.name == "vertex"), None)
        if position is None:
            raise InputError(name, "no element 'vertex'", "Write the points as vertices with x, y, z")
        vertex, before = elements[position], elements[:position]
        if vertex.lists:
            raise InputError(name, f"vertex property '{vertex.lists[0]}' is a list", CURE)
        size = path.stat().st_size - file.tell()
        table = _binary(file, name, vertex, before, order, size) if order else _text(file, name, vertex, before, size)
    return {c: table[c] for c in "xyz" if c in table}


def _header(file: BinaryIO, name: str) -> tuple[str, list[_Element]]:
    """Byte order ("" of text) and elements; the file is left where the data begin."""
    elements: list[_Element] = []
    order: str | None = None
    for number, words in enumerate(_lines(file, name), start=1):
        match words:
            case ["ply"] if number == 1:
                continue
            case _ if number == 1:
                raise unreadable(name, "PLY", "it does not begin with 'ply'")
            case ["format", kind, "1.0"] if kind in BYTE_ORDERS:
                order = BYTE_ORDERS[kind]
            case ["element", element, count] if count.isascii() and count.isdigit():
                elements.append(_Element(element, int(count)))
            case ["property", "list", count, kind, column] if elements and {count, kind} <= PLY_TYPES.keys():
                elements[-1].lists.append(column)
            case ["property", kind, column] if elements and kind in PLY_TYPES and column not in elements[-1].properties:
                elements[-1].properties[column] = PLY_TYPES[kind]
            case ["comment" | "obj_info", *_] | []:
                continue
            case _:
                raise unreadable(f"{name}, line {number}", "PLY", f"'{' '.join(words)[:60]}' in its header")
    if order is None:
        raise unreadable(name, "PLY", "no line 'format' in its header")
    return order, elements


def _lines(file: BinaryIO, name: str) -> Iterator[list[str]]:
    """Lines of the header as words, up to ``end_header``."""
    while file.tell() < MOST_HEADER_BYTES and (line := file.readline(MOST_HEADER_BYTES)).endswith(b"\n"):
        words = line.decode("ascii", errors="replace").split()
        if words == ["end_header"]:
            return
        yield words
    raise unreadable(name, "PLY", "no line 'end_header'")


def _binary(
    file: BinaryIO, name: str, vertex: _Element, before: list[_Element], order: str, size: int
) -> dict[str, Array]:
    if odd := next((e for e in before if e.lists), None):
        found = f"element '{odd.name}', whose rows differ in length, stands before the vertices"
        raise InputError(name, found, "Write the vertices first, or the cloud as csv with x, y, z")
    skipped = sum(e.count * e.row(order).itemsize for e in before)
    row = vertex.row(order)
    if skipped + vertex.count * row.itemsize > size:
        raise too_short(name, vertex.count, max(size - skipped, 0) // max(row.itemsize, 1))
    file.seek(skipped, io.SEEK_CUR)
    table = np.frombuffer(file.read(vertex.count * row.itemsize), dtype=row) if row.itemsize else np.empty(0, row)
    return {column: table[column].astype(np.float64) for column in vertex.properties}


def _text(file: BinaryIO, name: str, vertex: _Element, before: list[_Element], size: int) -> dict[str, Array]:
    width = len(vertex.properties)
    if 2 * (vertex.count * width + sum(e.count for e in before)) - 1 > size:  # at least a digit and a space each
        raise too_short(name, vertex.count)
    for _ in range(sum(e.count for e in before)):
        file.readline()
    if not vertex.count or not width:
        return {column: np.empty(0) for column in vertex.properties}
    rows = (line for line in file if line.strip())
    first = next(rows, None)
    if first is None:
        raise too_short(name, vertex.count, 0)
    try:
        table = np.loadtxt(chain([first], rows), dtype=np.float64, max_rows=vertex.count, comments=None, ndmin=2)
    except ValueError as error:
        raise unreadable(name, "PLY", str(error).split("; ")[0]) from error
    if table.shape[1] != width:
        found = f"{table.shape[1]} numbers a vertex where its header names {width}"
        raise InputError(name, found, CURE)
    if len(table) < vertex.count:
        raise too_short(name, vertex.count, len(table))
    return dict(zip(vertex.properties, table.T, strict=True))
