"""Point clouds as files."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def ply(cloud: Array, form: str = "ascii", kind: str = "double", end: str = "\n", faces: bool = True) -> bytes:
    """A cloud as other programs write it: with colours before and after z, a comment, two faces."""
    order, code = ORDERS[form], {"double": "f8", "float": "f4"}[kind]
    lines = [
        "ply", f"format {form} 1.0", "comment made by a scanner, ü", "obj_info none", f"element vertex {len(cloud)}",
        f"property {kind} x", f"property {kind} y", "property uchar red", f"property {kind} z", "property short w",
    ]  # fmt: skip
    lines += ["element face 2", "property list uchar int vertex_indices"] * faces
    header = "".join(f"{line}{end}" for line in [*lines, "end_header"]).encode()
    if not order:
        body = "".join(f"{x!r} {y!r} 7 {z!r} -1{end}" for x, y, z in cloud.tolist()).encode()
        return header + body + (f"3 0 1 2{end}" * 2 * faces).encode()
    row = np.dtype([(n, f"{order}{c}") for n, c in (("x", code), ("y", code), ("red", "u1"), ("z", code), ("w", "i2"))])
    table = np.zeros(len(cloud), row)
    for name, column in zip("xyz", cloud.T, strict=True):
        table[name] = column
    return header + table.tobytes() + struct.pack(f"{order}B3i", 3, 0, 1, 2) * 2 * faces
