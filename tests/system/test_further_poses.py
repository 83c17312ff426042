"""What rows hold of a fit and what more of them would bring: against fits of surveys with those rows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from identification.estimation.fit import fit_machine
from identification.report.outliers_and_poses import gain_part
from identification.report.page import page
from identification.results.analysis import Analysis
from identification.results.store import as_json, save
from identification.uncertainty.further_poses import leverages
from tests.helpers.chains import Array, errors
from tests.helpers.motions import motion_rows
from tests.helpers.nightly import first_of
from tests.helpers.surveys import measured, positions, survey

MACHINE = read_machine("horizontal_three_axis")
CHAIN = Chain(MACHINE)
P = errors(CHAIN, 1)
SIGMA = ["sigma_x", "sigma_y", "sigma_z"]


def table(n: int, seed: int = 0, points: pd.DataFrame | None = None) -> pd.DataFrame:
    return positions(measured(MACHINE, P, n, seed, noise=4e-3, points=points)).assign(**dict.fromkeys(SIGMA, 4e-3))


def test_ten_more_like_these_and_the_best_ten() -> None:
    """Both are what a fit with ten more rows says; the best bring more, and most of all groups."""
    plain = fit_machine(MACHINE, survey(table(60)))
    gain, std = Analysis(plain).gain, np.sqrt(np.diag(plain.solution.covariance)) * plain.inflation
    np.testing.assert_allclose(gain.like_these, std * np.sqrt(60 / 70), rtol=1e-9)
    assert gain.best is not None
    assert gain.poses is not None
    assert gain.poses.shape == (10, 3)
    wanted = (
        table(60).iloc[:10].drop(columns=["mx", "my", "mz"]).assign(**{c: v.to_numpy() for c, v in gain.poses.items()})
    )
    richer = fit_machine(MACHINE, survey(table(60), table(10, points=wanted)))
    found = np.sqrt(np.diag(richer.solution.covariance))
    np.testing.assert_allclose(found, gain.best / plain.inflation, rtol=0.01)
    assert np.mean(gain.best / std) < np.mean(gain.like_these / std) - 0.05
    assert (gain.best <= std).all()


def test_leverages_sum_to_the_rank_and_single_out_a_lonely_row() -> None:
    rows = table(80)
    x = MACHINE.joints[0].name
    rows[x] = rows[x] / 10
    far = rows.iloc[:1].assign(**{x: MACHINE.joints[0].travel[1]})
    again = table(81, points=pd.concat([rows, far], ignore_index=True).drop(columns=["mx", "my", "mz"]))
    fit = fit_machine(MACHINE, survey(again))
    found = leverages(fit)
    assert np.sum(found) == pytest.approx(fit.solution.groups.rank, rel=1e-6)
    assert found.argmax() == 80
    assert found[80] > 2 * np.sort(found)[-2]


def test_what_a_folder_says_of_it(tmp_path: Path) -> None:
    fit = fit_machine(MACHINE, survey(table(60)))
    save(fit, tmp_path)
    data = json.loads((tmp_path / "fit.json").read_text())
    now, more, best = (
        np.array([p[name] for p in data["parameters"]]) for name in ("std", "std_after_10_more", "std_after_10_best")
    )
    np.testing.assert_allclose(more, now * np.sqrt(60 / 70), rtol=1e-9)  # nothing is known beforehand: as 1/sqrt(rows)
    assert (best > 0).all()
    assert (best < now).all()
    assert np.mean(best / now) < np.mean(more / now) - 0.05
    assert len(data["next_poses"]) == 10
    assert (data["robust"], data["outliers"]) == (False, [])
    assert "leverage" in pd.read_csv(tmp_path / "residuals.csv")
    std = np.sqrt(np.diag(fit.solution.covariance))
    matrix = fit.solution.covariance / np.outer(std, std)
    strong = np.abs(np.triu(matrix, 1)) > 0.9
    assert len(data["correlations"]) == strong.sum()
    values = [abs(c["correlation"]) for c in data["correlations"]]
    assert values == sorted(values, reverse=True)


def mixed(seed: int, noises: dict[str, float], stated: bool) -> Array:
    """z of the groups of X's own motions in a fit of volumetric rows, an interferometer and a level."""
    rng = np.random.default_rng(seed)
    volumetric = table(60, seed).drop(columns=SIGMA).assign(joint="")
    volumetric = volumetric.assign(**dict.fromkeys(SIGMA, 4e-3)) if stated else volumetric
    motions = motion_rows(MACHINE, P, "X", tuple(noises), 30)
    for motion, sigma in noises.items():
        motions[motion] += rng.normal(0, sigma, len(motions))
        if stated:
            motions[f"u_{motion}"] = sigma
    fit = fit_machine(MACHINE, survey(volumetric, motions))
    s = fit.solution
    assert (set(s.declared) == {"position", "displacement", "angle"}) is stated
    names = [s.unknowns[j] for j in s.groups.base]
    ids = [n for n in names if n.startswith(("X.dx", "X.eb", "X.ec")) and n in CHAIN.index]
    places = [names.index(n) for n in ids]
    truth = s.groups.coefficients[places] @ np.array([P[CHAIN.index[u]] if u in CHAIN.index else 0 for u in s.unknowns])
    z = (s.values[s.groups.base][places] - truth) / (np.sqrt(np.diag(s.covariance))[places] * fit.inflation)
    alone = [k for k, p in enumerate(places) if len(s.groups.members(p)) == 1]
    return np.asarray(z[alone])


@pytest.mark.parametrize("stated", first_of([False, True]))
def test_error_motions_with_their_own_noises(stated: bool) -> None:
    """Interferometer, level and tracker in one fit, each at its noise, stated or found: two sigma hold the truth."""
    noises = {"dx": 3e-4, "eb": 2e-6, "ec": 2e-6}
    z = np.concatenate([mixed(seed, noises, stated) for seed in range(8)])
    assert len(z) >= 16
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3
    assert np.mean(np.abs(z) > 2) < 0.15


def test_uncertainty_of_some_motions_only() -> None:
    motions = motion_rows(MACHINE, P, "X", ("dx", "eb"), 30).assign(u_dx=1e-4)
    motions.loc[7, "u_dx"] = np.nan
    with pytest.raises(InputError, match="row 8, column u_dx"):
        fit_machine(MACHINE, survey(motions))


def test_a_robust_fit_needs_rows_to_spare() -> None:
    with pytest.raises(InputError, match="too few to say which rows are wrong"):
        fit_machine(MACHINE, survey(table(14).drop(columns=SIGMA)), robust=True)


def test_noise_that_hangs_together_as_long_as_the_run() -> None:
    """It cannot be told from a drift, and the fit says so."""
    rows = table(60).drop(columns=SIGMA).sort_values(MACHINE.joints[0].name, ignore_index=True)
    walk = np.cumsum(np.random.default_rng(1).normal(0, 3e-3, (60, 3)), axis=0)
    rows[["mx", "my", "mz"]] += walk
    fit = fit_machine(MACHINE, survey(rows))
    assert any("cannot be distinguished from an offset" in note for note in fit.notes)


def test_next_poses_need_positions() -> None:
    fit = fit_machine(MACHINE, survey(motion_rows(MACHINE, P, "X", ("dx", "eb"), 30)))
    assert as_json(Analysis(fit))["next_poses"] == []
    assert all(p["std_after_10_best"] is None for p in as_json(Analysis(fit))["parameters"])


def test_a_pose_that_is_listed_twice_is_to_be_measured_twice() -> None:
    fit = fit_machine(MACHINE, survey(table(60)))
    part = gain_part(Analysis(fit))
    assert part is not None
    poses = [tuple(row) for row in part.poses]
    assert len(poses) == 10
    assert part.repeated == (len(set(poses)) < 10)
    text = page("gain.html", gain=part)
    assert ("is to be measured as often" in text) == part.repeated
    once = page("gain.html", gain=part._replace(repeated=not part.repeated))
    assert ("is to be measured as often" in once) != part.repeated
