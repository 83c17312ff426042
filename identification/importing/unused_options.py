"""Options of an import that nothing follows: they are refused, since whoever gives one expects that it acts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from errormodel.exceptions import InputError
from errormodel.surveys.raw import LEFT_OUT
from errormodel.units import UNIT_EXAMPLES
from identification.importing.sources import SourceFile, Wishes


def refuse_unused(wishes: Wishes, sources: Sequence[SourceFile], commanded: SourceFile | None) -> None:
    """InputError about the first option that applies to none of the files."""
    for option, found, cure in _unused(wishes, sources, commanded):
        raise InputError(option, found, cure)


def _unused(
    wishes: Wishes, sources: Sequence[SourceFile], commanded: SourceFile | None
) -> Iterator[tuple[str, str, str]]:
    """Option, what was found, what to do, of each option that does nothing."""
    every = [*sources, *([commanded] if commanded else [])]
    uses = {word for source in every for word in source.uses}
    out = "Leave it out"
    for word, option, given, what in (
        ("offsets", "--offset", wishes.offsets, "is an NC programme"),
        ("at", "--at", wishes.at, "is an NC programme"),
        ("dialect", "--dialect", wishes.dialect != "auto", "is a programme in G-code"),
        ("joint", "--joint", wishes.joint, "is a table of readings of one joint"),
        ("circle", "--centre", wishes.circle is not None, "is a trace of a ballbar over its angle"),
        ("dates", "--dates", wishes.dates, "has dates"),
        ("sheet", "--sheet", wishes.sheet, "is a workbook with such a sheet"),
    ):
        if given and word not in uses:
            yield option, f"none of the files {what}", out
    if wishes.columns and not any("columns" in source.uses for source in sources):
        names = ", ".join(dict.fromkeys(t if t != LEFT_OUT else ours for ours, t in wishes.columns.items()))
        yield "--columns", f"none of the files has a column of {names}", "Write names as they stand in a file"
    if wishes.log_offset and not any(s.what == "log" for s in sources):
        yield "--log-offset", "none of the files is a log on a clock of its own", out
    if wishes.axes == "tool" and not any(s.what == "points" for s in sources):
        yield "--axes", "none of the files has measured coordinates", out
    if commanded is None:
        for option, said in (
            ("--command-columns", wishes.command_columns), ("--command-units", wishes.command_units),
            ("--command-format", wishes.command_format), ("--match", wishes.match != "auto"),
        ):  # fmt: skip
            if said:
                found = "no --commands: commands and readings stand in one table"
                yield option, found, "Give --commands, or leave it out"
    raw = {word for source in sources for word in source.uses}
    for option, units, own in (
        ("--units", wishes.units, raw), ("--command-units", wishes.command_units, commanded.uses if commanded else ()),
    ):  # fmt: skip
        for word, unit in units.items():
            if f"unit {word}" not in own:
                found = f"{word}={unit}, and no column is read in it"
                cure = f"{out}, or name a column, such as mx={unit}: a unit in the file goes before one by kind"
                yield option, found, cure if word in UNIT_EXAMPLES else out
