"""Reading text files of tables, with the place of what is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from errormodel.exceptions import InputError

Files = Mapping[str, str]  # name in the folder: text


@dataclass(frozen=True)
class Lines:
    """Non-empty lines of a file, each with its place for messages."""

    file: str
    lines: tuple[tuple[int, str], ...] = field(default=())

    @classmethod
    def of(cls, file: str, text: str, comment: Sequence[str] = ()) -> Lines:
        """Lines without blank ones and those that begin with a comment sign."""
        kept = [(k, s.strip()) for k, s in enumerate(text.splitlines(), start=1)]
        return cls(file, tuple((k, s) for k, s in kept if s and not s.startswith(tuple(comment) or "\0")))

    def error(self, number: int, found: str, cure: str) -> InputError:
        return InputError(f"{self.file}, line {number}", found, cure)

    def numbers(self, number: int, line: str, count: int | None = None, separator: str | None = None) -> list[float]:
        """The figures of a line.

        Raises
        ------
        InputError
            One is no number, or there are not `count` of them.
        """
        try:
            values = [float(v) for v in line.split(separator)]
        except ValueError as error:
            raise self.error(number, f"'{line[:60]}' where numbers belong", "Write the file again") from error
        if count is not None and len(values) != count:
            raise self.error(number, f"{len(values)} figures where {count} belong", "Write the file again")
        return values


def one_file(files: Files, suffix: str) -> tuple[str, str]:
    """Name and text of the only file with that suffix."""
    found = [(n, t) for n, t in files.items() if n.lower().endswith(suffix.lower())]
    if len(found) != 1:
        raise InputError("files", f"{len(found)} files *{suffix}", "Give the folder that was written")
    return found[0]
