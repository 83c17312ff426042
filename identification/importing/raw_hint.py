"""What to do with a file that is no survey's table, and that an import would read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from errormodel.exceptions import InputError, ReadValueError
from errormodel.machine import Machine
from errormodel.raw_formats.base import Asked, format_of, open_raw

if TYPE_CHECKING:
    from identification.sources import AnySurvey


@contextmanager
def with_hint(survey: AnySurvey, machine: Machine) -> Iterator[None]:
    """Context in which a survey is read: an error about a raw file says how it is imported.

    Raises
    ------
    InputError
        As it is, or with the format that the file has.
    """
    try:
        yield
    except ReadValueError:
        raise
    except InputError as error:
        path = Path(survey) if isinstance(survey, str | Path) else None
        if path is None or not path.is_file() or path.suffix.lower() in (".yaml", ".yml"):
            raise
        try:
            raw = open_raw(path, str(path))
            kind = format_of(raw)
            recording = kind.read(raw, Asked(machine))
        except InputError:
            raise error from None
        what = f"{kind.title}, {len(recording.frame)} rows of {', '.join(map(str, recording.frame))}"
        found = f"{error.found}. As a raw file it is {what}"
        named = {*recording.frame}
        whole = all({j.name} <= named or ({*j.drives} and {*j.drives} <= named) for j in machine.joints)
        command = f"errormodel import {path.name} --machine .. {'' if whole else '--commands .. '}--out survey"
        # of a table with its commands the error may be all that is wrong
        cure = f"{error.cure}; or take it in with: {command}" if whole else f"Take it in with: {command}"
        raise InputError(error.where, found, cure) from error
