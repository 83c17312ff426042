"""Reader of PCD point clouds, by pypcd4; the header is checked against the file size before memory is allocated."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.extras import optional
from identification.registration.refusals import too_short, unreadable

LZF_RATIO = 132  # bytes from one byte of LZF at most: two or three bytes repeat up to 264
HEADER_LINES = 10  # lines of a header, as many as pypcd4 reads


def read_pcd(path: Path, name: str) -> dict[str, Array]:
    """Coordinates of a point cloud in the format of the Point Cloud Library.

    Parameters
    ----------
    path : Path
    name : str
        The path as the user wrote it, for messages.

    Returns
    -------
    dict of array (n,)
        Those of the fields x, y and z that the file has, in its unit.

    Raises
    ------
    InputError
        The file is not a PCD, or holds fewer points than its header announces.
    """
    pypcd4 = optional("pypcd4.pypcd4", name, "a point cloud in PCD", "save it as PLY or XYZ")
    try:
        with path.open("rb") as file:
            promised = _promised(file, name, path.stat().st_size)
        cloud = pypcd4.PointCloud.from_path(path)
        data = {field: cloud.numpy((field,))[:, 0] for field in cloud.fields if field in "xyz"}
    except InputError:
        raise
    except (ValueError, KeyError, IndexError, RuntimeError, TypeError, struct.error) as error:  # no class of its own
        raise unreadable(name, "PCD", error) from error
    for values in data.values():
        if len(values) != promised:
            raise too_short(name, promised, len(values))
    return data


def _promised(file: BinaryIO, name: str, size: int) -> int:
    """Number of points by the header; InputError where the file cannot hold them."""
    from pypcd4.pypcd4 import Encoding, MetaData

    lines: list[str] = []
    for row in file:
        line = row.decode("utf-8").strip()
        if line and not line.startswith("#"):
            lines.append(line)
            if line.startswith("DATA") or len(lines) >= HEADER_LINES:
                break
    head = MetaData.parse_header(lines)
    left = size - file.tell()
    values = head.points * sum(head.count)
    bytes_ = head.points * sum(s * c for s, c in zip(head.size, head.count, strict=True))
    if head.data == Encoding.ASCII:
        enough = 2 * values - 1 <= left  # at least a digit and a space each
    elif head.data == Encoding.BINARY:
        enough = bytes_ <= left
    elif head.points:
        packed, unpacked = struct.unpack("II", file.read(8))
        if unpacked != bytes_:
            raise ValueError(f"{unpacked} bytes are packed, its header makes it {bytes_}")
        enough = packed <= left - 8 and unpacked <= LZF_RATIO * packed
    else:
        enough = True
    if not enough:
        raise too_short(name, head.points)
    return int(head.points)
