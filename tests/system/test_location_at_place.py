"""Squareness of a fitted machine is that of lines measured on it: a simulator of its own, exact kinematics."""

from __future__ import annotations

import json
import shutil
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import read_machine
from errormodel.arrays import Array, as_rows
from errormodel.chain import Chain
from errormodel.machine import Basis, Joint, Machine, Shape
from identification import compensate, fit, iso
from identification.iso_standards.fitted import FittedMachine
from identification.results.axis_lines import locations_of
from identification.results.store import load
from tests.helpers.commands import write
from tests.helpers.crossbeam import pose

TRAVEL = {"X": (0.0, 4000.0), "Y": (-1250.0, 1250.0), "Z": (-1000.0, 0.0)}
CHAIN = """errormodel: 1
name: Portal mill
units: {length: mm, angle: deg}
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 4000]}
  - {shape: beam, offset: [0, 0, 1500]}
  - {joint: Y, type: prismatic, axis: y, travel: [-1250, 1250]}
  - {shape: saddle, offset: [200, 0, 0]}
  - {joint: Z, type: prismatic, axis: z, travel: [-1000, 0]}
  - {shape: ram, offset: [0, 0, 0]}
tool: [0, 0, -300]
errors:
  shapes: all
  joints: {X: {polynomial: 3}, Y: {polynomial: 3}, Z: {polynomial: 2}}
"""
SYMBOLS = {"EC(0X)Y", "EB(0X)Z", "EA(0Y)Z"}


def tip(x: float, y: float, z: float) -> Array:
    """Where the tip is: straightness, angles and constants of a portal mill, mm and rad; third powers at most."""
    u, v, w = x / 4000, y / 1250, z / 1000
    of_x = (-16e-6 * x, 0.036 * u * (u - 1), 0.020 * u**2 - 0.012 * u,
            12e-6 * u - 20e-6 * u**2, 25e-6 * u + 10e-6 * u**3, 22e-6 * u**2 - 30e-6 * u)  # fmt: skip
    of_y = (0.006 * v**2 - 0.003 * v**3, 14e-6 * y, -0.015 * v**2, 18e-6 * v + 6e-6 * v**2, -8e-6 * v, 15e-6 * v)
    of_z = (0.004 * w**2, -0.003 * w**2, -9e-6 * z, 10e-6 * w, -14e-6 * w, 4e-6 * w)
    steps = [
        (np.array([x, 0, 0, 0, 0, 0]) + of_x), (0, 0, 1500, 15e-6, -8e-6, -45e-6),
        (np.array([0, y, 0, 0, 0, 0]) + of_y), (200, 0, 0, 22e-6, 30e-6, 0), (np.array([0, 0, z, 0, 0, 0]) + of_z),
    ]  # fmt: skip
    out = np.eye(4)
    for six in steps:
        out = out @ pose(np.asarray(six, dtype=np.float64))
    return np.asarray((out @ [0, 0, -300, 1])[:3])


def line(joint: str, at: dict[str, float], ends: tuple[float, float]) -> Array:
    """Direction of the least-squares line of the tip's path through 21 targets."""
    targets = np.linspace(*ends, 21)
    points = np.array([tip(*({**at, joint: float(t)}[n] for n in "XYZ")) for t in targets])
    slope = (targets - targets.mean()) @ points
    return np.asarray(slope / np.linalg.norm(slope))


def measured(at: dict[str, float], ranges: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Squareness between lines through a place: how far the second leans from the first, signed as in ISO 230-1."""
    d = {n: line(n, at, ranges[n]) for n in "XYZ"}
    return {
        "EC(0X)Y": -float(d["X"] @ d["Y"]), "EB(0X)Z": float(d["X"] @ d["Z"]), "EA(0Y)Z": -float(d["Y"] @ d["Z"]),
    }  # fmt: skip


def survey(q: Array, sigma: float, seed: int) -> pd.DataFrame:
    """Points of a tracker that stands anywhere."""
    frame = pose(np.array([900.0, -400.0, 300.0, 0.0, 0.0, 0.7]))
    points = np.array([tip(*row) for row in q]) @ frame[:3, :3].T + frame[:3, 3]
    points += sigma * np.random.default_rng(seed).standard_normal(points.shape)
    columns = {**dict(zip("XYZ", q.T, strict=True)), **dict(zip(("mx", "my", "mz"), points.T, strict=True))}
    return pd.DataFrame(columns).assign(sigma=sigma)


def in_volume(count: int, seed: int) -> Array:
    low, high = np.array(list(TRAVEL.values())).T
    return np.random.default_rng(seed).uniform(low, high, (count, 3)).round(0)


def place_of(words: str) -> dict[str, float]:
    """``lines through X 2000, Y 0, Z -500``."""
    pairs = (part.split() for part in words.removeprefix("lines through ").split(", "))
    return {name: float(value) for name, value in pairs}


@pytest.fixture(scope="module")
def portal(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return read_machine(write(tmp_path_factory.mktemp("portal") / "portal.yaml", CHAIN))


@pytest.fixture(scope="module")
def folder(portal: Machine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of points all over the travels."""
    out = tmp_path_factory.mktemp("fitted") / "fit"
    fit(portal, survey(in_volume(200, 0), 0.002, 0)).save(out)
    return out


def test_a_certificate_has_the_squareness_of_lines_through_the_middle(folder: Path) -> None:
    """The constants alone pass where the machine fails."""
    result = iso("230-1", folder, tolerance={"EC(0X)Y": "50 um/m"})
    stored = load(folder)
    entries = {e["symbol"]: e for e in stored.data["location_errors"]}
    ranges = {n: tuple(stored.data["covered"][n]) for n in "XYZ"}
    found = {q.symbol: q for q in result.evaluations[0].quantities if q.symbol in entries}
    assert set(found) == SYMBOLS
    place = place_of(entries["EC(0X)Y"]["at"])
    assert all(abs(place[n] - np.mean(ranges[n])) < np.ptp(ranges[n]) / 1000 for n in "XYZ")
    for symbol, truth in measured(place, ranges).items():
        q = found[symbol]
        assert q.expanded is not None
        assert abs(q.value - truth) < 1.5 * q.expanded < 6e-6, symbol
        assert q.value == pytest.approx(entries[symbol]["value"], abs=1e-12)
        assert q.expanded == pytest.approx(2 * entries[symbol]["std"])
        assert entries[symbol]["at"] in q.words
    assert result.conformity.verdict == "fails"
    assert measured(place, ranges)["EC(0X)Y"] < -55e-6
    (note,) = (n for n in result.notes if "depend on the place" in n)
    assert "EC(0X)Y" in note


def test_where_it_is_measured_is_said(folder: Path) -> None:
    """Between lines along the edges it is what lines there show."""
    stored = load(folder)
    ranges = {n: tuple(stored.data["covered"][n]) for n in "XYZ"}
    edges = [measured(dict(zip("XYZ", at, strict=True)), ranges) for at in product(*ranges.values())]
    model = FittedMachine.of(stored, folder, None)
    errors = {e.symbol: e for e in model.chain.location_errors}
    for symbol in SYMBOLS:
        truth = [e[symbol] for e in edges]
        assert model.lines.elsewhere(errors[symbol]) == pytest.approx((min(truth), max(truth)), abs=8e-6)
        assert np.ptp(truth) > 10e-6


def test_the_uncertainty_covers_what_lines_show(portal: Machine) -> None:
    off: list[float] = []
    for seed in range(1, 6):
        table = survey(in_volume(120, seed), 0.003, seed)
        ranges = {n: (table[n].min(), table[n].max()) for n in "XYZ"}
        estimates = fit(portal, table).analysis.location_errors
        truth = measured(place_of(estimates[0].at), ranges)
        off += [(e.value - truth[e.symbol]) / e.std for e in estimates]
    assert len(off) == 15
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6


def test_lines_of_a_survey_and_of_a_fit_of_them_agree(portal: Machine) -> None:
    """Lines that do not meet, far from the middle: the fit knows nothing of that, but has their squareness."""
    at = {"X": {"Y": -900.0, "Z": -100.0}, "Y": {"X": 500.0, "Z": -100.0}, "Z": {"X": 500.0, "Y": -900.0}}
    rows = [[{**at[n], n: float(t)}[m] for m in "XYZ"] for n in "XYZ" for t in np.linspace(*TRAVEL[n], 21)]
    table = survey(np.array(rows), 0.001, 3)
    of_lines = {q.symbol: q for q in iso("230-1", portal, table).evaluations[0].quantities}
    of_fit = {e.symbol: e for e in fit(portal, table).analysis.location_errors}
    assert set(of_fit) == SYMBOLS
    for symbol, e in of_fit.items():
        assert e.at.startswith("lines at ")
        assert e.spoken == of_lines[symbol].words
        assert e.value == pytest.approx(of_lines[symbol].value, abs=2 * e.std)
        assert (
            0.5 < 2 * e.std / (of_lines[symbol].expanded or 0.0) < 1.2
        )  # the lines share straightness, which is smooth


def test_what_to_adjust_is_the_same_squareness(folder: Path) -> None:
    out = compensate(folder, controller="csv", points=3)
    (advice,) = (a for a in out.compensation.advice if "of Y against X" in a.what)
    (entry,) = (e for e in load(folder).data["location_errors"] if e["symbol"] == "EC(0X)Y")
    # Y leans away from X by a negative rotation about z: narrower is positive
    assert abs(advice.angle) == pytest.approx(abs(entry["value"]), abs=0.2e-6)


def test_a_result_of_an_older_version_is_evaluated_anew(folder: Path, tmp_path: Path) -> None:
    """Its location errors were sums of constants; a certificate does not repeat them."""
    shutil.copytree(folder, tmp_path / "fit")
    path = tmp_path / "fit" / "fit.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    for e in data["location_errors"]:
        e["value"] = 1.0
        del e["at"]
    (tmp_path / "fit" / "manifest.json").unlink()
    path.write_text(json.dumps(data), encoding="utf-8")
    new, old = (
        {q.symbol: q.value for q in iso("230-1", f).evaluations[0].quantities} for f in (folder, tmp_path / "fit")
    )
    assert new == pytest.approx(old)


def test_an_axis_average_line_has_the_mean_tilt_of_its_turn_where_it_stands() -> None:
    """A rotary table on a carriage: the centres of two circles, at two heights of the tip, against the path along X."""
    tilts = {"ea": Basis("polynomial", 1), "eb": Basis("polynomial", 1)}
    x = Joint("X", "prismatic", (1.0, 0.0, 0.0), (0.0, 800.0), tilts)  # type: ignore[arg-type]
    c = Joint("C", "rotary", (0.0, 0.0, 1.0), (0.0, 2 * np.pi), {"eb": Basis("harmonic", 1)})
    z = Joint("Z", "prismatic", (0.0, 0.0, 1.0), (0.0, 500.0))
    chain = Chain(Machine("m", (x, Shape("table", motions=("eb",)), c, Shape("column"), z), (100.0, 0.0, 0.0)))
    values = {"X.ea.1": 3e-6, "X.eb.1": 8e-6, "C.eb.cos1": 5e-6, "C.eb.sin1": -4e-6, "table.eb": 2e-6}
    p = chain.vector(values)

    def points(**q: Array) -> Array:
        columns = np.broadcast_arrays(*(np.asarray({"tool_x": 100.0, **q}.get(name, 0.0)) for name in chain.channels))
        return np.asarray(chain.kernel("actual", outputs=(0, 1, 2))(as_rows(*columns), p)).T

    turn = np.linspace(0.0, 2 * np.pi, 73)[:-1]
    low, high = (points(X=np.array(400.0), C=turn, Z=np.array(h)).mean(axis=0) for h in (0.0, 500.0))
    axis = (high - low) / np.linalg.norm(high - low)
    along = points(X=np.linspace(0.0, 800.0, 21), Z=np.array(250.0))
    slope = (np.arange(21) - 10.0) @ along
    (at,) = (at for at in locations_of(chain, pd.DataFrame(), {}) if at.error.symbol == "EB(0X)C")
    value = sum(coefficient * values.get(i, 0.0) for i, coefficient in at.members.items())
    assert value == pytest.approx(float(axis @ slope / np.linalg.norm(slope)), abs=1e-9)
    assert at.members["C.eb.cos1"] == pytest.approx(-1.0)  # cos(q) - 1
    assert at.members["table.eb"] == pytest.approx(1.0)
