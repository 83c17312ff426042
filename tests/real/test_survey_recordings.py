"""Recordings are read as they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey

# ---- recordings


def recordings(folder: Path) -> list[tuple[Path, Path]]:
    tables = [
        p for p in sorted(folder.glob("*/*.csv")) if "truth" not in p.name and (p.parent / "machine.yaml").exists()
    ]
    assert tables
    return [(p, p.parent / "machine.yaml") for p in tables]


@pytest.mark.long
def test_practice_recordings(practice_data: Path):
    for path, machine in recordings(practice_data):
        notes = read_survey(path, read_machine(machine), measured=path.name != "heldout.csv").notes
        assert all("outside the travel of" in note for note in notes)


@pytest.mark.long
def test_directions_of_practice_recordings(practice_data: Path):
    """The recorded directions are those of the row order."""
    for path, file in recordings(practice_data):
        survey = read_survey(path, read_machine(file), measured=False)
        for column in [c for c in survey.table if c.startswith("dir_")]:
            derived = Survey(survey.table.drop(columns=column), "shared", (), survey.instrument, path).direction(
                column[4:]
            )
            agree = derived == survey.table[column]
            assert agree[survey.table[column[4:]].diff() != 0][1:].all()


def test_real_recordings(real_data: Path):
    for path, machine in recordings(real_data):
        assert not read_survey(path, read_machine(machine)).notes
