"""Table files: one module per format, chosen by the file's suffix; a folder of parts is one table in several files."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from types import ModuleType

from errormodel.discovery import modules
from errormodel.exceptions import InputError, nearest
from errormodel.formats.base import Table
from errormodel.inputs import noted, noted_folder


def _by_suffix() -> dict[str, ModuleType]:
    """Every module of this package, or from outside, that has ``SUFFIXES`` and ``open_table``; RuntimeError for two."""
    out: dict[str, ModuleType] = {}
    for module in map(import_module, modules(__name__)):
        for suffix in getattr(module, "SUFFIXES", ()):
            if suffix in out:
                raise RuntimeError(f"{suffix} is defined twice, by {out[suffix].__name__} and {module.__name__}")
            out[suffix] = module
    return out


_MODULES = _by_suffix()
SUFFIXES = tuple(_MODULES)
MOST_COLUMNS = 10_000  # of a table: a survey has some ten; more take longer to read than a survey to fit


def module_of(suffix: str) -> ModuleType:
    """The module that reads files of a suffix, one of `SUFFIXES`."""
    return _MODULES[suffix]


def open_tables(path: Path, name: str) -> list[Table]:
    """Open a file, or the files of a folder or a pattern in the order of their names (``part2`` before ``part10``).

    Parameters
    ----------
    path : Path
        Its name may be a pattern such as ``part*.parquet``.
    name : str
        The path as the user wrote it, for messages.

    Raises
    ------
    InputError
        There is no such file, or its content does not match its suffix.
    """
    try:
        if path.is_dir():
            return [_open(part, f"{name.rstrip('/')}/{part.name}") for part in _parts(path, name, path.iterdir())]
        if not path.exists() and re.search(r"[*?\[]", path.name) and any(path.parent.glob(path.name)):
            parts = _parts(path.parent, name, path.parent.glob(path.name))
            return [_open(part, (Path(name).parent / part.name).as_posix()) for part in parts]
        if not path.exists():
            beside = [p.name for p in path.parent.glob("*") if p.suffix.lower() in SUFFIXES or p.is_dir()]
            raise InputError(name, "no such file", nearest(path.name, beside, most=20))
        return [_open(path, name)]
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(name, f"cannot be read: {reason}", "Give a file that can be read") from error


def _open(path: Path, name: str) -> Table:
    noted(path)
    module = _MODULES.get(path.suffix.lower())
    if module is None:
        raise InputError(name, f"a file of type '{path.suffix}'", f"Write the table as one of {', '.join(SUFFIXES)}")
    table: Table = module.open_table(path, name)
    if len(table.columns) > MOST_COLUMNS:
        found = f"more than {MOST_COLUMNS} columns"
        raise InputError(f"{name}, header", found, "Give a table with a column for each quantity, and a row a pose")
    return table


def _parts(folder: Path, name: str, files: Iterable[Path]) -> list[Path]:
    noted_folder(folder, SUFFIXES)
    visible = [p for p in files if p.is_file() and not p.name.startswith((".", "_"))]
    parts = [p for p in visible if p.suffix.lower() in SUFFIXES]
    if not parts:
        surveys = [p.name for p in visible if p.suffix.lower() in (".yaml", ".yml")]
        cure = f"Give {name.rstrip('/')}/{surveys[0]}" if surveys else f"Put the parts there: {', '.join(SUFFIXES)}"
        raise InputError(name, "a folder without a table in it", cure)
    kinds = {_MODULES[p.suffix.lower()] for p in parts}
    if len(kinds) > 1:  # most likely the same data twice
        found = f"a folder with both {' and '.join(sorted({p.suffix.lower() for p in parts}))} files"
        cure = "Keep one kind there; if all are parts, name each under files: in a survey.yaml, and give that"
        raise InputError(name, found, cure)
    return sorted(parts, key=lambda p: ([int(t) if t.isdigit() else t for t in re.split(r"(\d+)", p.name)], p.name))
