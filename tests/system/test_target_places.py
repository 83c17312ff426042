"""Targets at places on the flange that nobody knows, or to so much: unknowns of the fit, told from the machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, simulate
from errormodel.arrays import Array
from errormodel.machine_file import read_machine
from identification import describe, diagnose, fit, import_survey, load, predict
from identification.results.fit_result import FitResult

ARM = read_machine("six_axis_arm")
JOINTS = [j.name for j in ARM.joints]
NOISE = 0.02  # mm of a coordinate
ERRORS = {"L2.dx": -0.4, "L3.ea": 6e-4, "L4.dy": 0.3, "L5.eb": -5e-4, "L6.dz": 0.2, "L6.ec": 4e-4}
STATED = np.array([[80.0, -140.0, 0.0], [-40.0, -140.0, 70.0], [-40.0, -195.0, -70.0]])
# 0.5 mm each, in directions in which no motion of the flange takes all three
OFF = 0.5 * np.array([[1, 2, -1], [-2, 1, 1], [1, -1, 2]]) / np.sqrt(6)


def poses(count: int, seed: int) -> pd.DataFrame:
    angles = np.random.default_rng(seed).uniform(-150, 150, (count, len(JOINTS))).round(3)
    return pd.DataFrame(angles, columns=JOINTS)


def measured(table: pd.DataFrame, places: Array, noise: float) -> pd.DataFrame:
    """Each pose with each target at its place: joints, target, measured point."""
    rows = table.loc[table.index.repeat(len(places))].reset_index(drop=True)
    at = np.tile(places, (len(table), 1))
    given = rows.assign(tool_x=at[:, 0], tool_y=at[:, 1], tool_z=at[:, 2])
    seen = simulate(ARM, given, ERRORS, translation=(500, -3000, 200), rotation=(1, 2, 170), noise=noise, seed=5)
    own = [f"T{k % len(places) + 1}" for k in range(len(rows))]
    return rows.assign(target=own, mx=seen["mx"], my=seen["my"], mz=seen["mz"])


def survey(folder: Path, targets: str, places: Array = STATED + OFF, noise: float = NOISE) -> Path:
    folder.mkdir(exist_ok=True)
    measured(poses(60, 1), places, noise).to_csv(folder / "points.csv", index=False)
    text = f"errormodel: 1\nfiles:\n  - path: points.csv\n    format: delimited-table\n    targets: {targets}\n"
    (folder / "survey.yaml").write_text(text)
    return folder


def listed(form: str, places: Array = STATED) -> str:
    return "{" + ", ".join(f"T{k}: {form.format(p.tolist())}" for k, p in enumerate(places, start=1)) + "}"


def off(result: FitResult, stated: Array = STATED) -> tuple[Array, Array]:
    """Errors (n, 3) of predictions of the targets at other poses, mm, and their standard uncertainties."""
    new = measured(poses(40, 2), STATED + OFF, 0.0)
    at = np.tile(stated, (40, 1))
    out = predict(result, new[JOINTS].assign(tool_x=at[:, 0], tool_y=at[:, 1], tool_z=at[:, 2]))
    table = out.table if hasattr(out, "table") else out
    return (
        table[["mx", "my", "mz"]].to_numpy() - new[["mx", "my", "mz"]].to_numpy(),
        table[["ux", "uy", "uz"]].to_numpy(),
    )


def test_a_place_that_nobody_knows_is_an_unknown(tmp_path: Path) -> None:
    """Stated as known it makes predictions of these very targets wrong by 0.2 mm a coordinate; as near it does not."""
    held = fit(ARM, survey(tmp_path / "held", listed("{}")))
    assert np.sqrt(np.square(off(held)[0]).mean()) > 5 * NOISE
    free = fit(ARM, survey(tmp_path / "free", listed("{{near: {}}}")))
    error, u = off(free)
    assert np.sqrt(np.square(error).mean()) < NOISE
    new = poses(5, 2).assign(**dict(zip(("tool_x", "tool_y", "tool_z"), STATED[0], strict=True)))
    assert any(
        "5 points with the tool at 80, -140, 0 count as the target T1" in n for n in predict(free, new).attrs["notes"]
    )
    assert not any("count as the target" in n for n in predict(free, new.assign(tool_x=81.0)).attrs["notes"])
    assert (np.abs(error) < 2 * u).mean() > 0.85
    assert not {"L6.dx", "L6.dy", "L6.dz", "L6.ea", "L6.eb", "L6.ec"} & {*free.parameters.index}  # in their groups
    assert any("L6.dz" in m for m in free.parameters.loc["tool.dz.target-offset-T1", "members"])
    groups = describe(ARM, survey(tmp_path / "free", listed("{{near: {}}}"))).groups
    assert groups.rank == describe(ARM, survey(tmp_path / "held", listed("{}"))).groups.rank + 3  # their distances


def test_a_constant_in_the_stated_place_changes_no_prediction(tmp_path: Path) -> None:
    moved = STATED + np.array([[0.7, -0.4, 0.9], [-0.8, 0.3, 0.2], [0.1, 0.6, -0.5]])
    one = fit(ARM, survey(tmp_path / "one", listed("{{near: {}}}")))
    other = fit(ARM, survey(tmp_path / "other", listed("{{near: {}}}", moved)))
    (error, u), (error_too, u_too) = off(one), off(other, moved)
    np.testing.assert_allclose(error, error_too, atol=1e-4)  # mm: a millimetre of 0.1 m of lever, of errors of 10 um
    np.testing.assert_allclose(u, u_too, rtol=1e-2)  # a millimetre of 0.1 m


def test_places_are_found_where_the_last_members_are_right(tmp_path: Path) -> None:
    """Without noise, and without errors of what carries the targets, the places come out exactly, with u, in JSON."""
    rows = measured(poses(60, 1), STATED + OFF, 0.0)
    at = np.tile(STATED + OFF, (60, 1))
    given = rows[JOINTS].assign(tool_x=at[:, 0], tool_y=at[:, 1], tool_z=at[:, 2])
    seen = simulate(ARM, given, {"L2.dx": -0.4, "L3.ea": 6e-4}, translation=(5, -30, 2), noise=0.0, seed=5)
    folder = survey(tmp_path / "survey", listed("{{near: {}}}"))
    rows.assign(mx=seen["mx"], my=seen["my"], mz=seen["mz"]).to_csv(folder / "points.csv", index=False)
    result = fit(ARM, folder)
    result.save(tmp_path / "fit")
    found = [o for o in load(tmp_path / "fit").stored.data["observations"] if o["type"] == "target"]
    assert [o["observation"] for o in found] == ["T1"] * 3 + ["T2"] * 3 + ["T3"] * 3
    np.testing.assert_allclose([o["value"] for o in found], (STATED + OFF).ravel(), atol=1e-4)
    assert all(o["std"] is not None and o["unit"] == "mm" for o in found)
    assert "places of targets" in result.summary()


def test_a_stated_uncertainty_is_a_prior(tmp_path: Path) -> None:
    """With 20 um a coordinate the members behind them are known to about so much, and are groups of their own."""
    places = STATED + np.random.default_rng(3).normal(0, 0.02, STATED.shape)
    result = fit(ARM, survey(tmp_path / "s", listed("{{place: {}, sigma: 0.02}}"), places))
    last = result.parameters.loc["L6.dz"]
    assert 0.005 < last["std"] < 0.1
    place = result.parameters.loc["tool.dx.target-offset-T1"]
    assert 0.002 < place["std"] < 0.03


def test_import_leaves_places_that_it_fitted_to_the_fit(tmp_path: Path) -> None:
    rows = measured(poses(60, 1), STATED + OFF, NOISE)
    rows.to_csv(tmp_path / "points.csv", index=False)
    result = import_survey(tmp_path / "points.csv", ARM)
    assert result.imported.files["survey.yaml"].count(b"near: [") == 3
    assert {*result.survey.places} == {"T1", "T2", "T3"}
    error, _ = off(fit(ARM, result.survey), np.array([result.survey.places[f"T{k}"].point for k in (1, 2, 3)]))
    assert np.sqrt(np.square(error).mean()) < NOISE


@pytest.mark.parametrize(
    ("target", "cure"),
    [
        ("{place: [1, 2, 3], near: [1, 2, 3]}", "Write place: .* or near:"),
        ("{near: [1, 2, 3], sigma: 0.1}", "near: is a place that nobody knows"),
        ("{place: [1, 2, 3], sigma: 0}", "standard uncertainty"),
        ("[1, 2]", "functional point"),
    ],
)
def test_a_target_that_says_two_things_is_refused(tmp_path: Path, target: str, cure: str) -> None:
    with pytest.raises(InputError, match=cure):
        fit(ARM, survey(tmp_path / "s", f"{{T1: {target}, T2: [0, 0, 1], T3: [0, 0, 2]}}"))


def test_targets_of_a_file_without_format_say_what_to_write(tmp_path: Path) -> None:
    path = survey(tmp_path / "s", listed("{}")) / "survey.yaml"
    path.write_text(path.read_text().replace("    format: delimited-table\n", ""))
    with pytest.raises(InputError, match=r"Write format: beside targets:, as errormodel import writes it$"):
        fit(ARM, path)


def as_written(k: int, place: Array) -> tuple[pd.DataFrame, Array]:
    """Points of three targets, of which the k-th is written at `place`."""
    table = measured(poses(60, 1), STATED, NOISE).drop(columns="target")
    written = STATED.copy()
    written[k] = place
    table[["tool_x", "tool_y", "tool_z"]] = np.tile(written, (60, 1))
    return table, STATED[k]


@pytest.mark.parametrize("look", ["fit", "diagnose"])
@pytest.mark.parametrize(("k", "place"), [(1, 10 * STATED[1]), (2, STATED[1])])
def test_rows_of_a_target_that_is_written_elsewhere_are_refused(
    tmp_path: Path, look: str, k: int, place: Array
) -> None:
    """A digit too many, or the name of another target: no column is wrong as a whole."""
    table, true = as_written(k, place)
    table.to_csv(tmp_path / "points.csv", index=False)
    with pytest.raises(InputError) as refused:
        (fit if look == "fit" else diagnose)(ARM, tmp_path / "points.csv")
    said = str(refused.value)
    assert "60 rows" in said
    assert "while the other 120 rows fit theirs" in said
    shown = [float(x) for x in said.split("show it at (")[1].split(")", maxsplit=1)[0].split(",")]
    assert np.abs(np.array(shown) - true).max() < 2


@pytest.mark.parametrize("look", [fit, diagnose])
@pytest.mark.parametrize(("count", "order"), [(3, [0, 2, 1]), (2, [1, 0])])
def test_two_targets_under_each_others_names_are_refused(
    tmp_path: Path, look: Callable[..., object], count: int, order: list[int]
) -> None:
    """Of two, all rows are wrong: the sign of a column had been blamed, which left a tenth of the misfit."""
    table = measured(poses(60, 1), STATED[:count], NOISE).drop(columns="target")
    table[["tool_x", "tool_y", "tool_z"]] = np.tile(STATED[order], (60, 1))
    table.to_csv(tmp_path / "points.csv", index=False)
    with pytest.raises(
        InputError, match=r"the targets at \(.*\) and \(.*\) are exchanged: .* misses by .* mm, with .* um"
    ):
        look(ARM, tmp_path / "points.csv")


def test_a_change_that_leaves_far_more_than_errors_of_a_machine_is_no_cure(tmp_path: Path) -> None:
    """A place with two wrong digits: the nearest change of a column leaves centimetres."""
    places = np.array([[60.0, 20.0, 95.0], [-70.0, 30.0, 95.0]])
    table = measured(poses(60, 1), places, NOISE).drop(columns="target")
    table[["tool_x", "tool_y", "tool_z"]] = np.tile([[-75.0, 30.0, 85.0], [55.0, 40.0, 75.0]], (60, 1))
    table.to_csv(tmp_path / "points.csv", index=False)
    with pytest.raises(InputError, match=r"no usual mistake in a column explains it: the nearest \(.*\) leaves .* mm"):
        diagnose(ARM, tmp_path / "points.csv")
