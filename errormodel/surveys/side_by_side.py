"""Single readings of several instruments side by side in a row of a raw file: ``length:A``, ``length:B`` ...

Tracking interferometers that measure one target together are read out so. In a survey each reading has a row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from errormodel.surveys.columns import OBSERVATION, READINGS

if TYPE_CHECKING:
    import pandas as pd

MARK = ":"  # between the column of a survey and the entry of observations: that its readings are of


def reading_of(name: str) -> tuple[str, str]:
    """Column of a survey and label of ``length:A``; any other name with an empty label."""
    column, mark, label = name.partition(MARK)
    return (column, label) if mark and label and column in READINGS else (name, "")


def one_below_the_other(frame: pd.DataFrame, lines: tuple[int, ...]) -> tuple[pd.DataFrame, tuple[int, ...]]:
    """Rows with one reading each, all of the first instrument first, and their lines; others stay as they are.

    Raises
    ------
    ValueError
        There is a column of plain readings, or of what they are of, as well.
    """
    import pandas as pd

    beside = {str(n): reading_of(str(n)) for n in frame if reading_of(str(n))[1]}
    if not beside:
        return frame, lines
    own = {column for column, _ in beside.values()}
    twice = [c for c in (*own, OBSERVATION) if c in frame]
    if twice or len(own) > 1:
        raise ValueError(f"{' and '.join((*beside, *twice))}: name readings of one kind, each with its own label")
    rest = frame.drop(columns=[*beside])
    parts = [rest.assign(**{c: frame[n]}).assign(**{OBSERVATION: label}) for n, (c, label) in beside.items()]
    return pd.concat(parts, ignore_index=True), lines * len(parts)
