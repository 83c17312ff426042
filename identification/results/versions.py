"""Reading of JSON files of results: their keys, the schema, and the version of errormodel that reads a file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel import __version__
from errormodel.exceptions import InputError

if TYPE_CHECKING:
    from pydantic import BaseModel

    from errormodel.yamlfile import Keys

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
        It is no JSON, has numbers that are not finite, is no such file, or a newer version of errormodel wrote it.
    OSError
        It cannot be opened.
    """
    place = str(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise InputError(place, "no mapping of keys to values", cure)
        keys = _not_finite(data)
    except UnicodeDecodeError as error:
        found = f"the byte 0x{error.object[error.start]:02x} at {error.start}, which is not UTF-8"
        raise InputError(place, found, cure) from error
    except json.JSONDecodeError as error:
        where = f"{path}, line {error.lineno}, column {error.colno}"
        raise InputError(where, f"no JSON from here on ({error.msg})", cure) from error
    except RecursionError as error:
        raise InputError(place, "lists or mappings nested too deep", cure) from error
    except ValueError as error:  # of thousands of digits
        raise InputError(place, "a number that is too long", cure) from error
    if keys:
        from errormodel.yamlfile import dotted

        raise InputError(f"{path}, key {dotted(keys)}", "a number that is not finite", cure)
    check_version(path, data, schema, cure)
    return data


def check_version(path: Path, data: Mapping[str, Any], schema: str, cure: str) -> None:
    """Check that a file of results is of a schema, and of no newer version of errormodel.

    Raises
    ------
    InputError
        It is not; the message names the version that reads it.
    """
    if "schema" not in data:
        raise InputError(f"{path}, key schema", "it is missing", cure)
    found, version = data["schema"], str(data.get("version", ""))
    written, own = (RELEASE.match(v) for v in (version, __version__))
    newer = (
        written is not None and own is not None and tuple(map(int, written.groups())) > tuple(map(int, own.groups()))
    )
    kind, _, number = schema.rpartition("/")
    if newer:
        what = f"errormodel {version} wrote it (schema {found!r}), and this is errormodel {__version__}"
        raise InputError(str(path), what, f"Use errormodel {version} or later")
    if found != schema and str(found).rpartition("/")[0] == kind:
        what = f"its schema is {found!r}, and errormodel {__version__} reads number {number} of it only"
        raise InputError(f"{path}, key schema", what, "Use the version of errormodel that wrote it")
    if found != schema:
        raise InputError(str(path), f"its schema is {found!r}, not {schema!r}", cure)


def validate(model: type[BaseModel], path: Path, data: Mapping[str, Any], cure: str) -> None:
    """Check the keys of a file by a model of them.

    Raises
    ------
    InputError
        About the first wrong key.
    """
    from pydantic import ValidationError

    from errormodel.yamlfile import dotted, shown

    try:
        model.model_validate(data)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        keys: Keys = detail["loc"]
        missing = detail["type"] == "missing"
        found = "it is missing" if missing else f"{shown(detail['input'])}: {_wanted(detail['msg'])}"
        raise InputError(f"{path}, key {dotted(keys)}", found, cure) from error


def reason_of(error: Exception) -> str:
    """Why a file cannot be read, in words."""
    return (
        f"the key {error} is missing" if isinstance(error, KeyError) else getattr(error, "strerror", "") or str(error)
    )


def _wanted(message: str) -> str:
    return re.sub("^(Input|List|Dictionary) should", "it should", message)


def _not_finite(data: object) -> Keys:
    """Keys of the first number that is NaN or infinite, which JSON does not have; empty where there is none."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        if isinstance(value, float) and not isfinite(value):
            return (key,)
        if keys := _not_finite(value):
            return (key, *keys)
    return ()
