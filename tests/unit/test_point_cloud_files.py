"""Files of point clouds: every form of PLY and PCD, and headers that promise what the file does not hold."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from identification.registration.readers import read_cloud
from tests.helpers.commands import run, write
from tests.helpers.point_clouds import ORDERS, Array, ply

CLOUD = np.array([[0.5, -1.25, 3.0], [2.0, 0.125, -4.5], [1e3, 0.25, 7.0]])  # exact in single precision as well


def read(path: Path) -> Array:
    return read_cloud(path, path.name, None)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("kind", ["double", "float"])
@pytest.mark.parametrize("form", ORDERS)
def test_ply_in_every_form(tmp_path: Path, form: str, kind: str, end: str):
    np.testing.assert_array_equal(read(write(tmp_path / "a.ply", ply(CLOUD, form, kind, end))), CLOUD)


@settings(deadline=None, max_examples=60)
@given(
    cloud=st.lists(st.tuples(*[st.floats(-1e5, 1e5)] * 2, st.floats(-90, 90)), min_size=1, max_size=20).map(np.array),
    form=st.sampled_from(list(ORDERS)),
    faces=st.booleans(),
)
def test_ply_comes_back_to_the_last_digit(
    tmp_path_factory: pytest.TempPathFactory, cloud: Array, form: str, faces: bool
):
    path = write(tmp_path_factory.mktemp("ply") / "a.ply", ply(cloud, form, faces=faces))
    np.testing.assert_array_equal(read(path), cloud)


def test_elements_before_the_vertices_are_passed_over(tmp_path: Path):
    head = "ply\nformat {} 1.0\nelement camera 1\nproperty float f\nproperty char c\nelement vertex 2\n"
    head += "".join(f"property float {c}\n" for c in "xyz") + "end_header\n"
    text = head.format("ascii") + "0.5 1\n1 2 3\n4 5 6\n"
    binary = head.format("binary_big_endian").encode() + struct.pack(">fb6f", 0.5, 1, 1, 2, 3, 4, 5, 6)
    for content in (text, binary):
        assert read(write(tmp_path / "a.ply", content)).tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.filterwarnings("error")
def test_a_signalling_nan_is_as_missing_as_any_other(tmp_path: Path):
    content = headed(2, form="binary_little_endian").encode() + struct.pack("<2fI3f", 1, 2, 0x7FA00000, 4, 5, 6)
    assert read(write(tmp_path / "a.ply", content)).tolist() == [[4, 5, 6]]


XYZ_PLY = "property float x\nproperty float y\nproperty float z\n"


def headed(count: object, properties: str = XYZ_PLY, form: str = "ascii", before: str = "") -> str:
    return f"ply\nformat {form} 1.0\n{before}element vertex {count}\n{properties}end_header\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (headed(10**12) + "1 2 3\n", "promises 1000000000000 points, the file is too short"),
        (headed(10**12, form="binary_little_endian") + "\0" * 24, "promises 1000000000000 points, the file holds 2"),
        (headed(1, before="element face 1000000000000\nproperty int i\n") + "1 2 3\n", "the file is too short"),
        (headed(1, before=f"element a {10**12}\nproperty int i\n", form="binary_big_endian"), "the file holds 0"),
        (headed(3) + "1 2 3\n4 5 6\n\n\n\n\n\n\n\n", "promises 3 points, the file holds 2"),
        (headed(1) + "\n\n\n\n\n\n", "promises 1 points, the file holds 0"),
        (headed(1) + "1 2 3 4 5\n", "5 numbers a vertex where its header names 3"),
        (headed(2) + "1 2 3\n4 five 6\n", "not readable as PLY: could not convert string 'five'"),
        (headed(2) + "1 2 3\n4 5\n999\n", "not readable as PLY: the number of columns changed from 3 to 2"),
        (headed(0) + "", "no points"),
        (headed("1e3"), "a.ply, line 3: not readable as PLY: 'element vertex 1e3'"),
        (headed(-1), "'element vertex -1' in its header"),
        (headed(1, "property float x\nproperty float x\n"), "'property float x' in its header"),
        (headed(1, "property float x\nproperty float y\n") + "1 2\n", "no column 'z'"),
        (headed(1, "property quad x\n"), "'property quad x' in its header"),
        (headed(1, XYZ_PLY + "property list uchar int n\n") + "1 2 3 0\n", "vertex property 'n' is a list"),
        (
            headed(1, before="element face 1\nproperty list uchar int i\n", form="binary_big_endian"),
            "element 'face', whose rows differ in length, stands before the vertices",
        ),
        (headed(1).replace("vertex", "point"), "no element 'vertex'"),
        (headed(1).replace("1.0", "2.0"), "'format ascii 2.0' in its header"),
        (headed(1).replace("format ascii 1.0\n", ""), "no line 'format'"),
        (headed(1).replace("ply", "obj"), "it does not begin with 'ply'"),
        ("ply\n" + "comment x\n" * 5, "no line 'end_header'"),
        (b"ply\n" + b"\xff" * 5000, "no line 'end_header'"),
        ("", "no line 'end_header'"),
    ],
)
def test_wrong_ply(tmp_path: Path, content: str | bytes, words: str):
    with pytest.raises(InputError) as wrong:
        read(write(tmp_path / "a.ply", content))
    assert words in str(wrong.value)


def pcd(points: int, data: str, body: bytes = b"", count: str = "1 1 1") -> bytes:
    head = (
        f"# .PCD v.7\nVERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT {count}\nWIDTH {points}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
    return head.encode() + body


def packed(points: Array) -> bytes:
    """What follows the header of a compressed file: two sizes, and the columns by LZF."""
    import lzf

    raw = points.astype("<f4").T.tobytes()
    compressed = lzf.compress(raw)
    return struct.pack("<II", len(compressed), len(raw)) + compressed


MANY = np.tile(CLOUD, (50, 1))
BODIES = {
    "ascii": "".join(f"{x} {y} {z}\n" for x, y, z in MANY.tolist()).encode(),
    "binary": MANY.astype("<f4").tobytes(),
    "binary_compressed": packed(MANY),
}


@pytest.mark.parametrize("data", BODIES)
def test_pcd_in_every_form_and_cut_short(tmp_path: Path, data: str):
    whole = pcd(len(MANY), data, BODIES[data])
    np.testing.assert_array_equal(read(write(tmp_path / "a.pcd", whole)), MANY)
    for part in (0, 3, 7, 9, len(BODIES[data]) // 2, len(BODIES[data]) - 8):
        cut = whole[: len(whole) - len(BODIES[data]) + part]
        with pytest.raises(InputError):
            read(write(tmp_path / "a.pcd", cut))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (pcd(10**12, "ascii", b"1 2 3\n"), "promises 1000000000000 points, the file is too short"),
        (pcd(10**12, "binary", b"\0" * 24), "promises 1000000000000 points, the file is too short"),
        (pcd(10**12, "binary_compressed", packed(MANY)), "not readable as PCD: 1800 bytes are packed"),
        (pcd(1, "binary", b"\0" * 24, "1000000000 1 1"), "promises 1 points, the file is too short"),
        (pcd(1, "ascii", b"1 2 3\n", "1000000000 1 1"), "promises 1 points, the file is too short"),
        (
            pcd(10**8, "binary_compressed", struct.pack("<II", 16, 12 * 10**8) + b"\0" * 16),
            "promises 100000000 points, the file is too short",
        ),
        (pcd(10, "ascii", BODIES["ascii"]), "promises 10 points, the file holds 150"),
    ],
)
def test_wrong_pcd(tmp_path: Path, content: bytes, words: str):
    with pytest.raises(InputError) as wrong:
        read(write(tmp_path / "a.pcd", content))
    assert words in str(wrong.value)


@pytest.mark.parametrize("name", ["artefact_01.ply", "artefact_01.pcd"])
def test_register_ends_with_one_message(tmp_path: Path, name: str):
    content = headed(10**12).encode() if name.endswith("ply") else pcd(10**12, "binary", b"\0" * 24)
    for folder in ("cold", "warm"):
        write(tmp_path / folder / name, content)
    mount = "mount: {translation: [0, 0, -170], rotation: [0, 0, 0]}\n"
    form = write(tmp_path / "p.yaml", f"joint: Y\npositions: [350]\nlever: [0, 0, 0]\n{mount}")
    out = tmp_path / "out.csv"
    ended = run("register", tmp_path / "cold", tmp_path / "warm", "--profiler", form, "--out", out)
    assert ended.code == 2
    assert f"cold/{name}: its header promises 1000000000000 points" in ended.err
    assert ended.err.count("\n") == 1
    assert not out.exists()
