"""Circular tests of surveys that hold more than one circle, and of a ballbar's lengths."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine, simulate
from errormodel.observations.base import Observation
from identification import iso
from tests.helpers.circles import RADIUS, as_survey, circles
from tests.helpers.lengths import entry, survey

MILL = "vertical_three_axis"
MACHINE = read_machine(MILL)
SCALE, SQUARE, PLAY = 30e-6, 40e-6, 0.008
TRUTH = {"X.dx.1": SCALE * 380, "saddle.ec": SQUARE}  # the travel of X reaches 380 mm


def bar(calibrated: float | str) -> Observation:
    return entry(type="ballbar-circle", calibrated=calibrated)


def figures(data: object) -> dict[str, float]:
    result = iso("230-4", MILL, data)  # type: ignore[arg-type]
    return {q.name: q.value for q in result.evaluations[0].quantities}


def circle(radius: float, z: float) -> list[tuple[float, float, float]]:
    angle = np.radians(np.arange(0.0, 361.0, 4.0))
    return [(radius * np.cos(a), radius * np.sin(a), z) for a in (*angle, *angle[::-1])]


def test_circles_are_found_among_lines_diagonals_and_each_other() -> None:
    """Two radii at one height, a line through it and a diagonal that crosses it: each circle as if it were alone."""
    lines = [(x, 1.0, 300.0) for x in np.linspace(-300, 300, 31)]
    crossing = [(k * 10.0, k * 5.0, 300.0 + (k % 3)) for k in range(-30, 31)]
    rows = [*lines, *circle(100, 300), *crossing, *circle(150, 300), *circle(80, 400), *circle(80, 250)]
    table = pd.DataFrame(np.array(rows).round(3), columns=["X", "Y", "Z"])
    seen = simulate(MILL, table, TRUTH, noise=0.0)
    found = figures(seen[["X", "Y", "Z", "mx", "my", "mz"]])
    for radius in (100, 150, 80):
        # of an ellipse with half axes r s / 2 along the axes and r g / 2 across: the frame takes half of the squareness
        own = {k: v for k, v in found.items() if k.startswith(f"XY r{radius}.")}
        assert own[f"XY r{radius}.G(b)"] == pytest.approx(radius * np.hypot(SCALE, SQUARE), rel=5e-3)
        # the angle 0 comes twice in 91 readings, where the circle is widest: their mean is up to 3 / 91 larger, the
        # radius of the least-squares circle by 1 / 91
        assert own[f"XY r{radius}.D"] == pytest.approx(radius * SCALE / 2, rel=1.2 / 91)
    assert found["XY r80 no. 2.G(b)"] == pytest.approx(found["XY r80.G(b)"], rel=1e-3)
    assert len(found) == 4 * 10


def test_lengths_of_a_ballbar_are_a_circular_test() -> None:
    """Against the figures of the simulated path itself: its ball lies a few micrometres off, which changes none."""
    rng = np.random.default_rng(7)
    table = circles(MACHINE, TRUTH, rng, backlash={"X": PLAY}, noise=0.0)
    found = figures(replace(as_survey(MACHINE, table), source=Path("a.csv")))
    for plane, name in (("XY", "XY"), ("YZ", "YZ"), ("ZX", "XZ")):
        part = table[table["plane"] == plane]
        sides = np.sign(np.gradient(np.unwrap(np.radians(part["angle"].to_numpy()))))
        for sense in (1.0, -1.0):
            own = part[sides == sense]
            sign = "+" if (sense > 0) == (plane != "ZX") else "-"  # X before Z: seen from the other side
            assert found[f"{name}.G{sign}"] == pytest.approx(_zone(own), abs=2e-5)
        assert found[f"{name}.G(b)"] == pytest.approx(_zone(part), abs=2e-5)
        assert found[f"{name}.D"] == pytest.approx(part["length"].mean(), abs=1e-4)
        assert found[f"{name}.F max"] - found[f"{name}.F min"] == pytest.approx(_range(part), abs=2e-5)


def test_a_bar_of_unknown_length_has_no_figures_of_its_size() -> None:
    rng = np.random.default_rng(7)
    table = circles(MACHINE, TRUTH, rng)
    part = table[table["plane"] == "XY"].drop(columns=["angle", "plane"]).assign(observation="XY")
    known, unknown = (
        iso("230-4", MILL, replace(survey(MACHINE, part, {"XY": bar(c)}), source=Path("a.csv")))
        for c in (RADIUS, "unknown")
    )
    symbols = {q.symbol: q.value for q in unknown.evaluations[0].quantities}
    assert {*symbols} == {"G+", "G-", "G(b)"}
    full = {q.symbol: q.value for q in known.evaluations[0].quantities}
    assert symbols == pytest.approx({k: full[k] for k in symbols}, abs=1e-9)
    assert any("length is not known" in n for n in unknown.evaluations[0].notes)
    assert any("(150 mm)" in n for n in known.evaluations[0].notes)


def _about(part: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angle, r = np.radians(part["angle"].to_numpy()), part["length"].to_numpy()
    columns = np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(r))])
    return angle, r, np.linalg.lstsq(columns, r, rcond=None)[0]


def _range(part: pd.DataFrame) -> float:
    angle, r, found = _about(part)
    return float(np.ptp(r - found[0] * np.cos(angle) - found[1] * np.sin(angle)))


def _zone(part: pd.DataFrame) -> float:
    """Least separation of concentric circles around the path, in the plane, by direct search."""
    from scipy.optimize import minimize

    angle, r, found = _about(part)
    points = (RADIUS + r)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    best = minimize(
        lambda c: float(np.ptp(np.linalg.norm(points - 1e-3 * c, axis=1))), 1e3 * found[:2], method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000},
    )  # fmt: skip
    return float(best.fun)


def test_an_arc_of_a_bar_has_no_figures_and_is_named() -> None:
    table = circles(MACHINE, {}, np.random.default_rng(3), each=60)
    short = table[(table["plane"] != "XY") | (table.index < 40)]
    result = iso("230-4", MILL, replace(as_survey(MACHINE, short), source=Path("s")))
    assert {q.name.partition(".")[0] for q in result.evaluations[0].quantities} == {"YZ", "XZ"}
    assert any("no figures of XY: less than 300" in note for note in result.evaluations[0].notes)
