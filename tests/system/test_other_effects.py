"""What a recording leaves open of an effect: hours later what is predicted is as uncertain as it is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.effects import make
from errormodel.effects.base import NOT_SETTLED
from errormodel.instruments.plain import Plain
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey, read_survey
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.search.candidates import score_of
from identification.diagnosis.search.other_lags import _of_departures
from identification.estimation.fit import fit_machine, parameters_of
from identification.results import store
from identification.results.predictions import predicted
from identification.results.stored_fit import StoredFit
from identification.uncertainty.other_effects import OtherEffect, unrecorded, without_times
from identification.uncertainty.prediction import notes
from tests.helpers.commands import MILL, XYZ, done, run
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of

WAVE = {"joint": "X", "motion": "dz", "every": 200.0}
UNCERTAINTY = ["ux", "uy", "uz"]


def test_a_warm_up_goes_on_after_the_recording_or_stays_as_it_was(tmp_path: Path) -> None:
    """It may be by a temperature that nobody recorded: the mean of both is predicted, and says so."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=False, grid=False)
    survey = replace(survey, table=survey.table.assign(time=np.linspace(0, 14400, len(survey))))
    spec = EffectSpec("warm-up", {"element": "column", "motion": "dy", "tau": 9000.0})
    whole = showing(survey, machine, [(spec, [0.05])], 0.002)
    first, later = (replace(whole, table=part) for part in (whole.table.head(250), whole.table.tail(150).reset_index()))
    diagnosed = diagnose(machine, first)
    assert [f.effect for f in diagnosed.diagnosis.findings] == ["warm-up"]
    store.save(diagnosed.final, tmp_path)
    fit = store.load(tmp_path)
    end = float(first.table["time"].max())
    (ends,) = (other for other in fit.others if "ends" in other.options)
    assert ends.options["ends"] == end

    def of(*others: OtherEffect, points: Survey = later) -> Array:
        return np.asarray(predicted(replace(fit, others=others), points)[[*XYZ, *UNCERTAINTY]])

    goes_on, stays, both = of(), of(replace(ends, weight=1.0)), of(ends)
    change = stays[:, :3] - goes_on[:, :3]
    assert np.abs(change).max() > 0.003
    assert both[:, :3] == pytest.approx(goes_on[:, :3] + change / 2)
    assert both[:, 3:] == pytest.approx(np.hypot(goes_on[:, 3:], change / 2))
    assert of(ends, points=first) == pytest.approx(of(points=first))
    said = [note for note in notes(fit, later) if "nobody recorded" in note]
    assert len(said) == 1
    assert "what warms" in said[0]
    assert not [note for note in notes(fit, first) if "nobody recorded" in note]


@pytest.mark.long
@pytest.mark.parametrize(("tau", "hours", "known"), first_of([(8000.0, 0.5, False), (1000.0, 4.0, True)]))
def test_later_than_the_recording(tau: float, hours: float, known: bool, tmp_path: Path) -> None:
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 500, 5, channels=False, grid=False)
    time = np.concatenate([np.linspace(0, 3600 * hours, 400), 3600 * np.linspace(hours, 12, 100)])
    bed = 20 + 8 * (1 - np.exp(-time / 900))
    survey = replace(survey, table=survey.table.assign(time=time, T_bed=bed))
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "dy", "sensor": "T_bed", "tau": tau})
    whole = showing(survey, machine, [(spec, [0.008])], 0.002)
    parts = (whole.table.head(400), whole.table.tail(100).reset_index(drop=True))
    first, later = (replace(whole, table=part) for part in parts)
    diagnosed = diagnose(machine, first)
    assert [f.effect for f in diagnosed.diagnosis.findings] == ["structure-drift"]
    store.save(diagnosed.final, tmp_path)
    fit = store.load(tmp_path)
    out, without = predicted(fit, later), predicted(replace(fit, others=()), later)
    error, u, less = (
        np.sqrt(np.square(v).mean()) for v in (out[XYZ] - later.table[XYZ], out[UNCERTAINTY], without[UNCERTAINTY])
    )
    assert (u["uy"] < less["uy"] + 0.001) == known
    assert error["my"] > 0.01 or known  # mm: the recording does not show where it ends
    assert error["my"] < 2 * u["uy"] + 0.002
    assert u["uy"] < 0.12


@pytest.mark.long
def test_a_member_that_was_behind_in_the_first_row(tmp_path: Path) -> None:
    """Where a recording does not show whether its lag began in equilibrium, later uncertainties have both."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 800, 5, channels=False, grid=False)
    time = np.linspace(-3600, 21600, 800)
    warm = 8 * (1 - np.exp(-(time + 3600) / 2400))
    bed = 20 + warm * np.exp(-np.maximum(time - 7200, 0) / 2400)  # on for three hours: the recording has the last two
    survey = replace(survey, table=survey.table.assign(time=time, T_bed=bed))
    spec = EffectSpec("scale-expansion", {"joint": "X", "sensor": "T_bed", "tau": 3600.0})
    whole = showing(survey, machine, [(spec, [5e-6])], 0.003)
    first, later = (
        replace(whole, table=whole.table[rows].reset_index(drop=True))
        for rows in ((time >= 0) & (time < 7200), time >= 7200)
    )
    diagnosed = diagnose(machine, first)
    assert [f.effect for f in diagnosed.diagnosis.findings] == ["scale-expansion"]
    store.save(diagnosed.final, tmp_path)
    fit = store.load(tmp_path)
    assert fit.others == diagnosed.final.others
    assert any(other.options.get("initial", 0.0) < -1.0 and other.options["tau"] > 1200 for other in fit.others)
    settled = replace(fit, others=tuple(other for other in fit.others if "initial" not in other.options))
    ratios = []
    for own in (fit, settled):
        out = predicted(own, later)
        ratios.append(np.sqrt(np.square(out["mx"] - later.table["mx"]).mean() / np.square(out["ux"]).mean()))
    # of one recording; what else explains it, a warm-up of 1 %, is no longer likely enough to be among them
    assert ratios[0] < 2.1 < ratios[1]


@pytest.mark.long
def test_sensors_that_warmed_alike(tmp_path: Path) -> None:
    """Which of two sensors is the cause the recording does not show: it is said, and later uncertainties have both."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 500, 5, channels=False, grid=False)
    rng = np.random.default_rng(3)
    time = np.linspace(0, 14400, 500)
    bed = 6 * (1 - np.exp(-time / 2400))  # both warm up alike, and one cools afterwards
    column = 0.7 * bed * np.exp(-np.maximum(time - 9600, 0) / 1800)
    sensors = {"T_bed": 20 + bed, "T_column": 21 + column, "T_hall": 20 + 0.3 * np.sin(time / 1000)}
    noisy = {name: values + rng.normal(0, 0.05, 500) for name, values in sensors.items()}
    survey = replace(survey, table=survey.table.assign(time=time, **noisy))
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "dy", "sensor": "T_bed", "tau": 900.0})
    whole = showing(survey, machine, [(spec, [0.006])], 0.003)
    first, later = (
        replace(whole, table=whole.table[rows].reset_index(drop=True)) for rows in (time < 9600, time >= 9600)
    )
    diagnosed = diagnose(machine, first)
    (finding,) = diagnosed.diagnosis.findings
    assert finding.effect == "structure-drift"
    ((own,),) = (finding.driver,)
    (other,) = {"T_bed", "T_column"} - {own}
    assert f"It may as well follow {other} (probability 0." in finding.statement
    # other members, that do not move against this one, are listed with the likelier sensor only
    same = [a.driver for a in finding.alternatives if (a.effect, a.where) == (finding.effect, finding.where)]
    assert same == [[other]]
    store.save(diagnosed.final, tmp_path)
    fit = store.load(tmp_path)
    assert fit.others == diagnosed.final.others
    out = predicted(fit, later)
    by_one = replace(fit, others=tuple(o for o in fit.others if "sensor" not in o.options))
    sure = predicted(by_one, later)
    error = (out["my"] - later.table["my"]).abs().to_numpy()
    # whichever is chosen, the uncertainty has the other: where the column has cooled by two thirds, the bed has not
    parted = later.table["time"].to_numpy() > 9600 + 1800
    assert (out["uy"] > 2 * sure["uy"])[parted].mean() > 0.95
    assert (error < 2 * out["uy"] + 0.006).mean() > 0.95
    assert (error < 2 * out["uy"] + 0.006)[parted].mean() > (error < 2 * sure["uy"] + 0.006)[parted].mean()
    without = replace(later, table=later.table.drop(columns=other))
    assert f"structure-drift of {finding.where} acts by {other}, which is not in all rows" in " ".join(
        notes(fit, without)
    )
    # of the same rows: what is left open of expansions is the mean over the temperatures that they have
    assert predicted(fit, without)["uy"].to_numpy() == pytest.approx(predicted(by_one, without)["uy"].to_numpy())


@pytest.mark.parametrize("motion", ["dy", "all"])
def test_departures_have_the_evidence_of_their_effects(motion: str) -> None:
    """All departures at once, as the columns are linear in them, and each as an effect of its own."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 150, 5, channels=False, grid=False)
    time = np.linspace(0, 7200, 150)
    survey = replace(survey, table=survey.table.assign(time=time, T_bed=20 + 4 * (1 - np.exp(-time / 1500))))
    linear = set_up(fit_machine(machine, showing(survey, machine, [], 0.003)))
    effect = make(EffectSpec("structure-drift", {"element": "column", "motion": motion, "sensor": "T_bed"}))
    initial = np.array([-2.0, 0.0, 3.0])
    scores = [score_of(linear, effect.model_copy(update={"tau": 900.0, "initial": k})) for k in initial.tolist()]
    expected = [s[0] + NOT_SETTLED * bool(k) for s, k in zip(scores, initial, strict=True) if s is not None]
    assert _of_departures(linear, effect, 900.0, initial) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_machine_without_the_effect_is_refused(tmp_path: Path) -> None:
    """A folder whose machine was edited: said, and no traceback."""
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    path = tmp_path / "fit/fit.json"
    other = {"effect": 0, "options": {"tau": 900.0}, "weight": 0.5, "parameters": {}}
    data = json.loads(path.read_text(encoding="utf-8")) | {"other_effects": [other]}
    path.write_text(json.dumps(data), encoding="utf-8")
    result = run("predict", tmp_path / "fit", tmp_path / "s.csv", "--out", tmp_path / "out.csv")
    assert result.code == 2
    assert "key other_effects: the effect number 1, which the machine does not have" in result.err


@pytest.mark.long
def test_a_time_constant_has_an_uncertainty() -> None:
    """It is off by as much as is stated: the sum of squares of four lies within 99 % of chi-squared."""
    machine, tau = read_machine("vertical_three_axis"), 1500.0
    survey = empty_survey(machine, 200, 5, channels=False, grid=False)
    time = np.linspace(0, 7200, 200)
    survey = replace(survey, table=survey.table.assign(time=time, T_bed=20 + 3 * np.sin(time / 900)))
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "dy", "sensor": "T_bed", "tau": tau})
    off = []
    for seed in range(4):
        found = diagnose(machine, showing(survey, machine, [(spec, [0.006])], 0.003, seed)).diagnosis.findings
        assert [f.effect for f in found] == ["structure-drift"]
        (amount,) = found[0].time_constants
        assert amount.unit == "s"
        off.append((amount.value - tau) / amount.std)
    assert 0.207 < np.sum(np.square(off)) < 14.86


@pytest.mark.long
def test_places_that_the_recording_does_not_tell_apart(tmp_path: Path) -> None:
    """Members that do not turn against each other: all are fitted, and predictions are those of all of them."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 400, 5, channels=False, grid=False)
    time = np.linspace(0, 14400, 400)
    bed = 20 + 3 * np.sin(time / 1500)
    survey = replace(survey, table=survey.table.assign(time=time, T_bed=bed))
    spec = EffectSpec("structure-drift", {"element": "column", "motion": "dy", "sensor": "T_bed", "tau": 900.0})
    diagnosed = diagnose(machine, showing(survey, machine, [(spec, [0.006])], 0.002))
    (finding,) = diagnosed.diagnosis.findings
    others = {o.options.get("element"): o.weight for o in diagnosed.final.others if o.name == "structure-drift"}
    elsewhere = {a.where: a.place_probability for a in finding.alternatives if a.effect == "structure-drift"}
    assert len(others) >= 2
    assert others == pytest.approx({p: finding.probability * elsewhere[p] for p in others}, rel=0.1)
    assert "Its place may also be" in finding.statement
    store.save(diagnosed.final, tmp_path)
    fit = store.load(tmp_path)
    assert fit.others == diagnosed.final.others
    out, likeliest = predicted(fit, survey), predicted(replace(fit, others=()), survey)
    # where nothing turns they are the same
    assert out[XYZ].to_numpy() == pytest.approx(likeliest[XYZ].to_numpy(), abs=5e-4)


def test_another_effect_in_its_place(tmp_path: Path) -> None:
    """The mean of two curves through the same levels, and their spread in the uncertainty."""
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    machine = replace(read_machine(MILL), effects=(EffectSpec("higher-order-geometry", WAVE),))
    fit = fit_machine(machine, read_survey(tmp_path / "s.csv", machine))
    dent = {"joint": "X", "motion": "dz", "at": 0.0, "width": 100.0}
    trial = OtherEffect(0, dent, 0.25, {}, "local-defect")
    values = parameters_of(trial.machine(machine), fit)
    store.save(replace(fit, others=(replace(trial, parameters=values),)), tmp_path / "fit")
    stored, points = store.load(tmp_path / "fit"), fit.survey
    alone = replace(stored, others=())
    out, own, other = (predicted(f, points) for f in (stored, alone, alone.with_effect(stored.others[0])))
    assert out[XYZ].to_numpy() == pytest.approx((0.75 * own[XYZ] + 0.25 * other[XYZ]).to_numpy())
    between = 0.75 * 0.25 * np.square((other[XYZ] - own[XYZ]).to_numpy())
    assert np.square(out[UNCERTAINTY].to_numpy()) == pytest.approx(np.square(own[UNCERTAINTY].to_numpy()) + between)
    assert between.max() > 0


def test_the_mean_of_models_where_the_side_is_unknown(tmp_path: Path) -> None:
    """Both sides are of the likeliest model, and what others change is added to their middle, in full."""
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    effects = (EffectSpec("higher-order-geometry", WAVE), EffectSpec("backlash", {"joint": "X"}))
    machine = replace(read_machine(MILL), effects=effects)
    fit = fit_machine(machine, read_survey(tmp_path / "s.csv", machine))
    trial = OtherEffect(0, {"joint": "X", "motion": "dz", "at": 0.0, "width": 100.0}, 0.25, {}, "local-defect")
    values = fit.solution.named() | {n: 0.01 for n in Chain(trial.machine(machine)).ids if "local-defect" in n}
    store.save(replace(fit, others=(replace(trial, parameters=values),)), tmp_path / "fit")
    stored = store.load(tmp_path / "fit")
    alone = replace(stored, others=())
    points = replace(fit.survey, table=fit.survey.table.drop(columns="dir_X", errors="ignore").head(1))
    out, own, other = (predicted(f, points) for f in (stored, alone, alone.with_effect(stored.others[0])))
    assert out[XYZ].to_numpy() == pytest.approx((0.75 * own[XYZ] + 0.25 * other[XYZ]).to_numpy(), abs=1e-9)


def test_a_lag_that_is_possible_is_named_as_that() -> None:
    """Without the column time: no effect of the time is meant, but that of a temperature, later."""
    machine = read_machine("vertical_three_axis")
    own = EffectSpec("structure-drift", {"element": "column", "motion": "dy", "sensor": "T_bed"})
    machine = replace(machine, effects=(own,))
    others = [OtherEffect(0, {"tau": tau}, weight, {}) for tau, weight in ((42.0, 0.5), (900.0, 0.16))]
    states = pd.DataFrame({"T_bed": [21.0, 22.0]})
    (note,) = without_times(others, machine, states)
    assert note.startswith("with a probability of 0.66 structure-drift of column acts late (likeliest: by 42 s), and")
    assert "Add the column time" in note
    moved = OtherEffect(0, {"tau": 70.0, "initial": -1.0}, 0.6, {})  # independent of the time constants of the first
    (both,) = without_times([*others, moved], machine, states)
    assert both.startswith("with a probability of 0.86 structure-drift of column acts late")
    sure = replace(machine, effects=(EffectSpec(own.effect, {**own.options, "tau": 60.0}),))
    (note,) = without_times([*others, moved], sure, states)
    assert note.startswith("structure-drift of column acts late (by 60 s), and the rows have no times")
    assert not list(unrecorded(others, machine, states))
    assert not list(without_times(others, machine, states.assign(time=[0.0, 60.0])))
    assert not list(without_times([OtherEffect(0, {"sensor": "T_air"}, 0.5, {})], machine, states))


@pytest.fixture
def perhaps_late(tmp_path: Path) -> StoredFit:
    """A fit in which the column may follow T_bed late, at once, or both: an effect, and one that is not among them."""
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    time = 60.0 * np.arange(60)
    table = pd.read_csv(tmp_path / "s.csv").assign(time=time, T_bed=20 + time / 900, T_air=20 + time / 1200)
    table.to_csv(tmp_path / "s.csv", index=False)
    column = {"element": "column", "motion": "dy", "sensor": "T_bed"}
    machine = replace(read_machine(MILL), effects=(EffectSpec("structure-drift", column),))
    fit = fit_machine(machine, read_survey(tmp_path / "s.csv", machine))
    further = column | {"motion": "dx", "sensor": "T_air", "tau": 600.0}
    trials = (OtherEffect(0, {"tau": 600.0}, 0.25, {}), OtherEffect(1, further, 0.25, {}, "structure-drift"))
    others = []
    for trial in trials:
        values = parameters_of(trial.machine(machine), fit)
        others.append(trial.fitted({n: 0.005 if "structure-drift" in n else v for n, v in values.items()}))
    store.save(replace(fit, others=tuple(others)), tmp_path / "fit")
    stored = store.load(tmp_path / "fit")
    return replace(stored, values={n: 0.005 if "structure-drift" in n else v for n, v in stored.values.items()})


def states(fit: StoredFit, warm: list[float], **columns: float | list[float]) -> Survey:
    """One pose of a machine at some temperatures."""
    table = random_points(fit.chain.machine, len(warm), 1)
    same = {n: table[n].iloc[0] for n in "XYZ"} | dict.fromkeys(XYZ, np.nan)
    table = table.assign(**same, T_bed=warm, T_air=warm, file="p.csv", run="1", row=range(1, len(warm) + 1), **columns)
    return Survey(table, "shared", (), Plain(), Path())


def test_what_may_act_late_is_in_equilibrium_where_rows_have_no_times(perhaps_late: StoredFit) -> None:
    """Also what was not found: it had been left out of the uncertainty."""
    warm = [20.0, 24.0]
    without, settled = (
        predicted(perhaps_late, states(perhaps_late, warm, **time)) for time in ({}, {"time": [7200.0, 7200.0]})
    )
    np.testing.assert_allclose(without[[*XYZ, *UNCERTAINTY]], settled[[*XYZ, *UNCERTAINTY]], atol=1e-12)
    for other in perhaps_late.others:
        rest = tuple(o for o in perhaps_late.others if o is not other)
        less = predicted(replace(perhaps_late, others=rest), states(perhaps_late, warm))
        axis = "uy" if other.effect == 0 else "ux"
        assert (without[axis] > less[axis]).all()
        assert other.effect == 0 or (without[axis] - less[axis]).max() > 1e-3
    said = notes(perhaps_late, states(perhaps_late, warm))
    assert sum("acts late (likeliest: by 600 s), and the rows have no times" in note for note in said) == 2


def test_cases_a_second_apart_are_as_uncertain_as_what_may_act_late(perhaps_late: StoredFit) -> None:
    """The likeliest model takes the temperature of each row at once; a quarter of the others hardly sees it."""
    warm = [20.0, 24.0, 20.0]
    alone = replace(perhaps_late, others=())
    quick, one = (states(perhaps_late, warm, time=t) for t in ([90000.0, 90001.0, 90002.0], 90000.0))
    np.testing.assert_allclose(predicted(alone, quick)[XYZ], predicted(alone, one)[XYZ], atol=1e-12)
    (late,) = (o for o in perhaps_late.others if o.effect == 0)
    own, other = (predicted(f, quick)["my"] for f in (alone, alone.with_effect(late)))
    assert abs(other[1] - own[1]) > 0.01
    u, less = (predicted(f, quick)["uy"] for f in (replace(perhaps_late, others=(late,)), alone))
    assert u[1] ** 2 - less[1] ** 2 == pytest.approx(0.25 * (other[1] - own[1]) ** 2)
    said = " ".join(notes(perhaps_late, quick))
    assert "T_bed may act up to 600 s late, and changes by 4 K in 1 s" in said
    assert "may act up to" not in " ".join(notes(perhaps_late, one))


def test_what_may_act_late_goes_on_from_the_recording(perhaps_late: StoredFit) -> None:
    """Also where the likeliest model has it at once, and where it is not in it."""
    assert set(perhaps_late.data["temperatures"]) == {"T_bed", "T_air"}
    assert set(perhaps_late.data["temperature_noise"]) == {"T_bed"}


def test_notes_do_not_say_that_nothing_depends_on_what_may_act(perhaps_late: StoredFit) -> None:
    """Both the time and a temperature that is not in the likeliest model."""
    points = states(perhaps_late, [40.0, 40.0], time=[90000.0, 180000.0])
    said = [note for note in notes(perhaps_late, points) if "beyond what was measured" in note]
    assert [("measured of time" in n, "measured of T_air" in n, "measured of T_bed" in n) for n in said].count(
        (False, False, True)
    ) == 1
    for name in ("time", "T_air"):
        (note,) = (note for note in said if f"measured of {name}" in note)
        assert "the likeliest model does not depend on it, but structure-drift of column may" in note
        assert "nothing in the model" not in note
        (plain,) = (n for n in notes(replace(perhaps_late, others=()), points) if f"measured of {name}" in n)
        assert "nothing in the model depends on it" in plain
