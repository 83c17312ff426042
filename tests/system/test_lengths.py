"""Fits of lengths alone: multilateration beside a tracker, coverage, ball bars and circles, stations known and unknown.

The readings are made by a simulation that shares no code with the product.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from identification.diagnosis.data_checks.gate import passed
from identification.estimation.fit import fit_machine
from identification.results.set_ups import set_ups
from identification.uncertainty.prediction import predict
from tests.benchmarks.length_coverage import NOISE, STATIONS, squared, stations
from tests.helpers.lengths import commands, distances, entry, standardised, survey, tips, truth
from tests.helpers.surveys import stored

MACHINE = read_machine("vertical_three_axis")
PLACES = {k: (p, 0.0) for k, p in STATIONS.items()}


def known(places: dict[str, tuple[np.ndarray, float]]) -> dict[str, float]:
    """True unknowns of stations by name."""
    out = {f"observation[{k}].{a}": float(v) for k, (p, _) in places.items() for a, v in zip("xyz", p, strict=True)}
    return out | {f"observation[{k}].dead_path": d for k, (_, d) in places.items()}


def test_multilateration_gives_what_a_tracker_gives() -> None:
    """Four unknown stations: the same groups within the machine, and the same errors, as points of that noise."""
    rng = np.random.default_rng(3)
    values = truth(MACHINE, rng)
    table = distances(MACHINE, values, PLACES, 150, 1e-3, rng)
    lengths = fit_machine(MACHINE, survey(MACHINE, table, {k: entry(type="station-distance") for k in PLACES}))
    at = commands(MACHINE, 200, rng)
    seen = tips(MACHINE, values, at) + rng.normal(0, 1e-3, (200, 3))  # 600 numbers, as many as the lengths
    points = fit_machine(MACHINE, survey(MACHINE, at.assign(mx=seen[:, 0], my=seen[:, 1], mz=seen[:, 2]), {}))
    set_up = [u.startswith("observation[") for u in np.array(lengths.solution.unknowns)[lengths.solution.groups.base]]
    framed = sum(any(m.startswith("frame") for m in points.solution.groups.members(k))
                 for k in range(points.solution.groups.rank))  # fmt: skip
    assert lengths.solution.groups.rank - sum(set_up) == points.solution.groups.rank - framed == 24
    fresh = survey(MACHINE, commands(MACHINE, 60, rng), {})
    one, other = (predict(stored(f), fresh) for f in (lengths, points))
    true = tips(MACHINE, values, fresh.table) - Chain(MACHINE).kernel("nominal", outputs=(0, 1, 2))(
        Chain(MACHINE).columns(fresh.table)
    ).T  # fmt: skip
    away, apart = (_within(one, true, fresh), _within(other, true, fresh))
    # three times the noise over the root of the rows per group is what either leaves; errors are twenty times as large
    assert away < 1.2e-3
    assert apart < 1.2e-3
    assert away < 2 * apart
    # as certain as the tracker's but for its better geometry: the note says that a shift of all is left out
    ratio = np.median(one[["ux", "uy", "uz"]].to_numpy()) / np.median(other[["ux", "uy", "uz"]].to_numpy())
    assert 0.5 < ratio < 3


def _within(predicted: pd.DataFrame, true: np.ndarray, fresh: object) -> float:
    """Root mean square distance of predicted from true errors, after the best rigid motion of all, mm."""
    nominal = predicted[["mx", "my", "mz"]].to_numpy() - predicted[["ex", "ey", "ez"]].to_numpy()
    gap = predicted[["ex", "ey", "ez"]].to_numpy() - true
    x, y, z = nominal.T
    o, i = np.zeros_like(x), np.ones_like(x)
    columns = np.stack([[i, o, o], [o, i, o], [o, o, i], [o, -z, y], [z, o, -x], [-y, x, o]]).reshape(6, -1).T
    left = gap.T.ravel() - columns @ np.linalg.lstsq(columns, gap.T.ravel(), rcond=None)[0]
    return float(np.sqrt(np.mean(left**2) * 3))


@pytest.mark.long
def test_stated_uncertainties_hold_the_truth() -> None:
    """Machine and stations, one interferometer in four places; 200 simulations are in the benchmark."""
    z = []
    for seed in range(12):
        machine, data, values = stations(squared(MACHINE), np.random.default_rng([11, seed]), 4, 80, declared=True)
        z += [*standardised(fit_machine(machine, data), values).values()]
    z_all = np.array(z)
    assert len(z_all) == 12 * 40
    # 480 numbers in 12 correlated sets: six standard errors of the share; 40 independent ones a set would have 1 %
    assert 0.90 < np.mean(np.abs(z_all) < 1.96) < 0.99
    assert 0.85 < np.sqrt(np.mean(z_all**2)) < 1.15


def test_one_station_says_by_its_rank_what_it_does_not_see() -> None:
    """From one place fewer groups are identified, none is invented, and the note names what more poses cannot help."""
    rng = np.random.default_rng(5)
    machine, data, values = stations(MACHINE, rng, 1, 200, declared=False)
    fit = fit_machine(machine, data)
    z = standardised(fit, values)
    assert len(z) == 19 + 4  # the table of what lengths identify
    assert np.abs([*z.values()]).max() < 5
    dependent = set(fit.problem.unknowns) - {fit.solution.unknowns[j] for j in fit.solution.groups.base}
    assert all(fit.solution.named()[u] == 0 for u in dependent)


def test_known_stations_place_the_measuring_frame() -> None:
    """Three stations known to each other only, in a frame turned and shifted: the frame is found from lengths."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(8)
    values = truth(squared(MACHINE), rng)
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 1.1]), np.array([2000.0, -500.0, 300.0])
    table = distances(MACHINE, values, {k: PLACES[k] for k in "ABC"}, 100, NOISE, rng)
    entries = {k: entry(type="station-distance", station=(turn.apply(PLACES[k][0]) + shift).tolist()) for k in "ABC"}
    fit = fit_machine(squared(MACHINE), survey(MACHINE, table, entries))
    (pose,) = fit.problem.frames.values()
    assert np.abs(pose.rotation - turn.as_matrix()).max() < 1e-4  # errors of 30 um over a metre
    assert np.abs(pose.translation - shift).max() < 0.3
    z, s = standardised(fit, values), fit.solution
    framed = {
        s.unknowns[j] for k, j in enumerate(s.groups.base) if any(m.startswith("frame") for m in s.groups.members(k))
    }
    assert len(z) - len(framed) > 15
    assert np.abs([v for name, v in z.items() if name not in framed]).max() < 5
    two = {k: entries[k] for k in "AB"}
    with pytest.raises(InputError, match="2 known stations"):
        fit_machine(MACHINE, survey(MACHINE, table[table["observation"] != "C"], two))
    fixed = {k: entry(type="station-distance", station=PLACES[k][0].tolist()) for k in "AB"}
    alone = fit_machine(MACHINE, survey(MACHINE, table[table["observation"] != "C"], fixed, "fixed"))
    assert not alone.problem.frames
    assert "table.dx" in {alone.solution.unknowns[j] for j in alone.solution.groups.base}


def test_runs_that_start_anew_have_a_dead_path_each() -> None:
    rng = np.random.default_rng(9)
    values = truth(MACHINE, rng)
    table = distances(MACHINE, values, PLACES, 90, NOISE, rng)
    table["run"] = np.tile(np.repeat(["1", "2", "3"], 30), 4)
    table["length"] -= table["run"].map({"1": 0.0, "2": 250.0, "3": -40.0})
    entries = {k: entry(type="station-distance", dead_path="per-run") for k in PLACES}
    fit = fit_machine(MACHINE, survey(MACHINE, table, entries))
    found = {v.id: v.value for v in set_ups(fit)}
    assert found["observation[A, run 2].dead_path"] - found["observation[A, run 1].dead_path"] == pytest.approx(
        250, abs=0.01
    )
    assert found["observation[D, run 3].dead_path"] - found["observation[D, run 1].dead_path"] == pytest.approx(
        -40, abs=0.01
    )


def circle(first: str, second: str, sense: int, radius: float = 150.0) -> pd.DataFrame:
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)[::sense]
    rows = pd.DataFrame({"X": 0.0, "Y": 0.0, "Z": 350.0}, index=range(120))
    rows[first] += radius * np.cos(angle)
    rows[second] += radius * np.sin(angle)
    return rows.assign(angle=angle, observation=first + second, run=f"{first}{second}{sense:+d}")


def test_circles_name_squareness_and_scales_as_the_textbook_does() -> None:
    """ISO 230-4: squareness b makes r(45) - r(135) = -R b, scales e make r(0) - r(90) = R (ex - ey)."""
    rng, radius = np.random.default_rng(1), 150.0
    machine = squared(MACHINE)
    values = {"saddle.ec": 60e-6, "X.dx.1": 0.019, "Y.dy.1": -0.0041}  # EC(0X)Y; 50 and -20 um/m of 380 and 205 mm
    parts = [circle(*pair, sense) for pair in (("X", "Y"), ("Y", "Z"), ("Z", "X")) for sense in (1, -1)]
    table = pd.concat(parts, ignore_index=True)
    ball = {"XY": [0.012, -0.02, 0.0], "YZ": [0.0, 0.015, 0.008], "ZX": [-0.01, 0.0, 0.02]}
    centre = tips(machine, {}, table.iloc[[0]].assign(X=0.0, Y=0.0, Z=350.0))[0]
    away = tips(machine, values, table) - centre - np.array([ball[o] for o in table["observation"]])
    table["length"] = np.linalg.norm(away, axis=1) - radius
    own = table[(table["observation"] == "XY") & (table["run"] == "XY+1")].set_index("angle")["length"]
    trace = np.interp(np.radians([0, 45, 90, 135, 180, 225, 270, 315]), own.index, own.to_numpy())
    mean = (trace[:4] + trace[4:]) / 2  # the ball's place cancels between opposite sides
    table["length"] += rng.normal(0, 3e-4, len(table))
    sigma = [3e-4, 0.0]
    entries = {o: entry(type="ballbar-circle", calibrated=radius, sigma=sigma) for o in ball}
    fit = fit_machine(machine, survey(machine, table.drop(columns="angle"), entries))
    estimated, std = fit.solution.named(), np.sqrt(np.diag(fit.solution.covariance))
    found = {
        fit.solution.unknowns[j]: (estimated[fit.solution.unknowns[j]], std[k])
        for k, j in enumerate(fit.solution.groups.base)
    }
    assert abs(found["saddle.ec"][0] - 60e-6) < 4 * found["saddle.ec"][1]
    assert found["saddle.ec"][0] == pytest.approx(-(mean[1] - mean[3]) / radius, abs=3e-6)
    scales = found["X.dx.1"][0] / 380 - found["Y.dy.1"][0] / 205
    assert scales == pytest.approx((mean[0] - mean[2]) / radius, abs=3e-6)
    assert abs(found["X.dx.1"][0] - 0.019) < 4 * found["X.dx.1"][1]
    where = {v.id: v for v in set_ups(fit)}
    assert where["observation[XY].z"].std is None  # across its plane a circle shows nothing
    assert where["observation[XY].x"].value == pytest.approx(0.012, abs=4 * where["observation[XY].x"].std)  # type: ignore[operator]
    unknown = {o: entry(type="ballbar-circle", calibrated="unknown", sigma=sigma) for o in ball}
    loose = fit_machine(machine, survey(machine, table.drop(columns="angle"), unknown))
    assert loose.solution.groups.rank == fit.solution.groups.rank + 3 - 1  # three lengths, one common scale lost
    # a difference of scales is left, as all that a bar of unknown length can show
    names = [loose.solution.groups.members(k) for k in range(loose.solution.groups.rank)]
    assert any({"X.dx.1", "Y.dy.1"} <= set(m) or {"X.dx.1", "Z.dz.1"} <= set(m) for m in names)


def test_a_step_gauge_sees_differences_only() -> None:
    """Calibrated distances between poses: scale, straightness and squareness, and nothing of where the machine is."""
    rng = np.random.default_rng(6)
    values = truth(MACHINE, rng)
    one, other = commands(MACHINE, 400, rng), commands(MACHINE, 400, rng)
    length = np.linalg.norm(tips(MACHINE, values, other) - tips(MACHINE, values, one), axis=1)
    table = other.join(one.add_prefix("from_")).assign(observation="bar", length=length + rng.normal(0, 5e-4, 400))
    fit = fit_machine(MACHINE, survey(MACHINE, table, {"bar": entry(type="pose-distance", sigma=[5e-4, 0.0])}))
    z = standardised(fit, values)
    assert len(z) == 24
    assert np.abs([*z.values()]).max() < 5
    assert {"table.dx", "table.ea", "head.dz"} <= set(fit.solution.groups.no_effect)


def test_outliers_among_lengths_are_named_and_do_no_harm() -> None:
    rng = np.random.default_rng(12)
    machine, data, values = stations(MACHINE, rng, 4, 100, declared=False)
    table = data.table.copy()
    wrong = rng.choice(len(table), 20, replace=False)
    table.loc[wrong, "length"] += rng.choice([-1, 1], 20) * rng.uniform(0.01, 3, 20)
    fit = fit_machine(machine, type(data)(**{**vars(data), "table": table}), robust=True)
    assert {o.index for o in fit.outliers} >= set(wrong.tolist())
    assert len(fit.outliers) <= 23
    assert all(o.what.startswith("length of ") for o in fit.outliers)
    assert np.abs([*standardised(fit, values).values()]).max() < 5


def test_points_and_lengths_are_one_fit() -> None:
    """A tracker's coarse points and an interferometer's fine lengths: surer than either, and right."""
    rng = np.random.default_rng(14)
    values = truth(MACHINE, rng)
    at = commands(MACHINE, 120, rng)
    seen = tips(MACHINE, values, at) + rng.normal(0, 5e-3, (120, 3))
    points = at.assign(mx=seen[:, 0], my=seen[:, 1], mz=seen[:, 2])
    lengths = distances(MACHINE, values, {"A": PLACES["A"]}, 120, NOISE, rng)
    both = pd.concat([points, lengths], ignore_index=True)
    entries = {"A": entry(type="station-distance")}
    alone = fit_machine(MACHINE, survey(MACHINE, points, {}))
    fit = fit_machine(MACHINE, survey(MACHINE, both, entries))
    assert set(fit.solution.sigma) == {"position", "station-distance"}
    assert 0.8 < fit.solution.sigma["station-distance"] / NOISE < 1.25
    z = standardised(fit, values)
    assert np.abs([v for n, v in z.items() if not n.startswith(("frame", "observation"))][6:]).max() < 5
    fresh = survey(MACHINE, commands(MACHINE, 40, rng), {})
    surer = predict(stored(fit), fresh)[["ux", "uy", "uz"]].to_numpy().mean()
    assert surer < 0.8 * predict(stored(alone), fresh)[["ux", "uy", "uz"]].to_numpy().mean()


def test_what_cannot_be_is_refused() -> None:
    rng = np.random.default_rng(2)
    values = truth(MACHINE, rng)
    table = distances(MACHINE, values, PLACES, 60, NOISE, rng)
    entries = {k: entry(type="station-distance") for k in PLACES}
    metres = survey(MACHINE, table.assign(length=table["length"] / 1000), entries)
    with pytest.raises(InputError, match="fit a station nowhere"):
        passed(MACHINE, metres, lambda: fit_machine(MACHINE, metres))
    flat = table.assign(Z=300.0)
    flat["length"] = np.concatenate(
        [np.linalg.norm(tips(MACHINE, values, r) - PLACES[k][0], axis=1) for k, r in flat.groupby("observation")]
    )
    with pytest.raises(InputError, match="near"):
        fit_machine(MACHINE, survey(MACHINE, flat, entries))
    some = {k: entry(type="station-distance", **({"sigma": [1e-3, 0.0]} if k == "A" else {})) for k in PLACES}
    with pytest.raises(InputError, match="without a standard uncertainty"):
        fit_machine(MACHINE, survey(MACHINE, table, some))
    far = entry(type="station-distance", station=[5000.0, 0.0, 0.0])
    elsewhere = survey(MACHINE, table[table["observation"] == "A"], {"A": far}, "fixed")
    with pytest.raises(InputError, match="beside the nominal machine"):
        passed(MACHINE, elsewhere, lambda: fit_machine(MACHINE, elsewhere))


def test_the_budget_of_a_prediction_adds_up_and_knows_the_scale_of_lengths() -> None:
    """The combined uncertainty is the predicted one; a common scale of all lengths is one of the machine's scales."""
    from errormodel.surveys.file import BudgetEntry
    from identification.results.analysis import Analysis

    rng = np.random.default_rng(15)
    machine, data, _ = stations(squared(MACHINE), rng, 4, 80, declared=True)
    scale = BudgetEntry(name="wavelength", std=1e-6, acts="scale")
    plain, with_scale = (
        Analysis(fit_machine(machine, type(data)(**{**vars(data), "budget": b}))) for b in ((), (scale,))
    )
    known = predict(plain.stored, survey(machine, commands(machine, 400, rng), {}))[["ux", "uy", "uz"]].to_numpy().max()
    budget = plain.budgets.prediction
    assert budget is not None
    assert budget.std > 0.95 * known  # the worst of the budget's poses, corners among them, is no better than these
    assert not any("does not identify" in line.name for line in budget.inputs)
    names = [g["id"] for g in with_scale.groups]
    own = with_scale.budgets.groups[names.index("X.dx.1")]
    line = next(i for i in own.inputs if i.name == "wavelength")
    assert abs(line.contribution) == pytest.approx(380e-6, rel=0.02)  # 380 mm of travel at 1 um/m
