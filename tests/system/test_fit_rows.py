"""Fits of rows that do not hold everything: components, orientations, error motions, uncertainties, nothing at all."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from identification.estimation.checks import looked_over
from identification.estimation.fit import fit_machine
from tests.helpers.chains import errors
from tests.helpers.motions import motion_rows
from tests.helpers.surveys import measured, positions, prediction_error, survey

FIVE_AXIS, THREE_AXIS = "five_axis_table_quill", "horizontal_three_axis"
EXACT = 1e-3  # um
SIGMA = ["sigma_x", "sigma_y", "sigma_z"]


def test_missing_components() -> None:
    """Rows with a height only, or without it: an interferometer, a probe."""
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 4)
    table = positions(measured(machine, p, 240))
    table.loc[60:119, ["mx", "my"]] = np.nan
    table.loc[120:179, "mz"] = np.nan
    fit = fit_machine(machine, survey(table))
    assert sum(s.count for s in fit.solution.sums.values()) == 60 * (3 + 1 + 2 + 3)
    assert np.isfinite(fit.residuals[60]).tolist() == [False, False, True]
    assert max(fit.fitted.rms_um, prediction_error(fit, p)) < EXACT
    aligned = (
        measured(machine, p, 240, frame=((1.0, 2.0, 3.0), (1e-3, 0.0, 2e-3))).drop(columns=["mz"]).assign(mz=np.nan)
    )
    assert fit_machine(machine, survey(positions(aligned))).fitted.rms_um < EXACT


def with_mount(table: pd.DataFrame, mount: Rotation) -> pd.DataFrame:
    turned = Rotation.from_rotvec(np.array(table[["mrx", "mry", "mrz"]])) * mount
    return table.assign(**dict(zip(["mrx", "mry", "mrz"], turned.as_rotvec().T, strict=True)))


@pytest.mark.parametrize("name", [FIVE_AXIS, "six_axis_arm"])
def test_orientations(name: str) -> None:
    """A 6-D target mounted at any angle sees angles that its position does not, and its rows say so."""
    machine = read_machine(name)
    p = errors(Chain(machine), 5)
    mount = Rotation.from_rotvec([1.2, -0.9, 2.0])
    table = with_mount(measured(machine, p, 150), mount)
    table.loc[100:, ["mrx", "mry", "mrz"]] = np.nan
    fit = fit_machine(machine, survey(table))
    assert fit.fitted.rms_um < EXACT
    assert prediction_error(fit, p) < EXACT
    plain = fit_machine(machine, survey(positions(table)))
    assert fit.solution.groups.rank > plain.solution.groups.rank
    assert fit.solution.sigma["orientation"] < 1e-10  # rad
    assert fit.problem.mount is not None
    assert Rotation.from_matrix(fit.problem.mount.T @ mount.as_matrix()).magnitude() < 1e-3


def test_error_motions_join_volumetric_rows() -> None:
    machine = read_machine(THREE_AXIS)
    p = errors(Chain(machine), 6)
    volumetric = positions(measured(machine, p, 60)).assign(joint="")
    rows = [motion_rows(machine, p, "X", ("dx", "eb")), motion_rows(machine, p, "Y", ("dx", "dz", "ea", "ec"))]
    fit = fit_machine(machine, survey(volumetric, *rows))
    assert max(fit.fitted.rms_um, prediction_error(fit, p)) < EXACT
    named, index = fit.solution.named(), fit.chain.index
    assert named["X.dx.1"] == pytest.approx(p[index["X.dx.1"]], rel=1e-6)  # its own, not the frame's or a group's
    assert named["zero[Y, run 1].dz"] == pytest.approx(2e-2, abs=1e-9)
    assert set(fit.solution.sigma) == {"position", "displacement", "angle"}
    alone = fit_machine(machine, survey(*rows))
    assert alone.solution.named()["Y.ec.1"] == pytest.approx(p[index["Y.ec.1"]], rel=1e-9)


@pytest.mark.parametrize("frame", ["shared", "fixed"])
def test_heights_alone(frame: str) -> None:
    """What is not measured shows by the frame's tilt, a few urad: it must not be fitted with metres of error."""
    machine = read_machine(THREE_AXIS)
    table = positions(measured(machine, errors(Chain(machine), 1), 80, noise=3e-3, frame=((0, 0, 0), (0, 0, 0))))
    fit = fit_machine(machine, survey(table.assign(mx=np.nan, my=np.nan), frame=frame))
    s = fit.solution
    assert s.converged
    assert np.abs(s.values).max() < 0.1  # mm, rad
    assert s.sigma["position"] == pytest.approx(3e-3, rel=0.2)
    assert {s.groups.ids[j].split(".")[1] for j in s.groups.base} <= {"dz", "ea", "eb"}


def test_orientations_of_rows_without_a_position() -> None:
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 2)
    table = measured(machine, p, 100)
    table.loc[60:, ["mx", "my", "mz"]] = np.nan
    fit = fit_machine(machine, survey(table))
    assert fit.solution.sums["orientation"].count == 300
    assert fit.solution.sums["position"].count == 180
    assert prediction_error(fit, p) < EXACT
    assert np.isnan(fit.heldout_residuals[60:]).all()


def test_a_stretch_where_nothing_was_measured() -> None:
    machine = read_machine(THREE_AXIS)
    p = errors(Chain(machine), 3)
    table = positions(measured(machine, p, 120))
    table.loc[30:70, ["mx", "my", "mz"]] = np.nan  # the beam was lost for a third of the rows
    fit = fit_machine(machine, survey(table))
    assert (fit.fitted.n, fit.heldout.n) == (79, 79)
    assert prediction_error(fit, p) < EXACT


def test_uncertainties_of_some_rows_only() -> None:
    """Neither a guess nor a crash: which row lacks it."""
    machine = read_machine(THREE_AXIS)
    table = positions(measured(machine, errors(Chain(machine), 4), 80, noise=3e-3))
    stated = table.assign(**dict.fromkeys(SIGMA, 3e-3))
    gap = stated.copy()
    gap.loc[10:, "sigma_z"] = np.nan
    with pytest.raises(InputError, match="row 11"):
        fit_machine(machine, survey(gap))
    with pytest.raises(InputError, match="uncertaint"):
        fit_machine(machine, survey(stated, table.assign(run="2"), frame="per-run"))
    gap.loc[10:, "mz"] = np.nan  # what was not measured needs none
    assert fit_machine(machine, survey(gap)).solution.converged
    other = table.assign(role="test", file="b.csv")
    assert fit_machine(machine, survey(stated, other, frame="per-file")).tests[0].fitted.rms_um < 10


def test_one_row_with_another_tool_among_thousands() -> None:
    """The rank is decided on a sample of rows; what the sample missed is found all the same."""
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 5)
    table = positions(measured(machine, p, 3000, noise=1e-3, frame=((0, 0, 0), (0, 0, 0))))
    one = fit_machine(machine, survey(table, frame="fixed")).solution.groups.rank
    long = positions(measured(machine, p, 1, 8, tools=((0, 0, -435.185),), frame=((0, 0, 0), (0, 0, 0))))
    two = fit_machine(machine, survey(table[:1501], long, table[1501:], frame="fixed")).solution.groups.rank
    assert (one, two) == (32, 34)


def test_too_few_rows_say_how_many_are_needed() -> None:
    machine = read_machine(FIVE_AXIS)
    table = positions(measured(machine, errors(Chain(machine), 6), 400, noise=1e-3))
    for n in (1, 2, 5, 10):
        with pytest.raises(InputError, match="Measure at least"):
            fit_machine(machine, survey(table[:n]))
    assert fit_machine(machine, survey(table[:15])).solution.dof > 0


def test_the_callers_arithmetic_is_left_alone() -> None:
    before = np.geterr()
    machine = read_machine(THREE_AXIS)
    fit_machine(machine, survey(positions(measured(machine, errors(Chain(machine), 7), 60))))
    assert np.geterr() == before


def test_everything_in_one_fit() -> None:
    """6-D rows, heights alone, an interferometer's lengths and a level's angles, each at its own noise."""
    machine = read_machine(FIVE_AXIS)
    chain = Chain(machine)
    p = errors(chain, 4)
    rng = np.random.default_rng(5)
    six = measured(machine, p, 80, 1)
    turn = Rotation.from_rotvec(rng.normal(0, 4e-6, (80, 3)))
    six[["mrx", "mry", "mrz"]] = (turn * Rotation.from_rotvec(np.array(six[["mrx", "mry", "mrz"]]))).as_rotvec()
    heights = positions(measured(machine, p, 60, 2)).assign(mx=np.nan, my=np.nan)
    joint = next(j for j in machine.joints if j.type == "prismatic")
    own = "xyz"[int(np.argmax(np.abs(joint.axis)))]
    across = [f"e{c}" for c, k in zip("abc", "xyz", strict=True) if k != own]
    motions = motion_rows(machine, p, joint.name, (f"d{own}", *across), 40)
    motions[f"d{own}"] += rng.normal(0, 3e-4, 40)
    motions[across] += rng.normal(0, 1e-6, (40, len(across)))
    table = pd.concat([six, heights]).assign(joint="")
    table[["mx", "my", "mz"]] += rng.normal(0, 2e-3, (140, 3))
    fit = fit_machine(machine, survey(table, motions))
    sigma = fit.solution.sigma
    assert sigma["position"] == pytest.approx(2e-3, rel=0.15)
    assert sigma["orientation"] == pytest.approx(4e-6, rel=0.15)
    assert sigma["displacement"] == pytest.approx(3e-4, rel=0.4)
    assert sigma["angle"] == pytest.approx(1e-6, rel=0.3)
    assert {k: s.count for k, s in fit.solution.sums.items()} == {
        "position": 300, "orientation": 240, "displacement": 40, "angle": 80,
    }  # fmt: skip
    alone = fit_machine(machine, survey(positions(six.assign(joint=""))))
    assert prediction_error(fit, p) < prediction_error(fit_machine(machine, survey(table)), p) * 1.1 < 4
    assert prediction_error(fit, p) < prediction_error(alone, p) + 4


def test_poses_that_leave_a_joint_out_are_told() -> None:
    machine = read_machine(THREE_AXIS)
    p = errors(Chain(machine), 1)
    whole = looked_over(fit_machine(machine, survey(positions(measured(machine, p, 60, noise=2e-3)))))
    assert not any("rank-deficient" in note for note in whole.notes)
    still = random_points(machine, 60, 0).assign(X=100.0)
    fit = fit_machine(machine, survey(positions(measured(machine, p, 60, noise=2e-3, points=still))))
    (note,) = looked_over(fit).notes
    assert "X covers 0 % of its travel" in note
    assert "X.dx.1" in note
    assert "errormodel plan" in note


def test_a_survey_of_another_machine_is_told() -> None:
    """Radians where degrees stand: the rotary axes hardly seem to move."""
    machine = read_machine("trunnion_five_axis")
    table = positions(measured(machine, errors(Chain(machine), 1), 80, noise=2e-3))
    table[["A", "C"]] = np.radians(table[["A", "C"]])
    fit = fit_machine(machine, survey(table))
    assert any("mm rms beside the nominal machine" in note for note in fit.notes)
    with pytest.raises(InputError, match="mm rms beside the nominal machine"):
        looked_over(fit)
