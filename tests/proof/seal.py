"""Truths are sealed before the tool runs: their SHA-256 is written down and checked when they are opened."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any


class BrokenSealError(RuntimeError):
    """A truth is not the one that was sealed."""


def write_atomic(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}")
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        stream.write(text)
    Path(name).replace(path)


def sealed(path: Path, truth: dict[str, Any]) -> str:
    """Write a truth, and return its seal."""
    text = json.dumps(truth, indent=1)
    write_atomic(path, text)
    return hashlib.sha256(text.encode()).hexdigest()


def opened(path: Path, seal: str) -> dict[str, Any]:
    """The truth of that seal.

    Raises
    ------
    BrokenSealError
        The file is not as it was sealed.
    """
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != seal:
        raise BrokenSealError(f"{path} is not what was sealed ({seal[:12]}...)")
    out: dict[str, Any] = json.loads(content)
    return out


def digest(folder: Path) -> str:
    """SHA-256 over the names and contents of a case's files: what a result belongs to."""
    whole = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        whole.update(path.name.encode() + path.read_bytes())
    return whole.hexdigest()


def simulator() -> str:
    """SHA-256 of the simulator's own source: cases of another one are made anew."""
    whole = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.stem not in ("run_case", "score", "__main__", "test_proof"):
            whole.update(path.read_bytes())
    return whole.hexdigest()


def whole_seal(seals: dict[str, str]) -> str:
    """One figure for all seals."""
    return hashlib.sha256(json.dumps(seals, sort_keys=True).encode()).hexdigest()
