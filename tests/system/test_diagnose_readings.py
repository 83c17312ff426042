"""Diagnosis of lengths and angles: linear model, names from circles and stations, outliers, repeats, what is unseen.

The readings are made by a simulation that shares no code with the product.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import effects
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.observations import registry
from errormodel.observations.base import Observation
from errormodel.simulation_readings import readings_at
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.diagnosis.decisions.constants import ABSORBED
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.linear.row_residuals import METRE, noise_mm, spread, vectors
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.diagnosed import Diagnosed
from identification.diagnosis.results.pure_error import repeats_of
from identification.diagnosis.results.verdict import judge
from identification.diagnosis.search.candidates import Candidates
from identification.estimation.fit import fit_machine
from identification.observation.assembly import build
from identification.observation.normal_equations import design_rows
from tests.benchmarks import length_diagnosis as benchmark
from tests.helpers.circles import as_survey, circles, trace
from tests.helpers.commands import done
from tests.helpers.lengths import commands, survey, tips, truth
from tests.helpers.nightly import first_of

MACHINE = read_machine("vertical_three_axis")
KINDS = registry()
# the driver is a position, a side of arrival, a place of the tool, and two channels at once
EFFECTS = {
    "X by its side": EffectSpec("backlash", {"joint": "X"}),
    "Y by its position": EffectSpec("pitch-cyclic", {"joint": "Y", "period": 37.0}),
    "Z by X": EffectSpec("unnamed", {"element": "Z", "motion": "ea", "driver": "X", "half_range": 380.0}),
}


def read(word: str, rows: int = 80) -> tuple[Observation, pd.DataFrame]:
    """Readings of an observation's example at random poses of a machine with random errors, with noise."""
    rng = np.random.default_rng(4)
    observation = KINDS[word](type=word, **KINDS[word].example)
    table = commands(MACHINE, rows, rng)
    if observation.poses > 1:
        table = table.join(commands(MACHINE, rows, rng).add_prefix("from_"))
        table["from_dir_X"] = rng.choice([-1.0, 1.0], rows)  # else the side of the second pose holds for both
    table = table.assign(
        observation="A", run="1", **dict(zip(("tool_x", "tool_y", "tool_z"), MACHINE.tool, strict=True))
    )
    exact = readings_at(Chain(MACHINE), table, {"A": observation}, Truth(truth(MACHINE, rng)))[observation.reading]
    return observation, table.assign(**{observation.reading: exact + 1e-4 * rng.standard_normal(rows)})


@pytest.mark.parametrize("what", first_of(EFFECTS))
@pytest.mark.parametrize("word", KINDS)
def test_columns_are_those_of_the_effect_in_the_machine(word: str, what: str) -> None:
    """A candidate's columns, through the gradient of the reading, are rows of M of that effect in machine.yaml."""
    observation, table = read(word)
    data = survey(MACHINE, table, {"A": observation})
    fit, spec = fit_machine(MACHINE, data), EFFECTS[what]
    linear = set_up(fit)
    columns, _ = linear.columns(effects.make(spec))
    extended = build(Chain(replace(MACHINE, effects=(spec,))), data)
    (view,) = extended.readings
    names = extended.chain.effect_ids[0]
    rows = design_rows(view, {name: k for k, name in enumerate(names)}, most=len(view)) / fit.solution.sigma[word]
    live = np.isin(np.arange(len(table)), linear.index)  # rows that depend on nothing are no observations
    assert not rows[~live].any()
    # the levers are linearised where the set-up starts, as M is: rounding only
    np.testing.assert_allclose(columns[:, : live.sum()].T, rows[live], atol=1e-9 * max(np.abs(rows).max(), 1.0))
    assert len(columns) == len(names)


def test_both_poses_of_a_ball_bar_act() -> None:
    """Opposite sides of arrival at the two poses double what backlash does to the length; equal ones leave nothing."""
    observation, table = read("pose-distance")
    table = table.assign(dir_X=1.0, from_dir_X=np.where(np.arange(len(table)) % 2, 1.0, -1.0))
    linear = set_up(fit_machine(MACHINE, survey(MACHINE, table, {"A": observation})))
    (column,), _ = linear.columns(effects.make(EFFECTS["X by its side"]))
    assert np.abs(column[1::2]).max() < 1e-9 * np.abs(column).max()
    assert np.median(np.abs(column[::2])) > 0.1 * np.abs(column).max()


@lru_cache
def circled(play: float, seed: int = 1) -> Diagnosed:
    """The diagnosis of ballbar circles with backlash of X (mm) and a squareness of X to Y."""
    rng = np.random.default_rng(seed)
    values = {**truth(MACHINE, rng), "saddle.ec": 60e-6}
    return diagnose(MACHINE, as_survey(MACHINE, circles(MACHINE, values, rng, {"X": play} if play else {})))


def test_circles_name_backlash_of_the_right_joint() -> None:
    found = circled(0.008)
    (finding,) = found.diagnosis.findings
    assert (finding.effect, finding.where) == ("backlash", "X")
    assert found.diagnosis.verdict == "explained"
    assert abs(finding.parameters[0].value) == pytest.approx(0.008, abs=4 * finding.parameters[0].std)
    # half of it at the tip in every row, less its mean: the two sides are not equally often
    assert 0.9 * 4.0 < finding.size_um <= 4.1
    # the noise is the bar's, and what circles XY and ZX lose by the finding YZ never had
    assert found.diagnosis.noise_um == pytest.approx(0.3, rel=0.1)
    assert not found.diagnosis.points
    by = {r.observation: r for r in found.diagnosis.readings}
    assert all(by[o].heldout_before > 5 * by[o].heldout_after for o in ("XY", "ZX"))
    assert by["YZ"].heldout_before < 1.5 * by["YZ"].heldout_after
    assert all(r.n == 360 and r.after < 1.2 * r.noise for r in by.values())


def test_circles_leave_squareness_to_the_parameters_and_find_nothing_in_a_sound_machine() -> None:
    """An ellipse at 45 degrees is no physics that was left out: it is a parameter, and the verdict is adequate."""
    found = circled(0.0)
    assert found.diagnosis.verdict == "adequate"
    assert not found.diagnosis.findings
    s = found.final.solution
    groups = {s.unknowns[j]: s.groups.members(k) for k, j in enumerate(s.groups.base)}
    (own,) = [m for m in groups.values() if "saddle.ec" in m]
    rng = np.random.default_rng(1)
    values = {**truth(MACHINE, rng), "saddle.ec": 60e-6}
    k = list(groups.values()).index(own)
    true = sum(c * values.get(n, 0.0) for n, c in own.items())
    base = s.unknowns[s.groups.base[k]]
    assert s.named()[base] == pytest.approx(true, abs=5 * float(np.sqrt(s.covariance[k, k])))
    assert abs(true) > 10 * float(np.sqrt(s.covariance[k, k]))


def test_what_one_plane_cannot_see_is_untestable() -> None:
    rng = np.random.default_rng(3)
    table = circles(MACHINE, truth(MACHINE, rng), rng)
    flat = as_survey(MACHINE, table[table["plane"] == "XY"])
    one = replace(flat, observations={"XY": flat.observations["XY"]})
    found = diagnose(MACHINE, one).diagnosis
    assert found.verdict == "adequate"
    reasons = {u.effect: u.reason for u in found.untestable}
    # in a circle x^n sin(a), a bow of X, is what x^(n-1) y cos(a) is, a turn of X; the model has bows of degree 2
    assert any(u.reason.startswith("of degree 3: ") and "EYX" in u.reason for u in found.untestable)
    assert reasons["backlash"] == "at Z: Z always arrived from the same side"  # that of X and Y is shown
    assert "Z did not move" in reasons["pitch-cyclic"]
    # all that acts across the plane changes no length
    linear = set_up(fit_machine(MACHINE, one))
    tried = Candidates.of(linear)
    seen = {(e.where, getattr(e, "motion", "")) for e in tried.effects if e.effect == "unnamed"}
    assert ("X", "dz") not in seen
    assert ("X", "dy") in seen
    assert (tried.scores(linear).absorbed < ABSORBED).any()


@pytest.mark.parametrize("kind", first_of(sorted(benchmark.KINDS, key=lambda kind: kind != "three stations")))
def test_a_hidden_effect_is_named_and_nothing_is_seen_where_nothing_is(kind: str) -> None:
    """One survey of each kind of the benchmark, with one effect and without."""
    assert benchmark.run(kind, 0, empty=True)[1] == "adequate"
    hidden, found, probability = benchmark.run(kind, 0, empty=False)
    assert found == hidden
    assert probability > 0.7  # likely: neighbours of an effect that the geometry hides the most of are not ruled out


def test_gross_rows_of_lengths_are_left_out_each_in_the_noise_of_its_own() -> None:
    """A wrong reading of the fine instrument is far below the noise of the coarse one beside it."""
    rng = np.random.default_rng(5)
    data = benchmark.mixed(rng, None)
    table = data.table.copy()
    lengths = np.flatnonzero(table["observation"] == "A")
    wrong = lengths[[7, 70]]
    table.loc[wrong, "length"] += [0.011, -0.013]  # 20 of the interferometer's noise, 2 of the tracker's
    found = diagnose(MACHINE, replace(data, table=table)).diagnosis
    assert [f.effect for f in found.findings] == ["outliers"]
    assert found.findings[0].rows == table["row"][wrong].tolist()
    assert found.findings[0].size_um == pytest.approx(12, abs=1)  # of 11 and 13, root mean square
    assert found.noise_um == pytest.approx(1e3 * benchmark.POINTS, rel=0.15)
    (own,) = found.readings
    assert own.noise == pytest.approx(1e3 * benchmark.NOISE, rel=0.3)


def test_repeats_of_readings_are_of_one_observation_each() -> None:
    """Poses read from four stations are no repeats; the same poses read again are, in the noise of a length."""
    rng = np.random.default_rng(6)
    once = benchmark.stations(rng, None, 4)
    assert repeats_of(fit_machine(MACHINE, once)) == ()
    repeats = repeats_of(fit_machine(MACHINE, _twice(once, rng)))
    assert [(r.observation, r.poses, r.count) for r in repeats] == [(a, 160, 160) for a in once.observations]
    for own in repeats:
        assert own.sigma_um == pytest.approx(3.0, rel=0.2)
        assert not own.misfit
        assert f"one reading of {own.observation} repeats" in own.text


def test_repeats_of_an_observation_are_compared_with_its_own_residuals() -> None:
    """One station of four has errors that repeat: its type's noise is estimated with them, and the others are right."""
    rng = np.random.default_rng(6)
    data = benchmark.stations(rng, None, 4)
    wrong = data.table["observation"].to_numpy() == "B"
    data.table.loc[wrong, "length"] += 0.012 * np.sin(data.table.loc[wrong, "X"] / 3.0)
    log = DecisionLog()
    verdict = judge(fit_machine(MACHINE, _twice(data, rng)), True, log=log)
    assert verdict.word == "partly-explained"
    assert "um rms of B where repeated poses let expect 3." in (verdict.unexplained or "")
    assert "of A where" not in (verdict.unexplained or "")
    told = {d.where: d.outcome for d in log if d.rule == "lack-of-fit-by-repeats"}
    assert told["residuals of B"] == "found"


def _twice(data: Survey, rng: np.random.Generator) -> Survey:
    twice = pd.concat([data.table, data.table], ignore_index=True)
    twice["length"] += rng.normal(0, 3e-3, len(twice))
    twice["row"] = np.arange(1, len(twice) + 1)
    return replace(data, table=twice)


def test_sizes_of_mixed_rows_are_distances_and_lengths_and_angles_alone_count_at_a_metre() -> None:
    data = benchmark.mixed(np.random.default_rng(7), None)
    fit = fit_machine(MACHINE, data)
    sizes = vectors(fit)
    assert sizes.shape == (len(data), 4)
    points = (data.table["observation"] == "").to_numpy() | data.table["observation"].isna().to_numpy()
    assert np.isnan(sizes[~points, :3]).all()
    assert np.isnan(sizes[points, 3]).all()
    square = np.nansum(sizes**2, axis=1)
    assert spread(fit).rms_um == pytest.approx(1e3 * np.sqrt(square.mean()))
    observation, table = read("precision-level", 120)
    angles = fit_machine(MACHINE, survey(MACHINE, table, {"A": observation}))
    assert noise_mm(angles) == pytest.approx(METRE * angles.solution.sigma["precision-level"])
    assert spread(angles).rms_um == pytest.approx(1e6 * np.sqrt(np.nanmean(angles.readings.fitted**2)))  # type: ignore[union-attr]


def test_lengths_in_another_unit_are_refused() -> None:
    data = benchmark.stations(np.random.default_rng(8), None, 4)
    with pytest.raises(InputError, match="fit a station nowhere"):
        diagnose(MACHINE, replace(data, table=data.table.assign(length=data.table["length"] / 1000)))


@pytest.mark.long
def test_traces_are_imported_and_diagnosed(tmp_path: Path) -> None:
    """Three raw traces become a survey with the direction of travel, and the report names the backlash."""
    rng = np.random.default_rng(1)
    table = circles(MACHINE, truth(MACHINE, rng), rng, {"Y": 0.006})
    for plane, part in table.groupby("plane"):
        (tmp_path / f"{plane}.csv").write_text(trace(part, str(plane)))
    files = [tmp_path / f"{p}.csv" for p in ("XY", "YZ", "ZX")]
    place = "X=0,Y=0,Z=375"
    said = done("import", *files, "--machine", "vertical_three_axis", "--centre", place, "--out", tmp_path / "s").out
    assert "observation XY, a circle of 150 mm in XY, both ways" in said
    printed = done("diagnose", "vertical_three_axis", tmp_path / "s", "--out", tmp_path / "d").out
    assert "Backlash of Y by 6.0 um" in printed
    assert "noise of one reading" in printed
    stored = json.loads((tmp_path / "d/diagnosis.json").read_text())
    assert [(f["effect"], f["where"]) for f in stored["findings"]] == [("backlash", "Y")]
    assert [r["observation"] for r in stored["readings"]] == ["XY", "YZ", "ZX"]
    assert "Backlash" in (tmp_path / "d/report.html").read_text()


def test_tips_of_the_helper_are_the_products(tmp_path: Path) -> None:
    """The circles are where the product's own chain has them, without errors."""
    table = circles(MACHINE, {}, np.random.default_rng(2), noise=0.0)
    chain = Chain(MACHINE)
    full = table.assign(**dict(zip(("tool_x", "tool_y", "tool_z"), MACHINE.tool, strict=True)))
    own = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(full)).T
    np.testing.assert_allclose(tips(MACHINE, {}, table), own, atol=1e-9)
