"""Writing files whole or not at all: into a neighbour of the target, then moved over it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from errormodel.exceptions import InputError

if TYPE_CHECKING:
    import pandas as pd


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A path beside `path` to write to; it takes the place of `path` when the block ends without an error.

    Folders on the way are made. The suffix is kept, since many writers go by it.

    Raises
    ------
    InputError
        The place cannot be written to.
    """
    path = Path(path)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        os.replace(part, path)  # noqa: PTH105  tests break the move here
    except OSError as error:
        found = f"cannot be written: {error.strerror or error}"
        raise InputError(str(path), found, "Give a place that can be written to") from error
    finally:
        with suppress(OSError):  # where nothing can be written nothing is left behind
            part.unlink(missing_ok=True)


def write_text_atomic(text: str, path: Path | str) -> None:
    r"""Write UTF-8 text with ``\n`` line ends on every system, so that the same input gives the same bytes."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def write_csv(frame: pd.DataFrame, path: Path | str) -> None:
    """Write a table without its index; every float in the shortest form that reads back as the same float.

    NaN and None become empty cells, which a survey reads as "not measured".
    """
    with replacing(path) as part:
        frame.to_csv(part, index=False, lineterminator="\n", encoding="utf-8")
