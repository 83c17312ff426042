"""Trackers that nobody declared, and tails: what the residuals say of the noise before anything is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.instruments.cmm import CoordinateMeasuringMachine
from errormodel.instruments.laser_tracker import LaserTracker
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.data_checks.outliers import gross_rows
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.search.instrument_noise import noise_note, seen_in, station_notes
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of

MILL = "vertical_three_axis"
ELSEWHERE = LaserTracker(
    type="laser-tracker", station=[1800.0, -900.0, 700.0], range=[1.5e-3, 3.0e-6], angle=1.2e-6, target=1e-3
)
AT_HOME = LaserTracker(type="laser-tracker", range=[1.0e-3, 0.5e-6], angle=5e-6)


def cloud(seed: int, rows: int = 300) -> np.ndarray:
    return np.random.default_rng(seed).uniform([500, 200, -300], [2500, 1400, 500], (rows, 3))


@pytest.mark.parametrize("seed", first_of(range(4), 2))
def test_the_station_and_the_noise_of_a_tracker_show_in_its_residuals(seed: int) -> None:
    points = cloud(seed)
    seen = seen_in(points, ELSEWHERE.draw_noise(points, np.random.default_rng(seed + 9)))
    assert seen is not None
    assert np.linalg.norm(np.subtract(seen.station, ELSEWHERE.station)) < 400  # it is 1200 from the points' middle
    size = np.linalg.norm(seen.covariance(points), axis=(1, 2)) / np.linalg.norm(
        ELSEWHERE.covariance(points), axis=(1, 2)
    )
    assert 0.65 < np.quantile(size, 0.1) < np.quantile(size, 0.9) < 1.4  # twelve draws: 0.73 to 1.24


@pytest.mark.parametrize("seed", first_of(range(6), 2))
def test_a_tracker_that_stands_far_off_is_found(seed: int) -> None:
    points = np.random.default_rng(seed).uniform([500, 200, -300], [1300, 900, 300], (300, 3))
    far = AT_HOME.model_copy(update={"station": (4000.0, -2500.0, 800.0), "angle": 4e-6})
    seen = seen_in(points, far.draw_noise(points, np.random.default_rng(seed + 9)))
    assert seen is not None  # searched all round the points only, two of six were not
    size = np.linalg.norm(seen.covariance(points), axis=(1, 2)) / np.linalg.norm(far.covariance(points), axis=(1, 2))
    assert 0.8 < np.quantile(size, 0.1) < np.quantile(size, 0.9) < 1.25


def test_a_tracker_in_its_own_coordinates_stands_in_their_origin() -> None:
    points = cloud(7)
    seen = seen_in(points, AT_HOME.draw_noise(points, np.random.default_rng(8)))
    assert seen is not None
    assert np.abs(seen.station).max() < 1e-6


def test_what_to_write_of_the_instrument_has_no_more_figures_than_are_known() -> None:
    """A station to 0.1 mm, uncertainties to three figures, and none of a part that does not show."""
    found = LaserTracker(station=[1234.5678, 0.04, -3.55271e-15], range=[3.4e-6, 1.2346e-6], angle=5.4321e-6, target=0)
    said = noise_note(found, cloud(7))
    assert "`instrument: {type: laser-tracker, station: [1234.6, 0, 0], range: [0, 1.23e-06], angle: 5.43e-06, " in said
    seat = LaserTracker(station=[0, 0, 0], range=[1e-6, 1e-9], angle=1e-9, target=5e-3)
    assert "range: [0, 1e-09]" in noise_note(seat, cloud(7))  # not both may be 0


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("free", [3.0, 1e6])
def test_noise_that_is_alike_in_all_directions_shows_no_tracker(seed: int, free: float) -> None:
    rng = np.random.default_rng(seed)
    assert seen_in(cloud(seed), 0.005 * rng.standard_t(free, (300, 3))) is None


@pytest.mark.parametrize("seed", first_of(range(6), 2))
def test_what_is_worse_along_a_line_than_across_it_is_no_tracker(seed: int) -> None:
    """A state that tilts a column moves all points about one way: no tracker's range is worse than its angles."""
    points, rng = cloud(seed), np.random.default_rng(seed)
    states = rng.choice([-1.0, 1.0], len(points))
    tilt = 0.02 * np.outer(states * points[:, 2] / 500, [0.9, 0.4, 0.0])
    assert seen_in(points, tilt + rng.normal(0, 0.003, points.shape)) is None


def test_no_noise_or_no_extent_shows_none() -> None:
    assert seen_in(cloud(0), np.zeros((300, 3))) is None
    assert seen_in(np.ones((80, 3)), np.random.default_rng(0).normal(0, 1, (80, 3))) is None


@pytest.fixture(scope="module")
def tracked() -> Survey:
    """Backlash of 20 um on a mill, seen by a tracker that the survey does not name."""
    machine = read_machine(MILL)
    survey = empty_survey(machine, 300, 5, channels=True, grid=False)
    station = np.add(survey.measured.mean(axis=0), (900.0, 700.0, 300.0)).tolist()
    backlash = EffectSpec("backlash", {"joint": "X"}), [0.02]
    return showing(survey, machine, [backlash], ELSEWHERE.model_copy(update={"station": station}), 5)


@pytest.mark.long
def test_rows_are_weighed_by_a_tracker_that_was_not_named(tracked: Survey) -> None:
    found = diagnose(read_machine(MILL), tracked).diagnosis
    assert [f.effect for f in found.findings] == ["backlash"]
    assert [n for n in found.notes if "line of sight" in n and "laser-tracker, station" in n]
    (amount, *_) = found.findings[0].parameters
    assert abs(abs(amount.value) - 0.02) < 4 * amount.std


@pytest.mark.long
def test_a_coordinate_measuring_machine_has_no_line_of_sight(tracked: Survey) -> None:
    found = diagnose(read_machine(MILL), replace(tracked, instrument=CoordinateMeasuringMachine(type="cmm"))).diagnosis
    assert not [n for n in found.notes if "line of sight" in n]


@pytest.mark.long
def test_a_declared_instrument_is_taken_at_its_word(tracked: Survey) -> None:
    found = diagnose(read_machine(MILL), replace(tracked, instrument=ELSEWHERE)).diagnosis
    assert not [n for n in found.notes if "line of sight" in n]


@pytest.mark.parametrize("free", [2.5, 4.0, 1e6])
def test_tails_are_no_gross_rows(tracked: Survey, free: float) -> None:
    """Twenty draws; one in fifty surveys is let through, and three of twenty would be a chance of one in 150."""
    fit = fit_machine(read_machine(MILL), tracked)
    named = 0
    for seed in range(20):
        noise = 0.004 * np.random.default_rng(seed).standard_t(free, fit.residuals.shape)
        named += bool(gross_rows(replace(fit, residuals=noise)).any())
    assert named <= 2


def test_a_gross_row_in_gaussian_noise_is_one(tracked: Survey) -> None:
    fit = fit_machine(read_machine(MILL), tracked)
    noise = 0.004 * np.random.default_rng(1).normal(size=fit.residuals.shape)
    noise[[17, 90]] += [0.03, -0.03, 0.02]
    assert [*np.flatnonzero(gross_rows(replace(fit, residuals=noise)))] == [17, 90]


def test_a_wrong_row_beside_others_that_were_left_out_is_one(tracked: Survey) -> None:
    """Of eight standard deviations: in some draws too little for a finding, and enough where another was wrong."""
    fit = fit_machine(read_machine(MILL), tracked)
    none = np.zeros(len(fit.residuals), dtype=bool)
    other = none.copy()
    other[5] = True
    found = []
    for seed in range(20):
        noise = 0.004 * np.random.default_rng(seed).normal(size=fit.residuals.shape)
        noise[90] += 8 * 0.004 / np.sqrt(3)
        noise[5] = np.nan
        left = replace(fit, residuals=noise)
        found.append([bool(gross_rows(left, earlier=earlier)[90]) for earlier in (none, other)])
    alone, beside = np.sum(found, axis=0)
    assert alone < beside
    assert beside >= 15


@pytest.mark.parametrize("wrong", [True, False])
def test_a_station_in_the_machines_coordinates_is_noted(wrong: bool) -> None:
    machine = read_machine(MILL)
    survey = empty_survey(machine, 300, 5, channels=False, grid=False)
    station = np.add(survey.measured.mean(axis=0), (900.0, 700.0, 300.0))
    (pose,) = fit_machine(machine, survey).problem.frames.values()
    truth = AT_HOME.model_copy(update={"station": station.tolist()})
    survey = showing(survey, machine, [], truth, 5)
    stated = pose.invert(station[None])[0].tolist() if wrong else station.tolist()
    fit = fit_machine(machine, replace(survey, instrument=truth.model_copy(update={"station": stated})))
    notes = list(station_notes(fit))
    assert len(notes) == wrong
    assert not wrong or "Write it in the measuring frame" in notes[0]
