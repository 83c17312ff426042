"""`register` on wrong input: exit 2, one message that says where, what and what to write, nothing half-written."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers import crossbeam as sim
from tests.helpers.commands import run, tree

X = (np.arange(200) - 100) * 0.2
Y = np.arange(-20.0, 20.0, 1.0)
YAML = "joint: Y\npositions: [350, 550]\nlever: [-900, 0, -2051]\n"
MOUNT = "mount: {translation: [2.8, -0.9, -173.9], rotation: [0.003, -0.001, -0.009]}\n"


def cloud(seed, where=None, relief=3.0):
    rng = np.random.default_rng(100 + seed)
    return sim.scan(sim.Artefact.random(seed, relief), np.eye(4) if where is None else where, Y, X, rng=rng)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Two artefacts, cold and warm: clouds (n, 3) by folder and file."""
    warm = sim.displaced(sim.warm_up(350, 60))
    return {
        "cold/artefact_01.csv": cloud(1),
        "cold/artefact_02.csv": cloud(2),
        "warm/artefact_01.csv": cloud(1, warm),
        "warm/artefact_02.csv": cloud(2, warm),
    }


def attempt(folder, clouds, yaml=YAML + MOUNT):
    """Run on these clouds (an array, or the text of a file), and see that nothing was left behind if it failed."""
    for name, points in clouds.items():
        path = folder / name
        if isinstance(points, str):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(points)
        else:
            sim.write_csv(points, path)
    (folder / "p.yaml").write_text(yaml)
    before = tree(folder)
    arguments = (folder / "cold", folder / "warm", "--profiler", folder / "p.yaml", "--out", folder / "out" / "y.csv")
    ended = run("register", *arguments)
    if ended.code:
        assert ended.code == 2
        assert ended.err.startswith("error: ")
        assert ended.err.count("\n") == 1
        assert tree(folder) == before
        assert not (folder / "out").exists()
    return ended


def test_good(good, tmp_path):
    assert attempt(tmp_path, good).code == 0


def mirrored(good):
    return {"warm/artefact_02.csv": good["warm/artefact_02.csv"] * [1, 1, -1]}


def elsewhere(good):
    return {"warm/artefact_02.csv": good["warm/artefact_02.csv"] + [500, 0, 0]}


def few(good):
    return {"warm/artefact_02.csv": good["warm/artefact_02.csv"][:50]}


def other(good):
    return {"warm/artefact_02.csv": good["warm/artefact_01.csv"]}


def plane(good):
    flat = cloud(1, relief=0.0)
    return {"cold/artefact_01.csv": flat, "warm/artefact_01.csv": flat + np.array([0, 0, 0.02])}


def ridge(good):
    wave = good["cold/artefact_01.csv"].copy()
    rng = np.random.default_rng(1)
    wave[:, 2] = 3 * np.sin(0.3 * wave[:, 0]) + sim.NOISE * rng.standard_normal(len(wave))
    return {"cold/artefact_01.csv": wave, "warm/artefact_01.csv": wave}


def empty(good):
    return {"warm/artefact_01.csv": good["warm/artefact_01.csv"] * [1, 1, np.nan]}


def sentinels(good):
    return {"warm/artefact_01.csv": good["warm/artefact_01.csv"] * [1, 1, 0] - [0, 0, 999.9999]}


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        (mirrored, "warm/artefact_02.csv", "upside down: mirrored in z it fits"),
        (elsewhere, "warm/artefact_02.csv", "does not overlap with"),
        (few, "warm/artefact_02.csv", "50 points"),
        (other, "warm/artefact_02.csv", "is not the surface of"),
        (plane, "cold/artefact_01.csv", "no shift along x, no shift along y"),
        (ridge, "cold/artefact_01.csv", "no shift along y"),
        (empty, "warm/artefact_01.csv", "all of them invalid"),
        (sentinels, "warm/artefact_01.csv", "all of them invalid"),
    ],
)
def test_clouds(good, tmp_path, change, place, words):
    ended = attempt(tmp_path, good | change(good))
    assert f"{place}: " in ended.err
    assert words in ended.err


def test_some_sentinels_and_gaps_are_left_out(good, tmp_path):
    spoilt = good["warm/artefact_01.csv"].copy()
    spoilt[::50, 2] = -99.9999
    spoilt[7::50, 2] = np.nan
    assert attempt(tmp_path, good | {"warm/artefact_01.csv": spoilt}).code == 0


def test_missing_artefact(good, tmp_path):
    ended = attempt(tmp_path, {k: v for k, v in good.items() if k != "warm/artefact_02.csv"})
    assert "warm: no cloud artefact_02.csv" in ended.err


def test_missing_folder(good, tmp_path):
    ended = attempt(tmp_path, {k: v for k, v in good.items() if k.startswith("cold")})
    assert "warm: no such folder" in ended.err


def test_other_names(good, tmp_path):
    named = {k.replace("warm/artefact_02", "warm/artefact_03"): v for k, v in good.items()}
    assert "artefact_03.csv: no cold cloud of that name; artefact_02.csv is missing" in attempt(tmp_path, named).err


def test_twice(good, tmp_path):
    ended = attempt(tmp_path, good | {"cold/artefact_02.xyz": "1 2 3\n"})
    assert "artefact_02.csv and artefact_02.xyz: the same artefact twice" in ended.err


@pytest.mark.parametrize(
    ("yaml", "words"),
    [
        (YAML.replace("positions: [350, 550]", "positions: [350, 550, 750]") + MOUNT, "where profiler.yaml has 3"),
        (YAML.replace("[350, 550]", "[350, 350]") + MOUNT, "line 2, key positions[2]: 350 a second time"),
        (YAML.replace("lever", "levr") + MOUNT, "unknown key 'levr'. Did you mean 'lever'?"),
        (YAML + MOUNT.replace("rotation", "rotations"), "unknown key 'rotations'. Did you mean 'rotation'?"),
        (YAML, "neither 'mount' nor 'calibration'"),
        (YAML.replace("joint: Y", "joint: 3") + MOUNT, "key joint: 3"),
        (YAML.replace("-2051", "far") + MOUNT, "'far'"),
        (
            YAML + "calibration: {plane: no.csv, circle: no.csv, centre: [0, 0, 0], radius: 12.5, height: -178}",
            "key calibration.plane: no such file",
        ),
        (
            YAML + "calibration: {plane: cold/artefact_01.csv, circle: cold/artefact_02.csv, centre: [0, 0, 0], "
            "radius: 12.5, height: -178}",
            "on an edge of radius 12.5 mm",
        ),
        (YAML + MOUNT + "calibration: {plane: a, circle: b, centre: [0, 0, 0], radius: 1}", "Give one of the two"),
    ],
)
def test_profiler_yaml(good, tmp_path, yaml, words):
    assert words in attempt(tmp_path, good, yaml).err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no line of numbers"),
        ("x,y,z\n1,2,3\n1,two,3\n", "line 3: 'two' is no number"),
        ("1,2\n3,4\n", "2 columns"),
        ("x,y,z\n1,2,3\n1,2,3,4\n", "line 3: 4 columns where the lines before have 3"),
        ("x,y,height\n1,2,3\n", "no column 'z'"),
        (",".join(["0.5"] * 40) + "\n", "Write profile: {pitch: 0.0125, step: 0.1}"),
    ],
)
def test_text(good, tmp_path, text, words):
    assert words in attempt(tmp_path, good | {"cold/artefact_01.csv": text}).err


@pytest.mark.parametrize(("name", "text"), [("a.ply", "ply\nformat"), ("a.pcd", "VERSION .7\nFIELDS x y\n")])
def test_binary(tmp_path, name, text):
    clouds = {f"cold/{name}": text, f"warm/{name}": text}
    ended = attempt(tmp_path, clouds, YAML.replace(", 550", "") + MOUNT)
    assert f"cold/{name}: not readable as {name[2:].upper()}" in ended.err
