"""Places of an artefact that were probed again are told from copies and from an instrument that had stopped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine, read_survey
from errormodel.chain import Chain
from errormodel.survey import Survey
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows
from tests.helpers.ball_plate import plate
from tests.helpers.commands import XYZ
from tests.helpers.importing import MILL

MACHINE = read_machine(MILL)


def copies(table: pd.DataFrame) -> tuple[int, ...] | None:
    found = copied_rows(Chain(MACHINE), survey(table))
    return found.rows if found else None


def survey(table: pd.DataFrame) -> Survey:
    return replace(read_survey(table, MACHINE), frame="per-run")


@pytest.mark.parametrize("digits", [5, 3])
@pytest.mark.parametrize("timed", [False, True])
def test_a_plate_probed_forth_and_back_holds_no_copies(digits: int, timed: bool) -> None:
    """Also where scales of a micrometre read the same position again, as noise of 0.4 um often has it."""
    table = plate().round(dict.fromkeys("XYZ", digits))
    table = table if timed else table.drop(columns="time")
    assert table.duplicated(subset=XYZ).sum() == 25
    assert table.duplicated(subset=["X", "Y", "Z"]).any() == (digits == 3)
    assert copies(table) is None


def test_a_ball_that_was_probed_again_at_the_end_is_no_copy() -> None:
    """An instrument that had stopped would not have read others in between."""
    table = plate().iloc[[*range(25), 49]].reset_index(drop=True)
    assert copies(table) is None


@pytest.mark.parametrize("timed", [False, True])
def test_copied_rows_of_a_plate_are_copies(timed: bool) -> None:
    table = plate()
    table = table if timed else table.drop(columns="time")
    assert copies(pd.concat([table, table.iloc[3:9]], ignore_index=True)) == tuple(range(51, 57))
    once = table.iloc[:25]
    assert copies(pd.concat([once, once], ignore_index=True)) == tuple(range(26, 51))


def test_an_instrument_that_had_stopped_is_found_beside_places() -> None:
    table = plate()
    table.loc[10:14, XYZ] = table.loc[10, XYZ].to_numpy()
    found = copies(table)
    assert found is not None
    assert {12, 13, 14, 15} <= set(found)


def test_readings_held_while_the_machine_moved_are_copies() -> None:
    """Each reading stands in two rows, a step of 20 um apart, where the next reading is 40 um on."""
    x = 100 + 0.02 * np.arange(60)
    held = x[::2].repeat(2) + np.random.default_rng(0).normal(0, 1e-3, 30).repeat(2)
    table = pd.DataFrame({"X": x, "Y": 50.0, "Z": 20.0, "mx": held, "my": 50.0, "mz": 20.0})
    assert copies(table) == tuple(range(2, 61, 2))


def test_places_that_were_read_again_are_noted() -> None:
    table = plate()
    (note,) = [n for n in read_survey(table, MACHINE).notes if "places" in n]
    assert note.startswith("50 rows read 25 places again")
    again = table.assign(**{n: table[n] + np.random.default_rng(5).normal(0, 1e-3, 50) for n in XYZ})
    assert not [n for n in read_survey(again, MACHINE).notes if "places" in n]
