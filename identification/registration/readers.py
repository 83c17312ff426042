"""Reader of point clouds in csv, xyz, ply and pcd, and of height matrices written by line profilers; mm."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.inputs import noted
from identification.registration.form import ProfileBlock
from identification.registration.pcd import read_pcd
from identification.registration.ply import read_ply
from identification.registration.refusals import unreadable

TEXT_SUFFIXES = (".csv", ".xyz", ".txt", ".asc")  # suffixes of text files
CLOUD_SUFFIXES = (*TEXT_SUFFIXES, ".ply", ".pcd")  # suffixes of all point clouds
# columns from which an unnamed table is taken for heights, not for points with attributes; by judgement
FEWEST_HEIGHT_COLUMNS = 12
MOST_COORDINATE_MM = 1e6  # mm: larger coordinates are refused
_MOST_PREAMBLE_BYTES = 1 << 16  # bytes in which the first line of numbers must begin
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf(?:inity)?)"  # a number, nan or inf
# Values that profilers write for missing returns: digits of 9 only, or the smallest integer in their unit.
_SENTINELS = (99.99, 99.999, 99.9999, 999.99, 999.999, 999.9999, 9999.0, 9999.99, 9999.999, 9999.9999, 99999.0)
_LEAST_INTEGERS = (2147483648.0, 2147483647.0, 21474.83648, 21474.83647, 2147483.648, 2147483.647, 32768.0)


def read_cloud(path: Path, name: str, profile: ProfileBlock | None) -> Array:
    """Points (n, 3) in mm in the sensor's frame; what the sensor marked as invalid is left out.

    Parameters
    ----------
    path : Path
    name : str
        The path as the user wrote it, for messages.
    profile : ProfileBlock or None
        Pitch and step, for files that hold heights alone.

    Raises
    ------
    InputError
        The file cannot be read, or holds no points.
    """
    suffix = path.suffix.lower()
    try:
        noted(path)
        with np.errstate(invalid="ignore"):  # a signalling NaN is as missing as any other
            if suffix == ".ply":
                points = _columns(name, read_ply(path, name))
            elif suffix == ".pcd":
                points = _columns(name, read_pcd(path, name))
            else:
                points = _text(path, name, profile)
    except OSError as error:
        raise InputError(name, f"cannot be read: {error.strerror or error}", "Give a file that can be read") from error
    invalid = np.isin(np.abs(points[:, 2]), (*_SENTINELS, *_LEAST_INTEGERS))
    valid = np.isfinite(points).all(axis=1) & ~invalid
    if not valid.any():
        found = "no points" if not len(points) else f"{len(points)} points, all of them invalid (NaN or a sentinel)"
        raise InputError(name, found, "Scan the artefact again")
    points = points[valid]
    far = np.abs(points).max()
    if far > MOST_COORDINATE_MM:
        raise InputError(name, f"a coordinate of {far:.3g} mm", "Write coordinates in mm; invalid points as NaN")
    return np.ascontiguousarray(points)


def _columns(name: str, data: dict[str, Array]) -> Array:
    missing = [c for c in "xyz" if c not in data]
    if missing:
        raise InputError(name, f"no column '{missing[0]}'", "Write a column each for x, y and z, in mm")
    return np.stack([np.asarray(data[c], dtype=np.float64) for c in "xyz"], axis=1)


def _text(path: Path, name: str, profile: ProfileBlock | None) -> Array:
    """Read a table of points with or without names, or a matrix of heights."""
    import pandas as pd

    with path.open("rb") as file:
        head = file.read(_MOST_PREAMBLE_BYTES)
    if b"\0" in head:
        raise InputError(name, "not a text file", f"Write the cloud as one of {', '.join(CLOUD_SUFFIXES)}")
    lines = head.decode("utf-8-sig", errors="replace").splitlines()
    skip = next((i for i, line in enumerate(lines) if _numbers(line)), None)
    if skip is None:
        raise InputError(name, "no line of numbers", "Write a point a line: x, y, z in mm")
    delimiter = next((d for d in ";\t," if d in lines[skip]), r"\s+")
    decimal = "," if delimiter in (";", "\t") and "," in lines[skip] else "."
    width = len(_split(lines[skip], delimiter))
    try:
        table = pd.read_csv(
            path,
            sep=delimiter,
            decimal=decimal,
            header=None,
            names=range(width),
            skiprows=skip,
            dtype=np.float64,
            comment="#",
            encoding="utf-8-sig",
            engine="c",
            skipinitialspace=True,
        )
    except (ValueError, pd.errors.ParserError) as error:
        raise _bad_cell(path, name, skip, delimiter, decimal, width, error) from error
    values = table.to_numpy()
    if width >= FEWEST_HEIGHT_COLUMNS:
        return _matrix(values, name, profile)
    return _columns(name, _named(values, name, lines[:skip], delimiter))


def _split(line: str, delimiter: str) -> list[str]:
    line = line.strip()
    return line.split() if delimiter == r"\s+" else line.split(delimiter)


def _numbers(line: str) -> bool:
    """Whether a line holds at least two numbers (or gaps) and nothing else."""
    cells = [c.strip() for c in re.split(r"[;\t]|,(?=\s)|(?<![;\t]),|\s+", line.strip())]
    filled = [c for c in cells if c]
    return len(filled) > 1 and all(re.fullmatch(_NUMBER, c, re.IGNORECASE) for c in filled)


def _bad_cell(
    path: Path, name: str, skip: int, delimiter: str, decimal: str, width: int, error: Exception
) -> InputError:
    """Where the table stops being one of numbers."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            cells = [c.strip().replace(decimal, ".") for c in _split(line.partition("#")[0], delimiter)]
            if number <= skip or not any(cells):
                continue
            bad = next((c for c in cells if c and not re.fullmatch(_NUMBER, c, re.IGNORECASE)), None)
            if bad is not None:
                return InputError(f"{name}, line {number}", f"'{bad[:40]}' is no number", "Write numbers, or NaN")
            if len(cells) > width:
                found = f"{len(cells)} columns where the lines before have {width}"
                return InputError(f"{name}, line {number}", found, "Give every line the same columns")
    return unreadable(name, "a table", error)


def _named(values: Array, name: str, above: Sequence[str], delimiter: str) -> dict[str, Array]:
    """Columns by the names in the last line above the numbers; otherwise the first three are x, y, z."""
    header = next((line for line in reversed(above) if line.strip("# \t\r\n")), "").strip("# \t\r\n")
    cells = header.split() if delimiter == r"\s+" else [c.strip() for c in re.split(delimiter, header)]
    bare = [re.sub(r"[\s_]*[\[(]?(mm)?[\])]?$", "", c.strip('" ').lower()) for c in cells]
    if len(cells) == values.shape[1] and any(c in ("x", "y", "z") for c in bare):
        return {c: values[:, bare.index(c)] for c in "xyz" if c in bare}
    if values.shape[1] < 3:
        raise InputError(name, f"{values.shape[1]} columns", "Write a point a line: x, y, z in mm")
    return {c: values[:, i] for i, c in enumerate("xyz")}


def _matrix(values: Array, name: str, profile: ProfileBlock | None) -> Array:
    """Points from heights by profile and column; x is 0 in the middle column, y in the first profile."""
    if profile is None:
        found = f"{values.shape[1]} columns: a matrix of heights, rows = profiles"
        raise InputError(name, found, "Write profile: {pitch: 0.0125, step: 0.1} (mm) in profiler.yaml")
    rows, columns = values.shape
    x = (np.arange(columns) - columns // 2) * profile.pitch  # the paper's Eq. (7): (i - 1600) pitch of 3200
    y = np.arange(rows) * profile.step  # from the first, so that an additional profile does not shift the others
    return np.stack([*np.broadcast_arrays(x[None, :], y[:, None]), values], axis=2).reshape(-1, 3)
