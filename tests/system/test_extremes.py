"""Numbers at the ends of what machines have: the right answer, or a sentence that says why there is none.

Units, travels, frames far away, wild readings, chains that are redundant or long, hardly any rows.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.helpers.commands import XYZ, Done, done, run, write

MILL = """\
errormodel: 1
units: {{length: {unit}, angle: deg}}
chain:
  - {{joint: X, type: prismatic, axis: x, travel: [0, {x}]}}
  - {{shape: saddle}}
  - {{joint: Y, type: prismatic, axis: y, travel: [0, {y}]}}
  - {{shape: column}}
  - {{joint: Z, type: prismatic, axis: z, travel: [0, {z}]}}
  - {{shape: head}}
tool: [0, 0, {tool}]
errors: {{shapes: all, joints: first-order}}
"""


def mill(length: float = 500.0, unit: str = "mm", of_mm: float = 1.0) -> str:
    """A mill whose travels are some tenths of `length` (mm), in a unit of so many mm."""
    x, y, z, tool = (repr(share * length / of_mm) for share in (1.0, 0.8, 0.6, -0.2))
    return MILL.format(unit=unit, x=x, y=y, z=z, tool=tool)


def chain_of(joints: int) -> str:
    """A redundant chain: slides and turns about x, y and z in turn, each with a member behind it."""
    lines = ["errormodel: 1", "chain:"]
    for k in range(joints):
        kind, travel = ("rotary", "[-90, 90]") if k % 2 else ("prismatic", "[0, 300]")
        lines.append(f"  - {{joint: J{k}, type: {kind}, axis: {'xyz'[k % 3]}, travel: {travel}}}")
        lines.append(f"  - {{shape: s{k}, offset: [10, 5, 50]}}")
    return "\n".join([*lines, "tool: [0, 0, -50]", "errors: {shapes: all, joints: first-order}", ""])


def recorded(place: Path, machine: str, rows: int, noise: float) -> pd.DataFrame:
    """A simulated survey ``s.csv`` of ``m.yaml``; `noise` in mm."""
    write(place / "m.yaml", machine)
    done("simulate", place / "m.yaml", rows, "--noise", noise, "--out", place / "s.csv")
    return pd.read_csv(place / "s.csv")


def fit(place: Path, *options: str, survey: str = "s.csv") -> Done:
    return run("fit", place / "m.yaml", place / survey, "--out", place / "fit", "--quiet", *options)


def figures(place: Path) -> dict[str, object]:
    data: dict[str, object] = json.loads((place / "fit/fit.json").read_text())
    return data


def refused(ended: Done) -> str:
    assert ended.code == 2, ended.out
    assert "Traceback" not in ended.err
    assert "Warning" not in ended.err
    return ended.err


@pytest.mark.long
def test_lengths_from_nanometres_to_metres(tmp_path: Path) -> None:
    """The same machine in four units: the same noise and as many groups; the digits of the files differ."""
    found = []
    for unit, of_mm in (("nm", 1e-6), ("um", 1e-3), ("mm", 1.0), ("m", 1e3)):
        recorded(tmp_path / unit, mill(unit=unit, of_mm=of_mm), 50, 0.002)
        assert fit(tmp_path / unit).code == 0
        data = figures(tmp_path / unit)
        found.append((data["sigma_um"], len(data["parameters"])))  # type: ignore[arg-type]
    noise, groups = zip(*found, strict=True)
    assert len(set(groups)) == 1
    assert noise == pytest.approx([2.0] * 4, rel=0.25)  # of 130 degrees of freedom: 4 of 6 %
    assert noise == pytest.approx([noise[0]] * 4, rel=1e-9)


@pytest.mark.parametrize(("length", "noise"), [(1.0, 2e-5), (50_000.0, 5e-3)])
def test_travels_from_a_millimetre_to_fifty_metres(length: float, noise: float, tmp_path: Path) -> None:
    recorded(tmp_path, mill(length), 50, noise)
    assert fit(tmp_path).code == 0
    assert figures(tmp_path)["sigma_um"] == pytest.approx(1e3 * noise, rel=0.25)  # as above


def test_a_frame_a_hundred_metres_away(tmp_path: Path) -> None:
    table = recorded(tmp_path, mill(), 50, 0.002)
    assert fit(tmp_path).code == 0
    near = figures(tmp_path)
    table[XYZ] += [1e5, -1e5, 1e5]
    table.to_csv(tmp_path / "far.csv", index=False)
    assert fit(tmp_path, survey="far.csv").code == 0
    far = figures(tmp_path)
    for figure in ("nominal", "fitted"):  # doubles near 1e5 mm are 1.5e-5 um apart
        assert far[figure]["rms_um"] == pytest.approx(near[figure]["rms_um"], abs=1e-4)  # type: ignore[index]


@pytest.mark.long
def test_a_wild_reading(tmp_path: Path) -> None:
    """Named by the plain fit and left out by the robust one, however far off it lies."""
    table = recorded(tmp_path, mill(), 50, 0.002)
    for value, words in ((1e9, "row 4 (line 5), column mx: 1000000000, beyond any machine"), (9e5, "row 4 lies")):
        table.loc[3, "mx"] = value
        table.to_csv(tmp_path / "wild.csv", index=False)
        assert words in refused(fit(tmp_path, survey="wild.csv"))
    noise = []
    for value in (9e5, 1e2):
        table.loc[3, "mx"] = value
        table.to_csv(tmp_path / "wild.csv", index=False)
        assert fit(tmp_path, "--robust", survey="wild.csv").code == 0
        noise.append(figures(tmp_path)["sigma_um"])
    assert noise[0] == pytest.approx(2.0, rel=0.25)
    assert noise[1] == pytest.approx(noise[0], rel=1e-6)  # of its size nothing is left but the digits of the solver


def test_joints_that_slide_along_one_line(tmp_path: Path) -> None:
    text = mill().replace("axis: y", "axis: x").replace("axis: z", "axis: x")
    write(tmp_path / "m.yaml", text)
    said = refused(run("describe", tmp_path / "m.yaml"))
    assert "the joints X, Y, Z all slide along one line" in said


@pytest.mark.long
def test_a_redundant_chain_of_twelve_joints(tmp_path: Path) -> None:
    recorded(tmp_path, chain_of(12), 300, 0.002)
    assert fit(tmp_path).code == 0
    data = figures(tmp_path)
    assert data["sigma_um"] == pytest.approx(2.0, rel=0.1)  # of some 800 degrees of freedom: 4 of 2.5 %
    assert len(data["parameters"]) < 11 * 6 + 6 * 4 + 6 * 6 + 6  # type: ignore[arg-type]  # groups, not parameters


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="a limit of memory that is kept")
def test_thirty_joints_in_two_gigabytes(tmp_path: Path) -> None:
    """What grows as 2 to the number of joints (corners of the travels, nodes of a lattice) is bounded or refused."""
    shapes = chain_of(30).replace(
        "joints: first-order", "joints: {" + ", ".join(f"J{k}: none" for k in range(30)) + "}"
    )
    recorded(tmp_path, shapes, 150, 0.002)
    start = f"ulimit -v 2000000; exec {sys.executable} -m errormodel"
    commands = ("fit m.yaml s.csv --out fit", "compensate fit --controller csv --out tables")
    first, second = (
        subprocess.run(
            ["bash", "-c", f"{start} {words} --quiet"], check=False, cwd=tmp_path, capture_output=True, text=True
        )
        for words in commands
    )
    assert first.returncode == 0, first.stderr
    assert figures(tmp_path)["sigma_um"] == pytest.approx(2.0, rel=0.2)  # of some 300 degrees of freedom: 4 of 4 %
    assert second.returncode == 2
    assert "a grid over 30 axes that follows the errors needs more than" in second.stderr


def test_one_row(tmp_path: Path) -> None:
    recorded(tmp_path, mill(), 50, 0.002).iloc[:1].to_csv(tmp_path / "one.csv", index=False)
    assert "1 row with 3 measured values where" in refused(fit(tmp_path, survey="one.csv"))


def test_many_rows_at_nearly_one_pose(tmp_path: Path) -> None:
    """Ten thousand poses within some micrometres show no error motion: a fit of them says what falls."""
    recorded(tmp_path, mill(), 50, 0.002)
    rng = np.random.default_rng(1)
    table = pd.DataFrame(rng.normal([250, 200, 150], 1e-3, (10_000, 3)).round(6), columns=["X", "Y", "Z"])
    table[XYZ] = (table.to_numpy() + np.array([0.0, 0.0, -100.0]) + rng.normal(0, 0.002, (10_000, 3))).round(6)
    table.to_csv(tmp_path / "near.csv", index=False)
    ended = fit(tmp_path, survey="near.csv")
    if ended.code == 0:  # what the noise hides must not be called found
        parameters = pd.read_csv(tmp_path / "fit/parameters.csv")
        assert (parameters["value"].abs() <= 5 * parameters["std"]).all()
    else:
        refused(ended)


@pytest.mark.parametrize("digits", [0, 6])
def test_fifty_readings_at_one_pose_test_nothing(digits: int, tmp_path: Path) -> None:
    """With or without scatter, coarse copies among them: that nothing was found is not called a result."""
    machine = "errormodel: 1\nchain:\n  - {joint: X, type: prismatic, axis: x, travel: [0, 500]}\ntool: [0, 0, -50]\n"
    write(tmp_path / "m.yaml", machine + "errors: {shapes: none, joints: first-order}\n")
    rng = np.random.default_rng(0)
    readings = (np.array([250.0, 0.0, -50.0]) + rng.normal(0, 0.002, (50, 3))).round(digits)
    pd.DataFrame({"X": 250.0, **dict(zip(XYZ, readings.T, strict=True))}).to_csv(tmp_path / "s.csv", index=False)
    said = done("diagnose", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "d").out
    assert "Nothing could be tested: no joint moved between the rows" in said
    assert "the model and the noise explain" not in said
    assert "Nothing could be tested" in (tmp_path / "d/report.html").read_text(encoding="utf-8")
    done("explain", tmp_path / "d")


@pytest.mark.parametrize(("angle", "said"), [(3e-3, True), (3e-5, False)])
def test_errors_so_large_that_first_order_is_not_enough(angle: float, said: bool, tmp_path: Path) -> None:
    """Groups are sums of parameters to first order: what a rotation makes of the others is said where it shows."""
    write(tmp_path / "m.yaml", mill())
    truth = {"saddle.ec": angle, "column.ea": -angle, "column.dz": 500 * angle, "X.dx.1": angle, "Y.ec.1": angle / 500}
    write(tmp_path / "t.yaml", f"parameters: {json.dumps(truth)}\n")
    done(
        "simulate", tmp_path / "m.yaml", 80, "--parameters", tmp_path / "t.yaml", "--noise", 1e-4,
        "--out", tmp_path / "s.csv",
    )  # fmt: skip
    notes = json.loads((tmp_path / "fit/fit.json").read_text())["notes"] if not fit(tmp_path).code else None
    assert notes is not None
    assert any("to first order only" in note for note in notes) == said


@pytest.mark.long
@pytest.mark.parametrize(("far", "cured"), [(9e4, True), (9e6, False)])
def test_a_robust_fit_is_recommended_where_it_works(far: float, cured: bool, tmp_path: Path) -> None:
    table = recorded(tmp_path, mill(), 60, 0.001)
    table.loc[3, "my"] += far
    table.to_csv(tmp_path / "s.csv", index=False)
    assert ("--robust" in fit(tmp_path).err) == cured
    assert fit(tmp_path, "--robust").code == 0 or not cured
