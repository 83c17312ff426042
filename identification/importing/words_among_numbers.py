"""Words in single cells of columns of numbers: such a column is what its name says, and the words are judged."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from errormodel.formats.base import as_numbers
from errormodel.machine import Machine
from errormodel.raw_formats.base import Recording
from errormodel.raw_formats.cells import kind_of
from errormodel.raw_formats.table_columns import no_numbers
from errormodel.surveys.columns import MEASURED, READINGS, quantity_of
from errormodel.surveys.raw import LEFT_OUT, plain_column


def spelt_out(recording: Recording) -> Recording:
    """A recording as its columns are meant: of numbers where there are more of these than words, which are empty.

    For finding what is what only. A column that is text for one cell has no role otherwise, and would be left out.
    """
    frame = recording.frame.copy()
    for name in map(str, recording.frame):
        if frame[name].dtype.kind == "f":
            continue
        kinds = Counter(map(kind_of, map(str, frame[name])))
        if kinds["number"] > kinds["text"]:
            frame[name] = as_numbers(frame[name].astype("str"), True)[0]
    return replace(recording, frame=frame)


def refuse_words(
    recording: Recording, columns: Mapping[str, str], machine: Machine, where: str, of_commands: bool
) -> None:
    """InputError where a column that is to hold numbers has text in a row that counts.

    Parameters
    ----------
    recording : under the names of its format.
    columns : its columns by ours, as its entry in ``survey.yaml`` says.
    where : the file's name.
    of_commands : whether it holds commands, of which no rows can be left out.
    """
    frame = recording.frame
    ours = {theirs if theirs in frame else theirs.removeprefix("-"): own for own, theirs in columns.items()}
    left = {own for own, theirs in columns.items() if theirs == LEFT_OUT}
    names = {str(name): ours.get(str(name), str(name)) for name in frame if name not in left}
    texts = [n for n, own in names.items() if frame[n].dtype.kind != "f" and _of_numbers(own, machine)]
    wordy = [n for n in texts if "text" in map(kind_of, map(str, frame[n]))]  # others are empty in all rows
    if wordy:
        measured = not of_commands and not {*names.values()}.isdisjoint((*MEASURED, *READINGS))
        raise no_numbers(recording, wordy, where, measured)


def _of_numbers(name: str, machine: Machine) -> bool:
    """Whether a column of a survey holds numbers: it has a unit."""
    return quantity_of(plain_column(name), machine) is not None or name.startswith("w_")
