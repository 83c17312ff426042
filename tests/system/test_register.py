"""Point clouds into thermal error motions: accuracy, conventions, file forms; by a simulator of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from errormodel.conventions import MOTIONS
from errormodel.machine import EffectSpec, Joint
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.compensation.volume import levels
from identification.diagnosis.linear.motions_as_points import as_points
from identification.estimation.fit import fit_machine
from identification.registration.motions import error_motions, pose
from identification.registration.register import register
from tests.helpers import crossbeam as sim
from tests.helpers.commands import done, run
from tests.helpers.point_clouds import ply

X = (np.arange(800) - 400) * 0.05  # every fourth point of a line, so that tests are quick
Y = np.arange(-20.0, 20.0, 0.5)
POSITIONS = [350.0, 1150.0]
RUNS = {"t_030min": 30, "t_180min": 180}
MOUNT = f"mount: {{translation: {list(sim.MOUNT[:3])}, rotation: {list(sim.MOUNT[3:])}}}"
CALIBRATION = "calibration: {plane: plane.csv, circle: circle.csv, centre: [0, 0, 0], radius: 12.496, height: -178.152}"
HEAD = f"joint: Y\npositions: {POSITIONS}\nlever: [-900, 0, -2051]\n"
MICRO = np.array([1e3] * 3 + [1e6] * 3)  # um, urad


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    """Folders ``cold``, ``t_030min`` and ``t_180min`` with two artefacts each, and ``profiler.yaml``."""
    folder = tmp_path_factory.mktemp("clouds")
    rng = np.random.default_rng(11)
    for k, position in enumerate(POSITIONS):
        artefact = sim.Artefact.random(k)
        for name, minutes in {"cold": 0, **RUNS}.items():
            there = sim.displaced(sim.warm_up(position, minutes))
            cloud = sim.disturbed(sim.scan(artefact, there, Y, X, rng=rng), rng)
            sim.write_csv(cloud, folder / name / f"artefact_{k + 1:02d}.csv")
    (folder / "profiler.yaml").write_text(HEAD + MOUNT)
    return folder


@pytest.fixture(scope="module")
def result(clouds):
    out = clouds / "y.csv"
    command = ["register", clouds / "cold", *(clouds / name for name in RUNS)]
    printed = done(*command, "--profiler", clouds / "profiler.yaml", "--out", out)
    return printed, pd.read_csv(out)


def truth(table):
    return np.array([sim.warm_up(r.Y, RUNS[r.run]) for r in table.itertuples()])


def test_six_motions_through_the_lever(result):
    printed, table = result
    assert list(table.columns) == [
        "joint", "Y", "run", "time", *MOTIONS, *(f"u_{m}" for m in MOTIONS), "rmse",
    ]  # fmt: skip
    assert list(table["time"]) == [1800.0, 1800.0, 10800.0, 10800.0]
    gap = table[list(MOTIONS)].to_numpy() - truth(table)
    u = table[[f"u_{m}" for m in MOTIONS]].to_numpy()
    assert np.abs(gap / u).max() < 4.0
    assert np.sqrt(np.mean((gap * MICRO) ** 2, axis=0))[:3].max() < 1.0
    assert (table["rmse"] < 0.021 / 20).all()  # the paper's average is 0.021
    assert "standard uncertainty" in printed.out


@pytest.mark.long
def test_a_survey_of_the_joint(result, clouds):
    """Its rows are read, the zero is that of the cold machine, and a thermal model of the joint is fitted to them."""
    machine = read_machine("gantry_crossbeam_ram")
    (clouds / "survey.yaml").write_text("errormodel: 1\nfiles: [{path: y.csv}]\nframe: fixed\n")
    warm_up = [EffectSpec("warm-up", {"joint": "Y", "motion": m, "degree": 1, "tau": 28 * 60.0}) for m in MOTIONS]
    bare = [replace(e, models={}) if isinstance(e, Joint) else replace(e, motions=()) for e in machine.elements]
    thermal = replace(machine, elements=tuple(bare), effects=tuple(warm_up))
    fit = fit_machine(thermal, read_survey(clouds / "survey.yaml", thermal))
    assert not any(name.startswith("zero") for name in fit.problem.unknowns)
    grown = fit.solution.named()
    middle = sum(sim.warm_up(q, 1e9)[1] for q in (350, 1150)) / 2  # of Y = 750, 900 is the middle of the travel
    slope = (sim.warm_up(1150, 1e9) - sim.warm_up(350, 1e9))[1] / 800
    assert abs(grown["Y.dy.warm-up-0"] - (middle + 150 * slope)) < 2e-3
    done("fit", "gantry_crossbeam_ram", _four_times(clouds), "--out", clouds / "fit", "--quiet")


def _four_times(clouds):
    """Rows enough for the six splines of the library's machine."""
    table = pd.read_csv(clouds / "y.csv")
    more = [table.assign(Y=table["Y"] + 70.0 * k) for k in range(8)]
    pd.concat(more).to_csv(clouds / "more.csv", index=False)
    return clouds / "more.csv"


@pytest.mark.long
def test_same_input_same_bytes(result, clouds):
    again = clouds / "again.csv"
    command = ["register", clouds / "cold", *(clouds / name for name in RUNS), "--quiet"]
    assert done(*command, "--profiler", clouds / "profiler.yaml", "--out", again).out == ""
    assert again.read_bytes() == (clouds / "y.csv").read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("stacked", [False, True], ids=["sensor's frame", "stacked along the travel"])
def test_mount_from_a_plane_and_a_pocket(clouds, stacked, tmp_path):
    rng = np.random.default_rng(5)
    sim.write_csv(sim.board(sim.MOUNT, rng, stacked, profiles=20, points=800), tmp_path / "plane.csv")
    sim.write_csv(sim.pocket(sim.MOUNT, rng, stacked), tmp_path / "circle.csv")
    (tmp_path / "p.yaml").write_text(HEAD + CALIBRATION)
    found = register(clouds / "cold", [clouds / "t_180min"], tmp_path / "p.yaml")
    gap = (found.mount.six - sim.MOUNT) / np.sqrt(np.diag(found.mount.covariance))
    assert np.abs(gap).max() < 4.0
    assert found.mount.stacked == stacked
    assert any(("alpha" if stacked else "gamma") + " of the mount cannot be seen" in n for n in found.notes)
    if not stacked:
        motions = found.table[list(MOTIONS)].to_numpy()
        u = found.table[[f"u_{m}" for m in MOTIONS]].to_numpy()
        assert np.abs((motions - truth(found.table)) / u).max() < 4.0


@pytest.mark.long
def test_mount_from_the_whole_scan_of_the_pocket(clouds, tmp_path):
    """Edges are found where profiles break: here at the floor, 3 mm below, and where nothing came back."""
    rng = np.random.default_rng(6)
    board = sim.board(sim.MOUNT, rng, profiles=700, points=1200)
    board = board[np.abs(board[:, 0]) < 16] * [2.4, 1, 1]
    x, y = np.meshgrid(np.arange(-16, 16, 0.025), np.arange(-16, 16, 0.05))
    rotation, shift = pose(np.array(sim.MOUNT))[:3, :3], np.array(sim.MOUNT[:3])
    z = (sim.HEIGHT - shift[2] - x * rotation[2, 0] - y * rotation[2, 1]) / rotation[2, 2]
    cloud = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    inside = np.hypot(*(cloud @ rotation.T + shift)[:, :2].T) < sim.RADIUS
    cloud[inside, 2] -= 3.0
    cloud[:, 2] += sim.NOISE * rng.standard_normal(len(cloud))
    cloud = cloud[~(inside & (cloud[:, 0] < -2))]
    sim.write_csv(cloud, tmp_path / "circle.csv")
    sim.write_csv(sim.board(sim.MOUNT, rng, profiles=20, points=800), tmp_path / "plane.csv")
    (tmp_path / "p.yaml").write_text(HEAD + CALIBRATION)
    found = register(clouds / "cold", [clouds / "t_180min"], tmp_path / "p.yaml").mount
    assert np.abs(found.six[:3] - sim.MOUNT[:3]).max() < 0.05  # gamma moves x and y by 0.03
    assert np.abs(found.six[3:5] - sim.MOUNT[3:5]).max() < 1e-4


def test_eq_11():
    """Its six values give what is printed, but for two elements, which are printed without a product."""
    printed = sim.PRINTED_MOUNT
    rounded = pose(np.array(sim.PRINTED_SIX))
    assert np.abs(rounded - printed)[:3, :3].max() < 5e-5  # the angles are printed to 1e-4 rad
    assert np.abs(rounded - printed)[:3, 3].max() < 1e-3
    full = pose(np.array(sim.MOUNT))  # angles to seven digits, from the elements that hold one angle each
    gap = np.abs(full - printed)[:3, :3]
    short = [(1, 0), (2, 1)]  # cos(gamma) sin(alpha) sin(beta), cos(alpha) sin(beta) sin(gamma)
    assert all(3e-6 < gap[place] < 1.3e-5 for place in short)
    gap[tuple(np.transpose(short))] = 0
    assert gap.max() < 5e-7
    assert abs(printed[0, :3] @ printed[1, :3]) > 3e-6  # no rotation: its rows are not perpendicular
    assert abs(full[0, :3] @ full[1, :3]) < 1e-15


def test_eq_3_against_the_simulator():
    rng = np.random.default_rng(2)
    for _ in range(20):
        motions = rng.uniform(-1, 1, 6) * ([0.05] * 3 + [5e-5] * 3)
        found = error_motions(sim.displaced(motions), np.array(sim.MOUNT), np.array(sim.LEVER))
        assert np.abs(found - motions)[:3].max() < 1e-9
        assert np.abs(found - motions)[3:].max() < 1e-12


def test_eq_14():
    """What a wrong mount does: true minus calculated, one sign of it mended, and a term that the print leaves out."""
    rng = np.random.default_rng(3)
    shift, turn = rng.uniform(-0.02, 0.02, 3), rng.uniform(-2e-5, 2e-5, 3)
    d_shift, d_turn = rng.uniform(-0.5, 0.5, 3), rng.uniform(-5e-3, 5e-3, 3)
    mount = np.array(sim.MOUNT) * 1e-3  # the print is for a mount and a lever that are small themselves
    displacement = pose(np.r_[shift, turn])
    (w, f, p), (da, db, dg) = turn, d_turn
    printed = np.array([
        [0, w * db + f * da, w * dg - p * da],
        [-w * db + f * da, 0, -p * db + f * dg],
        [p * da - w * dg, p * db - f * dg, 0],
    ])  # fmt: skip
    delta_t = np.cross(d_turn, shift) + np.cross(d_shift, turn)  # as printed, component by component

    def gap(lever):
        calculated = pose(error_motions(displacement, mount, lever))
        true = pose(error_motions(displacement, mount + np.r_[d_shift, d_turn], lever))
        return true - calculated

    near = gap(np.zeros(3))
    size = np.abs(printed).max()
    wrong = np.abs(near[:3, :3] - printed) > 0.1 * size
    assert wrong.sum() == 1
    assert wrong[0, 1]
    mended = printed.copy()
    mended[0, 1] = w * db - f * da  # antisymmetric, as the difference of two small rotations is
    assert np.abs(near[:3, :3] - mended).max() < 0.05 * size
    assert np.abs(near[:3, 3] - delta_t).max() < 0.05 * np.abs(delta_t).max()
    lever = np.array(sim.LEVER)  # which Eq. (13) has, and Eq. (14) lost
    lost = np.cross(lever, np.cross(d_turn, turn))
    far = gap(lever)[:3, 3]
    assert np.abs(far - delta_t - lost).max() < 0.05 * np.abs(lost).max()
    assert np.abs(lost).max() > np.abs(delta_t).max()


@pytest.mark.parametrize(
    ("name", "profile"),
    [("a.xyz", ""), ("a.ply", ""), ("a.pcd", ""), ("semicolons.csv", ""), ("names.csv", ""), ("matrix.csv", "profile")],
)
def test_file_forms(name, profile, tmp_path):
    """The same cloud in every form gives the same displacement."""
    from identification.registration.form import ProfileBlock
    from identification.registration.readers import read_cloud

    x, y = np.arange(40) * 0.05 - 1.0, np.arange(30) * 0.1
    grid = np.stack([a.ravel() for a in np.meshgrid(x, y)], axis=1)
    cloud = np.column_stack([grid, np.sin(grid[:, 0]) + 0.2 * grid[:, 1]])
    path = tmp_path / name
    block = None
    if name.endswith(".xyz"):
        np.savetxt(path, cloud, fmt="%.7f")
    elif name.endswith(".ply"):
        path.write_bytes(ply(cloud, "binary_little_endian", "double"))
    elif name.endswith(".pcd"):
        from pypcd4 import PointCloud

        PointCloud.from_xyz_points(cloud).save(path)
    elif name == "semicolons.csv":
        text = "\n".join(";".join(f"{v:.7f}".replace(".", ",") for v in p) for p in cloud)
        path.write_text("x;y;z\n" + text)
    elif name == "names.csv":
        sim.write_csv(np.column_stack([np.ones(len(cloud)), cloud[:, ::-1]]), path, "intensity,Z [mm],Y [mm],X [mm]")
    else:
        heights = cloud[:, 2].reshape(30, 40)
        heights[3, 5], heights[4, 7] = -99.9999, np.nan
        np.savetxt(path, heights, delimiter=",", fmt="%.7f")
        block = ProfileBlock(pitch=0.05, step=0.1)
        cloud = np.delete(cloud, [3 * 40 + 5, 4 * 40 + 7], axis=0)
    assert np.abs(read_cloud(path, name, block) - cloud).max() < 1e-6


def test_start_far_away_and_clouds_of_unequal_size(tmp_path):
    """1 mm and 0.3 degrees off, another density, an edge of the artefact in view with the table below."""
    rng = np.random.default_rng(9)
    artefact = sim.Artefact.random(5)
    far = sim.pose([0.6, -0.55, 0.5, *np.radians([0.2, -0.15, 0.17])])
    cold = sim.scan(artefact, np.eye(4), Y, X, rng=rng)
    warm = sim.scan(artefact, far, Y[::2], X, rng=rng)
    beside = lambda cloud: np.where(np.abs(cloud[:, :1]) < 17, cloud, cloud * [1, 1, 0] - [0, 0, 25])  # noqa: E731
    sim.write_csv(sim.disturbed(beside(cold), rng), tmp_path / "cold" / "a.csv")
    sim.write_csv(sim.disturbed(beside(warm), rng), tmp_path / "warm" / "a.csv")
    (tmp_path / "p.yaml").write_text(f"joint: Y\npositions: [350]\nlever: [0, 0, 0]\n{MOUNT}")
    found = register(tmp_path / "cold", [tmp_path / "warm"], tmp_path / "p.yaml").displacements[0]
    gap = np.linalg.inv(far) @ found.matrix
    assert np.abs(gap[:3, 3]).max() < 0.5e-3
    assert np.abs(sim.rotation_vector(gap)).max() < 4e-6


def test_times_and_labels(clouds, tmp_path):
    (tmp_path / "p.yaml").write_text(HEAD + MOUNT + "\ntimes: [1800]")
    arguments = ["register", clouds / "cold", clouds / "t_030min", clouds / "t_180min", "--out", tmp_path / "no.csv"]
    wrong = run(*arguments, "--profiler", tmp_path / "p.yaml")
    assert wrong.code == 2
    assert "1 times for 2 WARM folders" in wrong.err
    assert not (tmp_path / "no.csv").exists()


def test_error_motions_as_points_to_diagnose(tmp_path):
    """Points that the joint carries, by the machine's exact kinematics; the components show each motion once."""
    machine = read_machine("gantry_crossbeam_ram")
    motions = np.array([0.02, -0.03, 0.01, 2e-5, -1e-5, 3e-5])
    row = {"joint": "Y", "Y": 700.0, "run": "a", "time": 60.0, **dict(zip(MOTIONS, motions, strict=True))}
    u = {f"u_{m}": 1e-3 if m.startswith("d") else 1e-7 for m in MOTIONS}
    pd.DataFrame([row | u]).to_csv(tmp_path / "y.csv", index=False)
    survey = as_points(machine, read_survey(tmp_path / "y.csv", machine))
    assert (survey.frame, survey.motions_of, len(survey)) == ("fixed", "Y", 3)
    for i, point in enumerate(survey.tool):
        carried = np.r_[-900.0, 0.0, -500.0 - 1900.0] + point  # in Y's frame, with Z in the middle of its travel
        exact = np.r_[2000.0, 700.0, 3200.0] + (sim.pose(motions) @ np.r_[carried, 1.0])[:3]
        seen = np.isfinite(survey.measured[i])
        assert seen.sum() == 3 - i
        assert np.abs(survey.measured[i] - exact)[seen].max() < 1e-5
    assert np.isclose(survey.table["sigma_y"][0], np.hypot(1e-3, 1e-7 * np.hypot(900, 2551)), rtol=1e-6)


def test_one_set_of_tables_for_each_time_of_a_warm_up():
    table = pd.DataFrame({"time": np.repeat([420.0, 900.0, 1800.0], 8), "Y": np.tile(np.arange(8.0), 3)})
    assert levels(table, ["time"]) == [{"time": 420.0}, {"time": 900.0}, {"time": 1800.0}]
    assert levels(table, []) == [{}]
    assert levels(table.assign(time=np.arange(24.0)), ["time"]) == [{}]
