"""Mistakes among lengths are found before a fit, as those among points are; the readings are simulated elsewhere."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.observations.station import interruptions
from errormodel.survey import Survey
from identification.diagnosis.data_checks.gate import passed
from identification.estimation.fit import fit_machine
from identification.importing.check import check_lines, check_survey
from tests.benchmarks.length_coverage import NOISE, STATIONS
from tests.helpers.lengths import distances, entry, survey, tips, truth

MACHINE = read_machine("vertical_three_axis")
ROWS = 80


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    rng = np.random.default_rng(5)
    places = {k: (STATIONS[k], 50.0) for k in ("A", "B", "C")}
    return distances(MACHINE, truth(MACHINE, rng), places, ROWS, NOISE, rng)


def of(table: pd.DataFrame, **keys: object) -> Survey:
    keys = {"dead_path": "unknown", **keys}
    return survey(MACHINE, table, {k: entry(type="station-distance", **keys) for k in ("A", "B", "C")})


def fitted(data: Survey, robust: bool = False) -> None:
    passed(MACHINE, data, lambda: fit_machine(MACHINE, data, robust), robust)


@pytest.mark.long
def test_lengths_that_stand_in_each_others_row_are_refused(table: pd.DataFrame) -> None:
    wrong = table.copy()
    wrong.loc[[5, 9], "length"] = table.loc[[9, 5], "length"].to_numpy()
    for look in (fitted, lambda data: check_survey(MACHINE, data)):
        with pytest.raises(InputError, match="rows 6 and 10 are exchanged"):
            look(of(wrong))
    fitted(of(wrong), robust=True)  # which leaves both out


@pytest.mark.long
def test_a_length_far_from_all_others_is_refused_by_name_and_listed_by_a_check(table: pd.DataFrame) -> None:
    wrong = table.copy()
    wrong.loc[ROWS + 3, "length"] += 30.0
    with pytest.raises(InputError, match=r"observation B: the length of row 84 is up to 30 mm from where the other 79"):
        fitted(of(wrong))
    fitted(of(wrong), robust=True)
    said = [*check_lines(check_survey(MACHINE, of(wrong)))]
    assert any(line.startswith("B: 80 lengths") and "far off: rows 84" in line for line in said)
    assert any(line.startswith("A: 80 lengths") and "far off" not in line for line in said)


@pytest.mark.long
@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize(("first", "step"), [(38, 0.5), (70, -3.0)])
def test_a_beam_that_was_lost_is_said_with_its_place_and_size(
    table: pd.DataFrame, first: int, step: float, robust: bool
) -> None:
    """The fit would bend the machine, or leave most of these lengths out without a word."""
    wrong = table.copy()
    wrong.loc[2 * ROWS + first : 3 * ROWS, "length"] += step
    words = rf"from reading {first + 1} of 80 on {abs(step):g}\d* mm {'longer' if step > 0 else 'shorter'}"
    with pytest.raises(InputError, match=words):
        fitted(of(wrong), robust)
    told = wrong.assign(run="1")  # as the message says: a run of its own, whose dead path is its own
    told.loc[2 * ROWS + first : 3 * ROWS, "run"] = "2"
    fitted(of(told, dead_path="per-run"), robust)


def test_several_steps_are_found_and_none_where_there_is_none() -> None:
    """Errors of a machine, a station that is roughly known and outliers make no step; plans in layers do not either."""
    rng = np.random.default_rng(8)
    for layers in (2, 7, 200):
        points = rng.uniform(0, 600, (200, 3))
        points[:, 2] = np.sort(rng.integers(0, layers, 200)) * 500.0 / layers
        errors = points @ rng.normal(0, 5e-5, (3, 3))  # scales and squareness of a poor machine
        station = np.array([900.0, -700.0, -200.0])
        lengths = np.linalg.norm(points + errors - station, axis=1) - 30.0 + rng.normal(0, 3e-4, 200)
        lengths[[3, 70]] += [5.0, -40.0]
        place = np.array([900.2, -700.1, -199.7, 30.3])
        assert interruptions(points, lengths, place) == []
        lengths[60:] += 0.4
        lengths[150:] -= 2.0
        found = interruptions(points, lengths, place)
        assert [k for k, _ in found] == [60, 150]
        # an error of the machine that layers share with the step stays in it: 50 um/m over 500 mm
        assert [s for _, s in found] == pytest.approx([0.4, -2.0], abs=0.05)


@pytest.mark.long
def test_a_robust_fit_that_leaves_most_readings_of_an_instrument_out_is_refused(table: pd.DataFrame) -> None:
    """Lengths of one instrument with the scale of another: the few that are left would look well."""
    wrong = table.copy()
    own = wrong["observation"] == "C"
    wrong.loc[own, "length"] *= 1 + 2e-3 * np.sin(np.arange(ROWS))
    with pytest.raises(InputError, match="of 80 readings lie far from what the other observations"):
        fitted(of(wrong), robust=True)


def gauge(wrong: float = 0.0, backlash: float = 0.0) -> Survey:
    """A step gauge along X, Y, Z and two diagonals, 15 steps each; the last set-up is off by `wrong`."""
    rng = np.random.default_rng(4)
    middle = np.array([0.0, 0.0, 350.0])
    parts = []
    for way in ([700, 0, 0], [0, 380, 0], [0, 0, 460], [600, 350, 0], [0, 350, -400]):
        first = middle - np.array(way) / 2
        steps = pd.DataFrame(first + np.outer(np.arange(1, 16) / 15, way), columns=["X", "Y", "Z"])
        parts.append(steps.assign(from_X=first[0], from_Y=first[1], from_Z=first[2]))
    table = pd.concat(parts, ignore_index=True)
    values = truth(MACHINE, rng)
    start = table[["from_X", "from_Y", "from_Z"]].set_axis(["X", "Y", "Z"], axis=1)
    length = np.linalg.norm(tips(MACHINE, values, table) - tips(MACHINE, values, start), axis=1)
    length += backlash * (np.arange(len(table)) < 15) + wrong * (np.arange(len(table)) >= 60)
    table = table.assign(observation="gauge", length=length + rng.normal(0, 5e-4, len(table)))
    return survey(MACHINE, table, {"gauge": entry(type="pose-distance")})


def test_a_set_up_that_is_off_in_all_its_readings_is_named() -> None:
    """A start, or a calibrated length, that was wrong by half a millimetre bends the machine unseen."""
    words = "gauge: the 15 readings from one start pose, rows 61, 62, 63"
    said = [line for line in check_lines(check_survey(MACHINE, gauge(0.5))) if line.startswith(words)]
    assert len(said) == 1
    assert re.search("are all (49|50).* um too long, whatever their length", said[0])
    notes = passed(MACHINE, gauge(0.5), lambda: fit_machine(MACHINE, gauge(0.5))).notes
    assert any(note.startswith(words) for note in notes)


@pytest.mark.parametrize("backlash", [0.0, 0.004])
def test_errors_of_a_machine_put_no_start_in_doubt(backlash: float) -> None:
    assert not any("start pose" in line for line in check_lines(check_survey(MACHINE, gauge(backlash=backlash))))
