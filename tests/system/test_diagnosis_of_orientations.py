"""Measured orientations in a diagnosis: a tilt that hardly moves the point is seen by a 6-D target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.linear.residual_rows import rms_um, views_of
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.non_repeatable_motion import _whole_rows
from identification.estimation.fit import fit_machine
from tests.helpers.diagnosed import FRAME, empty_survey

ORIENTATION = ["mrx", "mry", "mrz"]
BENT = EffectSpec("column-bending", {"joint": "Z", "load_joint": "X", "foot": "low"})
ROWS, NOISE_MM, NOISE_RAD = 240, 0.006, 3e-6


def six_dimensional(tilt: float = 4e-5, seed: int = 4) -> Survey:
    """A mill whose column bends under its table (rad at the end of both travels), read by a 6-D target."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, ROWS, seed, channels=False, grid=False)
    chain = Chain(replace(machine, effects=(BENT,)))
    (names,) = chain.effect_ids
    truth = Truth({names[0]: tilt}, *FRAME)
    seen = measured_at(chain.machine, survey.table, truth, NOISE_MM, seed)
    turned = Rotation.from_rotvec(np.array(seen[ORIENTATION]))
    noise = Rotation.from_rotvec(np.random.default_rng(seed).normal(0.0, NOISE_RAD, (ROWS, 3)))
    seen[ORIENTATION] = (noise * turned).as_rotvec()
    return replace(survey, table=survey.table.assign(**{c: seen[c] for c in seen.columns}))


def without_orientations(survey: Survey) -> Survey:
    return replace(survey, table=survey.table.drop(columns=ORIENTATION))


def test_a_tilt_that_hardly_moves_the_point_is_found_by_its_orientation() -> None:
    machine, survey = read_machine("vertical_three_axis"), six_dimensional()
    found = diagnose(machine, survey).diagnosis.findings
    assert [(f.effect, f.where) for f in found] == [("column-bending", "Z")]
    amount = found[0].parameters[0]  # from the other end of the travel it has the other sign
    assert abs(amount.value) == pytest.approx(4e-5, abs=3 * amount.std)
    alone = diagnose(machine, without_orientations(survey)).diagnosis.findings
    assert "column-bending" not in [f.effect for f in alone]


def test_nothing_but_geometry_and_noise_stays_quiet() -> None:
    result = diagnose(read_machine("vertical_three_axis"), six_dimensional(0.0)).diagnosis
    assert (result.verdict, result.findings) == ("adequate", ())


def test_the_linear_model_has_six_observations_a_pose_and_of_many_rows_the_positions() -> None:
    survey = six_dimensional()
    fit = fit_machine(read_machine("vertical_three_axis"), survey)
    whole, some = set_up(fit), set_up(fit, 100)
    assert (len(whole.index), len(some.index)) == (6 * ROWS, 3 * 100)
    assert [len(views_of(fit, linear)) for linear in (whole, some)] == [2, 1]
    # sizes are of points, whatever angles are beside them
    values = np.concatenate([np.ones(3 * ROWS), np.full(3 * ROWS, 7.0)])
    assert rms_um(fit, whole, values) == pytest.approx(1e3 * fit.solution.sigma["position"] * np.sqrt(3))


def test_of_a_pose_the_position_shows_what_does_not_repeat() -> None:
    fit = fit_machine(read_machine("vertical_three_axis"), six_dimensional())
    linear = set_up(fit)
    rows = _whole_rows(linear)
    assert rows.shape == (ROWS, 3)
    assert (rows < 3 * ROWS).all()  # positions come first
    assert (linear.index[rows] == linear.index[rows[:, :1]]).all()


@pytest.mark.parametrize("rows", [7, 8])
def test_a_few_poses_are_diagnosed(rows: int) -> None:
    """Their orientations leave degrees of freedom, which a few candidates take up."""
    survey = six_dimensional(0.0)
    few = diagnose(read_machine("vertical_three_axis"), replace(survey, table=survey.table.head(rows)))
    assert few.diagnosis.findings == ()


def test_a_tilt_that_had_made_orientations_noisy_leaves_nothing_behind() -> None:
    """The search is repeated with the noise that it left: positions and orientations had been weighed by the first."""
    machine, survey = read_machine("vertical_three_axis"), six_dimensional(2e-4)
    found = diagnose(machine, survey)
    assert [f.effect for f in found.diagnosis.findings] == ["column-bending"]
    assert found.diagnosis.verdict == "explained"
    assert ("noise-of-kinds", "found") in [(d.rule, d.outcome) for d in found.log]
