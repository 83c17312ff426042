"""Search for the inputs of a folder of results by name and digest, and comparison of two folders of results."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path

from errormodel.exceptions import InputError
from errormodel.files import sha256
from identification.results.manifest import Manifest

MOST_LOOKED_AT = 100_000  # files and folders looked at for one input; by judgement, some seconds
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
LONGEST_COMPARED = 20_000_000  # bytes of a file whose numbers are compared


def found_input(name: str, manifest: Manifest, places: Sequence[Path]) -> Path:
    """Path of an input by its name: a file of the digest that the manifest states, or a folder that holds such files.

    Parameters
    ----------
    name : str
        Its name without folders, as the manifest has it.
    places : sequence of Path
        Folders to search, with all below them; the first that holds it counts.

    Raises
    ------
    InputError
        It is in none of them, or was changed.
    """
    other = None
    for path in _named(name, places):
        if path.is_dir():
            inside = [p for p in path.iterdir() if p.name in manifest.inputs and p.is_file()]
            if any(sha256(p) in manifest.inputs[p.name] for p in inside):
                return path
        elif name not in manifest.inputs or sha256(path) in manifest.inputs[name]:
            return path
        other = other or path
    where = ", ".join(dict.fromkeys(str(p) for p in places))
    if other is not None:
        found = "it was changed since the results were made"
        raise InputError(str(other), found, "Give the folder of the inputs as they were with --inputs")
    raise InputError(name, f"no such input in {where} or below", "Give the folder that it is in with --inputs")


def _named(name: str, places: Sequence[Path]) -> Iterator[Path]:
    """Files and folders of a name in the places and below them, the nearest first."""
    for place in places:
        queue, count = deque([place]), 0
        while queue:
            try:
                entries = sorted(queue.popleft().iterdir())
            except OSError:
                continue
            yield from (e for e in entries if e.name == name)
            count += len(entries)
            if count > MOST_LOOKED_AT:
                break
            queue.extend(e for e in entries if e.is_dir() and not e.is_symlink() and not e.name.startswith("."))


def differences(old: Path, new: Path, before: Manifest, after: Manifest) -> Iterator[str]:
    """Sentences on what differs between two folders of results: inputs, then files."""
    for name in sorted({*before.inputs, *after.inputs}):
        one, two = (sorted(m.inputs.get(name, [])) for m in (before, after))
        if one != two:
            what = "not read this time" if not two else "read this time only" if not one else "another content"
            yield f"input {name}: {what}"
    for name in sorted({*before.files, *after.files}):
        if name not in after.files:
            yield f"{name}: not made again"
        elif name not in before.files:
            yield f"{name}: not among the old results"
        elif before.files[name] != after.files[name]:
            yield f"{name}: {_apart(old / name, new / name)}"


def _apart(old: Path, new: Path) -> str:
    """How far two files differ: in their numbers alone, and by how much, or in their text."""
    if max(old.stat().st_size, new.stat().st_size) > LONGEST_COMPARED:
        return "other bytes"
    try:
        texts = [path.read_text(encoding="utf-8") for path in (old, new)]
    except ValueError:
        return "other bytes"
    if NUMBER.sub("#", texts[0]) != NUMBER.sub("#", texts[1]):
        return "another text"
    pairs = zip(*([float(n) for n in NUMBER.findall(text)] for text in texts), strict=True)
    apart = max((abs(a - b) / max(abs(a), abs(b)) for a, b in pairs if a != b and math.isfinite(a - b)), default=0.0)
    return f"numbers that differ by up to {apart:.1g} of their size"
