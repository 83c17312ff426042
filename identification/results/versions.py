"""Reading of JSON files of results: the schema, and the version of errormodel that reads a file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from errormodel import __version__
from errormodel.exceptions import InputError

RELEASE = re.compile(r"(\d+)\.(\d+)")  # major and minor number, which a change of meaning raises


def read_json(path: Path, schema: str, cure: str) -> dict[str, Any]:
    """Content of a JSON file of results of a schema.

    Parameters
    ----------
    path : Path
    schema : str
        The value that its key ``schema`` must have.
    cure : str
        What to give instead of a file of another kind.

    Raises
    ------
    InputError
        It is no such file, or was written by a newer version of errormodel.
    OSError, ValueError, RecursionError
        It cannot be opened, or is no JSON.
    """
    data = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number)
    if not isinstance(data, dict):
        raise ValueError("no mapping of keys to values")
    check_version(path, data, schema, cure)
    return data


def check_version(path: Path, data: Mapping[str, Any], schema: str, cure: str) -> None:
    """Check that a file of results is of a schema, and of no newer version of errormodel.

    Raises
    ------
    InputError
        It is not; the message names the version that reads it.
    """
    found, version = data["schema"], str(data.get("version", ""))
    written, own = (RELEASE.match(v) for v in (version, __version__))
    newer = (
        written is not None and own is not None and tuple(map(int, written.groups())) > tuple(map(int, own.groups()))
    )
    kind = schema.rpartition("/")[0]
    if newer or (found != schema and str(found).rpartition("/")[0] == kind and version):
        what = f"errormodel {version} wrote it (schema {found!r}), and this is errormodel {__version__}"
        raise InputError(str(path), what, f"Use errormodel {version} or later")
    if found != schema:
        raise InputError(str(path), f"its schema is {found!r}, not {schema!r}", cure)


def _no_number(word: str) -> float:
    raise ValueError(f"{word}, which is no number of JSON")
