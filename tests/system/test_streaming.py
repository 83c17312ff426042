"""Fits in one pass: what the usual fit gives, whatever the parts, blocks and workers; and what they refuse."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from errormodel import simulate
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from errormodel.survey_rows import SurveyRows, open_rows
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.runtime.engines import Crew
from identification.streaming.fit import Sizing, fit_rows
from tests.helpers.commands import done, run
from tests.helpers.nightly import first_of

FIVE, MILL = "five_axis_table_quill", "vertical_three_axis"
# sizes of errors as machines have them
ERRORS = {
    FIVE: {"X.dx.1": 2e-5, "T2.eb": 2e-5, "Y.ea.1": 3e-8, "T3.ec": 5e-5},
    MILL: {"X.dx.1": 2e-5, "Y.ec.1": 3e-8},
}
NOISE = 0.003
# mm: round-off of coordinates of metres, of sums over some thousand rows in another order
ROUND_OFF = 2e-11


def table(machine: str, n: int, seed: int = 1, frame: float = 100.0) -> pd.DataFrame:
    return simulate(
        machine, n, ERRORS[machine], noise=NOISE, seed=seed, translation=(frame, 20.0, 3.0), rotation=(1.0, 2.0, 3.0)
    )


def files(folder: Path, text: str, **tables: pd.DataFrame) -> Path:
    for name, own in tables.items():
        own.to_parquet(folder / f"{name}.parquet", index=False)
    path = folder / "survey.yaml"
    path.write_text(text)
    return path


def both(machine: str, source: Any, **sizing: int) -> tuple[Fit, Fit]:
    model = read_machine(machine)
    streamed = fit_rows(model, open_rows(source, model), sizing=Sizing(**sizing))
    return fit_machine(model, read_survey(source, model)), streamed


def apart(usual: Fit, streamed: Fit) -> float:
    """Largest difference of a residual of the sample's rows, mm."""
    place = usual.survey.table.reset_index().set_index(["file", "row"])["index"]
    rows = place.loc[list(zip(streamed.survey.table["file"], streamed.survey.table["row"], strict=True))].to_numpy()
    return float(np.nanmax(np.abs(usual.residuals[rows] - streamed.residuals)))


def agree(usual: Fit, streamed: Fit) -> None:
    """All that the two state, to round-off."""
    assert apart(usual, streamed) < ROUND_OFF
    s, t = usual.solution, streamed.solution
    assert s.groups.base.tolist() == t.groups.base.tolist()
    std = np.sqrt(np.diag(s.covariance))
    # a millionth of a standard uncertainty: the iterations end where a step is as small as that
    assert (np.abs((s.values - t.values)[s.groups.base]) < 1e-6 * std).all()
    np.testing.assert_allclose(t.covariance, s.covariance, rtol=1e-7, atol=1e-9 * s.covariance.max())
    assert (s.dof, usual.folds) == (t.dof, streamed.folds)
    np.testing.assert_allclose([s.chi2, *s.sigma.values()], [t.chi2, *t.sigma.values()], rtol=1e-9)
    for name in ("nominal", "fitted"):
        one, other = getattr(usual, name), getattr(streamed, name)
        np.testing.assert_allclose(
            [other.rms_um, other.mean_um, other.max_um, other.n],
            [one.rms_um, one.mean_um, one.max_um, one.n],
            rtol=1e-9,
        )
    # without the second order of a step that leaves a block out: 1e-4 (errors over size) of a part of the noise
    assert streamed.heldout.rms_um == pytest.approx(usual.heldout.rms_um, rel=1e-5)
    np.testing.assert_allclose(streamed.heldout_residuals, usual.heldout_residuals, atol=1e-7)


def missing(own: pd.DataFrame) -> pd.DataFrame:
    own.loc[200:400, ["mx", "my"]] = np.nan
    own.loc[500:600, "mz"] = np.nan
    own.loc[700:710, ["mx", "my", "mz"]] = np.nan
    return own


def stated(own: pd.DataFrame) -> pd.DataFrame:
    return own.assign(sigma=np.where(np.arange(len(own)) % 3 == 0, 0.002, 0.004))


def directed(own: pd.DataFrame) -> pd.DataFrame:
    return own.assign(sigma_x=0.002, sigma_y=0.003, sigma_z=np.where(np.arange(len(own)) % 2 == 0, 0.002, 0.004))


@pytest.mark.parametrize("change", [lambda own: own, missing, stated, directed], ids=["plain", "gaps", "sigma", "xyz"])
@pytest.mark.parametrize("machine", first_of([MILL, FIVE]))
def test_a_small_survey_gives_the_usual_fit(machine: str, change: Any) -> None:
    agree(*both(machine, change(table(machine, 1500)), segment=700, block=190))


def test_frames_of_files_instruments_and_files_held_out(tmp_path: Path) -> None:
    text = (
        "errormodel: 1\nfiles: [{path: a.parquet}, {path: b.parquet}, {path: c.parquet, role: test}]\nframe: per-file\n"
        "instrument: {type: laser-tracker, station: [2000, -1500, 600], range: [0.5e-3, 3.0e-6], angle: 1.2e-6}\n"
    )
    parts = {name: table(MILL, 500 + 40 * k, k + 1, 100.0 * k) for k, name in enumerate("abc")}
    usual, streamed = both(MILL, files(tmp_path, text, **parts), segment=300, block=170)
    agree(usual, streamed)
    assert streamed.tests[0].fitted.rms_um == pytest.approx(usual.tests[0].fitted.rms_um, rel=1e-9)


def test_a_fixed_frame(tmp_path: Path) -> None:
    own = simulate(MILL, 800, ERRORS[MILL], noise=NOISE, seed=3)
    source = files(tmp_path, "errormodel: 1\nfiles: [{path: a.parquet}]\nframe: fixed\n", a=own)
    agree(*both(MILL, source, segment=300, block=170))


def test_correlated_noise_and_bounds_are_as_in_the_usual_fit() -> None:
    own = table(MILL, 3000)
    drift = np.convolve(np.random.default_rng(0).normal(0, 0.02, 3200), np.ones(200) / 200, "valid")[:3000]
    own["mx"] += drift
    usual, streamed = both(MILL, own)
    assert any("correlated" in note for note in streamed.notes)
    scale = np.sqrt(np.outer(*[np.diag(usual.solution.covariance)] * 2))
    np.testing.assert_allclose(streamed.solution.covariance / scale, usual.solution.covariance / scale, atol=1e-7)
    model = read_machine(MILL)
    from identification.bayes.settings import priors_of

    bounds, document = priors_of({"X.dx.1": {"low": 3e-5, "high": 4e-5}}, bounds_only=True)
    limited = fit_rows(model, open_rows(own, model), bounds, document)
    expected = fit_machine(model, read_survey(own, model), bounds=bounds, document=document)
    assert [b.id for b in limited.at_bound] == [b.id for b in expected.at_bound] == ["X.dx.1"]
    std = np.sqrt(np.diag(usual.solution.covariance))
    base = usual.solution.groups.base
    assert (np.abs((limited.solution.values - expected.solution.values)[base]) < 1e-4 * std).all()


@pytest.mark.long
@pytest.mark.parametrize("machine", [FIVE, MILL])
def test_a_large_survey_gives_the_usual_fit_within_a_hundredth_of_its_uncertainty(machine: str) -> None:
    own = table(machine, 12_000)
    usual, streamed = both(machine, own, sample=1500, segment=5000, block=1700)
    s = usual.solution
    of_a_point = s.sigma["position"] * np.sqrt(s.groups.rank / 12_000 / 3)
    assert apart(usual, streamed) < 0.01 * of_a_point
    assert streamed.rows == 12_000
    assert len(streamed.survey) == 1500
    assert streamed.fitted.rms_um == pytest.approx(usual.fitted.rms_um, rel=1e-7)
    assert streamed.nominal.rms_um == pytest.approx(usual.nominal.rms_um, rel=1e-7)
    # the statement of the notes: the last step moves the points so little
    assert streamed.streamed is not None
    assert abs(streamed.fitted.mean_um - usual.fitted.mean_um) < 1e3 * streamed.streamed.moved_mm


def estimates(fit: Fit) -> list[bytes]:
    s = fit.solution
    return [s.values.tobytes(), s.covariance.tobytes(), np.array([s.chi2, fit.heldout.rms_um]).tobytes()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rows") / "a.parquet"
    table(FIVE, 6000).to_parquet(path, index=False)
    return path


SMALL = Sizing(sample=900, segment=1000, block=450)


@pytest.fixture(scope="module")
def once(whole: Path) -> Fit:
    model = read_machine(FIVE)
    return fit_rows(model, open_rows(whole, model), sizing=SMALL)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_the_parts_of_a_survey_do_not_matter(whole: Path, once: Fit, kind: str, tmp_path: Path) -> None:
    own, model = pd.read_parquet(whole), read_machine(FIVE)
    for k, rows in enumerate(np.array_split(np.arange(len(own)), 7)):
        if kind == "csv":  # in the shortest form that reads back as the same float
            own.iloc[rows].to_csv(tmp_path / f"p{k}.csv", index=False)
        else:
            own.iloc[rows].to_parquet(tmp_path / f"p{k}.parquet", index=False, row_group_size=333)
    assert estimates(fit_rows(model, open_rows(tmp_path, model), sizing=SMALL)) == estimates(once)


@pytest.mark.long
@pytest.mark.parametrize("crew", first_of([Crew(workers=2), Crew("dask", 2)]), ids=["processes", "dask"])
def test_who_works_does_not_matter(whole: Path, once: Fit, crew: Crew) -> None:
    if crew.engine == "dask":
        pytest.importorskip("distributed")
    model = read_machine(FIVE)
    assert estimates(fit_rows(model, open_rows(whole, model), crew=crew, sizing=SMALL)) == estimates(once)


@pytest.mark.long
@pytest.mark.parametrize("sizing", [Sizing(900, 6000, 6000), Sizing(900, 170, 170), Sizing(900, 2500, 77)])
def test_sizes_of_blocks_matter_to_round_off(whole: Path, once: Fit, sizing: Sizing) -> None:
    model = read_machine(FIVE)
    other = fit_rows(model, open_rows(whole, model), sizing=sizing)
    assert np.abs(other.residuals - once.residuals).max() < ROUND_OFF
    scale = np.sqrt(np.diag(once.solution.covariance))
    step = (other.solution.values - once.solution.values)[once.solution.groups.base]
    assert (np.abs(step) < 1e-6 * scale).all()
    np.testing.assert_allclose(other.solution.covariance / np.outer(scale, scale),
                               once.solution.covariance / np.outer(scale, scale), rtol=0, atol=1e-10)  # fmt: skip
    assert other.solution.chi2 == pytest.approx(once.solution.chi2, rel=1e-12)


def test_each_row_is_read_once_and_a_block_at_a_time(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The work: the sample, the stretch for correlation, and one pass in blocks."""
    asked: list[tuple[tuple[int, int], ...]] = []
    read = SurveyRows.survey

    def counted(self: SurveyRows, *places: tuple[int, int]) -> Any:
        asked.append(places)
        return read(self, *places)

    monkeypatch.setattr(SurveyRows, "survey", counted)
    model = read_machine(FIVE)
    fit = fit_rows(model, open_rows(whole, model), sizing=SMALL)
    sizes = [sum(b - a for a, b in places) for places in asked]
    assert fit.streamed is not None
    assert fit.streamed.passes == 1
    assert sizes == [900, *([450, 450, 100] * 6), 4000]


def test_rows_outside_the_sample_may_tell_parameters_apart(tmp_path: Path) -> None:
    """A joint that moves in a few rows only, which no stretch of the sample holds."""
    model, n = read_machine(MILL), 4000
    commands = simulate(MILL, n, seed=2)[["X", "Y", "Z"]]
    commands["Z"] = np.where(np.arange(n) // 5 == 137, commands["Z"], 100.0)
    own = simulate(MILL, commands, ERRORS[MILL], noise=NOISE, seed=2)
    fit = fit_rows(model, open_rows(own, model), sizing=Sizing(sample=512, segment=1000, block=500))
    usual = fit_machine(model, read_survey(own, model))
    places = set(range(685, 690))
    assert not places & set(fit.survey.table["row"] - 1)
    assert fit.solution.groups.base.tolist() == usual.solution.groups.base.tolist()
    assert apart(usual, fit) < 0.01 * NOISE


REFUSED: dict[str, tuple[Any, str]] = {
    "orientations": (lambda own: own.assign(mrx=0.0, mry=0.0, mrz=0.0), "mrx mry mrz"),
    "error motions": (lambda own: own.assign(joint=np.where(np.arange(len(own)) == 7, "X", ""), dx=0.0), "row 8"),
    "one sigma": (lambda own: own.assign(sigma=np.where(np.arange(len(own)) < 300, 0.002, np.nan)), "sigma"),
    "no number": (lambda own: own.astype({"mx": object}).assign(mx=[*own["mx"][:-1], "?"]), "row 600, column mx"),
    "wild": (lambda own: own.assign(mx=own["mx"] + 500.0 * (np.arange(len(own)) == 401)), "402"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_streamed_is_refused(name: str) -> None:
    change, words = REFUSED[name]
    model = read_machine(MILL)
    with pytest.raises(InputError, match=words):
        fit_rows(model, open_rows(change(table(MILL, 600)), model), sizing=Sizing(sample=256, segment=400, block=150))


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("{effect: backlash, joint: X}", "dir_X"),
        ("{effect: scale-expansion, joint: X, sensor: T_bed}", "smoothed temperature"),
    ],
)
def test_effects_that_follow_from_the_course_of_the_rows_are_refused(effect: str, words: str, tmp_path: Path) -> None:
    text = (Path(read_machine(MILL).source or "")).read_text()
    path = tmp_path / "machine.yaml"
    path.write_text(f"{text}\neffects:\n  - {effect}\n")
    model = read_machine(path)
    own = table(MILL, 300).assign(T_bed=20.0 + np.arange(300) / 100, time=np.arange(300) * 60.0)
    with pytest.raises(InputError, match=words):
        open_rows(own, model)
    if "dir_X" in words:
        own = own.assign(dir_X=np.random.default_rng(0).choice([-1.0, 1.0], 300))
        agree(_usual(model, own), _streamed(model, own))


def _usual(model: Any, own: pd.DataFrame) -> Fit:
    return fit_machine(model, read_survey(own, model))


def _streamed(model: Any, own: pd.DataFrame) -> Fit:
    return fit_rows(model, open_rows(own, model))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.long
def test_the_commands(folder: Path) -> None:
    done("simulate", MILL, 700, "--stream", "--noise", 0.002, "--out", "rows.parquet")
    text = done("fit", MILL, "rows.parquet", "--stream", "--residuals", "--out", "s").out
    assert "700 rows in" in text
    assert "rows a second" in text
    done("fit", MILL, "rows.parquet", "--out", "u")
    left, right = pd.read_parquet("s/residuals.parquet"), pd.read_csv("u/residuals.csv")
    for name in ("nominal", "residual", "heldout"):
        columns = [f"{name}_{axis}_um" for axis in "xyz"]
        # um; those of the blocks left out lack the second order of a small step
        np.testing.assert_allclose(left[columns], right[columns], atol=1e-4 if name == "heldout" else 1e-7)
    done("predict", "s", "rows.parquet", "--stream", "--out", "p.parquet")
    done("predict", "s", "rows.parquet", "--out", "p.csv")
    ours, theirs = pd.read_parquet("p.parquet"), pd.read_csv("p.csv")
    assert list(ours) == list(theirs)
    numbers = list(theirs.select_dtypes("float"))
    assert {"mx", "ex", "ux"} <= set(numbers)
    np.testing.assert_allclose(ours[numbers], theirs[numbers], rtol=1e-12, atol=1e-12)
    assert run("verify", "s").code == 0
    assert run("rerun", "s").code == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--stream", "--robust"], "--robust with --stream"),
        (["--stream", "--bayes"], "--bayes with --stream"),
        (["--stream", "--dwells"], "--dwells with --stream"),
        (["--residuals"], "without --stream"),
        (["--workers", "2"], "without --stream"),
    ],
)
def test_options_that_do_not_go_together(folder: Path, options: list[str], words: str) -> None:
    table(MILL, 60).to_csv("a.csv", index=False)
    result = run("fit", MILL, "a.csv", "--out", "o", *options)
    assert result.code == 2
    assert words in result.err
    assert not (folder / "o").exists()


def test_streams_are_written_as_parquet(folder: Path) -> None:
    assert "no Parquet file" in run("simulate", MILL, 10, "--stream", "--out", "a.csv").err
    done("simulate", MILL, 40, "--stream", "--out", "a.parquet", "--seed", 5)
    first = (folder / "a.parquet").read_bytes()
    done("simulate", MILL, 40, "--stream", "--out", "a.parquet", "--seed", 5)
    assert (folder / "a.parquet").read_bytes() == first


@pytest.mark.parametrize("stream", [True, False])
def test_an_empty_part_is_left_out_and_said(stream: bool, tmp_path: Path) -> None:
    whole = table(MILL, 80)
    whole.to_csv(tmp_path / "a.csv", index=False)
    whole.iloc[:0].to_csv(tmp_path / "b.csv", index=False)
    model = read_machine(MILL)
    survey = fit_rows(model, open_rows(tmp_path, model)).survey if stream else read_survey(tmp_path, model)
    assert len(survey) == 80
    assert any("b.csv has no rows below its header, and is left out" in note for note in survey.notes)
    (tmp_path / "a.csv").unlink()
    with pytest.raises(InputError, match="no rows below the header"):
        open_rows(tmp_path, model)


def test_rows_in_another_unit_are_named_and_no_advice_is_what_a_stream_refuses(tmp_path: Path) -> None:
    one, other = table(MILL, 120), table(MILL, 120, seed=2)
    lengths = ["X", "Y", "Z", "mx", "my", "mz"]
    inch = pd.concat([one, other.assign(**{c: other[c] / 25.4 for c in lengths})])
    moved = pd.concat([one, table(MILL, 120, seed=2, frame=900.0)])
    for k, (rows, words) in enumerate(((inch, "as if in inch where these are in mm"), (moved, "frame: per-file"))):
        rows.to_csv(tmp_path / f"{k}.csv", index=False)
        result = run("fit", MILL, tmp_path / f"{k}.csv", "--stream", "--out", tmp_path / "out")
        assert result.code == 2
        assert words in result.err
        assert "per-run" not in result.err
