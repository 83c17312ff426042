"""Every reader of a file, with a sound file of its kind to start mutations from."""

from __future__ import annotations

import atexit
import shutil
import struct
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from errormodel.chain import Chain
from errormodel.exceptions import ErrorModelError, InputError
from errormodel.gcode.programme import Source
from errormodel.gcode.reading import Reading
from errormodel.machine_file import read_machine
from errormodel.machine_formats.base import read_description
from errormodel.raw_formats.base import Asked, format_of, open_raw
from errormodel.raw_formats.programme_poses import plain_setup
from errormodel.survey import read_survey
from errormodel.surveys.pairs import read_pairs
from errormodel.truth import read_truth
from identification.bayes.settings import read_priors
from identification.compensation.findings import findings_of
from identification.compensation.rows import read_rows
from identification.fleets.listing import read_list
from identification.planning.setup import read_setup
from identification.registration.form import read_profiler
from identification.registration.readers import read_cloud
from identification.results import manifest
from identification.results.stored_fit import read_files
from tests.helpers.raw_samples import SAMPLES
from tests.helpers.robots import joint, robot

HERE = Path(__file__).resolve().parents[1]
OLD = HERE / "contract/version_1/fit"  # a small result
MOST_S = 5.0  # s of the processor that a file of a few kB may take
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    b"end_header\n1 2 3\n4 5 6\n"
)
PCD = (
    b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n" + struct.pack("<6f", *range(6))
)
PROGRAMME = (
    b"%\nO1\nG21 G90 G94 G17\nG0 X0. Y0. Z300.\nG1 X-5. F1500.\nM98 P2 L2\nG2 X10. Y0. I6.5\nG98 G81 Z280. R290.\nX3.\n"
    b"G80\nM30\nO2\nG91\nX1.\nG90\nM99\n%\n"
)
ROBOT_FILES = {
    "urdf": robot(joint("J1", "base", "arm", "revolute", '<origin xyz="0 0 0.1" rpy="0 0 1"/><axis xyz="0 0 1"/>'),
                  joint("J2", "arm", "hand", "prismatic"), joint("J3", "hand", "tip", "fixed")).encode(),
    "dh": b"# convention: standard\njoint,type,a [mm],alpha [deg],d [mm],theta [deg],low,high\n"
          b"J1,rotary,0,90,127,0,-180,180\nJ2,prismatic,-612,0,0,0,0,90\n",
    "dh yaml": b"convention: modified\nunits: {length: mm, angle: deg}\nrows:\n"
               b"  - {joint: J1, type: rotary, a: 0, alpha: 90, d: 127, theta: 0, travel: [-180, 180]}\n",
    "ur": b"kinematics:\n" + b"".join(
        b"  %s: {x: 0, y: 0, z: 0.1, roll: 0, pitch: 0, yaw: 0}\n" % name
        for name in (b"shoulder", b"upper_arm", b"forearm", b"wrist_1", b"wrist_2", b"wrist_3")
    ) + b"  hash: calib_1\n",
}  # fmt: skip
FINDINGS = (
    b'{"schema": "errormodel.diagnosis/1", "version": "0.1.0", "findings": [{"effect": "backlash", "where": "X", '
    b'"probability": 0.9, "size_um": 5, "driver": ["dir_X"], "parameters": [{"name": "X.dx.backlash"}]}]}'
)
PLY_BINARY = PLY.split(b"1 2 3")[0].replace(b"ascii", b"binary_little_endian") + struct.pack("<6f", *range(6))


@dataclass(frozen=True)
class Reader:
    """A reader, the name that its file has, and a sound content."""

    file: str
    sound: bytes
    read: Callable[[Path], object]


@cache
def readers() -> dict[str, Reader]:
    """Readers by name."""
    machine = read_machine(OLD)
    chain = Chain(machine)
    axes = plain_setup(read_machine("vertical_three_axis"))
    rows = (OLD.parent / "expected.csv").read_bytes().replace(b"ex,ey,ez,ux,uy,uz", b"time,T_a,w_b,w_c,w_d,w_e")

    def whole(folder: Path) -> object:
        return read_files(folder.parent)

    def moves(path: Path) -> object:
        return Source.of(path.name, _text(path), Reading.of()).without_cycles(axes).steps(axes)

    known = (OLD / "fit.json").read_bytes()
    made = [
        ("machine", Reader("machine.yaml", (OLD / "machine.yaml").read_bytes(), read_machine)),
        ("survey", Reader("s.csv", rows, lambda p: read_survey(p, machine))),
        ("commands", Reader("s.txt", rows.replace(b",", b";"), lambda p: read_survey(p, machine, measured=False))),
        ("form", Reader("s.yaml", b"errormodel: 1\nfiles:\n  - {path: points.csv, role: fit}\nframe: per-run\n"
                        b"units: {length: mm, X: m}\ninstrument: {type: cmm, sigma: [1e-3, 1e-6]}\n"
                        b"budget: [{name: a, std: 0.1, acts: X}]\n",
                        lambda p: read_survey(p, machine, measured=False))),
        ("truth", Reader("t.yaml", b"parameters: {X.dx.1: 0.02}\nframe: {translation: [1, 2, 3], rotation: [0, 0, 9]}",
                         lambda p: read_truth(p, chain))),
        ("priors", Reader("p.yaml", b"errormodel: 1\npriors:\n  X.dx.1: {low: -1, high: 1}\n", read_priors)),
        ("setup", Reader("u.yaml", b"errormodel: 1\ntravels: {X: [0, 300]}\ntools: [[0, 0, -50]]\n",
                         lambda p: read_setup(p, machine))),
        ("profiler", Reader("r.yaml", b"joint: Y\npositions: [1, 2]\nlever: [0, 0, 0]\n"
                            b"mount: {translation: [0, 0, 0], rotation: [0, 0, 0]}\n", read_profiler)),
        ("cloud", Reader("c.csv", b"x,y,z\n1,2,3\n4,5,6\n", lambda p: read_cloud(p, p.name, None))),
        ("ply", Reader("c.ply", PLY, lambda p: read_cloud(p, p.name, None))),
        ("binary ply", Reader("c.ply", PLY_BINARY, lambda p: read_cloud(p, p.name, None))),
        ("pcd", Reader("c.pcd", PCD, lambda p: read_cloud(p, p.name, None))),
        ("compressed pcd", Reader("c.pcd", PCD.replace(b"DATA binary", b"DATA binary_compressed"),
                                  lambda p: read_cloud(p, p.name, None))),
        ("fit", Reader("fit.json", known, whole)),
        ("covariance", Reader("covariance.csv", (OLD / "covariance.csv").read_bytes(), whole)),
        ("residuals", Reader("residuals.csv", (OLD / "residuals.csv").read_bytes(),
                             lambda p: read_rows(p.parent, machine))),
        ("pairs", Reader("pairs.csv", b"command,first,last,from,run\n1,1,3,1,a\n2,4,4,1,b\n",
                         lambda p: read_pairs(p, p.name))),
        ("findings", Reader("diagnosis.json", FINDINGS, lambda p: findings_of(p.parent))),
        ("manifest", Reader("manifest.json", (OLD / "manifest.json").read_bytes(),
                            lambda p: manifest.check_whole(p.parent))),
        ("list", Reader("l.csv", b"machine,survey,id,type,date\na,a.csv,1,mill,2026-03-31\na,b.csv,2,mill,\n",
                        read_list)),
        ("programme", Reader("p.nc", PROGRAMME, moves)),
    ]  # fmt: skip
    made += [(f"raw {name}", _raw(content, asked)) for name, (content, asked) in SAMPLES.items()]
    made += [(f"robot {name}", Reader("r.txt", content, read_description)) for name, content in ROBOT_FILES.items()]
    return dict(made)


def _raw(content: bytes | str, asked: Asked) -> Reader:
    """A reader of raw files by whichever format recognises one."""

    def read(path: Path) -> object:
        raw = open_raw(path, path.name)
        return format_of(raw).read(raw, asked)

    return Reader("raw.txt", content.encode() if isinstance(content, str) else content, read)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except ValueError as error:  # the command says it in its own words
        raise InputError(path.name, "not UTF-8", "") from error


@cache
def _space(name: str) -> Path:
    """A folder of this process to read in: a small result, and beside it what it was made of."""
    space = tempfile.TemporaryDirectory()
    atexit.register(space.cleanup)
    folder = Path(space.name) / "fit"
    shutil.copytree(OLD, folder)
    shutil.copy(OLD.parent / "points.csv", folder)
    return folder


def tried(name: str, content: bytes) -> bool:
    """Read a content; whether it was taken. Anything but the project's own refusal is raised, slowness too."""
    reader = readers()[name]
    path = _space(name) / reader.file
    path.write_bytes(content)
    begun = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(path)
    except ErrorModelError:
        return False
    finally:
        took = time.process_time() - begun
        assert took < MOST_S, f"{took:.1f} s for {len(content)} bytes"
    return True
