"""Folders of point clouds: one file per artefact, the same artefacts in every folder, and the time of each scan."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from errormodel.exceptions import InputError
from errormodel.inputs import noted, noted_folder
from identification.registration.readers import CLOUD_SUFFIXES

_SECONDS = {"s": 1.0, "sec": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0, "hr": 3600.0}  # s per unit of time


def clouds_in(folder: Path, count: int, reference: Sequence[Path] = ()) -> list[Path]:
    """Clouds of a folder, in the order of the numbers in their names (``artefact_2`` before ``artefact_10``).

    Parameters
    ----------
    folder : Path
    count : int
        Number of artefacts.
    reference : sequence of Path
        Clouds of the cold folder, from which the name of a missing file follows.

    Raises
    ------
    InputError
        The folder does not exist, or does not hold one cloud per artefact.
    """
    if not folder.is_dir():
        found = "a file" if folder.exists() else "no such folder"
        raise InputError(str(folder), found, "Give a folder with one cloud an artefact, such as artefact_01.csv")
    files = [
        p for p in folder.iterdir() if p.is_file() and p.suffix.lower() in CLOUD_SUFFIXES and p.name[0] not in "._"
    ]
    for path in files:
        noted(path)
    noted_folder(folder, CLOUD_SUFFIXES)
    files.sort(key=lambda p: ([int(t) if t.isdigit() else t for t in re.split(r"(\d+)", p.stem)], p.name))
    stems = [p.stem for p in files]
    twice = next((s for i, s in enumerate(stems) if s in stems[:i]), None)
    if twice is not None:
        both = " and ".join(p.name for p in files if p.stem == twice)
        raise InputError(str(folder), f"{both}: the same artefact twice", "Keep one of the two")
    lacking = [p.name for p in reference if p.stem not in stems]
    if len(files) != count:
        if lacking and len(lacking) + len(files) == count:
            found = f"no cloud {', '.join(lacking)}"
            raise InputError(
                str(folder), found, f"Give it one cloud an artefact ({count}), named as in the cold folder"
            )
        kinds = ", ".join(CLOUD_SUFFIXES)
        found = f"{len(files)} clouds ({kinds}) where profiler.yaml has {count} positions"
        raise InputError(str(folder), found, "Give one cloud an artefact, and one position in the same order")
    if reference and 0 < len(lacking) < count:  # entirely different names may number the same artefacts differently
        other = next(p.name for p in files if p.stem not in {r.stem for r in reference})
        raise InputError(str(folder / other), f"no cold cloud of that name; {lacking[0]} is missing", "Name them alike")
    return files if lacking or not reference else [next(p for p in files if p.stem == r.stem) for r in reference]


def labels(folders: Sequence[Path]) -> list[str]:
    """One label per folder for the column ``run``: its name, with as much of its path as makes it unique."""
    parts = [f.absolute().parts for f in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(p[-depth:]) for p in parts]
        if len(set(names)) == len(names):
            return names
    raise InputError(str(folders[-1]), "the same WARM folder twice", "Give each folder once")


def time_in(name: str) -> float | None:
    """Seconds in a folder's name: a number with a unit (``t_030min``, ``90s``, ``1.5h``); None without one."""
    found = re.findall(r"(?<![\d.])(\d+(?:\.\d+)?)[ _-]?(sec|min|hr|s|m|h)(?![a-zA-Z])", Path(name).name, re.IGNORECASE)
    return float(found[0][0]) * _SECONDS[found[0][1].lower()] if len(found) == 1 else None
