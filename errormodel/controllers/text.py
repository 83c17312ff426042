"""Text files of tables: safe comments, and parsing with the line of an error."""

from __future__ import annotations

import textwrap
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError

Files = Mapping[str, str]  # name in the folder: text
COMMENT_WIDTH = 100  # characters of a comment: older controls take little more than a hundred in a block
TRANSLITERATION = str.maketrans(
    {
        "ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss", "ø": "o", "Ø": "O", "æ": "ae",
        "Æ": "Ae", "ł": "l", "Ł": "L", "µ": "u", "μ": "u", "°": " deg ", "²": "2", "–": "-", "—": "-", "−": "-",
        "‘": "'", "’": "'", "“": "'", "”": "'",
    }
)  # fmt: skip
COMMENT_ENDS = str.maketrans({"%": " pct ", ";": ",", "\\": "/", "{": "[", "}": "]", "*": "x"})
"""Characters that end a tape or a comment on some control, or have another meaning in it, with their replacements."""


def printable(text: str) -> str:
    """Text as printable ASCII on one line: umlauts as two letters, accents removed, any other character as `?`."""
    plain = unicodedata.normalize("NFKD", unicodedata.normalize("NFC", text).translate(TRANSLITERATION))
    kept = "".join(c for c in plain if not unicodedata.combining(c))
    return " ".join("".join(c if " " <= c <= "~" else " " if not c.isprintable() else "?" for c in kept).split())


@dataclass(frozen=True)
class Comment:
    """Comment syntax of a control; names and notes reach its files as comments only.

    Attributes
    ----------
    start, end : delimiters; `end` is empty if the comment runs to the end of the line.
    upper : whether the control accepts capital letters only.
    """

    start: str
    end: str = ""
    upper: bool = False

    def line(self, text: str) -> str:
        """One line of comment: printable ASCII, without the characters that could end it."""
        plain = printable(text).translate(COMMENT_ENDS)
        if self.end:
            plain = plain.replace("(", "[").replace(")", "]")
        return f"{self.start}{' '.join((plain.upper() if self.upper else plain).split())}{self.end}"

    def lines(self, texts: Sequence[str], width: int = COMMENT_WIDTH) -> list[str]:
        """Comment lines for each text, wrapped at `width` characters."""
        return [self.line(part) for text in texts for part in textwrap.wrap(printable(text), width) or [""]]


@dataclass(frozen=True)
class Lines:
    """Non-empty lines of a file, each with its number for messages."""

    file: str
    lines: tuple[tuple[int, str], ...] = field(default=())

    @classmethod
    def of(cls, file: str, text: str, comment: Sequence[str] = ()) -> Lines:
        """Lines without blank ones and those that begin with a comment sign."""
        signs = tuple(comment)
        kept = [(k, s) for k, line in enumerate(text.splitlines(), start=1) if (s := line.strip())]
        return cls(file, tuple((k, s) for k, s in kept if not s.startswith(signs)) if signs else tuple(kept))

    def error(self, number: int, found: str, cure: str) -> InputError:
        return InputError(f"{self.file}, line {number}", found, cure)

    def numbers(self, number: int, line: str, count: int | None = None, separator: str | None = None) -> list[float]:
        """Numbers of a line.

        Raises
        ------
        InputError
            A field is no number, or their number is not `count`.
        """
        try:
            values = [float(v) for v in line.split(separator)]
        except ValueError as error:
            raise self.error(number, f"'{line[:60]}' where numbers belong", "Write the file again") from error
        if count is not None and len(values) != count:
            raise self.error(number, f"{len(values)} figures where {count} belong", "Write the file again")
        return values

    def rows(self, start: int, count: int, separator: str | None = None) -> Array:
        """Numbers (n, count) of all lines from index `start` on.

        Raises
        ------
        InputError
            A field is no number, or a line has another number of them than `count`.
        """
        lines, sign = self.lines[start:], separator or " "
        try:  # all at once, which takes a tenth of the time
            found = np.array(sign.join(s for _, s in lines).split(separator), np.float64)
            if found.size == count * len(lines) and all(s.count(sign) == count - 1 for _, s in lines):
                return found.reshape(-1, count)
        except ValueError:
            pass  # the line is sought below
        return np.array([self.numbers(k, s, count, separator) for k, s in lines]).reshape(-1, count)


def one_file(files: Files, suffix: str) -> tuple[str, str]:
    """Name and text of the only file with that suffix."""
    found = [(n, t) for n, t in files.items() if n.lower().endswith(suffix.lower())]
    if len(found) != 1:
        raise InputError("files", f"{len(found)} files *{suffix}", "Give the folder that was written")
    return found[0]
