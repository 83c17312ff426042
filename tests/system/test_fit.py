"""Fits of exact recordings: what comes out must be what went in, whatever was measured and in whichever frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.machine import Machine
from errormodel.machine_file import library, read_machine
from errormodel.survey import Survey
from identification import api
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.results.store import load, save
from identification.uncertainty.prediction import notes, predict
from tests.helpers.chains import Array, errors
from tests.helpers.commands import run
from tests.helpers.nightly import first_of
from tests.helpers.surveys import FAR, TURNED, measured, positions, prediction_error, stored, survey

MACHINES = sorted(library())
FIVE_AXIS, THREE_AXIS = "five_axis_table_quill", "horizontal_three_axis"
EXACT = 1e-3  # um: what second-order terms and round-off may leave


def tools(machine: Machine) -> tuple[tuple[float, float, float], ...]:
    x, y, z = machine.tool
    return (x, y, z), (x + 30, y - 20, z - 123)


@pytest.mark.parametrize("name", first_of(MACHINES, 5))
def test_every_machine_is_recovered(name: str) -> None:
    """Errors of 10 um and 20 urad, two tools, a tracker that stands askew 2 m away."""
    machine = read_machine(name)
    p = errors(Chain(machine), 1)
    fit = fit_machine(machine, survey(positions(measured(machine, p, tools=tools(machine)))))
    assert fit.solution.converged
    assert fit.solution.passes <= 7
    assert fit.nominal.rms_um > 4
    assert max(fit.fitted.rms_um, fit.heldout.rms_um, prediction_error(fit, p, tools=tools(machine))) < EXACT


def test_large_errors_are_recovered_too() -> None:
    """A hundred times larger: M itself changes, and is taken anew."""
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 1, um=1e3, urad=2e3)
    fit = fit_machine(machine, survey(positions(measured(machine, p))))
    assert fit.solution.converged
    assert max(fit.fitted.rms_um, prediction_error(fit, p)) < 0.05


def test_a_machine_without_errors_settles() -> None:
    """Nothing to find, no noise: the first step is round-off already."""
    machine = read_machine(FIVE_AXIS)
    fit = fit_machine(machine, survey(positions(measured(machine, np.zeros(len(Chain(machine).ids))))))
    assert fit.solution.converged
    assert fit.nominal.rms_um < EXACT
    assert ["hold only as far as the tip" in note for note in fit.notes] == [True]  # of the rotary axis


def test_a_frame_for_each_run() -> None:
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 2)
    frames = {"1": (FAR, TURNED), "2": ((-300.0, 10.0, 2e3), (1.0, -0.5, 2.0)), "a": ((0.0, 0.0, 0.0), (0.0, 0.0, 3.1))}
    tables = [positions(measured(machine, p, 80, k, frame=f, run=run)) for k, (run, f) in enumerate(frames.items())]
    fit = fit_machine(machine, survey(*tables, frame="per-run"))
    assert list(fit.problem.frames) == list(frames)
    assert fit.fitted.rms_um < EXACT
    for label, frame in frames.items():
        assert prediction_error(fit, p, frame=frame, run=label) < EXACT


def test_a_test_file_finds_its_frame_and_its_tool() -> None:
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 3)
    fitted = positions(measured(machine, p, 150, tools=tools(machine)))
    other = positions(
        measured(machine, p, 40, 5, frame=((50.0, -3e3, 0.0), (0.0, 2.0, 0.3)), file="b.csv", role="test")
    )
    fit = fit_machine(machine, survey(fitted, other, frame="per-file"))
    assert fit.tests[0].nominal.rms_um > 5
    assert fit.tests[0].fitted.rms_um < EXACT
    moved = other.assign(tool_x=other["tool_x"] - 0.05, tool_z=other["tool_z"] + 0.1)  # a target mounted anew
    alone = fit_machine(machine, survey(fitted, moved, frame="per-file")).tests[0]
    both = fit_machine(machine, survey(fitted, moved, frame="per-file", refit=("frame", "tool"))).tests[0]
    assert alone.fitted.rms_um > 1
    assert both.fitted.rms_um < EXACT
    assert both.refit["tool.dx"] == pytest.approx(0.05, abs=1e-6)
    shared = fit_machine(machine, survey(fitted, positions(measured(machine, p, 40, 5, role="test", file="b.csv"))))
    assert shared.tests[0].fitted.rms_um < EXACT
    assert shared.tests[0].refit == {}


def test_save_load_predict(tmp_path: Path) -> None:
    """What a folder gives back predicts as the fit itself does, to the last digit that a file keeps."""
    machine = read_machine(FIVE_AXIS)
    p = errors(Chain(machine), 7)
    tables = [positions(measured(machine, p, 100, k, noise=2e-3, run=run)) for k, run in enumerate(("1", "b 2"))]
    fit = fit_machine(machine, survey(*tables, frame="per-run"))
    save(fit, tmp_path)
    points = survey(positions(measured(machine, p, 50, 9, run="b 2")), frame="per-run")
    expected, found = predict(stored(fit), points), predict(load(tmp_path), points)
    columns = ["mx", "my", "mz", "ex", "ey", "ez"]
    np.testing.assert_allclose(found[columns], expected[columns], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[["ux", "uy", "uz"]], expected[["ux", "uy", "uz"]], rtol=1e-9)


def test_errors_along_the_machines_axes_do_not_depend_on_how_the_tracker_stands(tmp_path: Path) -> None:
    machine, turn = read_machine(FIVE_AXIS), Rotation.from_euler("XYZ", [1.0, -2.0, 37.0], degrees=True)
    p = errors(Chain(machine), 7)
    straight = positions(measured(machine, p, 100, 1, noise=2e-3, frame=(FAR, (0.0, 0.0, 0.0))))
    turned, points = straight.copy(), survey(straight)
    turned[["mx", "my", "mz"]] = turn.apply(straight[["mx", "my", "mz"]].to_numpy().copy())
    save(fit_machine(machine, survey(turned)), tmp_path / "turned")
    save(fit_machine(machine, survey(straight)), tmp_path / "straight")
    there, here = load(tmp_path / "turned"), load(tmp_path / "straight")
    e, u = ["ex", "ey", "ez"], ["ux", "uy", "uz"]
    as_machine, along = replace(there, error_axes="machine"), predict(here, points)
    found, measuring = predict(as_machine, points), predict(there, points)
    # an alignment is off by what the machine errs, some 1e-5 rad, and so are the axes of errors of 0.1 mm
    np.testing.assert_allclose(found[e], along[e], rtol=0, atol=5e-6)
    np.testing.assert_allclose(found[u], along[u], rtol=1e-4)
    assert np.abs(measuring[e] - along[e]).to_numpy().max() > 5e-3
    np.testing.assert_allclose(turn.apply(found[e].to_numpy().copy()), measuring[e], rtol=0, atol=5e-6)
    np.testing.assert_array_equal(found[["mx", "my", "mz"]], measuring[["mx", "my", "mz"]])
    said = "turned against the machine by 37.0 deg: --axes machine gives them along x y z of machine.yaml"
    assert any(said in note for note in notes(there, points))
    assert not any("--axes" in note for fit in (as_machine, here) for note in notes(fit, points))


def test_the_command_gives_errors_along_either_axes(tmp_path: Path) -> None:
    machine = read_machine(THREE_AXIS)
    table = positions(measured(machine, errors(Chain(machine), 7), 60, 1, noise=2e-3))
    save(fit_machine(machine, survey(table)), tmp_path / "fit")
    table[[j.name for j in machine.joints]].to_csv(tmp_path / "p.csv", index=False)
    out = {
        axes: run("predict", tmp_path / "fit", tmp_path / "p.csv", *(("--axes", axes) if axes else ()), "--out", out)
        for axes, out in (("", tmp_path / "a.csv"), ("measured", tmp_path / "b.csv"), ("machine", tmp_path / "c.csv"))
    }
    assert all(result.code == 0 for result in out.values())
    assert [("--axes machine" in result.err) for result in out.values()] == [True, True, False]
    plain, same, machines = (pd.read_csv(tmp_path / f"{name}.csv") for name in "abc")
    assert plain.equals(same)
    assert [*plain] == [*machines]
    along = api.predict(tmp_path / "fit", tmp_path / "p.csv", axes="machine")
    np.testing.assert_allclose(machines[["ex", "ey", "ez"]], along[["ex", "ey", "ez"]], rtol=0, atol=1e-9)
    stream = run(
        "predict",
        tmp_path / "fit",
        tmp_path / "p.csv",
        "--axes",
        "machine",
        "--stream",
        "--out",
        tmp_path / "d.parquet",
    )
    assert stream.code == 0
    np.testing.assert_allclose(pd.read_parquet(tmp_path / "d.parquet")[["ex", "ux"]], along[["ex", "ux"]], rtol=1e-9)


def test_inches_and_metres_give_the_same_parameters(tmp_path: Path) -> None:
    from errormodel.simulation import outward
    from errormodel.survey import read_survey

    machine = read_machine(FIVE_AXIS)
    table = outward(positions(measured(machine, errors(Chain(machine), 8), 120, noise=2e-3)), machine)
    lengths = ["X", "Y", "Z", "W", "mx", "my", "mz", "tool_x", "tool_y", "tool_z"]
    found: list[Fit] = []
    for unit, size in (("mm", 1.0), ("m", 1e3), ("inch", 25.4)):
        written = table.drop(columns=["file", "role", "row"])
        written[lengths] /= size
        written.to_csv(tmp_path / f"{unit}.csv", index=False, float_format="%.17g")
        yaml = f"errormodel: 1\nfiles: [{{path: {unit}.csv, role: fit}}]\nunits: {{length: {unit}, angle: deg}}\n"
        (tmp_path / f"{unit}.yaml").write_text(yaml)
        found.append(fit_machine(machine, read_survey(tmp_path / f"{unit}.yaml", machine)))
    for fit in found[1:]:
        std = np.sqrt(np.diag(found[0].solution.covariance))
        base = found[0].solution.groups.base
        assert fit.solution.groups.base.tolist() == base.tolist()
        assert (np.abs(fit.solution.values - found[0].solution.values)[base] < 1e-7 * std).all()


def test_rows_in_any_order_and_blocks_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    from errormodel import kernel
    from identification.estimation.fit import anchored
    from identification.estimation.least_squares import solve
    from identification.observation.assembly import build

    machine = read_machine(THREE_AXIS)
    chain = Chain(machine)
    table = positions(measured(machine, errors(chain, 9), 500, noise=2e-3))
    problem, _ = anchored(build(chain, survey(table)), len(table))
    shuffled = np.random.default_rng(0).permutation(len(table))
    other = replace(problem, views=tuple(v.part(shuffled) for v in problem.views))
    first = solve(chain, problem.views, problem.unknowns)
    std = np.sqrt(np.diag(first.covariance))
    sizes = kernel.Kernel.blocks.__defaults__
    for size in (7, 64, 500):
        monkeypatch.setattr(kernel.Kernel.blocks, "__defaults__", (sizes[0], size, *sizes[2:]))  # type: ignore[index]
        for what in (problem, other):
            again = solve(chain, what.views, what.unknowns)
            assert (np.abs(again.values - first.values)[first.groups.base] < 1e-9 * std).all()


def test_the_linear_mode_is_plain_least_squares() -> None:
    from identification.estimation.least_squares import solve
    from identification.observation.assembly import build
    from identification.observation.normal_equations import design_rows

    machine = read_machine(FIVE_AXIS)
    chain = Chain(machine)
    table = positions(measured(machine, errors(chain, 10), 100, noise=5e-3, frame=((0, 0, 0), (0, 0, 0))))
    view = build(chain, survey(table, frame="fixed")).views[0]
    found = solve(chain, [view], chain.machine_ids, exact=False)
    place = {i: k for k, i in enumerate(chain.machine_ids)}
    m = design_rows(view, place)[:, found.groups.base]
    gap = np.concatenate([g for _, g in view.gaps(np.zeros(len(chain.ids)))], axis=1).ravel()
    scale = np.linalg.norm(m, axis=0)
    expected, square, *_ = np.linalg.lstsq(m / scale, gap, rcond=None)
    np.testing.assert_allclose(
        found.values[found.groups.base] * scale, expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )
    assert found.sigma["position"] ** 2 == pytest.approx(float(square[0]) / (300 - found.groups.rank), rel=1e-9)
    assert found.dof == 300 - found.groups.rank


def refitted(machine: Machine, full: Survey, keep: Array) -> Fit:
    return fit_machine(machine, full.rows(keep.astype(bool)))


def test_held_out_is_what_refits_would_say() -> None:
    """Ten blocks left out one by one, each predicted by a fit of the other nine."""
    machine = read_machine(THREE_AXIS)
    table = positions(measured(machine, errors(Chain(machine), 11), 60, noise=3e-3))
    full = survey(table)
    fit = fit_machine(machine, full)
    assert fit.folds == 10
    for block in np.array_split(np.arange(60), 10)[::3]:
        keep = ~np.isin(np.arange(60), block)
        out = predict(stored(refitted(machine, full, keep)), full.rows(~keep))
        expected = table.loc[block, ["mx", "my", "mz"]].to_numpy() - out[["mx", "my", "mz"]].to_numpy()
        np.testing.assert_allclose(fit.heldout_residuals[block], expected, rtol=0, atol=1e-6)
    assert fit.heldout.rms_um > fit.fitted.rms_um
